//! From the arguments to a list of image files.

use std::collections::BTreeMap;
use std::collections::hash_map::{Entry, HashMap};
use std::fs;
use std::path::{Path, PathBuf};

use farsight_data::{IMAGE_FORMATS, UnsupportedFormat, has_image_extension};

use crate::printer::counted;

/// Images, and what was wrong with arguments that gave none or not all.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Inputs {
    /// In the order of the arguments, sorted within each, each file once.
    pub(crate) images: Vec<PathBuf>,
    /// One message for each argument without an image, and for each kind of file that looks like an image or film and
    /// is left out.
    pub(crate) problems: Vec<String>,
}

/// Finds the images that `arguments` mean: files, folders (not those within) and globs.
pub(crate) fn find(arguments: &[PathBuf]) -> Inputs {
    let mut inputs = Inputs::default();
    // Each file with the name under which it was found first.
    let mut seen = HashMap::new();
    for argument in arguments {
        match images_of(argument) {
            Ok((images, skipped)) => {
                inputs.problems.extend(skipped);
                inputs.add(argument, images, &mut seen);
            }
            Err(problem) => inputs.problems.push(problem),
        }
    }
    inputs
}

impl Inputs {
    /// Adds the images that are not there yet. A file that is named twice is meant once; links to a file that is there
    /// are told.
    fn add(&mut self, argument: &Path, images: Vec<PathBuf>, seen: &mut HashMap<PathBuf, PathBuf>) {
        let mut links = Vec::new();
        for image in images {
            match seen.entry(identity(&image)) {
                Entry::Vacant(free) => {
                    free.insert(image.clone());
                    self.images.push(image);
                }
                Entry::Occupied(taken) if is_link(&image) || is_link(taken.get()) => {
                    links.push(format!("{} is {}", image.display(), taken.get().display()));
                }
                Entry::Occupied(_) => {}
            }
        }
        if let Some(first) = links.first() {
            let names = counted(links.len(), "name");
            let shown = argument.display();
            self.problems
                .push(format!("{shown}: {names} left out, of images that are there under another name: {first}"));
        }
    }
}

fn is_link(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_symlink())
}

/// The images that an argument means, and messages about what is left out.
fn images_of(argument: &Path) -> Result<(Vec<PathBuf>, Vec<String>), String> {
    let shown = argument.display();
    let pattern = argument.to_string_lossy();
    if ["http://", "https://", "ftp://", "s3://", "rtsp://"].iter().any(|scheme| pattern.starts_with(scheme)) {
        return Err(format!("{shown}: an address; expected a file: download it first (curl -O {shown})"));
    }
    let (paths, mut problems) = if argument.is_dir() {
        let entries = fs::read_dir(argument).map_err(|error| format!("{shown}: cannot be listed: {error}"))?;
        let (paths, errors) = apart(entries.map(|entry| entry.map(|entry| entry.path())));
        (paths, errors.into_iter().map(|error| format!("{shown}: cannot be listed: {error}")).collect::<Vec<_>>())
    } else if argument.exists() {
        return Ok((vec![argument.to_owned()], Vec::new()));
    } else if is_link(argument) {
        return Err(format!("{shown}: a link to nothing"));
    } else if pattern.contains(['*', '?', '[']) {
        let matches = glob::glob(&pattern).map_err(|error| format!("{shown}: no pattern: {error}"))?;
        let (paths, errors) = apart(matches);
        (paths, errors.into_iter().map(|error| error.to_string()).collect())
    } else {
        return Err(format!("{shown}: no such file or folder; expected an image, a folder of images or a pattern"));
    };
    let (images, skipped) = sorted_out(argument, paths);
    problems.extend(skipped);
    if images.is_empty() && problems.is_empty() {
        let found = if argument.is_dir() { "no images in this folder" } else { "matches no image" };
        return Err(format!("{shown}: {found}; expected files of {IMAGE_FORMATS}"));
    }
    Ok((images, problems))
}

fn apart<T, E>(results: impl Iterator<Item = Result<T, E>>) -> (Vec<T>, Vec<E>) {
    let (mut values, mut errors) = (Vec::new(), Vec::new());
    for result in results {
        match result {
            Ok(value) => values.push(value),
            Err(error) => errors.push(error),
        }
    }
    (values, errors)
}

