//! How the camera moves: KITTI's oxts, or CSV.

use std::path::{Path, PathBuf};
use std::{fs, io};

use farsight_files::read_text;
use farsight_track::EgoMotion;
use thiserror::Error;

/// Fields of a row of oxts (KITTI raw, `dataformat.txt`): velocity ahead, m/s, and turn about the axis up, rad/s.
const OXTS_FIELDS: usize = 30;
const OXTS_SPEED: usize = 8;
const OXTS_YAW_RATE: usize = 22;

/// Fields of a row of poses (KITTI odometry): a 3x4 matrix from the camera to the world, row by row.
const POSE_FIELDS: usize = 12;

/// Standard deviations of the readings: what is left when nothing moves, and a share of the reading.
const SPEED_SIGMA: [f64; 2] = [0.1, 0.01];
const YAW_RATE_SIGMA: [f64; 2] = [0.003, 0.02];

/// No reading is used for frames that are farther away in time, seconds.
const MAX_GAP_S: f64 = 0.5;

/// A file that does not tell how the camera moves.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EgoError {
    /// It cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// What is in it is not what was expected.
    #[error("{place}: {problem}")]
    Content {
        /// The file, and the line where it is one.
        place: String,
        /// What is wrong, and what was expected.
        problem: String,
    },
}

/// Ego motion of a video.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum EgoFile {
    /// Speed and yaw rate of each frame.
    Frames(Vec<[f64; 2]>),
    /// Time, speed, yaw rate; in the order of time.
    Times(Vec<[f64; 3]>),
    /// Where the camera is at each frame: x, z and the angle to the right of z, metres and radians.
    Poses(Vec<[f64; 3]>),
}

impl EgoFile {
    /// Reads rows of KITTI's oxts (a file with one row a frame, or a folder with one file a frame), poses of KITTI's
    /// odometry (12 numbers a frame, camera coordinates), or CSV with the
    /// columns `time_s`, `speed_mps` and `yaw_rate` (rad/s, to the left).
    ///
    /// # Errors
    /// When it cannot be read, or is neither.
    pub fn read(path: &Path) -> Result<Self, EgoError> {
        if path.is_dir() {
            return Self::read_folder(path);
        }
        let text = text(path)?;
        if text.lines().next().is_some_and(|line| line.contains(',')) {
            return Self::from_csv(path, &text);
        }
        let mut lines = text.lines().zip(1..).filter(|(line, _)| !line.trim().is_empty()).peekable();
        if lines.peek().is_some_and(|(line, _)| line.split_ascii_whitespace().count() == POSE_FIELDS) {
            return Ok(Self::Poses(lines.map(|(line, number)| pose(path, number, line)).collect::<Result<_, _>>()?));
        }
        let rows: Vec<[f64; 2]> = lines.map(|(line, number)| oxts(path, number, line)).collect::<Result<_, _>>()?;
        if rows.is_empty() {
            return Err(content(path, None, "empty; expected rows of oxts, poses, or CSV"));
        }
        Ok(Self::Frames(rows))
    }

    fn read_folder(folder: &Path) -> Result<Self, EgoError> {
        let data = folder.join("data");
        let folder = if data.is_dir() { &data } else { folder };
        let unread = |source| EgoError::Read { path: folder.to_owned(), source };
        let entries = fs::read_dir(folder).map_err(unread)?;
        let mut paths: Vec<PathBuf> =
            entries.map(|entry| Ok(entry?.path())).collect::<io::Result<_>>().map_err(unread)?;
        paths.retain(|path| path.extension().is_some_and(|extension| extension == "txt"));
        paths.sort();
        if paths.is_empty() {
            return Err(content(folder, None, "no .txt in this folder; expected KITTI's oxts"));
        }
        let row = |path: &PathBuf| oxts(path, 1, text(path)?.lines().next().unwrap_or_default());
        Ok(Self::Frames(paths.iter().map(row).collect::<Result<_, _>>()?))
    }

    fn from_csv(path: &Path, text: &str) -> Result<Self, EgoError> {
        let mut lines = text.lines().zip(1..).filter(|(line, _)| !line.trim().is_empty());
        let header: Vec<&str> =
            lines.next().map(|(line, _)| line.split(',').map(str::trim).collect()).unwrap_or_default();
        let mut columns = [0; 3];
        for (column, name) in columns.iter_mut().zip(["time_s", "speed_mps", "yaw_rate"]) {
            *column = header.iter().position(|known| *known == name).ok_or_else(|| {
                let problem = format!("no column {name}; expected the columns time_s, speed_mps and yaw_rate");
                content(path, Some(1), &problem)
            })?;
        }
        let mut rows: Vec<[f64; 3]> = Vec::new();
        for (line, number) in lines {
            let fields: Vec<&str> = line.split(',').collect();
            let mut row = [0.0; 3];
            for (value, &column) in row.iter_mut().zip(&columns) {
                *value = finite(path, number, column, fields.get(column).copied().unwrap_or_default())?;
            }
            if let Some([before_s, ..]) = rows.last().filter(|before| before[0] >= row[0]) {
                let problem = format!("{} s after {before_s} s; expected a later time", row[0]);
                return Err(content(path, Some(number), &problem));
            }
            rows.push(row);
        }
        if rows.is_empty() {
            return Err(content(path, None, "no rows; expected time_s, speed_mps and yaw_rate in each"));
        }
        Ok(Self::Times(rows))
    }

