//! What the service promises: queue, deadlines, sizes, cameras, errors.

use std::collections::BTreeMap;
use std::io::Write;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

use farsight::service::{Config, Infer, Inference, MAX_BODY_BYTES, ModelCard, Server, Token};
use farsight::{CameraSource, RangeError, ViewSource};

use crate::client::{Stage, get, post, sent};

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
    assert!(
        metrics.contains("farsight_requests_total{route=\"/v1/range\",status=\"429\",reason=\"queue_full\"} 1\n"),
        "{metrics}"
    );
    assert!(
        metrics.contains("farsight_requests_total{route=\"/v1/range\",status=\"200\",reason=\"ok\"} 3\n"),
        "{metrics}"
    );
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
    stream.write_all(b"POST /v1/range?hfov=65 HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\nhalf").unwrap();
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
    let cameras = BTreeMap::from([("front".to_owned(), CameraSource::FieldOfView(50.0).into())]);
    let stage = Stage::new(Config { cameras, ..Config::default() });
    let address = stage.server.address();
    for (query, status, told) in [
        ("?hfov=wide", 400, "hfov"),
        ("?fov=65", 400, "unknown field `fov`, expected one of `camera`, `hfov`"),
        ("?hfov=65&fx=700", 400, "expected one of camera=, hfov=, fx= and projection="),
        ("?cx=700", 400, "need fx="),
        ("?projection=1,2,3", 400, "row \"P2:\" has 3 numbers; expected 12; projection= takes twelve numbers"),
        ("?road=0,0,1.6,0,0,0.1", 400, "road= needs projection="),
        ("?hfov=65&lens=fisheye:1", 400, "is no lens; expected brown:k1,k2,p1,p2,k3 or kb4:k1,k2,k3,k4"),
        ("?camera=front&lens=kb4:0,0,0,0", 400, "lens= beside camera=; expected one"),
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
    let cameras = BTreeMap::from([("front".to_owned(), CameraSource::FieldOfView(50.0).into())]);
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
    let seen = stage.stand_in.seen.lock().unwrap();
    assert!(seen.iter().map(ViewSource::cameras).eq(&expected), "{seen:?}");
    assert_eq!(get(address, "/v1/cameras").body, r#"{"cameras":["front"],"videos":[]}"#);
}

/// Looks for calibrations, as a pipeline whose cameras lie in a folder does.
struct Calibrated;

impl Infer for Calibrated {
    fn infer(&self, _: &[u8], name: &Path, views: &ViewSource) -> Result<Inference, RangeError> {
        let camera = views.view(name, [640, 480], &farsight_data::Exif::default())?;
        panic!("there is no such camera: {camera:?}");
    }

    fn card(&self) -> ModelCard {
        ModelCard::default()
    }
}

#[test]
fn no_error_names_a_file_of_the_machine() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("image.txt"), "no calibration").unwrap();
    let cameras = BTreeMap::from([
        ("none".to_owned(), CameraSource::Folder(folder.path().join("none")).into()),
        ("broken".to_owned(), CameraSource::Folder(folder.path().to_owned()).into()),
    ]);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let infer: Arc<dyn Infer> = Arc::new(Calibrated);
    let server = Server::start(listener, &infer, Config { cameras, ..Config::default() }).unwrap();
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
