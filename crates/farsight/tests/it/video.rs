//! `farsight::video`: what is read, and what becomes of streams that stall.

use crate::rtsp;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::Duration;

use farsight::json::FrameRecord;

use farsight::video::{VideoError, VideoOptions, VideoSource};

#[test]
fn a_folder_needs_a_rate_and_a_film_has_one() {
    let folder = tempfile::tempdir().unwrap();
    let told = |path: &Path, fps: Option<f64>| VideoSource::open(path, fps).unwrap_err().to_string();
    assert!(told(folder.path(), Some(10.0)).contains("no images in this folder"));
    let image = farsight::RgbImage::new(4, 3);
    for name in ["b.png", "a.png"] {
        image.save(folder.path().join(name)).unwrap();
    }
    assert!(told(folder.path(), None).contains("images have no times"));
    assert!(told(&folder.path().join("film.mp4"), Some(10.0)).contains("a video has times of its own"));
    let frames = VideoSource::open(folder.path(), Some(4.0)).unwrap().frames(&VideoOptions::default()).unwrap();
    let frames: Vec<_> = frames.map(Result::unwrap).collect();
    let seen: Vec<_> =
        frames.iter().map(|frame| (frame.number, frame.time_s, frame.path.file_name().unwrap())).collect();
    assert_eq!(seen, [(0, 0.0, "a.png".as_ref()), (1, 0.25, "b.png".as_ref())]);
}

/// A program that sends two frames, as ffmpeg would. The first time it then sends a part of a third one and nothing
/// more for long, the second time it ends.
#[cfg(unix)]
fn stalling_ffmpeg(folder: &Path) -> std::path::PathBuf {
    use std::os::unix::fs::PermissionsExt;

    let frame = |number: usize, bytes: usize| {
        format!(
            "echo '[Parsed_showinfo_0 @ 0x1] [info] n: {number} pts: {number} pts_time:0.{number} fmt:rgb24 s:4x3 i:P' >&2\n\
             head -c {bytes} /dev/zero\n"
        )
    };
    let shown = folder.display();
    let script = format!(
        "#!/bin/sh\n{}{}if [ -e {shown}/twice ]; then exit 0; fi\ntouch {shown}/twice\n{}exec sleep 60\n",
        frame(0, 36),
        frame(1, 36),
        frame(2, 20)
    );
    let path = folder.join("ffmpeg.sh");
    fs::write(&path, script).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    path
}

#[cfg(unix)]
#[test]
fn a_stream_that_stalls_is_opened_again_and_its_times_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let ffmpeg = stalling_ffmpeg(folder.path());
    let options = VideoOptions { ffmpeg, patience: Duration::from_secs(3), ..VideoOptions::default() };
    let source = VideoSource::open("rtsp://camera/stream", None).unwrap();
    let frames: Vec<_> = source.frames(&options).unwrap().collect();
    let numbers: Vec<_> = frames.iter().map(|frame| frame.as_ref().ok().map(|frame| frame.number)).collect();
    assert_eq!(numbers, [Some(0), Some(1), None, Some(2), Some(3)]);
    assert!(matches!(frames[2], Err(VideoError::Stalled { .. })));
    let times: Vec<f64> = frames.iter().filter_map(|frame| Some(frame.as_ref().ok()?.time_s)).collect();
    assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{times:?}");
    // The clock went on while nothing came.
    assert!(times[2] - times[1] > 1.0 && (times[3] - times[2] - 0.1).abs() < 1e-9, "{times:?}");
}

#[test]
fn a_camera_that_falls_silent_is_watched_again_over_rtsp() {
    if !rtsp::has_ffmpeg() {
        return eprintln!("skipped: there is no ffmpeg, so no stream was read");
    }
    let folder = tempfile::tempdir().unwrap();
    let camera = rtsp::Camera::start(folder.path(), 10);
    let options = VideoOptions { patience: Duration::from_secs(6), ..VideoOptions::default() };
    let source = VideoSource::open(format!("rtsp://{}/front", camera.address), None).unwrap();
    let mut frames = source.frames(&options).unwrap();
    let (mut seen, mut stalls) = (Vec::new(), 0);
    while seen.iter().filter(|(_, _, stalls)| *stalls > 0).count() < 15 {
        match frames.next().unwrap() {
            Ok(frame) => {
                assert_eq!(frame.image.dimensions(), (320, 180));
                seen.push((frame.number, frame.time_s, stalls));
            }
            Err(VideoError::Stalled { .. }) => stalls += 1,
            Err(error) => panic!("{error}"),
        }
    }
    assert_eq!((stalls, camera.plays.load(Ordering::SeqCst)), (1, 2));
    assert!(seen.iter().zip(0..).all(|((number, ..), place)| *number == place), "{seen:?}");
    assert!(seen.windows(2).all(|pair| pair[0].1 < pair[1].1), "{seen:?}");
    let before = seen.iter().filter(|(_, _, stalls)| *stalls == 0).count();
    // Ten frames a second, of which the last ones were on their way when it fell silent.
    assert!((50..=100).contains(&before), "{before} before it fell silent");
}

#[test]
fn track_follows_a_camera_over_rtsp() {
    if !rtsp::has_ffmpeg() {
        return eprintln!("skipped: there is no ffmpeg, so no stream was followed");
    }
    let folder = tempfile::tempdir().unwrap();
    let camera = rtsp::Camera::start(folder.path(), 30);
    let address = format!("rtsp://{}/front", camera.address);
    let mut track = Command::new(env!("CARGO_BIN_EXE_farsight"));
    track.args(["track", &address, "--hfov", "80", "--realtime", "--json", "-", "--model", "farsight-s"]);
    let mut track = track.current_dir(folder.path()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let lines = BufReader::new(track.stdout.take().unwrap()).lines().take(3);
    let found: Vec<FrameRecord> = lines.map(|line| serde_json::from_str(&line.unwrap()).unwrap()).collect();
    track.kill().unwrap();
    track.wait().unwrap();
    assert!(found.len() == 3 && found.is_sorted_by(|a, b| a.time_s < b.time_s), "{found:?}");
}
