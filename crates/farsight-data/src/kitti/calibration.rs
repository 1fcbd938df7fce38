//! Calibration files: the matrices of one frame's sensors.

use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};

use farsight_core::Camera;
use farsight_core::camera::CameraError;
use farsight_core::road::RoadPlane;
use farsight_files::write_quickly;
use thiserror::Error;

/// A 3x4 matrix, row by row.
pub type Matrix3x4 = [[f64; 4]; 3];

/// What the rows of a calibration file are called, in KITTI's order. The last one is ours.
const NAMES: [&str; 8] = ["P0", "P1", "P2", "P3", "R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo", "road"];

/// The camera that KITTI's images, labels and results belong to: the left colour camera.
const LABELLED_CAMERA: usize = 2;

/// Row of the rectifying rotation, with nine numbers.
const RECTIFICATION: usize = 4;

/// Row of the road, with six numbers: slope, tilt and height of the camera, and their standard deviations.
const ROAD: usize = 7;

/// The calibration of one frame.
///
/// Only `P2` must be there: it alone is the camera of the images and labels. Files of other tools often hold nothing
/// else.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Projection of the left colour camera: rectified camera coordinates (metres) to pixels.
    pub p2: Matrix3x4,
    /// Projection of the left grey camera.
    pub p0: Option<Matrix3x4>,
    /// Projection of the right grey camera.
    pub p1: Option<Matrix3x4>,
    /// Projection of the right colour camera.
    pub p3: Option<Matrix3x4>,
    /// Rotation from camera 0 to rectified coordinates.
    pub r0_rect: Option<[[f64; 3]; 3]>,
    /// From the laser scanner (metres) to camera 0.
    pub tr_velo_to_cam: Option<Matrix3x4>,
    /// From the inertial unit to the laser scanner, metres.
    pub tr_imu_to_velo: Option<Matrix3x4>,
    /// The road under a fixed camera, as `farsight calibrate` finds it. KITTI's files have none.
    pub road: Option<RoadPlane>,
}

/// A calibration file that could not be read or written.
#[derive(Debug, Error)]
pub enum CalibrationError {
    /// The file cannot be opened or is no text.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The file cannot be written; the old one, if any, is still there.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A line is malformed.
    #[error("{}:{line}: {problem}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// What is wrong.
        problem: MatrixError,
    },
    /// The camera of the images is missing.
    #[error("{}: no row \"P2:\"; expected the 3x4 projection of the left colour camera", path.display())]
    NoCamera {
        /// The file.
        path: PathBuf,
    },
}

/// Why a row of a calibration file cannot be used.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MatrixError {
    /// The row has another name.
    #[error("row \"{found}\"; expected one of P0: P1: P2: P3: R0_rect: Tr_velo_to_cam: Tr_imu_to_velo: road:")]
    Name {
        /// First word of the line.
        found: String,
    },
    /// The row was there already.
    #[error("second row \"{name}:\"; expected one")]
    Twice {
        /// Name of the row.
        name: &'static str,
    },
    /// Numbers are missing or there are too many.
    #[error("row \"{name}:\" has {found} numbers; expected {expected}")]
    Count {
        /// Name of the row.
        name: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// A word is no finite number.
    #[error("row \"{name}:\", number {number} is \"{found}\"; expected a number")]
    Number {
        /// Name of the row.
        name: &'static str,
        /// Position in the row, from 1, the name not counted.
        number: usize,
        /// The word.
        found: String,
    },
    /// The projection is none that a camera can have.
    #[error("row \"P2:\": {0}")]
    Camera(#[from] CameraError),
    /// The road is none that a camera stands over.
    #[error(
        "row \"road:\": slope, tilt, height and their errors are {0:?}; expected a positive height and errors of at least 0"
    )]
    Road(Vec<f64>),
}

impl Calibration {
    /// A calibration that knows the camera of the images and nothing else.
    pub fn from_camera(camera: &Camera) -> Self {
        Self {
            p2: camera.projection,
            p0: None,
            p1: None,
            p3: None,
            r0_rect: None,
            tr_velo_to_cam: None,
            tr_imu_to_velo: None,
            road: None,
        }
    }

    /// The camera that took the images, with all four columns of its projection.
    pub fn camera(&self) -> Camera {
        Camera { projection: self.p2 }
    }

    /// Reads a calibration file.
    ///
    /// # Errors
    /// When the file cannot be read, a line is malformed, a row comes twice or there is no `P2`.
    pub fn read(path: &Path) -> Result<Self, CalibrationError> {
        let text = farsight_files::read_text(path)
            .map_err(|source| CalibrationError::Read { path: path.to_owned(), source })?;
        Self::from_text(&text, path)
    }

