//! KITTI's files: labels, results, calibrations, splits, and the folders they lie in.
//!
//! Readers are strict: a malformed line is an error with file, line, field, what was found and what was expected. Label
//! and result files can also be read leniently, with a report of the lines left out.

pub mod calibration;
pub mod dataset;
pub mod devkit;
pub mod fields;
pub mod rows;
pub mod sizes;
pub mod split;

pub use calibration::{Calibration, CalibrationError};
pub use dataset::{FORMAT, KittiDataset, KittiError};
pub use devkit::{DevkitRow, Diagnostic, rows_as_devkit};
pub use fields::{Row, RowKind, row_from_fields};
pub use rows::{
    LineError, RowsError, Skipped, read_labels, read_results, read_rows, read_rows_lenient, text_from_labels,
    text_from_results, write_labels, write_results,
};
pub use sizes::image_size;
pub use split::{SplitError, read_split};
