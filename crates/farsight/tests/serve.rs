//! `farsight serve`: over the loopback, with the pipeline and with stand-ins for it.

#![allow(clippy::unwrap_used, reason = "the helpers of a test may panic")]

#[allow(dead_code, reason = "each test file uses a part of it")]
mod program;

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use farsight::CameraSource;
use farsight::json::ImageRecord;
use farsight::service::{Config, Look, LookError, MAX_BODY_BYTES, Server, Token};
use image::{ExtendedColorType, ImageEncoder};
use serde_json::Value;

/// An answer of the service.
#[derive(Debug)]
struct Response {
    status: u16,
    head: String,
    body: String,
}

impl Response {
    fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }

    /// The word for programs and the text for people.
    fn error(&self) -> (String, String) {
        let error = &self.json()["error"];
        (error["reason"].as_str().unwrap().to_owned(), error["message"].as_str().unwrap().to_owned())
    }
}

/// Sends `head` (with the header lines given) and `body` and reads the answer.
fn sent(address: SocketAddr, first_line: &str, headers: &[&str], body: &[u8]) -> Response {
    let mut stream = TcpStream::connect(address).unwrap();
    let first_line = format!("{first_line} HTTP/1.1");
    let lines = [&[first_line.as_str(), "Host: test", "Connection: close"], headers].concat();
    let head = lines.join("\r\n") + "\r\n\r\n";
    stream.write_all(head.as_bytes()).unwrap();
    // A service that refuses at once need not read all of it.
    let _ = stream.write_all(body);
    received(stream)
}

fn received(mut stream: TcpStream) -> Response {
    stream.set_read_timeout(Some(Duration::from_mins(1))).unwrap();
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    let text = String::from_utf8(bytes).unwrap();
    let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("no answer: {text:?}"));
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    Response { status, head: head.to_ascii_lowercase(), body: body.to_owned() }
}

fn post(address: SocketAddr, query: &str, body: &[u8]) -> Response {
    sent(address, &format!("POST /v1/range{query}"), &[&format!("Content-Length: {}", body.len())], body)
}

fn get(address: SocketAddr, path: &str) -> Response {
    sent(address, &format!("GET {path}"), &[], b"")
}

/// Panics at `panic`, waits at `wait` until it is told to go on, and finds nothing in anything else.
struct StandIn {
    looks: AtomicUsize,
    seen: Mutex<Vec<CameraSource>>,
    begun: Mutex<Sender<()>>,
    go_on: Mutex<Receiver<()>>,
}

impl Look for StandIn {
    fn look(&self, bytes: &[u8], name: &Path, cameras: &CameraSource) -> Result<ImageRecord, LookError> {
        self.looks.fetch_add(1, Ordering::SeqCst);
        self.seen.lock().unwrap().push(cameras.clone());
        match bytes {
            b"panic" => panic!("a panic that the test asked for"),
            b"wait" => {
                self.begun.lock().unwrap().send(()).unwrap();
                self.go_on.lock().unwrap().recv().unwrap();
            }
            _ => {}
        }
        let record = format!(r#"{{"image": {:?}, "width": 1, "height": 1, "detections": []}}"#, name.to_string_lossy());
        Ok(serde_json::from_str(&record).unwrap())
    }
}

/// A service around a stand-in.
struct Stage {
    server: Server,
    stand_in: Arc<StandIn>,
    begun: Receiver<()>,
    go_on: Sender<()>,
}

impl Stage {
    fn new(config: Config) -> Self {
        let (tell_begun, begun) = channel();
        let (go_on, wait) = channel();
        let stand_in = Arc::new(StandIn {
            looks: AtomicUsize::new(0),
            seen: Mutex::default(),
            begun: Mutex::new(tell_begun),
            go_on: Mutex::new(wait),
        });
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let look: Arc<dyn Look> = stand_in.clone();
        Self { server: Server::start(listener, &look, config).unwrap(), stand_in, begun, go_on }
    }

    /// A request on its way whose work has begun and lasts until [`Stage::go_on`].
    fn waiting(&self) -> thread::JoinHandle<Response> {
        let address = self.server.address();
        let request = thread::spawn(move || post(address, "?hfov=65", b"wait"));
        self.begun.recv_timeout(Duration::from_secs(30)).unwrap();
        request
    }

