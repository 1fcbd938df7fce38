//! The program itself.

use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use image::{ExtendedColorType, ImageEncoder};

use crate::client::{post, sent};
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
    let mut service = Service::start(&images, &["--camera", "wide=81.4"]);
    let line = program::done(&images, &["range", "000000.jpg", "--hfov", "81.4", "--format", "jsonl"]);
    let mut form = b"--B\r\nContent-Disposition: form-data; name=\"image\"; filename=\"C/000000.jpg\"\r\n\r\n".to_vec();
    form.extend_from_slice(&image);
    form.extend_from_slice(b"\r\n--B--\r\n");
    let headers = ["Content-Type: multipart/form-data; boundary=B", &format!("Content-Length: {}", form.len())];
    let in_a_form = sent(service.address, "POST /v1/range?hfov=81.4", &headers, &form);
    assert_eq!((in_a_form.status, in_a_form.body.as_str()), (200, line.trim_end()));
    let raw = post(service.address, "?camera=wide", &image);
    assert_eq!(raw.body, line.trim_end().replace("\"image\":\"000000.jpg\"", "\"image\":\"image\""));
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
        let asked = Command::new("kill").args(["-TERM", &service.child.id().to_string()]).status().unwrap();
        assert!(asked.success());
        assert!(service.child.wait().unwrap().success());
    }
}

#[test]
fn the_program_listens_elsewhere_with_a_token_only() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("short"), "password").unwrap();
    std::fs::write(folder.path().join("long"), "0123456789abcdef").unwrap();
    for (arguments, told) in [
        (vec!["--listen", "0.0.0.0:0"], "expected --token-file FILE or FARSIGHT_TOKEN"),
        (vec!["--listen", "0.0.0.0:0", "--token-file", "long"], "expected --tls-cert FILE and --tls-key FILE, or --plain-http"),
        (vec!["--tls-cert", "none", "--tls-key", "none"], "none: cannot be read"),
        (vec!["--tls-cert", "short", "--tls-key", "short"], "short, short: the certificate cannot be read"),
        (vec!["--tls-cert", "short"], "--tls-key"),
        (vec!["--token-file", "short"], "short: the token is no such word; expected at least 16"),
        (vec!["--token-file", "none"], "none: cannot be read"),
        (vec!["--camera", "front"], "expected NAME=HFOV or NAME=FILE"),
        (vec!["--camera", "front=180"], "less than 180 degrees"),
        (vec!["--camera", "front=."], "a folder; expected a calibration file"),
        (vec!["--camera", "front=none.txt"], "none.txt: cannot be read"),
        (vec!["--camera", "a=60", "--camera", "a=70"], "--camera a: named twice"),
    ] {
        let output = program::farsight(folder.path(), &[&["serve"], arguments.as_slice()].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(text.contains(told), "{arguments:?}: {text}");
    }
}
