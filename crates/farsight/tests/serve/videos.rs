//! Films that are watched.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use farsight::service::{Config, Infer, Log, LogRecord, Server, SourceFrame, SourceFrames, Video, VideoFailure};
use farsight::{Box2d, Box3d, Camera, Detection, RgbImage};
use serde_json::{Value, json};

use crate::client::{Stage, get};

/// A film of noise with one car in it, that comes nearer.
#[derive(Debug, Default)]
pub(crate) struct Film {
    pub(crate) frames: u64,
    pub(crate) frame_s: f64,
    /// How often it was opened, and how many of those are still read.
    opened: AtomicUsize,
    reading: Arc<AtomicUsize>,
    fails: bool,
}

const SIZE: [u32; 2] = [320, 200];

/// The record of a car so far ahead, and the same as a detection.
fn car(frame: u64, time_s: f64, z: f64) -> (Value, Detection) {
    let box3d = Box3d {
        location: [1.0, 1.5, z],
        dimensions: farsight_core::Dimensions { length: 4.0, height: 1.5, width: 1.7 },
        yaw: -1.57,
    };
    let box2d = Box2d { x1: 150.0, y1: 90.0, x2: 190.0, y2: 120.0 };
    let record = json!({"frame": frame, "time_s": time_s, "tracks": [{
        "id": 7, "class": "Car", "score": 0.9, "age": frame + 1, "box2d": [150.0, 90.0, 190.0, 120.0],
        "dimensions_hwl": [1.5, 1.7, 4.0], "location": [1.0, 1.5, z], "rotation_y": -1.57, "range_m": z,
        "range_sigma_m": 1.0, "range_interval_m": [z - 1.6, z + 1.6], "velocity_mps": [0.0, 0.0, -5.0],
        "velocity_sigma_mps": [0.1, 0.0, 0.5], "closing_mps": 5.0, "closing_sigma_mps": 0.5, "ttc_s": z / 5.0,
        "ttc_interval_s": [z / 6.0, z / 4.0], "coasting": false}]});
    let class = farsight::ObjectClass::Car;
    (record, Detection { class, score: 0.9, box2d, box3d, range_sigma_m: Some(1.0) })
}

pub(crate) fn frame(number: u64, time_s: f64, image: RgbImage, hfov_deg: f64) -> SourceFrame {
    let camera = Camera::from_hfov(hfov_deg, image.width(), image.height()).unwrap();
    let (record, detection) = car(number, time_s, 30.0 - 5.0 * time_s);
    SourceFrame {
        record: serde_json::from_value(record).unwrap(),
        detections: vec![detection],
        view: camera.into(),
        image,
    }
}

/// Says that it is read until it is dropped.
struct Reading(Arc<AtomicUsize>);

impl Drop for Reading {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::SeqCst);
    }
}

impl Video for Film {
    fn open(&self) -> Result<SourceFrames, VideoFailure> {
        self.opened.fetch_add(1, Ordering::SeqCst);
        if self.fails {
            return Err("secret/film.mp4: no such file".into());
        }
        self.reading.fetch_add(1, Ordering::SeqCst);
        let reading = Reading(Arc::clone(&self.reading));
        let frame_s = self.frame_s;
        let mut state = 1_u32;
        Ok(Box::new((0..self.frames).map(move |number| {
            let _ = &reading;
            let image = RgbImage::from_fn(SIZE[0], SIZE[1], |_, _| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                image::Rgb([(state >> 24) as u8; 3])
            });
            Ok(frame(number, number as f64 * frame_s, image, 65.0))
        })))
    }
}

fn stage(film: &Arc<Film>, config: Config) -> Stage {
    let film: Arc<dyn Video> = film.clone();
    Stage::new(Config { videos: [("front".to_owned(), film)].into(), ..config })
}

/// A stream that is read as it comes.
fn watched(address: SocketAddr, path: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_mins(1))).unwrap();
    write!(stream, "GET {path} HTTP/1.0\r\nHost: localhost\r\n\r\n").unwrap();
    stream
}

fn all_of(mut stream: TcpStream) -> Vec<u8> {
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    bytes
}

fn until(what: &str, is_so: impl Fn() -> bool) {
    let end = Instant::now() + Duration::from_secs(30);
    while !is_so() {
        assert!(Instant::now() < end, "never {what}");
        thread::sleep(Duration::from_millis(5));
    }
}

