//! What the devkit does silently.

use farsight_core::ObjectClass;
use thiserror::Error;

use crate::kitti::fields::RowError;

/// Something about a file that the devkit accepts, or passes over, without a word.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Diagnostic {
    /// A row that ends too early, or holds a word where a number belongs.
    #[error("row dropped: field {} \"{name}\" is \"{found}\"; expected a number (a row of {expected} fields)", .fields + 1)]
    DroppedRow {
        /// How many fields were read before.
        fields: usize,
        /// The field that could not be read.
        name: &'static str,
        /// What stands there; the next row's class when fields are missing, nothing at the end of the file.
        found: String,
        /// How many fields a row has.
        expected: usize,
    },
    /// More fields than a row has, a score in a label file for instance.
    #[error("{extra} {} after the row's {expected}; the devkit reads past that", if *extra == 1 { "field" } else { "fields" })]
    ExtraFields {
        /// How many.
        extra: usize,
        /// How many a row has.
        expected: usize,
    },
    /// A row that goes on over a line end.
    #[error("a row over several lines; the devkit does not mind line ends")]
    SplitRow,
    /// A word that only begins as a number.
    #[error("field {number} \"{name}\" only begins as a number; the devkit takes \"{rest}\" for the next field")]
    PartialNumber {
        /// Position in the row, from 1.
        number: usize,
        /// Name of the column.
        name: &'static str,
        /// What is left of the word.
        rest: String,
    },
    /// An occlusion such as `0.00` in a label file.
    #[error(
        "field 3 \"occluded\" is \"{found}\"; expected a whole number (the devkit would shift every later field by one and evaluate wrong boxes)"
    )]
    FractionalOcclusion {
        /// What stands there.
        found: String,
    },
    /// NaN or an infinite number.
    #[error("field \"{name}\" is {value}; expected a finite number")]
    NotFinite {
        /// Name of the column.
        name: &'static str,
        /// The value.
        value: f64,
    },
    /// A number that no scene has.
    #[error("field \"{name}\" is {value:e}; expected metres, pixels or radians of a real scene")]
    Absurd {
        /// Name of the column.
        name: &'static str,
        /// The value.
        value: f64,
    },
    /// A value outside the range of its meaning.
    #[error("{0}")]
    OutOfRange(RowError),
    /// A class that KITTI does not have.
    #[error("class {found:?}; expected one of KITTI's (the devkit takes it for an object of no interest)")]
    UnknownClass {
        /// The name.
        found: String,
    },
    /// A class of KITTI's in another case.
    #[error("class \"{found}\"; the devkit takes it for {known}, other evaluators do not")]
    ClassInOtherCase {
        /// The name.
        found: String,
        /// The class that it counts as.
        known: ObjectClass,
    },
    /// More of this than is kept.
    #[error("{count} more like those before")]
    Untold {
        /// How many.
        count: usize,
    },
    /// Line ends of another system.
    #[error("line ends are CR LF; harmless")]
    CarriageReturn,
}

impl Diagnostic {
    /// What all diagnostics of this kind have in common, for a summary.
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::DroppedRow { .. } => "rows dropped",
            Self::ExtraFields { .. } => "rows with extra fields",
            Self::SplitRow => "rows over several lines",
            Self::PartialNumber { .. } => "numbers that go on as text",
            Self::FractionalOcclusion { .. } => "occlusion that is no whole number",
            Self::NotFinite { .. } => "numbers that are not finite",
            Self::Absurd { .. } => "absurd numbers",
            Self::OutOfRange(_) => "values out of range",
            Self::UnknownClass { .. } => "unknown classes",
            Self::ClassInOtherCase { .. } => "classes in unusual case",
            Self::Untold { .. } => "more of these",
            Self::CarriageReturn => "Windows line ends",
        }
    }

    /// Whether the devkit's reading is plainly wrong, so that no figure should be made from it: the row is left out,
    /// and the caller should stop.
    pub const fn is_fatal(&self) -> bool {
        matches!(self, Self::FractionalOcclusion { .. })
    }
}
