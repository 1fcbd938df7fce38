//! What a data set may know of a frame beside its camera and labels: number plates, depth of every pixel.
//!
//! An annotation is a type. A [`Frame`](crate::Frame) holds any of them in its [`Annotations`], and nobody but who
//! makes and who uses a kind knows of it. Kinds that are kept in files are listed in [`FILE_FORMATS`]; a new kind is
//! one file here and, if it has files, one line there.

mod depth_map;
mod files;
mod plates;

use std::any::Any;
use std::collections::BTreeMap;
use std::fmt::{self, Debug};
use std::sync::Arc;

pub use depth_map::DepthMap;
pub use files::{AnnotationError, FileAnnotation, FileFormat};
pub use plates::{Plate, Plates};

/// The kinds of annotations that data sets in KITTI's layout may keep in files.
pub const FILE_FORMATS: [FileFormat; 1] = [FileFormat::of::<Plates>()];

/// A kind of annotation.
pub trait Annotation: Any + Debug + PartialEq + Send + Sync {
    /// Its name; files of this kind lie in a folder called so.
    const NAME: &'static str;
}

/// An annotation whose type is known only at run time.
trait AnyAnnotation: Any + Debug + Send + Sync {
    fn is_equal(&self, other: &dyn AnyAnnotation) -> bool;
}

impl<A: Annotation> AnyAnnotation for A {
    fn is_equal(&self, other: &dyn AnyAnnotation) -> bool {
        (other as &dyn Any).downcast_ref::<A>() == Some(self)
    }
}

/// The annotations of one frame, at most one of each kind. A clone shares them.
#[derive(Clone, Default)]
pub struct Annotations(BTreeMap<&'static str, Arc<dyn AnyAnnotation>>);

impl Annotations {
    /// Adds an annotation, in place of another of its kind.
    pub fn insert<A: Annotation>(&mut self, annotation: A) {
        self.0.insert(A::NAME, Arc::new(annotation));
    }

    /// The annotation of this kind, if the frame has one.
    pub fn get<A: Annotation>(&self) -> Option<&A> {
        let found = self.0.get(A::NAME)?.as_ref();
        (found as &dyn Any).downcast_ref()
    }

    /// Names of the kinds that there are, sorted.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        self.0.keys().copied()
    }
}

impl Debug for Annotations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_map().entries(&self.0).finish()
    }
}

impl PartialEq for Annotations {
    fn eq(&self, other: &Self) -> bool {
        let is_equal = |((a_name, a), (b_name, b)): ((&&str, &Arc<_>), (&&str, &Arc<_>))| {
            let (a, b): (&Arc<dyn AnyAnnotation>, &Arc<dyn AnyAnnotation>) = (a, b);
            a_name == b_name && a.as_ref().is_equal(b.as_ref())
        };
        self.0.len() == other.0.len() && self.0.iter().zip(&other.0).all(is_equal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq)]
    struct Weather(&'static str);

    impl Annotation for Weather {
        const NAME: &'static str = "weather";
    }

    #[test]
    fn each_kind_is_there_once_and_equality_looks_inside() {
        let mut annotations = Annotations::default();
        assert_eq!(annotations.get::<Weather>(), None);
        annotations.insert(Weather("rain"));
        let shared = annotations.clone();
        assert_eq!(shared, annotations);
        annotations.insert(Weather("fog"));
        assert_ne!(shared, annotations);
        assert_eq!((shared.get(), annotations.get()), (Some(&Weather("rain")), Some(&Weather("fog"))));
        annotations.insert(Plates::default());
        assert_eq!(annotations.names().collect::<Vec<_>>(), ["plates", "weather"]);
        assert_eq!(annotations.get::<Plates>(), Some(&Plates::default()));
        assert_eq!(annotations.get::<DepthMap>(), None);
    }
}
