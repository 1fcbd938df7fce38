//! The law of films: what ffmpeg says of one, whatever it is, gives frames or an error.

use std::io::Cursor;
use std::path::Path;
use std::time::Duration;

use farsight::video::FrameStream;

/// What parts ffmpeg's log from the pixels in an input.
pub(crate) const PIXELS: &[u8] = b"\nPIXELS\n";

/// Nothing has to be waited for.
const PATIENCE: Duration = Duration::from_secs(4);

/// A log and raw pixels: frames come in order, each as large as the log says and at a time that is a number, no more of
/// them than there are pixels for; an error names the film, and there is an end.
pub(crate) fn film(bytes: &[u8]) -> bool {
    let at = bytes.windows(PIXELS.len()).position(|window| window == PIXELS);
    let (log, pixels) = at.map_or((bytes, &[][..]), |at| (&bytes[..at], &bytes[at + PIXELS.len()..]));
    let (log, pixels) = (log.to_vec(), pixels.to_vec());
    let (path, all) = (Path::new("input.mp4"), pixels.len());
    let mut stream = FrameStream::new(path, Cursor::new(pixels), Cursor::new(log));
    let (mut frames, mut taken) = (0, 0);
    loop {
        match stream.next_frame(Some(PATIENCE)) {
            Some(Ok((number, time_s, image))) => {
                assert_eq!(number, frames);
                assert!(time_s.is_finite());
                frames += 1;
                taken += image.as_raw().len();
                assert!(taken <= all, "{taken} bytes of frames out of {all}");
                // Frames without pixels could come for ever.
                assert!(frames as usize <= bytes.len());
            }
            Some(Err(error)) => {
                let told = error.to_string();
                assert!(told.contains("input.mp4"), "no file in: {told}");
                assert!(!told.contains("no frame for"), "it waits: {told}");
                return false;
            }
            None => return frames > 0,
        }
    }
}
