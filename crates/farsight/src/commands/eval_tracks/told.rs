//! What `farsight track --json` wrote, read back.

use std::path::Path;

use anyhow::{Context, Result};
use farsight::json::{FrameRecord, TrackRecord};
use farsight_core::{Box2d, Box3d, Dimensions, ObjectClass};
use farsight_eval::tracks::{MAX_FRAMES, PredictedFrame, PredictedTrack};
use farsight_files::read_text;

/// The lines of a file by the numbers of their frames.
pub(crate) fn told(path: &Path) -> Result<Vec<Option<PredictedFrame>>> {
    let text = read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let mut frames = Vec::new();
    for (line, number) in text.lines().zip(1..).filter(|(line, _)| !line.trim().is_empty()) {
        let record: FrameRecord =
            serde_json::from_str(line).with_context(|| format!("{}:{number}: no frame of tracks", path.display()))?;
        let place = usize::try_from(record.frame).ok().filter(|place| *place < MAX_FRAMES);
        let place = place.with_context(|| {
            format!("{}:{number}: frame {}; expected one below {MAX_FRAMES}", path.display(), record.frame)
        })?;
        if frames.len() <= place {
            frames.resize(place + 1, None);
        }
        let tracks = record.tracks.iter().map(told_track).collect();
        frames[place] = Some(PredictedFrame { time_s: record.time_s, tracks });
    }
    Ok(frames)
}

fn told_track(track: &TrackRecord) -> PredictedTrack {
    let [x1, y1, x2, y2] = track.box2d;
    let [height, width, length] = track.dimensions_hwl;
    let dimensions = Dimensions { height, width, length };
    let speed = track.speed_mps.flatten().zip(track.speed_sigma_mps.flatten());
    PredictedTrack {
        id: track.id,
        class: ObjectClass::from_name(&track.class),
        box2d: Box2d::new(x1, y1, x2, y2),
        box3d: Box3d { dimensions, location: track.location, yaw: track.rotation_y },
        range_sigma_m: Some(track.range_sigma_m),
        closing_mps: track.closing_mps.zip(track.closing_sigma_mps).map(|(mps, sigma)| [mps, sigma]),
        ttc_s: track.ttc_s,
        ttc_interval_s: track.ttc_interval_s,
        speed_mps: speed.map(|(mps, sigma)| [mps, sigma]),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn frames_have_their_places_and_one_that_no_film_has_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tracks.jsonl");
        let line = |frame: usize| format!("{{\"frame\":{frame},\"time_s\":0.5,\"tracks\":[]}}\n");
        fs::write(&path, line(2)).unwrap();
        let frames = told(&path).unwrap();
        assert_eq!(frames.iter().map(Option::is_some).collect::<Vec<_>>(), [false, false, true]);
        // Sixty bytes that ask for hundreds of megabytes of empty frames.
        fs::write(&path, line(0) + &line(MAX_FRAMES)).unwrap();
        let error = told(&path).unwrap_err().to_string();
        assert!(error.ends_with("tracks.jsonl:2: frame 200000; expected one below 200000"), "{error}");
    }
}
