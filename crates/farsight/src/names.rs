//! Names of output files.

use std::collections::HashSet;
use std::path::PathBuf;

use farsight::camera_source::file_stem;

/// A name for the outputs of each image: its own without the extension, and with a number where another image has that
/// name.
///
/// Names that differ only in case count as one, because some file systems take them for one.
pub(crate) fn output_names(images: &[PathBuf]) -> Vec<String> {
    let mut taken = HashSet::new();
    images.iter().map(|image| free_name(&file_stem(image), &mut taken)).collect()
}

fn free_name(stem: &str, taken: &mut HashSet<String>) -> String {
    let mut name = stem.to_owned();
    let mut number = 1;
    while !taken.insert(name.to_lowercase()) {
        number += 1;
        name = format!("{stem}-{number}");
    }
    name
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::output_names;

    #[test]
    fn no_two_images_share_a_name() {
        let images = ["a/1.png", "b/1.png", "b/1.jpg", "a/1-2.png", "a/x.png", "a/X.png"].map(PathBuf::from);
        assert_eq!(output_names(&images), ["1", "1-2", "1-3", "1-2-2", "x", "X-2"]);
    }
}
