//! `farsight track`: images and videos in, tracks out.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crate::program::{done, farsight, root};
use farsight::json::FrameRecord;

/// One scene again and again: nothing in it moves.
fn still_scene(folder: &Path, frames: usize) {
    fs::create_dir(folder.join("frames")).unwrap();
    let image = farsight::read_image(root().join("assets/scenes/image_2/000000.jpg")).unwrap();
    for frame in 0..frames {
        image.save(folder.join(format!("frames/{frame:06}.png"))).unwrap();
    }
    fs::copy(root().join("assets/scenes/calib/000000.txt"), folder.join("calib.txt")).unwrap();
}

fn records(text: &str) -> Vec<FrameRecord> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// What is said where nothing can be done.
fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let output = farsight(folder, &[&["track"], arguments].concat());
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{arguments:?}: {told}");
    told
}

#[test]
fn in_a_still_scene_everything_stands_still() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    still_scene(folder, 6);
    fs::write(folder.join("ego.csv"), "time_s,speed_mps,yaw_rate\n0,10,0\n0.3,10,0\n").unwrap();
    let common = ["track", "frames", "--fps", "10", "--calib", "calib.txt"];
    let files = ["--tracks", "tracks.csv", "--kitti-tracking", "rows.txt", "--out", "drawn", "--ego", "ego.csv"];
    let printed = done(folder, &[&common[..], &files, &["--json", "-"]].concat());
    let found = records(&printed);
    assert_eq!(found.iter().map(|frame| frame.frame).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
    assert!(found.iter().all(|frame| (frame.time_s - 0.1 * frame.frame as f64).abs() < 1e-9));
    let identities = |frame: &FrameRecord| frame.tracks.iter().map(|track| track.id).collect::<Vec<_>>();
    assert!(!found[0].tracks.is_empty());
    for frame in &found[1..] {
        assert_eq!(identities(frame), identities(&found[0]));
    }
    let is_known = |frame: &FrameRecord| frame.tracks.iter().filter(|track| track.closing_mps.is_some()).count();
    assert!(found[..3].iter().all(|frame| is_known(frame) == 0));
    assert!(is_known(&found[5]) > 0);
    for track in &found[5].tracks {
        let [low, high] = track.range_interval_m;
        assert!(
            low < track.range_m && track.range_m < high && (track.range_m - track.location[2]).abs() < 1e-12,
            "{track:?}"
        );
        assert!(!track.coasting && track.age == 6, "{track:?}");
        let (Some(closing), Some(sigma)) = (track.closing_mps, track.closing_sigma_mps) else { continue };
        assert!(closing.abs() < sigma, "{track:?}");
        assert_eq!(track.ttc_s, None, "{track:?}");
    }
    // With the camera's own speed, what keeps its distance drives as fast.
    let speeds = found[5].tracks.iter().filter_map(|track| Some([track.speed_mps??, track.speed_sigma_mps??]));
    assert!(speeds.clone().count() > 0);
    assert!(speeds.clone().all(|[speed, sigma]| (speed - 10.0).abs() < 2.0 * sigma));

    let rows = fs::read_to_string(folder.join("rows.txt")).unwrap();
    let told: usize = found.iter().map(|frame| frame.tracks.len()).sum();
    assert_eq!(rows.lines().count(), told);
    assert!(rows.lines().all(|row| row.split(' ').count() == 18), "{rows}");
    let table = fs::read_to_string(folder.join("tracks.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + identities(&found[5]).len());
    assert!(table.lines().nth(1).unwrap().starts_with("1,"), "{table}");
    assert_eq!(fs::read_dir(folder.join("drawn")).unwrap().count(), 6);

    // A file has the same lines.
    done(folder, &[&common[..], &["--json", "lines.json", "--ego", "ego.csv"]].concat());
    assert_eq!(fs::read_to_string(folder.join("lines.json")).unwrap(), printed);
}

#[test]
fn a_camera_that_sees_nothing_move_stands_still() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    still_scene(folder, 5);
    let track = |more: &[&str]| {
        let common = [
            "track",
            "frames",
            "--fps",
            "10",
            "--calib",
            "calib.txt",
            "--json",
            "-",
            "--ego",
            "auto",
            "--model",
            "farsight-n",
        ];
        let output = farsight(folder, &[&common[..], more].concat());
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{told}");
        (records(&String::from_utf8(output.stdout).unwrap()), told)
    };
    let (found, told) = track(&["--above-road", "1.65"]);
    assert!(told.contains("ego motion estimated in 4 of 5 frames"), "{told}");
    let speeds: Vec<[f64; 2]> =
        found[4].tracks.iter().filter_map(|track| Some([track.speed_mps??, track.speed_sigma_mps??])).collect();
    assert!(!speeds.is_empty() && speeds.iter().all(|[speed, sigma]| *speed < 2.0 * sigma), "{speeds:?}");
    // A picture knows no metres.
    let (found, told) = track(&[]);
    assert!(told.contains("expected --above-road METRES, or a calibration with its road"), "{told}");
    assert!(found.iter().flat_map(|frame| &frame.tracks).all(|track| track.speed_mps.flatten().is_none()));
}

#[test]
fn what_cannot_be_done_is_told_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    still_scene(folder, 2);
    for name in ["a.mp4", "b.mp4"] {
        fs::write(folder.join(name), "").unwrap();
    }
    fs::write(folder.join("ego.csv"), "time_s,speed_mps,yaw_rate\n0,fast,0\n").unwrap();
    let frames = ["frames", "--hfov", "80"];
    let timed = ["frames", "--hfov", "80", "--fps", "10"];
    let film = ["a.mp4", "--hfov", "80"];
    let table: [(&[&str], &[&str], &str); 13] = [
        (&frames, &[], "error: images have no times; expected --fps N, their number in a second\n"),
        (&frames, &["--fps", "0"], "expected a number from 0.1 to 1000"),
        (&frames, &["--fps", "-5"], "expected a number from 0.1 to 1000"),
        (&film, &["--fps", "5"], "error: --fps is for images; a.mp4 has times of its own\n"),
        (&film, &["b.mp4"], "error: a.mp4: one of several videos; expected one\n"),
        (&film, &["frames"], "error: a.mp4: a video beside other inputs; expected it alone\n"),
        (&["a.mp4"], &[], "error: no camera: distances need its focal length; give one of"),
        (&["nowhere", "--fps", "5", "--hfov", "80"], &[], "error: nowhere: no such file or folder"),
        (
            &timed,
            &["--out", "film.flv"],
            "error: film.flv: no film of this kind is written; expected a folder, or one of .mp4",
        ),
        (
            &timed,
            &["--out", "frames"],
            "error: frames: inputs come from this folder; expected another one for results\n",
        ),
        (
            &timed,
            &["--json", "nowhere/a.json"],
            "error: nowhere/a.json: no folder nowhere; expected one that is there\n",
        ),
        (&timed, &["--ego", "ego.csv"], "error: ego.csv:2: field 2 is \"fast\"; expected a finite number\n"),
        (&film, &["--ffmpeg", "./no-ffmpeg"], "error: ./no-ffmpeg: no such program; videos need ffmpeg: install it"),
    ];
    for (arguments, more, expected) in table {
        let told = refusal(folder, &[arguments, more].concat());
        assert!(told.contains(expected), "{arguments:?} {more:?}: {told}");
    }
    assert!(!folder.join("film.flv").exists());
}

