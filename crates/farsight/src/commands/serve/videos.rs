//! Films and cameras that the service shows.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, bail};
use farsight::service::{SourceFrame, SourceFrames, Video, VideoFailure};
use farsight::video::{DEFAULT_LOW_SCORE, VideoOptions, VideoSource, VideoTracker};
use farsight::{Pipeline, PipelineBuilder, ViewSource};

use super::ServeArgs;

/// The videos by their names. They have a pipeline of their own, which tells detections of low scores, too: those
/// continue tracks.
pub(super) fn open(
    args: &ServeArgs,
    builder: &PipelineBuilder,
    cameras: &BTreeMap<String, ViewSource>,
) -> Result<BTreeMap<String, Arc<dyn Video>>> {
    let mut videos: BTreeMap<String, Arc<dyn Video>> = BTreeMap::new();
    if args.videos.is_empty() {
        return Ok(videos);
    }
    let pipeline = builder.clone().low_score(DEFAULT_LOW_SCORE).open()?;
    for (name, input) in &args.videos {
        let Some(camera) = cameras.get(name) else { continue };
        let source = Source {
            input: input.clone(),
            camera: camera.clone(),
            ffmpeg: args.ffmpeg.clone(),
            pipeline: pipeline.clone(),
        };
        if videos.insert(name.clone(), Arc::new(source)).is_some() {
            bail!("--video {name}: named twice; expected another name");
        }
    }
    Ok(videos)
}

/// A video with its camera.
struct Source {
    input: PathBuf,
    camera: ViewSource,
    ffmpeg: PathBuf,
    pipeline: Pipeline,
}

impl Video for Source {
    fn open(&self) -> Result<SourceFrames, VideoFailure> {
        let mut tracker = VideoTracker::new(self.pipeline.clone(), self.camera.clone());
        // Of a film every frame is looked at; a camera does not wait.
        let options =
            VideoOptions { ffmpeg: self.ffmpeg.clone(), realtime: is_live(&self.input), ..VideoOptions::default() };
        let frames = VideoSource::open(&self.input, None)?.frames(&options)?;
        Ok(Box::new(frames.map(move |frame| {
            let frame = frame?;
            let followed = tracker.update(&frame)?;
            let detections = followed.detections();
            Ok(SourceFrame { record: followed.record, detections, view: followed.view, image: frame.image })
        })))
    }
}

/// Whether its frames come when they are taken.
fn is_live(input: &Path) -> bool {
    !input.is_file()
}

impl fmt::Debug for Source {
    /// Not the address: there may be a password in it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Source")
    }
}
