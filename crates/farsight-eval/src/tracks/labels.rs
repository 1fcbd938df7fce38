//! Label files of KITTI's tracking benchmark, and the velocities that rendered sequences have beside them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use farsight_core::ObjectClass;
use farsight_data::kitti::{RowKind, row_from_fields};
use farsight_files::read_text;
use thiserror::Error;

use super::{GroundTruthFrame, GroundTruthTrack};

/// A sequence whose truth cannot be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TrackLabelError {
    /// A file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A row of labels is wrong.
    #[error("{}:{line}: {problem}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong.
        problem: String,
    },
    /// A field that is no number of the kind that was expected.
    #[error("{}:{line}: field {field} is \"{found}\"; expected {expected}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The field, from 1.
        field: usize,
        /// What is there.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
}

/// No sequence is longer: more than two hours at 25 frames a second. Every frame up to the last takes memory, whether
/// there is a row for it or not.
pub const MAX_FRAMES: usize = 200_000;

/// The frames of a label file, and their velocities from a file with the columns `frame`, `time_s`, `id`, `vx_mps`,
/// `vy_mps`, `vz_mps` and `speed_mps`, if there is one. Frames without a row are empty.
///
/// # Errors
/// When a file cannot be read, or at its first malformed line.
pub fn read_sequence(labels: &Path, velocities: Option<&Path>) -> Result<Vec<GroundTruthFrame>, TrackLabelError> {
    let mut frames: Vec<GroundTruthFrame> = Vec::new();
    for (line, number) in text(labels)?.lines().zip(1..).filter(|(line, _)| !line.trim().is_empty()) {
        let fields: Vec<&str> = line.split_ascii_whitespace().collect();
        let frame = whole(labels, number, 0, &fields, FRAME)?;
        let id = field(labels, number, 1, &fields, "an identity", |text| text.parse::<i64>().ok())?;
        let row = row_from_fields(fields.get(2..).unwrap_or_default(), RowKind::Label).map_err(|error| {
            TrackLabelError::Row { path: labels.to_owned(), line: number, problem: error.to_string() }
        })?;
        if frames.len() <= frame {
            frames.resize_with(frame + 1, GroundTruthFrame::default);
        }
        match u64::try_from(id) {
            Ok(id) if row.label.class != ObjectClass::DontCare => {
                frames[frame].tracks.push(GroundTruthTrack {
                    id,
                    label: row.label,
                    velocity_mps: None,
                    speed_mps: None,
                });
            }
            _ => frames[frame].dont_care.push(row.label.box2d),
        }
    }
    if let Some(path) = velocities {
        let mut known = BTreeMap::new();
        let text = text(path)?;
        for (line, number) in text.lines().zip(1..).skip(1).filter(|(line, _)| !line.trim().is_empty()) {
            let fields: Vec<&str> = line.split(',').collect();
            let frame = whole(path, number, 0, &fields, FRAME)?;
            let id = field(path, number, 2, &fields, "an identity", |text| text.parse::<u64>().ok())?;
            let finite = |text: &str| text.trim().parse::<f64>().ok().filter(|value| value.is_finite());
            let mut values = [0.0; 4];
            for (value, place) in values.iter_mut().zip(3..) {
                *value = field(path, number, place, &fields, "a finite number", finite)?;
            }
            known.insert((frame, id), values);
        }
        for (number, frame) in frames.iter_mut().enumerate() {
            for track in &mut frame.tracks {
                if let Some([x, y, z, speed]) = known.get(&(number, track.id)) {
                    (track.velocity_mps, track.speed_mps) = (Some([*x, *y, *z]), Some(*speed));
                }
            }
        }
    }
    Ok(frames)
}

const FRAME: &str = "the number of a frame, below 200000";

fn text(path: &Path) -> Result<String, TrackLabelError> {
    read_text(path).map_err(|source| TrackLabelError::Read { path: path.to_owned(), source })
}

fn whole(
    path: &Path,
    line: usize,
    place: usize,
    fields: &[&str],
    expected: &'static str,
) -> Result<usize, TrackLabelError> {
    field(path, line, place, fields, expected, |text| text.parse().ok().filter(|number| *number < MAX_FRAMES))
}

fn field<T>(
    path: &Path,
    line: usize,
    place: usize,
    fields: &[&str],
    expected: &'static str,
    read: impl Fn(&str) -> Option<T>,
) -> Result<T, TrackLabelError> {
    let found = fields.get(place).copied().unwrap_or_default();
    read(found).ok_or_else(|| TrackLabelError::Field {
        path: path.to_owned(),
        line,
        field: place + 1,
        found: found.to_owned(),
        expected,
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::{FRAME, MAX_FRAMES, read_sequence};

    const CAR: &str = "Car 0 0 -1.5 600 170 700 230 1.5 1.6 4.0 1.0 1.7 20.0 -1.57";

    #[test]
    fn rows_go_to_their_frames_and_velocities_to_their_rows() {
        let folder = tempfile::tempdir().unwrap();
        let [labels, velocities] = ["a.txt", "a.csv"].map(|name| folder.path().join(name));
        let dont_care = "1 -1 DontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10";
        fs::write(&labels, format!("0 7 {CAR}\n2 7 {CAR}\n{dont_care}\n")).unwrap();
        fs::write(&velocities, "frame,time_s,id,vx_mps,vy_mps,vz_mps,speed_mps\n2,0.2,7,0.5,0,-3,9\n").unwrap();
        let frames = read_sequence(&labels, Some(&velocities)).unwrap();
        let counts: Vec<_> = frames.iter().map(|frame| (frame.tracks.len(), frame.dont_care.len())).collect();
        assert_eq!(counts, [(1, 0), (0, 1), (1, 0)]);
        assert_eq!(frames[0].tracks[0].velocity_mps, None);
        assert_eq!(
            (frames[2].tracks[0].velocity_mps, frames[2].tracks[0].speed_mps),
            (Some([0.5, 0.0, -3.0]), Some(9.0))
        );
    }

    #[test]
    fn the_limit_that_is_told_is_the_limit() {
        assert_eq!(FRAME, format!("the number of a frame, below {MAX_FRAMES}"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, format!("{} 7 {CAR}\n", MAX_FRAMES - 1)).unwrap();
        assert_eq!(read_sequence(&path, None).unwrap().len(), MAX_FRAMES);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        for (text, expected) in [
            (format!("0 7 {CAR}\nx 7 {CAR}\n"), ":2: field 1 is \"x\"; expected the number of a frame, below 200000"),
            // A hundred bytes that ask for half a gigabyte of empty frames.
            (format!("9999999 7 {CAR}\n"), ":1: field 1 is \"9999999\"; expected the number of a frame, below 200000"),
            (format!("0 7.5 {CAR}\n"), ":1: field 2 is \"7.5\"; expected an identity"),
            ("0 7 Car 0 0\n".to_owned(), ":1: "),
        ] {
            fs::write(&path, text).unwrap();
            let told = read_sequence(&path, None).unwrap_err().to_string();
            assert!(told.contains(expected), "{told}");
        }
    }
}
