//! Videos read by the user's ffmpeg, a child process: pixels through a pipe, times from its log.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::thread;
use std::time::Duration;

use farsight_data::ImageLimits;
use image::RgbImage;

use super::error::VideoError;

/// Complaints of ffmpeg that are told, at most.
const TOLD_COMPLAINTS: usize = 3;

/// Bytes of pixels that are read at once, and how many such pieces may wait.
const PIECE: usize = 1 << 16;
const WAITING_PIECES: usize = 16;

/// What ffmpeg's log says.
#[derive(Debug, Clone, PartialEq)]
enum Said {
    /// Frames a second of the video.
    Fps(f64),
    /// A frame that comes next through the pipe: its time in seconds, if it has one, its width and height.
    Frame(Option<f64>, [u32; 2]),
    /// Something went wrong.
    Complaint(String),
}

/// No line of a log that tells anything is longer, bytes; the rest of it counts as another line.
const MAX_LINE: u64 = 1 << 16;

/// Number, time in seconds and pixels of a frame.
pub type Decoded = (u64, f64, RgbImage);

/// Reads a video.
pub(super) struct Decoder {
    child: Child,
    frames: FrameStream,
    is_over: bool,
}

/// Frames out of what ffmpeg says of a video: raw pixels, and a log that tells of each frame before it comes.
#[derive(Debug)]
pub struct FrameStream {
    path: PathBuf,
    pixels: Receiver<Vec<u8>>,
    /// Those of the next frame that came with the last ones.
    rest: Vec<u8>,
    log: Receiver<Said>,
    fps: Option<f64>,
    next: u64,
    complaints: Vec<String>,
}

impl Decoder {
    /// Starts `ffmpeg` on a file, an address or a device.
    pub(super) fn start(ffmpeg: &Path, video: &Path) -> Result<Self, VideoError> {
        let mut command = Command::new(ffmpeg);
        command.args(["-nostdin", "-hide_banner", "-loglevel", "level+info"]).args(input(video));
        // Its first video stream, as viewers show it: ffmpeg turns it upright before its filters.
        command.args(["-map", "0:v:0", "-vf", "showinfo", "-fps_mode", "passthrough"]);
        // The end of a frame is not to wait for the next one.
        command.args(["-f", "rawvideo", "-pix_fmt", "rgb24", "-flush_packets", "1", "pipe:1"]);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|error| unstarted(ffmpeg, error))?;
        let (Some(pixels), Some(log)) = (child.stdout.take(), child.stderr.take()) else {
            return Err(unstarted(ffmpeg, ErrorKind::BrokenPipe.into()));
        };
        Ok(Self { child, frames: FrameStream::new(video, pixels, log), is_over: false })
    }

    pub(super) fn path(&self) -> &Path {
        &self.frames.path
    }

    /// Frames a second, known from the first frame on.
    pub(super) fn fps(&self) -> Option<f64> {
        self.frames.fps
    }

    /// The next frame. The last answer of a video that broke off, or that was silent for longer than `patience`, is an
    /// error.
    pub(super) fn next(&mut self, patience: Option<Duration>) -> Option<Result<Decoded, VideoError>> {
        if self.is_over {
            return None;
        }
        let next = self.frames.next_frame(patience);
        self.is_over = !matches!(next, Some(Ok(_)));
        next.or_else(|| self.ended().err().map(Err))
    }

    /// Whether ffmpeg came to the end of the video.
    fn ended(&mut self) -> Result<(), VideoError> {
        let FrameStream { path, next, complaints, .. } = &self.frames;
        let path = path.clone();
        let status = match self.child.wait() {
            Ok(status) => status,
            Err(error) => return Err(VideoError::NoVideo { path, told: format!("ffmpeg was lost: {error}") }),
        };
        let told = complaints.join("; ");
        if !status.success() || *next == 0 {
            let told = if told.is_empty() { format!("ffmpeg ended with {status}") } else { told };
            return Err(VideoError::NoVideo { path, told });
        }
        if told.is_empty() { Ok(()) } else { Err(VideoError::Damaged { path, told }) }
    }
}