/// The images among `paths`, sorted, and messages about what looks like an image or film and is none that can be read.
fn sorted_out(argument: &Path, mut paths: Vec<PathBuf>) -> (Vec<PathBuf>, Vec<String>) {
    paths.sort();
    let (mut images, mut problems) = (Vec::new(), Vec::new());
    let mut foreign: BTreeMap<UnsupportedFormat, Vec<PathBuf>> = BTreeMap::new();
    for path in paths {
        // What macOS keeps beside files on other disks.
        let is_shadow = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("._"));
        if is_shadow || path.is_dir() {
            continue;
        }
        if let Some(kind) = UnsupportedFormat::from_name(&path) {
            foreign.entry(kind).or_default().push(path);
        } else if has_image_extension(&path) {
            if path.is_file() {
                images.push(path);
            } else if is_link(&path) && !path.exists() {
                problems.push(format!("{}: a link to nothing", path.display()));
            } else {
                problems.push(format!("{}: a pipe, socket or device; expected a file with an image", path.display()));
            }
        }
    }
    for (kind, paths) in foreign {
        let first = paths[0].file_name().unwrap_or_default().to_string_lossy().into_owned();
        let files = counted(paths.len(), "file");
        problems.push(format!("{}: {files} left out, {first} is {kind}; {}", argument.display(), kind.advice()));
    }
    (images, problems)
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
        for name in ["b.png", "a.JPG", "c.jpeg", "notes.txt", "photo", "._a.JPG"] {
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
            format!("{shown}: no images in this folder; expected files of PNG, JPEG, WebP, BMP, TIFF, GIF, PPM or PGM"),
            format!("{shown}/*.png: matches no image; expected files of PNG, JPEG, WebP, BMP, TIFF, GIF, PPM or PGM"),
        ];
        assert_eq!(found.problems, expected);
    }

    #[test]
    fn what_looks_like_an_image_and_is_left_out_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        for name in ["a.webp", "b.HEIC", "c.heic", "d.mp4", "e.avif", "notes.txt", "f.gif"] {
            fs::write(root.join(name), "").unwrap();
        }
        let found = find(&[root.to_owned()]);
        assert_eq!(found.images, ["a.webp", "f.gif"].map(|name| root.join(name)));
        let shown = root.display();
        let starts = [
            format!("{shown}: 2 files left out, b.HEIC is a HEIC picture; convert it to JPEG: "),
            format!("{shown}: 1 file left out, e.avif is an AVIF picture; convert it to PNG: "),
            format!("{shown}: 1 file left out, d.mp4 is a video; take its frames out: ffmpeg "),
        ];
        assert_eq!(found.problems.len(), starts.len());
        for (problem, start) in found.problems.iter().zip(&starts) {
            assert!(problem.starts_with(start), "{problem}");
        }
        let found = find(&[root.join("*.mp4")]);
        assert_eq!((found.images.len(), found.problems.len()), (0, 1));
        let found = find(&["https://example.org/a.jpg".into()]);
        let expected = "https://example.org/a.jpg: an address; expected a file: download it first \
                        (curl -O https://example.org/a.jpg)";
        assert_eq!(found.problems, [expected]);
    }

    #[cfg(unix)]
    #[test]
    fn links_that_lead_to_the_same_image_are_told() {
        use std::os::unix::fs::symlink;

        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("links")).unwrap();
        fs::write(at("a.png"), "").unwrap();
        for name in ["links/1.png", "links/2.png", "links/3.png"] {
            symlink(at("a.png"), at(name)).unwrap();
        }
        symlink(at("gone.png"), at("links/4.png")).unwrap();
        let found = find(&[at("links")]);
        assert_eq!(found.images, [at("links/1.png")]);
        let expected = [
            format!("{}: a link to nothing", at("links/4.png").display()),
            format!(
                "{}: 2 names left out, of images that are there under another name: {} is {}",
                at("links").display(),
                at("links/2.png").display(),
                at("links/1.png").display()
            ),
        ];
        assert_eq!(found.problems, expected);
        // The same name twice is meant once.
        assert_eq!(find(&[at("a.png"), at("./a.png")]), Inputs { images: vec![at("a.png")], problems: Vec::new() });
    }
}