    /// The motion at a frame; none where the file tells nothing of that time.
    pub fn motion(&self, frame: u64, time_s: f64) -> Option<EgoMotion> {
        let [speed, yaw_rate] = match self {
            Self::Frames(rows) => *rows.get(usize::try_from(frame).ok()?)?,
            Self::Poses(rows) => {
                // Frames come evenly; the first one has no time that tells how fast.
                let frame_s = if frame > 0 && time_s > 0.0 { time_s / frame as f64 } else { return None };
                from_poses(rows, usize::try_from(frame).ok()?, frame_s)?
            }
            Self::Times(rows) => {
                let next = rows.partition_point(|row| row[0] < time_s);
                let around = [next.checked_sub(1).map(|before| rows[before]), rows.get(next).copied()];
                interpolated(around, time_s)?
            }
        };
        let sigma = |[still, share]: [f64; 2], value: f64| still + share * value.abs();
        Some(EgoMotion {
            speed_mps: speed,
            speed_sigma_mps: sigma(SPEED_SIGMA, speed),
            yaw_rate,
            yaw_rate_sigma: sigma(YAW_RATE_SIGMA, yaw_rate),
        })
    }
}

/// Speed ahead and yaw rate of a frame, by the frames before and behind it, which are `frame_s` apart.
fn from_poses(rows: &[[f64; 3]], frame: usize, frame_s: f64) -> Option<[f64; 2]> {
    let [_, _, heading] = *rows.get(frame)?;
    let (first, last) = (frame.saturating_sub(1), (frame + 1).min(rows.len() - 1));
    if first == last {
        return None;
    }
    let ([x, z, before], [new_x, new_z, after]) = (rows[first], rows[last]);
    let passed_s = (last - first) as f64 * frame_s;
    let ahead = (new_x - x) * heading.sin() + (new_z - z) * heading.cos();
    Some([ahead / passed_s, -farsight_core::wrapped_angle(after - before) / passed_s])
}

/// Speed and yaw rate between two rows, or of the one that is near.
fn interpolated(around: [Option<[f64; 3]>; 2], time_s: f64) -> Option<[f64; 2]> {
    let is_near = |row: &[f64; 3]| (row[0] - time_s).abs() <= MAX_GAP_S;
    match around {
        [Some(before), Some(after)] if is_near(&before) && is_near(&after) => {
            let share = (time_s - before[0]) / (after[0] - before[0]);
            Some([1, 2].map(|place| before[place] + share * (after[place] - before[place])))
        }
        [before, after] => {
            before.filter(is_near).or(after.filter(is_near)).map(|[_, speed, yaw_rate]| [speed, yaw_rate])
        }
    }
}

fn text(path: &Path) -> Result<String, EgoError> {
    read_text(path).map_err(|source| EgoError::Read { path: path.to_owned(), source })
}

fn content(path: &Path, line: Option<usize>, problem: &str) -> EgoError {
    let line = line.map_or_else(String::new, |line| format!(":{line}"));
    EgoError::Content { place: format!("{}{line}", path.display()), problem: problem.to_owned() }
}

fn pose(path: &Path, line: usize, text: &str) -> Result<[f64; 3], EgoError> {
    let fields: Vec<&str> = text.split_ascii_whitespace().collect();
    if fields.len() != POSE_FIELDS {
        let problem = format!("{} fields; expected the {POSE_FIELDS} of a pose", fields.len());
        return Err(content(path, Some(line), &problem));
    }
    let mut row = [0.0; POSE_FIELDS];
    for (place, value) in row.iter_mut().enumerate() {
        *value = finite(path, line, place, fields[place])?;
    }
    // The third column is the camera's axis, the fourth its place.
    Ok([row[3], row[11], row[2].atan2(row[10])])
}