impl FrameStream {
    /// Of the video `path`, which is only what errors call it. Both streams are read by threads, so that neither waits
    /// for the other.
    pub fn new(path: &Path, pixels: impl Read + Send + 'static, log: impl Read + Send + 'static) -> Self {
        let (say, said) = channel();
        thread::spawn(move || listen(log, &say));
        let (give, given) = sync_channel(WAITING_PIECES);
        thread::spawn(move || hand_on(pixels, &give));
        Self {
            path: path.to_owned(),
            pixels: given,
            rest: Vec::new(),
            log: said,
            fps: None,
            next: 0,
            complaints: Vec::new(),
        }
    }

    /// The next frame; none when the log ends. After an error there is no other.
    ///
    /// # Errors
    /// When the pixels end early, a frame has no time or too many pixels, or nothing came for longer than `patience`.
    pub fn next_frame(&mut self, patience: Option<Duration>) -> Option<Result<Decoded, VideoError>> {
        loop {
            match received(&self.log, patience) {
                Ok(Said::Fps(fps)) => self.fps = self.fps.or(Some(fps)),
                Ok(Said::Complaint(text)) if self.complaints.len() < TOLD_COMPLAINTS => self.complaints.push(text),
                Ok(Said::Complaint(_)) => {}
                Ok(Said::Frame(time_s, size)) => return Some(self.frame(time_s, size, patience)),
                Err(RecvTimeoutError::Timeout) => return Some(Err(self.stalled(patience))),
                Err(RecvTimeoutError::Disconnected) => return None,
            }
        }
    }

    fn stalled(&self, patience: Option<Duration>) -> VideoError {
        VideoError::Stalled { path: self.path.clone(), waited_s: patience.unwrap_or_default().as_secs_f64() }
    }

    fn frame(
        &mut self,
        time_s: Option<f64>,
        size: [u32; 2],
        patience: Option<Duration>,
    ) -> Result<Decoded, VideoError> {
        let place = format!("{}: frame {}", self.path.display(), self.next);
        let ([width, height], most) = (size, ImageLimits::default().max_pixels);
        let count = u64::from(width) * u64::from(height);
        if count > most {
            return Err(VideoError::TooLarge { place, size, most });
        }
        let length = 3 * count as usize;
        let mut pixels = std::mem::take(&mut self.rest);
        while pixels.len() < length {
            match received(&self.pixels, patience) {
                Ok(piece) => pixels.extend(piece),
                Err(RecvTimeoutError::Timeout) => return Err(self.stalled(patience)),
                Err(RecvTimeoutError::Disconnected) => {
                    let told = self.complaints.join("; ");
                    let told = if told.is_empty() { "its pixels end early".to_owned() } else { told };
                    return Err(VideoError::BrokeOff { place, told });
                }
            }
        }
        self.rest = pixels.split_off(length);
        let Some(time_s) = time_s else { return Err(VideoError::NoTime { place }) };
        let Some(image) = RgbImage::from_raw(width, height, pixels) else {
            return Err(VideoError::BrokeOff { place, told: "no pixels".to_owned() });
        };
        self.next += 1;
        Ok((self.next - 1, time_s, image))
    }
}

