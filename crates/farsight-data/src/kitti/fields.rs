//! The fields of a KITTI row: one parser for labels, results and the evaluator.

use farsight_core::{Box2d, Box3d, Detection, Dimensions, Label, ObjectClass};
use thiserror::Error;

/// Names of the columns, in file order. Field numbers in messages are positions in this list, from 1.
pub const COLUMNS: [&str; 16] = [
    "type",
    "truncated",
    "occluded",
    "alpha",
    "left",
    "top",
    "right",
    "bottom",
    "height",
    "width",
    "length",
    "x",
    "y",
    "z",
    "rotation_y",
    "score",
];

/// What a dimension holds when the row has no 3D box.
const NO_DIMENSION: f64 = -1.0;

/// The two kinds of rows that KITTI has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RowKind {
    /// Ground truth: 15 columns, the occlusion a whole number.
    Label,
    /// A detection: 16 columns, the last one its score; truncation and occlusion are read and mean nothing.
    Result,
}

impl RowKind {
    /// Number of fields in a row.
    pub const fn columns(self) -> usize {
        match self {
            Self::Label => 15,
            Self::Result => 16,
        }
    }
}

/// One row: what a label holds and, in result files, a score.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The 15 columns that labels and results share; alpha is as written, not computed.
    pub label: Label,
    /// The 16th column of a result.
    pub score: Option<f64>,
}

impl Row {
    /// The row with these numbers, in the order of [`COLUMNS`] (the first is not looked at).
    pub(super) fn from_numbers(class: ObjectClass, numbers: &[f64; COLUMNS.len()], kind: RowKind) -> Self {
        let [_, truncation, occlusion, alpha, x1, y1, x2, y2, height, width, length, x, y, z, yaw, score] = *numbers;
        let box3d = Box3d { dimensions: Dimensions { height, width, length }, location: [x, y, z], yaw };
        let label =
            Label { class, truncation, occlusion: occlusion as i32, alpha, box2d: Box2d::new(x1, y1, x2, y2), box3d };
        Self { label, score: (kind == RowKind::Result).then_some(score) }
    }

    /// The numbers that are evaluated, with the names of their columns.
    pub(super) fn numbers(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let Label { truncation, alpha, box2d, box3d, .. } = &self.label;
        let Dimensions { height, width, length } = box3d.dimensions;
        let [x, y, z] = box3d.location;
        let scene = [height, width, length, x, y, z, box3d.yaw];
        let image = [*alpha, box2d.x1, box2d.y1, box2d.x2, box2d.y2];
        let names = COLUMNS[3..].iter().chain(&COLUMNS[1..2]).copied();
        names.zip(image.into_iter().chain(scene).chain([self.score.unwrap_or(0.0), *truncation]))
    }

    /// The row as a detection; a row without a score has score 1. The written alpha is dropped, a detection computes
    /// its own.
    pub fn into_detection(self) -> Detection {
        let Label { class, box2d, box3d, .. } = self.label;
        Detection { class, score: self.score.unwrap_or(1.0), box2d, box3d, range_sigma_m: None }
    }
}

/// Why a row cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum RowError {
    /// Fields are missing or there are too many.
    #[error("{found} {}; expected {expected}", if *found == 1 { "field" } else { "fields" })]
    Columns {
        /// How many the row has.
        found: usize,
        /// How many a row of its kind has.
        expected: usize,
    },
    /// A field does not hold what belongs there.
    #[error("field {number} \"{name}\" is \"{found}\"; expected {expected}")]
    Field {
        /// Position in the row, from 1.
        number: usize,
        /// Name of the column.
        name: &'static str,
        /// What the row says.
        found: String,
        /// What belongs there.
        expected: &'static str,
    },
}

/// Reads one row from its `fields` (the words of the line, without white space).
///
/// # Errors
/// When the number of fields is not that of `kind`, a field is no finite number, or a value is not in the range of its
/// meaning.
pub fn row_from_fields(fields: &[&str], kind: RowKind) -> Result<Row, RowError> {
    let (row, problem) = row_and_problem(fields, kind)?;
    problem.map_or(Ok(row), Err)
}

