//! What the service promises: queue, deadlines, sizes, cameras, errors.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

use farsight::json::ImageRecord;
use farsight::service::{AskedImage, Config, Infer, Inference, MAX_BODY_BYTES, ModelCard, Server, Token};
use farsight::{CameraSource, Pipeline, RangeError, ViewSource};
use serde_json::Value;

use crate::client::{Response, Stage, get, post, sent};
use crate::program;

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

/// So long nobody waits, so a batch begins when it is full.
const FOR_EVER: Duration = Duration::from_hours(1);

const IMAGE: &[u8] = b"an image";

/// Sends all at once; the answers.
fn posted(address: SocketAddr, bodies: &[&'static [u8]]) -> Vec<Response> {
    let ask = |body: &&'static [u8]| {
        let body = *body;
        thread::spawn(move || post(address, "?hfov=65", body))
    };
    let asked: Vec<_> = bodies.iter().map(ask).collect();
    asked.into_iter().map(|asked| asked.join().unwrap()).collect()
}

#[test]
fn images_that_wait_make_one_batch() {
    let stage = Stage::new(Config { batch: 2, batch_wait: FOR_EVER, ..Config::default() });
    let address = stage.server.address();
    let statuses: Vec<u16> = posted(address, &[IMAGE; 4]).iter().map(|answer| answer.status).collect();
    assert_eq!(statuses, [200; 4]);
    assert_eq!(*stage.stand_in.batches.lock().unwrap(), [2, 2]);
    let metrics = get(address, "/metrics").body;
    for line in [
        "farsight_batch_size_bucket{le=\"1.0\"} 0\n",
        "farsight_batch_size_bucket{le=\"2.0\"} 2\n",
        "farsight_work_seconds_count 4\n",
    ] {
        assert!(metrics.contains(line), "no {line} in {metrics}");
    }
}

#[test]
fn a_panic_in_a_batch_harms_its_own_request_only() {
    let stage = Stage::new(Config { batch: 3, batch_wait: FOR_EVER, ..Config::default() });
    let answers = posted(stage.server.address(), &[IMAGE, b"panic", IMAGE]);
    let statuses: Vec<u16> = answers.iter().map(|answer| answer.status).collect();
    assert_eq!(statuses, [200, 500, 200]);
    assert_eq!(answers[1].error().0, "panic");
    assert_eq!(*stage.stand_in.batches.lock().unwrap(), [3]);
    assert_eq!(posted(stage.server.address(), &[IMAGE; 3]).len(), 3);
}

#[test]
fn a_lone_image_waits_for_company_no_longer_than_the_limit() {
    let stage = Stage::new(Config { batch: 3, ..Config::default() });
    let address = stage.server.address();
    assert_eq!(post(address, "?hfov=65", b"an image").status, 200);
    let metrics = get(address, "/metrics").body;
    assert!(metrics.contains("farsight_batch_size_bucket{le=\"1.0\"} 1\n"), "{metrics}");
}

#[test]
fn what_waits_for_company_past_its_deadline_is_never_begun() {
    let deadline = Duration::from_millis(300);
    let stage = Stage::new(Config { batch: 3, batch_wait: FOR_EVER, deadline, ..Config::default() });
    let address = stage.server.address();
    let late = post(address, "?hfov=65", b"too early");
    assert_eq!((late.status, late.error().0.as_str()), (504, "deadline"));
    // It still has its place in the batch, but is not looked at with the others.
    assert!(posted(address, &[IMAGE; 2]).iter().all(|answer| answer.status == 200));
    assert_eq!(*stage.stand_in.batches.lock().unwrap(), [2]);
}

