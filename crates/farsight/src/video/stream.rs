//! A live stream that may stall: it is opened again, and its times go on.

use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use super::error::VideoError;
use super::ffmpeg::{Decoded, Decoder};

/// A stream is opened again so often in a row without a frame, with so long a pause before.
const MAX_TRIES: u32 = 20;
const PAUSE: Duration = Duration::from_millis(500);

/// Frames of a film, or of a stream that is opened again when it stalls or breaks off.
pub(super) struct Stream {
    ffmpeg: PathBuf,
    decoder: Decoder,
    /// Of a live stream: no frame for so long is a stall.
    patience: Option<Duration>,
    next: u64,
    /// Time of the last frame, and when it came.
    last: Option<(f64, Instant)>,
    /// What is added to the times of the decoder.
    offset_s: f64,
    is_fresh: bool,
    tries: u32,
    is_over: bool,
}

impl Stream {
    /// Starts to read; with `patience` as a live stream.
    pub(super) fn start(ffmpeg: &Path, video: &Path, patience: Option<Duration>) -> Result<Self, VideoError> {
        Ok(Self {
            ffmpeg: ffmpeg.to_owned(),
            decoder: Decoder::start(ffmpeg, video)?,
            patience,
            next: 0,
            last: None,
            offset_s: 0.0,
            is_fresh: false,
            tries: 0,
            is_over: false,
        })
    }

    pub(super) fn path(&self) -> &Path {
        self.decoder.path()
    }

    pub(super) fn fps(&self) -> Option<f64> {
        self.decoder.fps()
    }

    /// The next frame. After the error of a live stream there may be more.
    pub(super) fn next(&mut self) -> Option<Result<Decoded, VideoError>> {
        if self.is_over {
            return None;
        }
        match self.decoder.next(self.patience) {
            Some(Ok((_, time_s, image))) => {
                if self.is_fresh {
                    let now_s = self.last.map_or(time_s, |(last_s, came)| last_s + came.elapsed().as_secs_f64());
                    self.offset_s = now_s - time_s;
                    self.is_fresh = false;
                }
                let time_s = time_s + self.offset_s;
                (self.last, self.tries) = (Some((time_s, Instant::now())), 0);
                self.next += 1;
                Some(Ok((self.next - 1, time_s, image)))
            }
            Some(Err(error)) => {
                // What never gave a frame is no stream.
                let comes_back = self.patience.is_some() && self.last.is_some() && self.tries < MAX_TRIES;
                self.is_over = !(comes_back && self.open_again().is_ok());
                Some(Err(error))
            }
            None => {
                self.is_over = true;
                None
            }
        }
    }

    fn open_again(&mut self) -> Result<(), VideoError> {
        self.tries += 1;
        thread::sleep(PAUSE);
        let path = self.decoder.path().to_owned();
        self.decoder = Decoder::start(&self.ffmpeg, &path)?;
        self.is_fresh = true;
        Ok(())
    }
}
