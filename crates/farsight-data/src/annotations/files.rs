//! Annotations in files: one a frame, called like the frame, in a folder called like the kind, beside the folder of
//! labels.

use std::io;
use std::path::{Path, PathBuf};

use farsight_files::write_quickly;
use thiserror::Error;

use super::{Annotation, Annotations};

/// A kind of annotation that is kept in text files.
pub trait FileAnnotation: Annotation + Sized {
    /// What a line of its files has, for messages.
    const EXPECTED: &'static str;

    /// The annotation in `text`; the number of the first wrong line, from 1, where there is none.
    ///
    /// # Errors
    /// When a line is malformed.
    fn from_text(text: &str) -> Result<Self, usize>;

    /// The text of its file.
    fn to_text(&self) -> String;
}

/// A file of annotations that cannot be used.
#[derive(Debug, Error)]
pub enum AnnotationError {
    /// It cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A line is malformed.
    #[error("{}:{line}: expected {expected}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// What a line has.
        expected: &'static str,
    },
}

/// How a kind of annotation is read and written.
#[derive(Debug, Clone, Copy)]
pub struct FileFormat {
    /// Name of the kind and of the folder.
    pub name: &'static str,
    read: fn(&Path, &mut Annotations) -> Result<(), AnnotationError>,
    write: fn(&Path, &Annotations) -> Result<(), AnnotationError>,
}

impl FileFormat {
    /// That of `A`.
    pub const fn of<A: FileAnnotation>() -> Self {
        Self { name: A::NAME, read: read::<A>, write: write::<A> }
    }

    /// The file of the frame called `id`; `folder` has the folder of this kind in it.
    pub fn path(&self, folder: &Path, id: &str) -> PathBuf {
        folder.join(self.name).join(format!("{id}.txt"))
    }

    /// Reads the file of the frame called `id`. A frame without a file has an annotation with nothing in it.
    ///
    /// # Errors
    /// When the file cannot be read or a line is malformed.
    pub fn read(&self, folder: &Path, id: &str, into: &mut Annotations) -> Result<(), AnnotationError> {
        (self.read)(&self.path(folder, id), into)
    }

    /// Writes the file of the frame called `id`, if it has an annotation of this kind. The file is there whole or not
    /// at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, folder: &Path, id: &str, annotations: &Annotations) -> Result<(), AnnotationError> {
        (self.write)(&self.path(folder, id), annotations)
    }
}

fn read<A: FileAnnotation>(path: &Path, into: &mut Annotations) -> Result<(), AnnotationError> {
    let text = match farsight_files::read_text(path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
        Err(source) => return Err(AnnotationError::File { path: path.to_owned(), source }),
    };
    let malformed = |line| AnnotationError::Line { path: path.to_owned(), line, expected: A::EXPECTED };
    into.insert(A::from_text(&text).map_err(malformed)?);
    Ok(())
}

fn write<A: FileAnnotation>(path: &Path, annotations: &Annotations) -> Result<(), AnnotationError> {
    let Some(annotation) = annotations.get::<A>() else { return Ok(()) };
    let text = annotation.to_text();
    write_quickly(path, |file| file.write_all(text.as_bytes()))
        .map_err(|source| AnnotationError::File { path: path.to_owned(), source: io::Error::other(source) })
}
