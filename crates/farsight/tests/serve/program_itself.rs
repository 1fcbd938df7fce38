//! The program itself.

use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::{ExtendedColorType, ImageEncoder};

use crate::client::{get, post, sent};
use crate::program;

/// The program, listening where it likes.
pub(crate) struct Service {
    child: Child,
    pub(crate) address: SocketAddr,
}

impl Service {
    pub(crate) fn start(folder: &Path, arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_farsight"));
        command.args(["serve", "--listen", "127.0.0.1:0"]).args(arguments).current_dir(folder);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("listening on http://").unwrap_or_else(|| panic!("{line:?}"));
        Self { address: address.parse().unwrap(), child }
    }
}

impl Service {
    fn terminate(&self) {
        let asked = Command::new("kill").args(["-TERM", &self.child.id().to_string()]).status().unwrap();
        assert!(asked.success());
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn the_program_answers_as_range_does_and_ends_when_it_is_asked_to() {
    let images = program::root().join("assets/scenes/image_2");
    let image = std::fs::read(images.join("000000.jpg")).unwrap();
    let calib = program::root().join("assets/scenes/calib/000000.txt");
    let (calib, lens) = (calib.to_string_lossy(), "brown:-0.05,0,0,0,0");
    let folder = tempfile::tempdir().unwrap();
    let over_road = folder.path().join("road.txt");
    let road = "road: 0.01 0.0 1.5 0.01 0.01 0.1\n";
    std::fs::write(&over_road, std::fs::read_to_string(&*calib).unwrap() + road).unwrap();
    let over_road = over_road.to_string_lossy();
    let bent = [format!("bent={over_road}"), format!("bent={lens}")];
    let arguments = ["--camera", "wide=81.4", "--camera", &bent[0], "--lens", &bent[1]];
    let mut service = Service::start(&images, &arguments);
    let line = program::done(&images, &["range", "000000.jpg", "--hfov", "81.4", "--format", "jsonl"]);
    let mut form = b"--B\r\nContent-Disposition: form-data; name=\"image\"; filename=\"C/000000.jpg\"\r\n\r\n".to_vec();
    form.extend_from_slice(&image);
    form.extend_from_slice(b"\r\n--B--\r\n");
    let headers = ["Content-Type: multipart/form-data; boundary=B", &format!("Content-Length: {}", form.len())];
    let in_a_form = sent(service.address, "POST /v1/range?hfov=81.4", &headers, &form);
    assert_eq!((in_a_form.status, in_a_form.body.as_str()), (200, line.trim_end()));
    let raw = post(service.address, "?camera=wide", &image);
    assert_eq!(raw.body, line.trim_end().replace("\"image\":\"000000.jpg\"", "\"image\":\"image\""));
    // A calibrated camera with its road, and a lens.
    let asked = ["range", "000000.jpg", "--calib", &over_road, "--lens", lens, "--format", "jsonl"];
    let line = program::done(&images, &asked).trim_end().replace("\"image\":\"000000.jpg\"", "\"image\":\"image\"");
    assert!(line.contains(&format!("\"lens\":\"{lens}\"")), "{line}");
    assert_eq!(post(service.address, "?camera=bent", &image).body, line);
    let estimated = post(service.address, "?hfov=auto", &image);
    assert_eq!(estimated.json()["camera"]["origin"], "estimated", "{estimated:?}");
    let folds = post(service.address, "?hfov=81.4&lens=brown:-0.9,0,0,0", &image);
    assert_eq!((folds.status, folds.error().0.as_str()), (400, "bad_lens"), "{folds:?}");
    let unknown = post(service.address, "", &image);
    assert_eq!((unknown.status, unknown.error().0.as_str()), (400, "no_camera"));
    let text = post(service.address, "?hfov=65", b"no image");
    assert_eq!((text.status, text.error().0.as_str()), (400, "bad_image"));

    let mut large = Vec::new();
    let (width, height) = (8000, 6000);
    let encoder = image::codecs::png::PngEncoder::new(&mut large);
    encoder.write_image(&vec![0; width * height], width as u32, height as u32, ExtendedColorType::L8).unwrap();
    let large = post(service.address, "?hfov=65", &large);
    assert_eq!((large.status, large.error().0.as_str()), (413, "too_many_pixels"));
    assert_eq!(large.error().1, "the image has 8000 x 6000 pixels; expected at most 40000000");

    if cfg!(unix) {
        service.terminate();
        assert!(service.child.wait().unwrap().success());
    }
}

#[cfg(unix)]
#[test]
fn what_is_inside_when_it_is_asked_to_end_is_answered() {
    let images = program::root().join("assets/scenes/image_2");
    let image = std::fs::read(images.join("000000.jpg")).unwrap();
    // However busy the machine is, what is inside is not too late, and done before the drain's end: few, and the faster
    // model.
    let options = ["--model", "farsight-s", "--batch", "2", "--deadline", "600000"];
    let mut service = Service::start(&images, &options);
    let address = service.address;
    let ask = |_| {
        let image = image.clone();
        thread::spawn(move || post(address, "?hfov=81.4", &image))
    };
    let asked: Vec<_> = (0..2).map(ask).collect();
    while !get(address, "/metrics").body.contains("farsight_requests_inside 2\n") {
        assert!(asked.iter().any(|asked| !asked.is_finished()), "never both at once");
    }
    service.terminate();
    assert!(asked.iter().any(|asked| !asked.is_finished()), "all were answered before it was asked to end");
    for asked in asked {
        let answer = asked.join().unwrap();
        assert_eq!(answer.status, 200, "{answer:?}");
    }
    assert!(service.child.wait().unwrap().success());
}

#[test]
fn no_answer_names_the_folder_of_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let hidden = folder.path().join("hidden-folder");
    std::fs::create_dir(&hidden).unwrap();
    std::fs::copy(program::root().join("models/farsight-s.safetensors"), hidden.join("mine.safetensors")).unwrap();
    let service = Service::start(folder.path(), &["--model", "hidden-folder/mine.safetensors"]);
    let image = std::fs::read(program::root().join("assets/scenes/image_2/000000.jpg")).unwrap();
    let elsewhere = std::fs::canonicalize(folder.path()).unwrap();
    let tensor = format!(
        r#"{{"inputs":[{{"name":"image","shape":[1],"datatype":"BYTES","data":["{}"]}}],"parameters":{{"hfov":81.4}}}}"#,
        STANDARD.encode(&image)
    );
    let length = format!("Content-Length: {}", tensor.len());
    let inferred = sent(service.address, "POST /v2/models/mine.safetensors/infer", &[&length], tensor.as_bytes());
    let ranged = post(service.address, "?hfov=81.4", &image);
    assert_eq!(ranged.json()["model"]["name"], "mine.safetensors", "{ranged:?}");
    for (answer, status) in [
        (ranged, 200),
        (inferred, 200),
        (post(service.address, "?hfov=81.4", b"no image"), 400),
        (post(service.address, "", &image), 400),
        (post(service.address, "?camera=front", &image), 404),
        (get(service.address, "/v2"), 200),
        (get(service.address, "/v2/models/mine.safetensors"), 200),
        (get(service.address, "/v2/models/none"), 404),
        (get(service.address, "/metrics"), 200),
    ] {
        assert_eq!(answer.status, status, "{answer:?}");
        let text = format!("{}{}", answer.head, answer.body);
        let named = ["hidden-folder", &elsewhere.to_string_lossy()].map(|path| text.contains(path));
        assert_eq!(named, [false, false], "{text}");
    }
}

#[test]
fn the_program_listens_elsewhere_with_a_token_only() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("short"), "password").unwrap();
    std::fs::write(folder.path().join("long"), "0123456789abcdef").unwrap();
    for (arguments, told) in [
        (vec!["--listen", "0.0.0.0:0"], "expected --token-file FILE or FARSIGHT_TOKEN"),
        (
            vec!["--listen", "0.0.0.0:0", "--token-file", "long"],
            "expected --tls-cert FILE and --tls-key FILE, or --plain-http",
        ),
        (vec!["--tls-cert", "none", "--tls-key", "none"], "none: cannot be read"),
        (vec!["--tls-cert", "short", "--tls-key", "short"], "short, short: the certificate cannot be read"),
        (vec!["--tls-cert", "short"], "--tls-key"),
        (vec!["--token-file", "short"], "short: the token is no such word; expected at least 16"),
        (vec!["--token-file", "none"], "none: cannot be read"),
        (vec!["--camera", "front"], "expected NAME=HFOV, NAME=auto or NAME=FILE"),
        (vec!["--camera", "front=180"], "less than 180 degrees"),
        (vec!["--camera", "front=."], "a folder; expected a calibration file"),
        (vec!["--camera", "front=none.txt"], "none.txt: cannot be read"),
        (vec!["--video", "front"], "expected NAME=INPUT"),
        (vec!["--video", "front=none.mp4"], "none.mp4: no such film"),
        (
            vec!["--video", "front=rtsp://user:secret@127.0.0.1:1/"],
            "--video front: no camera of this name; expected --camera front",
        ),
        (vec!["--camera", "a=60", "--camera", "a=70"], "--camera a: named twice"),
        (vec!["--camera", "a=60", "--lens", "a=fisheye:1"], "is no lens; expected brown:"),
        (vec!["--camera", "a=60", "--lens", "b=kb4:0,0,0,0"], "--lens b: no camera of this name; expected --camera b="),
    ] {
        let output = program::farsight(folder.path(), &[&["serve"], arguments.as_slice()].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(text.contains(told), "{arguments:?}: {text}");
        assert!(!text.contains("secret"), "{arguments:?}: {text}");
    }
}