    /// Waits until so many requests are inside.
    fn until_inside(&self, count: usize) {
        let line = format!("farsight_requests_inside {count}\n");
        let end = Instant::now() + Duration::from_secs(30);
        while !get(self.server.address(), "/metrics").body.contains(&line) {
            assert!(Instant::now() < end, "never {line}");
        }
    }
}

#[test]
fn one_more_than_the_queue_holds_is_refused_at_once() {
    let stage = Stage::new(Config { workers: 1, queue: 1, ..Config::default() });
    let address = stage.server.address();
    let first = stage.waiting();
    let second = thread::spawn(move || post(address, "?hfov=65", b"an image"));
    stage.until_inside(2);
    let refused = post(address, "?hfov=65", &vec![0; 4 << 20]);
    assert_eq!((refused.status, refused.error().0.as_str()), (429, "queue_full"));
    assert!(refused.head.contains("retry-after: "), "{}", refused.head);
    stage.go_on.send(()).unwrap();
    assert_eq!([first.join().unwrap().status, second.join().unwrap().status], [200, 200]);
    assert_eq!(post(address, "?hfov=65", b"an image").status, 200);
    let metrics = get(address, "/metrics").body;
    assert!(metrics.contains("farsight_requests_total{status=\"429\",reason=\"queue_full\"} 1\n"), "{metrics}");
    assert!(metrics.contains("farsight_requests_total{status=\"200\",reason=\"ok\"} 3\n"), "{metrics}");
    assert!(metrics.contains("farsight_work_seconds_count 3\n"), "{metrics}");
}

#[test]
fn what_waited_past_its_deadline_is_never_begun_and_what_was_begun_is_finished() {
    let stage = Stage::new(Config { deadline: Duration::from_millis(300), ..Config::default() });
    let first = stage.waiting();
    let late = post(stage.server.address(), "?hfov=65", b"an image");
    assert_eq!((late.status, late.error().0.as_str()), (504, "deadline"));
    stage.go_on.send(()).unwrap();
    assert_eq!(first.join().unwrap().status, 200);
    stage.until_inside(0);
    assert_eq!(stage.stand_in.looks.load(Ordering::SeqCst), 1);
}

#[test]
fn a_body_that_does_not_arrive_gives_its_place_back() {
    let stage = Stage::new(Config { deadline: Duration::from_millis(200), ..Config::default() });
    let slow = sent(stage.server.address(), "POST /v1/range?hfov=65", &["Content-Length: 100"], b"half");
    assert_eq!((slow.status, slow.error().0.as_str()), (408, "slow_body"));
    stage.until_inside(0);
}

#[test]
fn a_client_that_went_away_gives_its_place_back() {
    let stage = Stage::new(Config::default());
    let mut stream = TcpStream::connect(stage.server.address()).unwrap();
    stream.write_all(b"POST /v1/range?hfov=65 HTTP/1.1\r\nHost: test\r\nContent-Length: 100\r\n\r\nhalf").unwrap();
    stage.until_inside(1);
    drop(stream);
    stage.until_inside(0);
    assert_eq!(stage.stand_in.looks.load(Ordering::SeqCst), 0);
}

#[test]
fn a_panic_harms_its_own_request_only() {
    let stage = Stage::new(Config::default());
    let address = stage.server.address();
    for _ in 0..3 {
        let broken = post(address, "?hfov=65", b"panic");
        assert_eq!((broken.status, broken.error().0.as_str()), (500, "panic"));
        assert_eq!(post(address, "?hfov=65", b"an image").status, 200);
    }
}

#[test]
fn a_body_of_more_than_16_mb_is_refused() {
    let stage = Stage::new(Config::default());
    let address = stage.server.address();
    let announced = sent(address, "POST /v1/range?hfov=65", &["Content-Length: 16777217"], b"");
    assert_eq!((announced.status, announced.error().0.as_str()), (413, "body_too_large"));
    let mut chunk = format!("{:x}\r\n", MAX_BODY_BYTES + 1).into_bytes();
    chunk.resize(chunk.len() + MAX_BODY_BYTES + 1, 0);
    let unannounced = sent(address, "POST /v1/range?hfov=65", &["Transfer-Encoding: chunked"], &chunk);
    assert_eq!((unannounced.status, unannounced.error().0.as_str()), (413, "body_too_large"));
    assert_eq!(post(address, "?hfov=65", &vec![0; MAX_BODY_BYTES]).status, 200);
}

#[test]
fn a_token_is_asked_for_where_there_is_one() {
    let token = Some(Token::new("0123456789abcdef").unwrap());
    let stage = Stage::new(Config { token, ..Config::default() });
    let address = stage.server.address();
    let with = |header: &str| sent(address, "GET /metrics", &[header], b"").status;
    assert_eq!(with("Authorization: Bearer 0123456789abcdef"), 200);
    assert_eq!(with("Authorization: Bearer 0123456789abcdeF"), 401);
    assert_eq!(with("Authorization: Basic 0123456789abcdef"), 401);
    let refused = post(address, "?hfov=65", b"an image");
    assert_eq!((refused.status, refused.error().0.as_str()), (401, "unauthorized"));
    assert_eq!(stage.stand_in.looks.load(Ordering::SeqCst), 0);
    assert_eq!(["/", "/v2/health/live", "/v2/health/ready"].map(|path| get(address, path).status), [200; 3]);
}

#[test]
fn wrong_requests_are_told_what_was_expected() {
    let cameras = BTreeMap::from([("front".to_owned(), CameraSource::FieldOfView(50.0))]);
    let stage = Stage::new(Config { cameras, ..Config::default() });
    let address = stage.server.address();
    for (query, status, told) in [
        ("?hfov=wide", 400, "hfov"),
        ("?fov=65", 400, "unknown field `fov`, expected one of `camera`, `hfov`"),
        ("?hfov=65&fx=700", 400, "expected one of camera=, hfov= and fx="),
        ("?cx=700", 400, "need fx="),
        ("?camera=rear", 404, "no camera \"rear\"; expected one of these: front"),
    ] {
        let response = post(address, query, b"an image");
        assert_eq!(response.status, status, "{query}: {response:?}");
        assert!(response.error().1.contains(told), "{query}: {response:?}");
    }
    assert!(post(address, "?hfov=65", b"").error().1.contains("expected an image file"));
    assert_eq!(get(address, "/v1/range").status, 405);
    assert_eq!(get(address, "/v1/none").error().0, "not_found");
    let form = "Content-Type: multipart/form-data; boundary=B";
    for (body, told) in [("--B--\r\n", "the form has no file"), ("--B\r\nCont", "the form is broken")] {
        let length = format!("Content-Length: {}", body.len());
        let response = sent(address, "POST /v1/range?hfov=65", &[form, &length], body.as_bytes());
        assert_eq!(response.status, 400);
        assert!(response.error().1.contains(told), "{response:?}");
    }
    assert_eq!(stage.stand_in.looks.load(Ordering::SeqCst), 0);
}

#[test]
fn cameras_are_those_of_the_request() {
    let cameras = BTreeMap::from([("front".to_owned(), CameraSource::FieldOfView(50.0))]);
    let stage = Stage::new(Config { cameras, ..Config::default() });
    let address = stage.server.address();
    for query in ["?camera=front", "?hfov=65.5", "?fx=700&cy=180", ""] {
        assert_eq!(post(address, query, b"an image").status, 200);
    }
    let expected = [
        CameraSource::FieldOfView(50.0),
        CameraSource::FieldOfView(65.5),
        CameraSource::Intrinsics { fx: 700.0, fy: 700.0, cx: None, cy: Some(180.0) },
        CameraSource::Exif,
    ];
    assert_eq!(*stage.stand_in.seen.lock().unwrap(), expected);
    assert_eq!(get(address, "/v1/cameras").body, r#"{"cameras":["front"]}"#);
}

/// Looks for calibrations, as a pipeline whose cameras lie in a folder does.
struct Calibrated;

impl Look for Calibrated {
    fn look(&self, _: &[u8], name: &Path, cameras: &CameraSource) -> Result<ImageRecord, LookError> {
        let camera = cameras.camera(name, [640, 480], &farsight_data::Exif::default())?;
        panic!("there is no such camera: {camera:?}");
    }
}

#[test]
fn no_error_names_a_file_of_the_machine() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("image.txt"), "no calibration").unwrap();
    let cameras = BTreeMap::from([
        ("none".to_owned(), CameraSource::Folder(folder.path().join("none"))),
        ("broken".to_owned(), CameraSource::Folder(folder.path().to_owned())),
    ]);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let look: Arc<dyn Look> = Arc::new(Calibrated);
    let server = Server::start(listener, &look, Config { cameras, ..Config::default() }).unwrap();
    for query in ["?camera=none", "?camera=broken"] {
        let response = post(server.address(), query, b"an image");
        assert_eq!((response.status, response.error().0.as_str()), (500, "calibration"), "{query}");
        assert_eq!(response.error().1, "the camera's calibration cannot be read", "{query}");
    }
}