    /// The calibration in `text`; `path` is what errors call it. Empty lines are skipped; lines may end in CR LF.
    ///
    /// # Errors
    /// As [`Calibration::read`].
    pub fn from_text(text: &str, path: &Path) -> Result<Self, CalibrationError> {
        let mut rows: [Option<Vec<f64>>; NAMES.len()] = Default::default();
        for (line, number) in text.lines().zip(1..) {
            read_line(line, &mut rows).map_err(|problem| CalibrationError::Line {
                path: path.to_owned(),
                line: number,
                problem,
            })?;
        }
        let [p0, p1, p2, p3, r0_rect, tr_velo_to_cam, tr_imu_to_velo, road] = rows.each_ref().map(Option::as_deref);
        Ok(Self {
            p2: p2.and_then(matrix).ok_or_else(|| CalibrationError::NoCamera { path: path.to_owned() })?,
            p0: p0.and_then(matrix),
            p1: p1.and_then(matrix),
            p3: p3.and_then(matrix),
            r0_rect: r0_rect.and_then(matrix),
            tr_velo_to_cam: tr_velo_to_cam.and_then(matrix),
            tr_imu_to_velo: tr_imu_to_velo.and_then(matrix),
            road: road.and_then(plane),
        })
    }

    /// A calibration file as KITTI writes it. Reading KITTI's own files and writing them again gives the same bytes.
    pub fn to_text(&self) -> String {
        let p2 = Some(self.p2);
        let projections = [&self.p0, &self.p1, &p2, &self.p3];
        let mut text = String::new();
        for (name, rows) in NAMES.iter().zip(projections) {
            push_row(&mut text, name, rows.as_ref().map(|m| m.as_flattened()));
        }
        push_row(&mut text, NAMES[RECTIFICATION], self.r0_rect.as_ref().map(|m| m.as_flattened()));
        for (name, rows) in NAMES[RECTIFICATION + 1..ROAD].iter().zip([&self.tr_velo_to_cam, &self.tr_imu_to_velo]) {
            push_row(&mut text, name, rows.as_ref().map(|m| m.as_flattened()));
        }
        if let Some(RoadPlane { slope, tilt, height_m, sigmas: [a, b, c] }) = self.road {
            push_row(&mut text, NAMES[ROAD], Some(&[slope, tilt, height_m, a, b, c]));
        }
        // KITTI's files end in an empty line.
        text.push('\n');
        text
    }

    /// Writes a calibration file; it is there whole or not at all.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn write(&self, path: &Path) -> Result<(), CalibrationError> {
        write_quickly(path, |file| file.write_all(self.to_text().as_bytes()))
            .map_err(|error| CalibrationError::Write { path: path.to_owned(), source: error.source })
    }
}

fn read_line(line: &str, rows: &mut [Option<Vec<f64>>; NAMES.len()]) -> Result<(), MatrixError> {
    let mut words = line.split_ascii_whitespace();
    let Some(first) = words.next() else { return Ok(()) };
    let known = first.strip_suffix(':').and_then(|name| NAMES.iter().position(|&known| known == name));
    let index = known.ok_or_else(|| MatrixError::Name { found: first.to_owned() })?;
    let name = NAMES[index];

    let numbers = words.zip(1..).map(|(word, number)| {
        let value = word.parse::<f64>().ok().filter(|v| v.is_finite());
        value.ok_or_else(|| MatrixError::Number { name, number, found: word.to_owned() })
    });
    let numbers = numbers.collect::<Result<Vec<_>, _>>()?;
    let expected = match index {
        RECTIFICATION => 9,
        ROAD => 6,
        _ => 12,
    };
    if numbers.len() != expected {
        return Err(MatrixError::Count { name, found: numbers.len(), expected });
    }
    if index == LABELLED_CAMERA {
        let projection = std::array::from_fn(|row| std::array::from_fn(|column| numbers[4 * row + column]));
        Camera::from_projection(projection)?;
    }
    if index == ROAD
        && !plane(&numbers).is_some_and(|road| road.height_m > 0.0 && road.sigmas.iter().all(|s| *s >= 0.0))
    {
        return Err(MatrixError::Road(numbers));
    }
    match rows[index].replace(numbers) {
        None => Ok(()),
        Some(_) => Err(MatrixError::Twice { name }),
    }
}

/// Slope, tilt and height with their standard deviations; `None` when these are not six numbers.
fn plane(numbers: &[f64]) -> Option<RoadPlane> {
    let &[slope, tilt, height_m, a, b, c] = numbers else { return None };
    Some(RoadPlane { slope, tilt, height_m, sigmas: [a, b, c] })
}

/// Three rows of `COLUMNS` numbers; `None` when there are not that many.
fn matrix<const COLUMNS: usize>(numbers: &[f64]) -> Option<[[f64; COLUMNS]; 3]> {
    let (rows, rest) = numbers.as_chunks::<COLUMNS>();
    if rest.is_empty() { rows.try_into().ok() } else { None }
}

fn push_row(text: &mut String, name: &str, numbers: Option<&[f64]>) {
    let Some(numbers) = numbers else { return };
    text.push_str(name);
    text.push(':');
    for &number in numbers {
        push_scientific(text, number);
    }
    text.push('\n');
}

/// A blank and the number in C's `%.12e`: Rust writes `7.07e2` where C writes `7.07e+02`.
fn push_scientific(text: &mut String, number: f64) {
    let written = format!("{number:.12e}");
    let (digits, exponent) = written.split_once('e').unwrap_or((&written, "0"));
    let (sign, exponent) = exponent.strip_prefix('-').map_or(('+', exponent), |e| ('-', e));
    // Writing to a string cannot fail.
    let _ = write!(text, " {digits}e{sign}{exponent:0>2}");
}