#[test]
fn a_batch_of_the_pipeline_gives_each_image_its_own_answer() {
    let scenes = program::root().join("assets/scenes/image_2");
    let [first, second] = ["000000.jpg", "000001.jpg"].map(|name| std::fs::read(scenes.join(name)).unwrap());
    let pipeline = Pipeline::shipped().unwrap();
    let [wide, narrow] = [81.4, 50.0].map(|hfov_deg| ViewSource::from(CameraSource::FieldOfView(hfov_deg)));
    let road = program::root().join("assets/scenes/calib/000000.txt");
    let calibrated = ViewSource::from(CameraSource::from_calibration(&road).unwrap())
        .with_lens(Some("brown:-0.05,0,0,0,0".parse().unwrap()));
    let name = Path::new("image");
    let asked = [
        (&first[..], &wide),
        (&b"no image"[..], &wide),
        (&second[..], &wide),
        (&first[..], &narrow),
        (&first[..], &calibrated),
    ]
    .map(|(bytes, views)| AskedImage { bytes, name, views });
    let together = pipeline.infer_batch(&asked);
    assert_eq!(together.len(), asked.len());
    for (AskedImage { bytes, name, views }, together) in asked.into_iter().zip(together) {
        match (pipeline.infer(bytes, name, views), together) {
            (Ok(alone), Ok(together)) => assert_near(&alone.record, &together.record),
            (Err(alone), Err(together)) => assert_eq!(alone.to_string(), together.to_string()),
            (alone, together) => panic!("{alone:?} alone, {together:?} together"),
        }
    }
}

/// The engine adds up in another order for a batch: so far the numbers of an answer may differ, metres and pixels.
const ORDER_OF_SUMS: f64 = 1e-2;

fn assert_near(a: &ImageRecord, b: &ImageRecord) {
    assert!(!a.detections.is_empty());
    let numbers = |record: &ImageRecord| {
        let mut found = Vec::new();
        numbers_in(&serde_json::to_value(record).unwrap(), &mut found);
        found
    };
    let [a, b] = [a, b].map(numbers);
    assert_eq!(a.len(), b.len());
    let most = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(most < ORDER_OF_SUMS, "{most}");
}

fn numbers_in(value: &Value, found: &mut Vec<f64>) {
    match value {
        Value::Number(number) => found.extend(number.as_f64()),
        Value::Array(list) => list.iter().for_each(|value| numbers_in(value, found)),
        Value::Object(fields) => fields.values().for_each(|value| numbers_in(value, found)),
        _ => {}
    }
}

#[test]
fn one_connection_more_than_there_may_be_waits_for_another_to_end() {
    let stage = Stage::new(Config { max_connections: 2, ..Config::default() });
    let open = || {
        let mut stream = TcpStream::connect(stage.server.address()).unwrap();
        stream.write_all(b"GET /v2/health/live HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(500))).unwrap();
        stream
    };
    let mut byte = [0];
    let [first, _second] = [open(), open()].map(|mut stream| {
        stream.read_exact(&mut byte).unwrap();
        stream
    });
    let mut third = open();
    assert!(third.read_exact(&mut byte).is_err(), "a third connection is answered");
    drop(first);
    third.set_read_timeout(Some(Duration::from_mins(1))).unwrap();
    third.read_exact(&mut byte).unwrap();
    assert_eq!(byte, *b"H");
}

#[test]
fn who_does_not_say_what_it_wants_is_cut_off() {
    let stage = Stage::new(Config { header_timeout: Duration::from_millis(200), ..Config::default() });
    for part in ["", "GET /v2/health/live HTTP/1.1\r\nHost: local"] {
        let mut stream = TcpStream::connect(stage.server.address()).unwrap();
        stream.write_all(part.as_bytes()).unwrap();
        // Again and again a little is no better than nothing.
        let mut slow = stream.try_clone().unwrap();
        let dripping = thread::spawn(move || {
            while slow.write_all(b"x").is_ok() {
                thread::sleep(Duration::from_millis(20));
            }
        });
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        let mut answer = Vec::new();
        // The end, or a reset, for what was sent too late.
        if let Err(error) = stream.read_to_end(&mut answer) {
            assert_eq!(error.kind(), ErrorKind::ConnectionReset, "{error}");
        }
        assert!(!answer.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&answer));
        dripping.join().unwrap();
    }
    assert_eq!(get(stage.server.address(), "/v2/health/live").status, 200);
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
        ("?hfov=wide", 400, "expected a number of degrees or auto"),
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
        let camera = views.view(name, &image::RgbImage::new(640, 480), &farsight_data::Exif::default())?;
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