fn oxts(path: &Path, line: usize, text: &str) -> Result<[f64; 2], EgoError> {
    let fields: Vec<&str> = text.split_ascii_whitespace().collect();
    if fields.len() != OXTS_FIELDS {
        let problem = format!("{} fields; expected the {OXTS_FIELDS} of KITTI's oxts, or CSV", fields.len());
        return Err(content(path, Some(line), &problem));
    }
    Ok([finite(path, line, OXTS_SPEED, fields[OXTS_SPEED])?, finite(path, line, OXTS_YAW_RATE, fields[OXTS_YAW_RATE])?])
}

fn finite(path: &Path, line: usize, column: usize, field: &str) -> Result<f64, EgoError> {
    let value = field.trim().parse().ok().filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| {
        let problem = format!("field {} is \"{field}\"; expected a finite number", column + 1);
        content(path, Some(line), &problem)
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::EgoFile;

    fn read(name: &str, text: &str) -> Result<EgoFile, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        let shown = format!("{}/", folder.path().display());
        EgoFile::read(&path).map_err(|error| error.to_string().replace(&shown, ""))
    }

    fn row(speed: f64, yaw_rate: f64) -> String {
        let field = |place: usize| match place {
            8 => speed.to_string(),
            22 => yaw_rate.to_string(),
            _ => format!("{place}.5"),
        };
        (0..30).map(field).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn oxts_go_by_frames() {
        let found = read("oxts.txt", &format!("{}\n{}\n", row(12.5, 0.1), row(13.0, -0.1))).unwrap();
        let motion = found.motion(1, 99.0).unwrap();
        assert_eq!((motion.speed_mps, motion.yaw_rate), (13.0, -0.1));
        assert_eq!(found.motion(2, 0.2), None);

        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("data")).unwrap();
        for (name, speed) in [("0000000001.txt", 2.0), ("0000000000.txt", 1.0)] {
            fs::write(folder.path().join("data").join(name), row(speed, 0.0)).unwrap();
        }
        assert_eq!(EgoFile::read(folder.path()).unwrap(), EgoFile::Frames(vec![[1.0, 0.0], [2.0, 0.0]]));
    }

    #[test]
    fn poses_give_speed_and_yaw_rate() {
        // A circle to the left: 10 m/s, 0.2 rad/s, ten frames a second.
        let row = |k: usize| {
            let angle = 0.02 * k as f64;
            let (sin, cos) = (-angle.sin(), angle.cos());
            let [x, z] = [-50.0 * (1.0 - angle.cos()), 50.0 * angle.sin()];
            format!("{cos} 0 {sin} {x} 0 1 0 0 {} 0 {cos} {z}\n", -sin)
        };
        let found = read("poses.txt", &(0..20).map(row).collect::<String>()).unwrap();
        for frame in [1, 7, 19] {
            let motion = found.motion(frame, 0.1 * frame as f64).unwrap();
            assert!((motion.speed_mps - 10.0).abs() < 0.02, "{frame}: {motion:?}");
            assert!((motion.yaw_rate - 0.2).abs() < 1e-6, "{frame}: {motion:?}");
        }
        assert_eq!([found.motion(0, 0.0), found.motion(20, 2.0)], [None; 2]);
    }

    #[test]
    fn csv_goes_by_time() {
        let found = read("ego.csv", "yaw_rate, time_s, speed_mps\n0.0,1.0,10\n0.2,1.5,12\n0.2,9,5\n").unwrap();
        let motion = |time_s| found.motion(0, time_s).map(|motion| [motion.speed_mps, motion.yaw_rate]);
        assert_eq!(motion(1.25), Some([11.0, 0.1]));
        assert_eq!(motion(0.75), Some([10.0, 0.0]));
        assert_eq!(motion(1.7), Some([12.0, 0.2]));
        assert_eq!([motion(0.2), motion(5.0), motion(10.0)], [None; 3]);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_place() {
        let table = [
            ("1 2 3\n", "e:1: 3 fields; expected the 30 of KITTI's oxts, or CSV"),
            ("", "e: empty; expected rows of oxts, poses, or CSV"),
            ("1 0 0 0 0 1 0 0 0 0 1 0\n1 0\n", "e:2: 2 fields; expected the 12 of a pose"),
            ("time_s,speed\n", "e:1: no column speed_mps; expected the columns time_s, speed_mps and yaw_rate"),
            ("time_s,speed_mps,yaw_rate\n", "e: no rows; expected time_s, speed_mps and yaw_rate in each"),
            ("time_s,speed_mps,yaw_rate\n0,fast,0\n", "e:2: field 2 is \"fast\"; expected a finite number"),
            ("time_s,speed_mps,yaw_rate\n0,1,0\n0,1,0\n", "e:3: 0 s after 0 s; expected a later time"),
        ];
        for (text, expected) in table {
            assert_eq!(read("e", text).unwrap_err(), expected);
        }
    }
}
