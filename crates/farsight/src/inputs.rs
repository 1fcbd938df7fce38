//! From the arguments to a list of image files.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use farsight_data::has_image_extension;

/// Images, and what was wrong with arguments that gave none.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Inputs {
    /// In the order of the arguments, sorted within each, each file once.
    pub(crate) images: Vec<PathBuf>,
    /// One message for each argument without an image.
    pub(crate) problems: Vec<String>,
}

/// Finds the images that `arguments` mean: files, folders (not those within) and globs.
pub(crate) fn find(arguments: &[PathBuf]) -> Inputs {
    let mut inputs = Inputs::default();
    let mut seen = HashSet::new();
    for argument in arguments {
        match images_of(argument) {
            Ok(images) => inputs.images.extend(images.into_iter().filter(|image| seen.insert(identity(image)))),
            Err(problem) => inputs.problems.push(problem),
        }
    }
    inputs
}

fn images_of(argument: &Path) -> Result<Vec<PathBuf>, String> {
    let shown = argument.display();
    if argument.is_dir() {
        let images = folder_images(argument).map_err(|error| format!("{shown}: cannot be listed: {error}"))?;
        return if images.is_empty() {
            Err(format!("{shown}: no images in this folder; {EXPECTED}"))
        } else {
            Ok(images)
        };
    }
    let pattern = argument.to_string_lossy();
    if argument.exists() {
        return Ok(vec![argument.to_owned()]);
    }
    if !pattern.contains(['*', '?', '[']) {
        return Err(format!("{shown}: no such file or folder; expected an image, a folder of images or a pattern"));
    }
    let matches = glob::glob(&pattern).map_err(|error| format!("{shown}: no pattern: {error}"))?;
    let images: Vec<PathBuf> = matches.filter_map(Result::ok).filter(|path| is_image(path)).collect();
    if images.is_empty() { Err(format!("{shown}: matches no image; {EXPECTED}")) } else { Ok(images) }
}

/// What folders and patterns should have.
const EXPECTED: &str = "expected files ending in .png, .jpg or .jpeg";

fn folder_images(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut images = Vec::new();
    for entry in fs::read_dir(folder)? {
        images.push(entry?.path());
    }
    images.retain(|path| is_image(path));
    images.sort();
    Ok(images)
}

/// What folders and globs are searched for; a file that is named itself is read whatever it is called.
fn is_image(path: &Path) -> bool {
    has_image_extension(path) && path.is_file()
}

/// The same for all names of one file.
pub(crate) fn identity(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::{Inputs, find};

    #[test]
    fn folders_globs_and_files_give_each_image_once_and_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        fs::create_dir(root.join("within.png")).unwrap();
        for name in ["b.png", "a.JPG", "c.jpeg", "notes.txt", "photo"] {
            fs::write(root.join(name), "").unwrap();
        }
        let found = find(&[root.join("photo"), root.join("*.png"), root.to_owned(), root.join("./b.png")]);
        let images = ["photo", "b.png", "a.JPG", "c.jpeg"].map(|name| root.join(name)).to_vec();
        assert_eq!(found, Inputs { images, problems: Vec::new() });
    }

    #[test]
    fn arguments_without_images_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let found = find(&[folder.path().to_owned(), folder.path().join("*.png")]);
        assert_eq!(found.images.len(), 0);
        let shown = folder.path().display();
        let expected = [
            format!("{shown}: no images in this folder; expected files ending in .png, .jpg or .jpeg"),
            format!("{shown}/*.png: matches no image; expected files ending in .png, .jpg or .jpeg"),
        ];
        assert_eq!(found.problems, expected);
    }
}