#[test]
fn a_service_that_ends_answers_what_is_inside() {
    let stage = Stage::new(Config::default());
    let address = stage.server.address();
    let first = stage.waiting();
    let second = thread::spawn(move || post(address, "?hfov=65", b"an image"));
    stage.until_inside(2);
    let Stage { server, go_on, .. } = stage;
    let stopping = thread::spawn(move || server.stop());
    let end = Instant::now() + Duration::from_secs(30);
    while TcpStream::connect(address).is_ok() {
        assert!(Instant::now() < end, "still accepting");
    }
    go_on.send(()).unwrap();
    assert_eq!([first.join().unwrap().status, second.join().unwrap().status], [200, 200]);
    stopping.join().unwrap();
}

#[test]
fn the_page_needs_nothing_from_elsewhere() {
    let stage = Stage::new(Config::default());
    for (path, kind) in [("/", "text/html"), ("/page.css", "text/css"), ("/page.js", "text/javascript")] {
        let page = get(stage.server.address(), path);
        assert_eq!(page.status, 200);
        assert!(page.head.contains(&format!("content-type: {kind}; charset=utf-8")), "{}", page.head);
        assert!(page.head.contains("content-security-policy: default-src 'none'"), "{}", page.head);
        assert!(!page.head.contains("access-control-allow-origin"), "{}", page.head);
        assert!(!page.body.contains("//") || path == "/page.js", "{path} names another place");
        assert!(!page.body.contains("http:") && !page.body.contains("https:"), "{path} names another place");
    }
}

/// The program, listening where it likes.
struct Service {
    child: Child,
    address: SocketAddr,
}

impl Service {
    fn start(folder: &Path, arguments: &[&str]) -> Self {
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
    for (arguments, told) in [
        (vec!["--listen", "0.0.0.0:0"], "expected --token-file FILE or FARSIGHT_TOKEN"),
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