impl Drop for Decoder {
    fn drop(&mut self) {
        // It has ended, or nobody wants the rest.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The error of an ffmpeg that does not start.
pub fn unstarted(ffmpeg: &Path, source: std::io::Error) -> VideoError {
    let ffmpeg = ffmpeg.to_owned();
    if source.kind() == ErrorKind::NotFound {
        VideoError::NoFfmpeg(ffmpeg)
    } else {
        VideoError::Ffmpeg { ffmpeg, source }
    }
}

/// The arguments by which ffmpeg opens it.
fn input(video: &Path) -> Vec<OsString> {
    let text = video.to_string_lossy();
    let words = |words: &[&str]| words.iter().map(OsString::from).collect::<Vec<_>>();
    let before = if text.starts_with("rtsp://") || text.starts_with("rtsps://") {
        words(&["-rtsp_transport", "tcp", "-i"])
    } else if text.starts_with("/dev/video") {
        words(&["-f", "v4l2", "-i"])
    } else {
        words(&["-i"])
    };
    let name = if text.contains("://") || text.starts_with("/dev/video") {
        video.as_os_str().to_owned()
    } else {
        // No name of a file is taken for an option or an address.
        let mut name = OsString::from("file:");
        name.push(video);
        name
    };
    before.into_iter().chain([name]).collect()
}

/// The next one, if it comes in time.
fn received<T>(from: &Receiver<T>, patience: Option<Duration>) -> Result<T, RecvTimeoutError> {
    match patience {
        Some(patience) => from.recv_timeout(patience),
        None => from.recv().map_err(|_| RecvTimeoutError::Disconnected),
    }
}

/// Hands on pixels as they come, until they end or nobody wants them.
fn hand_on(mut pixels: impl Read, give: &SyncSender<Vec<u8>>) {
    loop {
        let mut piece = vec![0; PIECE];
        let Ok(read @ 1..) = pixels.read(&mut piece) else { return };
        piece.truncate(read);
        if give.send(piece).is_err() {
            return;
        }
    }
}

/// Hands on what is of use in ffmpeg's log, until it ends.
fn listen(log: impl Read, say: &Sender<Said>) {
    let mut log = BufReader::new(log);
    let mut line = Vec::new();
    loop {
        line.clear();
        match log.by_ref().take(MAX_LINE).read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => return,
            Ok(_) => {}
        }
        // Once nobody listens the pipe is still read, so that ffmpeg can end.
        if let Some(said) = said(&String::from_utf8_lossy(&line)) {
            let _ = say.send(said);
        }
    }
}

/// What one line says.
fn said(line: &str) -> Option<Said> {
    let is_frame = line.contains("showinfo") && line.contains(" pts_time:");
    if is_frame {
        let time_s = after(line, " pts_time:")?.parse().ok().filter(|time_s: &f64| time_s.is_finite());
        let (width, height) = after(line, " s:")?.split_once('x')?;
        return Some(Said::Frame(time_s, [width.parse().ok()?, height.parse().ok()?]));
    }
    if line.contains("[error]") || line.contains("[fatal]") {
        let text = line.rsplit_once("[error]").or(line.rsplit_once("[fatal]")).map_or(line, |(_, text)| text);
        return Some(Said::Complaint(text.trim().to_owned()));
    }
    if line.contains("Stream #") && line.contains("Video:") {
        let before = line.split(" fps").next()?;
        let fps: f64 = before.rsplit([' ', ',']).next()?.parse().ok()?;
        return (fps > 0.0 && fps.is_finite()).then_some(Said::Fps(fps));
    }
    None
}

/// The word that follows `key`.
fn after<'a>(line: &'a str, key: &str) -> Option<&'a str> {
    line.split_once(key)?.1.split_ascii_whitespace().next()
}

#[cfg(test)]
mod tests {
    use super::{Said, said};

    #[test]
    fn times_and_sizes_are_read_from_the_log() {
        let table = [
            (
                "[Parsed_showinfo_0 @ 0x55d5] [info] n:   3 pts:   1536 pts_time:0.12    duration:    512 \
                 duration_time:0.04 fmt:yuv420p cl:left sar:1/1 s:640x360 i:P iskey:0 type:P checksum:0BF8E4B5",
                Some(Said::Frame(Some(0.12), [640, 360])),
            ),
            (
                "[Parsed_showinfo_0 @ 0x55d5] [info] n:   3 pts: NOPTS pts_time:NOPTS fmt:rgb24 sar:0/1 s:64x36 i:P",
                Some(Said::Frame(None, [64, 36])),
            ),
            ("[Parsed_showinfo_0 @ 0x55d5] [info] config in time_base: 1/12800, frame_rate: 25/1", None),
            (
                "[info]   Stream #0:0[0x1](und): Video: h264 (High) (avc1 / 0x31637661), yuv420p(progressive), 640x360 \
                 [SAR 1:1 DAR 16:9], 40 kb/s, 29.97 fps, 30k tbr, 12800 tbn (default)",
                Some(Said::Fps(29.97)),
            ),
            ("[x] showinfo: pts_time:inf s:64x36", Some(Said::Frame(None, [64, 36]))),
            ("[info]   Stream #0:0: Video: x, inf fps, 30k tbr", None),
            ("[info]   Stream #0:1: Audio: aac, 48000 Hz, stereo", None),
            (
                "[mov,mp4,m4a @ 0x5] [error] moov atom not found",
                Some(Said::Complaint("moov atom not found".to_owned())),
            ),
            ("[info] frame=  40 fps= 12", None),
        ];
        for (line, expected) in table {
            assert_eq!(said(line), expected, "{line}");
        }
    }
}