/// The error bar of the distance, metres, in the 17th column of a result.
pub(super) fn sigma_from_field(field: &str) -> Result<f64, RowError> {
    let sigma = field.parse().ok().filter(|sigma: &f64| sigma.is_finite() && *sigma >= 0.0);
    sigma.ok_or_else(|| RowError::Field {
        number: RowKind::Result.columns() + 1,
        name: "range_sigma_m",
        found: field.to_owned(),
        expected: "the error bar of the distance, metres, or nothing",
    })
}

/// The row, and the first value in it that is out of its range.
pub(super) fn row_and_problem(fields: &[&str], kind: RowKind) -> Result<(Row, Option<RowError>), RowError> {
    if fields.len() != kind.columns() {
        return Err(RowError::Columns { found: fields.len(), expected: kind.columns() });
    }
    let fields = Fields(fields);
    let row = fields.row(kind)?;
    let problem = fields.check_ranges(&row, kind).err();
    Ok((row, problem))
}

/// The words of one row; the right number of them.
#[derive(Clone, Copy)]
struct Fields<'a>(&'a [&'a str]);

impl Fields<'_> {
    fn row(self, kind: RowKind) -> Result<Row, RowError> {
        let class = self.class()?;
        let mut numbers = [0.0; COLUMNS.len()];
        for (index, number) in numbers.iter_mut().enumerate().take(kind.columns()).skip(1) {
            *number = self.number(index)?;
        }
        self.require_whole_occlusion(kind)?;
        Ok(Row::from_numbers(class, &numbers, kind))
    }

    fn error(self, index: usize, expected: &'static str) -> RowError {
        RowError::Field { number: index + 1, name: COLUMNS[index], found: self.0[index].to_owned(), expected }
    }

    fn require(self, holds: bool, index: usize, expected: &'static str) -> Result<(), RowError> {
        if holds { Ok(()) } else { Err(self.error(index, expected)) }
    }

    /// A byte order mark or a row that starts with a number would otherwise pass as a class of its own.
    fn class(self) -> Result<ObjectClass, RowError> {
        let name = self.0[0];
        self.require(name.starts_with(|c: char| c.is_ascii_alphabetic()), 0, "the name of a class")?;
        Ok(ObjectClass::from_name(name))
    }

    fn number(self, index: usize) -> Result<f64, RowError> {
        let number = self.0[index].parse::<f64>().ok().filter(|v| v.is_finite());
        number.ok_or_else(|| self.error(index, "a number"))
    }

    /// The devkit reads the occlusion of results as a real number and forgets it; in labels `0.00` would shift its
    /// whole row.
    fn require_whole_occlusion(self, kind: RowKind) -> Result<(), RowError> {
        self.require(kind == RowKind::Result || self.0[2].parse::<i32>().is_ok(), 2, "a whole number")
    }

    fn check_ranges(self, row: &Row, kind: RowKind) -> Result<(), RowError> {
        let Label { class, truncation, occlusion, box2d, box3d, .. } = &row.label;
        let unlabelled = *class == ObjectClass::DontCare;
        if kind == RowKind::Label {
            let least = if unlabelled { -1.0 } else { 0.0 };
            self.require((least..=1.0).contains(truncation), 1, "a share from 0 to 1 (-1 for DontCare)")?;
            self.require((-1..=3).contains(occlusion), 2, "a whole number from -1 to 3")?;
        }
        self.require(box2d.x1 <= box2d.x2, 6, "a right edge not left of the left one")?;
        self.require(box2d.y1 <= box2d.y2, 7, "a bottom edge not above the top one")?;
        let Dimensions { height, width, length } = box3d.dimensions;
        let dimensions = [height, width, length];
        // Results of 2D detectors say -1 three times.
        let no_box3d = kind == RowKind::Result && dimensions == [NO_DIMENSION; 3];
        if unlabelled || no_box3d {
            return Ok(());
        }
        (8..).zip(dimensions).try_for_each(|(i, v)| self.require(v > 0.0, i, "a positive number of metres"))
    }
}