/// Names and data of events.
fn events(text: &str) -> Vec<(String, Value)> {
    let body = text.split_once("\r\n\r\n").unwrap().1;
    let field = |event: &str, name: &str| {
        event.lines().find_map(|line| Some(line.strip_prefix(name)?.strip_prefix(": ")?.to_owned()))
    };
    let event = |event: &str| Some((field(event, "event")?, serde_json::from_str(&field(event, "data")?).unwrap()));
    body.split("\n\n").filter_map(event).collect()
}

#[test]
fn tracks_come_as_events_the_camera_before_them_and_the_end_after() {
    let film = Arc::new(Film { frames: 5, frame_s: 0.02, ..Film::default() });
    let stage = stage(&film, Config::default());
    assert_eq!(get(stage.server.address(), "/v1/cameras").body, r#"{"cameras":[],"videos":["front"]}"#);
    let text = String::from_utf8(all_of(watched(stage.server.address(), "/v1/videos/front/tracks"))).unwrap();
    assert!(text.to_lowercase().contains("content-type: text/event-stream"), "{text}");
    let events = events(&text);
    let names: Vec<&str> = events.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!((names[0], *names.last().unwrap()), ("camera", "end"), "{names:?}");
    assert!(names[1..names.len() - 1].iter().all(|name| *name == "frame"), "{names:?}");
    assert_eq!((&events[0].1["width"], &events[0].1["height"]), (&json!(320), &json!(200)));
    let numbers: Vec<u64> = events.iter().filter_map(|(_, data)| data["frame"].as_u64()).collect();
    // Who reads slowly misses some, but never the last.
    assert!(numbers.is_sorted_by(|a, b| a < b) && numbers.last() == Some(&4), "{numbers:?}");
    assert_eq!(events[names.len() - 2].1["tracks"][0]["id"], json!(7));
    let metrics = get(stage.server.address(), "/metrics").body;
    assert!(metrics.contains("farsight_video_frames_total{video=\"front\"} 5\n"), "{metrics}");
}

/// The first picture of a stream of frames, and its number.
fn first_part(bytes: &[u8]) -> (RgbImage, u64) {
    let head_end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap() + 4;
    let head = String::from_utf8_lossy(&bytes[..head_end]).to_lowercase();
    assert!(head.contains("content-type: multipart/x-mixed-replace; boundary=frame"), "{head}");
    let part = &bytes[head_end..];
    let part_end = part.windows(4).position(|four| four == b"\r\n\r\n").unwrap() + 4;
    let head = String::from_utf8_lossy(&part[..part_end]).into_owned();
    let number = |name: &str| head.split(name).nth(1).unwrap().lines().next().unwrap().parse::<u64>().unwrap();
    let jpeg = &part[part_end..part_end + number("Content-Length: ") as usize];
    (image::load_from_memory(jpeg).unwrap().to_rgb8(), number("X-Frame: "))
}

#[test]
fn frames_come_as_pictures_with_or_without_what_was_found() {
    let film = Arc::new(Film { frames: 3, frame_s: 0.02, ..Film::default() });
    let stage = stage(&film, Config::default());
    let address = stage.server.address();
    let plain = all_of(watched(address, "/v1/videos/front/frames?plain=true"));
    let (image, number) = first_part(&plain);
    assert_eq!((image.dimensions(), number), ((320, 200), 0));
    assert!(plain.ends_with(b"--frame--\r\n"));
    let (drawn, _) = first_part(&all_of(watched(address, "/v1/videos/front/frames")));
    assert!(drawn.width() > 320 && drawn.height() >= 200, "{:?}", drawn.dimensions());
    assert_eq!(film.opened.load(Ordering::SeqCst), 2, "a film that ended begins anew");
}

#[test]
fn a_film_runs_once_for_all_and_only_while_somebody_watches() {
    let film = Arc::new(Film { frames: u64::MAX, frame_s: 0.01, ..Film::default() });
    let stage = stage(&film, Config::default());
    let address = stage.server.address();
    let watchers = [0, 1].map(|_| watched(address, "/v1/videos/front/tracks"));
    let line = "farsight_video_watchers{video=\"front\"} ";
    until("two watchers", || get(address, "/metrics").body.contains(&format!("{line}2\n")));
    assert_eq!((film.opened.load(Ordering::SeqCst), film.reading.load(Ordering::SeqCst)), (1, 1));
    drop(watchers);
    until("left", || film.reading.load(Ordering::SeqCst) == 0);
    until("no watchers", || get(address, "/metrics").body.contains(&format!("{line}0\n")));
}

#[test]
fn who_reads_nothing_is_cut_off() {
    let film = Arc::new(Film { frames: u64::MAX, frame_s: 0.001, ..Film::default() });
    let stage = stage(&film, Config { write_timeout: Duration::from_millis(100), ..Config::default() });
    let stream = watched(stage.server.address(), "/v1/videos/front/frames?plain=true");
    until("begun", || film.reading.load(Ordering::SeqCst) == 1);
    until("cut off", || film.reading.load(Ordering::SeqCst) == 0);
    drop(stream);
}

#[test]
fn who_reads_a_little_now_and_then_is_cut_off() {
    let film = Arc::new(Film { frames: u64::MAX, frame_s: 0.001, ..Film::default() });
    let config = Config { write_timeout: Duration::from_secs(2), least_write_rate: 1 << 30, ..Config::default() };
    let stage = stage(&film, config);
    let stream = watched(stage.server.address(), "/v1/videos/front/frames?plain=true");
    until("begun", || film.reading.load(Ordering::SeqCst) == 1);
    until("cut off", || {
        // Less than the film has, and enough that hardly a write waits for two seconds.
        thread::sleep(Duration::from_millis(100));
        let _ = (&stream).read(&mut [0; 16 << 10]);
        film.reading.load(Ordering::SeqCst) == 0
    });
}

#[test]
fn who_keeps_pace_is_not_cut_off() {
    let film = Arc::new(Film { frames: 200, frame_s: 0.001, ..Film::default() });
    let config = Config { write_timeout: Duration::from_millis(500), ..Config::default() };
    let stage = stage(&film, config);
    let all = all_of(watched(stage.server.address(), "/v1/videos/front/frames?plain=true"));
    assert!(all.ends_with(b"--frame--\r\n"));
}

#[test]
fn streams_end_with_the_service() {
    let film = Arc::new(Film { frames: u64::MAX, frame_s: 0.01, ..Film::default() });
    let Stage { server, .. } = stage(&film, Config::default());
    let stream = watched(server.address(), "/v1/videos/front/tracks");
    until("begun", || film.reading.load(Ordering::SeqCst) == 1);
    let reading = thread::spawn(move || all_of(stream));
    server.stop();
    let text = String::from_utf8(reading.join().unwrap()).unwrap();
    assert_eq!(events(&text).last().unwrap().0, "end");
    until("left", || film.reading.load(Ordering::SeqCst) == 0);
}

#[test]
fn a_video_that_cannot_be_read_is_told_without_its_path_and_logged_with_it() {
    let told = Arc::new(Mutex::new(String::new()));
    let kept = Arc::clone(&told);
    let log = Log::new(move |record| {
        if let LogRecord::Video { message, .. } = record {
            *kept.lock().unwrap() += message;
        }
    });
    let film = Arc::new(Film { fails: true, ..Film::default() });
    let stage = stage(&film, Config { log, ..Config::default() });
    let text = String::from_utf8(all_of(watched(stage.server.address(), "/v1/videos/front/tracks"))).unwrap();
    assert_eq!(events(&text), [("failed".to_owned(), json!({"message": "the video cannot be read"}))]);
    assert!(told.lock().unwrap().contains("cannot be read: secret/film.mp4: no such file"));
    let unknown = get(stage.server.address(), "/v1/videos/rear/tracks");
    assert_eq!((unknown.status, unknown.error().0.as_str()), (404, "no_video"));
    assert!(unknown.error().1.contains("expected one of these: front"), "{unknown:?}");
    assert_eq!(get(stage.server.address(), "/v1/videos/front/frames?plain=perhaps").status, 400);
}

/// A service for the page: a real pipeline, or any other, and films.
pub(crate) fn served(infer: &Arc<dyn Infer>, videos: Vec<(&str, Arc<dyn Video>)>, config: Config) -> Server {
    let videos = videos.into_iter().map(|(name, video)| (name.to_owned(), video)).collect();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    Server::start(listener, infer, Config { videos, ..config }).unwrap()
}
