//! An annotated film, written by the user's ffmpeg.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::{self, JoinHandle};

use anyhow::{Context, Result, anyhow, bail, ensure};
use farsight::RgbImage;
use farsight::video::unstarted;
use farsight_files::Scratch;
use image::imageops::{FilterType, resize};

/// How names of films end, and what ffmpeg calls such files.
pub(super) const FORMATS: [(&str, &str); 5] =
    [("mp4", "mp4"), ("mkv", "matroska"), ("mov", "mov"), ("avi", "avi"), ("webm", "webm")];

/// What ffmpeg calls the kind of film that `path` is named as; none of other names.
pub(super) fn format(path: &Path) -> Option<&'static str> {
    let extension = path.extension()?.to_string_lossy().to_lowercase();
    FORMATS.iter().find(|(name, _)| *name == extension).map(|(_, format)| *format)
}

/// Where nothing tells how many frames a second there are.
const USUAL_FPS: f64 = 25.0;

/// Videos with odd clocks claim more frames a second; no screen shows them.
const MAX_FPS: f64 = 120.0;

/// A gap in time is shown for at most so long, seconds.
const MAX_STILL_S: f64 = 10.0;

/// What ffmpeg says, and ends with 0, when what it kept in memory could not be written at the end.
const UNCLOSED: &str = "Error closing file";

/// A film that grows beside its target, and takes its place when it is whole.
pub(super) struct Film {
    target: PathBuf,
    format: &'static str,
    ffmpeg: PathBuf,
    encoder: Option<String>,
    run: Option<Run>,
}

struct Run {
    child: Child,
    log: JoinHandle<String>,
    scratch: Scratch,
    size: [u32; 2],
    fps: f64,
    begin_s: f64,
    written: u64,
}

impl Film {
    pub(super) fn new(target: &Path, format: &'static str, ffmpeg: &Path, encoder: Option<&str>) -> Self {
        let (target, ffmpeg, encoder) = (target.to_owned(), ffmpeg.to_owned(), encoder.map(str::to_owned));
        Self { target, format, ffmpeg, encoder, run: None }
    }

    /// Adds the picture of a time, as often as the film's rate asks for.
    pub(super) fn add(&mut self, time_s: f64, picture: &RgbImage, fps: Option<f64>) -> Result<()> {
        let size = [picture.width(), picture.height()];
        let mut run = match self.run.take() {
            Some(run) => run,
            None => self.start(size, fps.unwrap_or(USUAL_FPS).min(MAX_FPS), time_s)?,
        };
        let place = ((time_s - run.begin_s) * run.fps).round().max(0.0) as u64 + 1;
        let times = place.saturating_sub(run.written).min((MAX_STILL_S * run.fps).ceil() as u64);
        let resized = (run.size != size).then(|| resize(picture, run.size[0], run.size[1], FilterType::Triangle));
        let pixels = resized.as_ref().unwrap_or(picture).as_raw();
        for _ in 0..times {
            let sent = run.child.stdin.as_mut().map(|pipe| pipe.write_all(pixels));
            if !matches!(sent, Some(Ok(()))) {
                return Err(self.failed(run));
            }
        }
        run.written = place.max(run.written);
        self.run = Some(run);
        Ok(())
    }

    fn start(&self, size: [u32; 2], fps: f64, begin_s: f64) -> Result<Run> {
        // ffmpeg opens the file by its name.
        let (scratch, _) = Scratch::file(&self.target).with_context(|| self.unwritable())?;
        let [width, height] = size;
        let mut command = Command::new(&self.ffmpeg);
        // Without -xerror, ffmpeg 5 ends with 0 although the disk is full.
        command.args(["-nostdin", "-hide_banner", "-xerror", "-loglevel", "error", "-y"]);
        command.args(["-f", "rawvideo", "-pix_fmt", "rgb24"]);
        command.args(["-video_size", &format!("{width}x{height}"), "-framerate", &fps.to_string(), "-i", "pipe:0"]);
        // Most codecs want even sides.
        command.args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"]);
        if let Some(encoder) = &self.encoder {
            command.args(["-c:v", encoder]);
        }
        // The name of a scratch file tells no format.
        command.args(["-f", self.format]).arg(scratch.path());
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|error| unstarted(&self.ffmpeg, error))?;
        let errors = child.stderr.take();
        let log = thread::spawn(move || {
            let mut bytes = Vec::new();
            // What cannot be read is not told.
            let _ = errors.map(|mut errors| errors.read_to_end(&mut bytes));
            String::from_utf8_lossy(&bytes).trim().replace('\n', "; ")
        });
        Ok(Run { child, log, scratch, size, fps, begin_s, written: 0 })
    }

    /// What there is to tell of an ffmpeg that could not write.
    fn failed(&self, run: Run) -> anyhow::Error {
        match self.ended(run) {
            Ok(_) => anyhow!("{}: could not be written: ffmpeg takes no more pictures", self.target.display()),
            Err(error) => error,
        }
    }

    /// Waits for the end of ffmpeg; the film beside its target, if it is whole.
    fn ended(&self, mut run: Run) -> Result<Scratch> {
        drop(run.child.stdin.take());
        let status = run.child.wait().with_context(|| format!("{}: ffmpeg was lost", self.target.display()))?;
        let told = run.log.join().unwrap_or_default();
        let is_whole = status.success() && !told.contains(UNCLOSED);
        ensure!(is_whole, "{}: could not be written: ffmpeg ended with {status}: {told}", self.target.display());
        Ok(run.scratch)
    }

    /// Ends the film and puts it into its place.
    pub(super) fn finish(mut self) -> Result<()> {
        let Some(run) = self.run.take() else {
            bail!("{}: no frame to write", self.target.display());
        };
        self.ended(run)?.persist().with_context(|| self.unwritable())
    }

    fn unwritable(&self) -> String {
        format!("{}: cannot be written", self.target.display())
    }
}