#[test]
fn an_image_that_is_damaged_is_told_and_its_time_passes() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    still_scene(folder, 4);
    fs::write(folder.join("frames/000001.png"), "no picture").unwrap();
    let arguments = ["track", "frames", "--fps", "10", "--calib", "calib.txt", "--json", "-", "-q"];
    let output = farsight(folder, &arguments);
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.starts_with("error: frames/000001.png: "), "{told}");
    let found = records(&String::from_utf8(output.stdout).unwrap());
    assert_eq!(found.iter().map(|frame| frame.frame).collect::<Vec<_>>(), [0, 2, 3]);
    let identities: BTreeSet<u64> = found.iter().flat_map(|frame| &frame.tracks).map(|track| track.id).collect();
    assert_eq!(identities.len(), found[2].tracks.len());
}

/// A program that says and sends what ffmpeg would for these frames, and then ends with `status`.
#[cfg(unix)]
fn fake_ffmpeg(folder: &Path, frames: usize, cut_bytes: usize, status: u8) {
    use std::os::unix::fs::PermissionsExt;

    let image = farsight::read_image(folder.join("frames/000000.png")).unwrap();
    fs::write(folder.join("pixels"), image.as_raw()).unwrap();
    let size = format!("{}x{}", image.width(), image.height());
    let mut script = "#!/bin/sh\necho '[info]   Stream #0:0: Video: h264, yuv420p, 10 fps, 10 tbr' >&2\n".to_owned();
    for frame in 0..frames {
        let line = format!(
            "[Parsed_showinfo_0 @ 0x1] [info] n: {frame} pts: {frame} pts_time:0.{frame} fmt:rgb24 s:{size} i:P"
        );
        let kept = image.as_raw().len() - if frame + 1 == frames { cut_bytes } else { 0 };
        script.extend([format!("echo '{line}' >&2\nhead -c {kept} pixels\n")]);
    }
    script.extend([format!("exit {status}\n")]);
    let path = folder.join("ffmpeg.sh");
    fs::write(&path, script).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
}

#[cfg(unix)]
#[test]
fn a_video_is_tracked_as_its_frames_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    still_scene(folder, 4);
    fs::write(folder.join("film.mp4"), "").unwrap();
    // The smallest model, for time.
    let more = ["--model", "farsight-n", "--calib", "calib.txt", "--json", "-", "-q"];
    let expected = done(folder, &[&["track", "frames", "--fps", "10"], &more[..]].concat());
    assert!(expected.contains("range_m"), "{expected}");
    let film = [&["track", "film.mp4", "--ffmpeg", "./ffmpeg.sh"], &more[..]].concat();
    fake_ffmpeg(folder, 4, 0, 0);
    assert_eq!(done(folder, &film), expected);

    // What is good of a video that breaks off is kept.
    for (cut_bytes, status, message) in
        [(1000, 0, "error: film.mp4: frame 3: broke off: "), (0, 1, "error: film.mp4: cannot be read as a video: ")]
    {
        fake_ffmpeg(folder, 4, cut_bytes, status);
        let output = farsight(folder, &film);
        let told = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{told}");
        assert!(told.starts_with(message), "{told}");
        let kept = String::from_utf8(output.stdout).unwrap();
        assert!(expected.starts_with(&kept) && kept.lines().count() >= 3, "{kept}");
    }

    // A film that is no video is no result.
    fake_ffmpeg(folder, 0, 0, 1);
    let told = refusal(folder, &film[1..]);
    assert!(told.starts_with("error: film.mp4: cannot be read as a video: ffmpeg ended with exit status: 1"), "{told}");
}