#[cfg(unix)]
#[test]
fn a_film_is_shown_with_the_tracks_that_track_finds() {
    use std::fs;
    use std::os::unix::fs::PermissionsExt;

    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let image = farsight::read_image(program::root().join("assets/scenes/image_2/000000.jpg")).unwrap();
    fs::create_dir(folder.join("frames")).unwrap();
    (0..3).for_each(|frame| image.save(folder.join(format!("frames/{frame}.png"))).unwrap());
    let (calib, lens) = (program::root().join("assets/scenes/calib/000000.txt"), "brown:-0.05,0,0,0,0");
    let road = "road: 0.01 0.0 1.5 0.01 0.01 0.1\n";
    fs::write(folder.join("front.txt"), fs::read_to_string(calib).unwrap() + road).unwrap();
    let view = ["--calib", "front.txt", "--lens", lens];
    let track = [&["track", "frames", "--fps", "10", "--json", "-", "-q"], &view[..]].concat();
    let found = program::done(folder, &track);
    // A program that says and sends what ffmpeg would.
    fs::write(folder.join("film.mp4"), "").unwrap();
    fs::write(folder.join("pixels"), image.as_raw()).unwrap();
    let size = format!("{}x{}", image.width(), image.height());
    let mut script = "#!/bin/sh\necho '[info]   Stream #0:0: Video: h264, yuv420p, 10 fps, 10 tbr' >&2\n".to_owned();
    for frame in 0..3 {
        let line = format!("[Parsed_showinfo_0 @ 0x1] [info] n: {frame} pts_time:0.{frame} fmt:rgb24 s:{size} i:P");
        script.extend([format!("echo '{line}' >&2\ncat pixels\n")]);
    }
    fs::write(folder.join("ffmpeg.sh"), script).unwrap();
    fs::set_permissions(folder.join("ffmpeg.sh"), fs::Permissions::from_mode(0o755)).unwrap();
    let lens = format!("front={lens}");
    let camera = ["--camera", "front=front.txt", "--lens", &lens];
    let film = ["--video", "front=film.mp4", "--ffmpeg", "./ffmpeg.sh", "--log", "log"];
    let service = Service::start(folder, &[&camera[..], &film].concat());
    let text = sent(service.address, "GET /v1/videos/front/tracks", &[], b"").body;
    let shown: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("data: {\"frame\"")).collect();
    let found: Vec<&str> = found.lines().filter_map(|line| line.strip_prefix("{\"frame\"")).collect();
    assert!(found.len() == 3 && found[2].contains("\"class\":\"Car\""), "{found:?}");
    // Some may have been missed, but never the last.
    assert!(shown.iter().all(|line| found.contains(line)) && shown.last() == found.last(), "{shown:?} of {found:?}");
    assert!(text.contains("event: end\n"), "{text}");
    assert!(text.contains("\"lens\":\"brown:-0.05,0,0,0,0\""), "{text}");
    let log = fs::read_to_string(folder.join("log")).unwrap();
    assert!(log.contains("\"message\":\"ended after 3 frames\""), "{log}");
    assert!(log.contains("\"route\":\"/v1/videos/{video}/tracks\",\"status\":200"), "{log}");
}
