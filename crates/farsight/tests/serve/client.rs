//! A client in few words, and a service around a stand-in for the pipeline.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use farsight::json::ImageRecord;
use farsight::service::{AskedImage, Config, Infer, Inference, ModelCard, Server};
use farsight::{RangeError, StageTimes, ViewSource};
use serde_json::Value;

/// An answer of the service.
#[derive(Debug)]
pub(crate) struct Response {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: String,
}

impl Response {
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }

    /// The word for programs and the text for people.
    pub(crate) fn error(&self) -> (String, String) {
        let error = &self.json()["error"];
        (error["reason"].as_str().unwrap().to_owned(), error["message"].as_str().unwrap().to_owned())
    }
}

/// Sends `head` (with the header lines given) and `body` and reads the answer.
pub(crate) fn sent(address: SocketAddr, first_line: &str, headers: &[&str], body: &[u8]) -> Response {
    let mut stream = TcpStream::connect(address).unwrap();
    let first_line = format!("{first_line} HTTP/1.1");
    let lines = [&[first_line.as_str(), "Host: localhost", "Connection: close"], headers].concat();
    let head = lines.join("\r\n") + "\r\n\r\n";
    stream.write_all(head.as_bytes()).unwrap();
    // A service that refuses at once need not read all of it.
    let _ = stream.write_all(body);
    received(stream)
}

pub(crate) fn received(mut stream: TcpStream) -> Response {
    stream.set_read_timeout(Some(Duration::from_mins(1))).unwrap();
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    // Tensors may be no text.
    let text = String::from_utf8_lossy(&bytes);
    let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("no answer: {text:?}"));
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    Response { status, head: head.to_ascii_lowercase(), body: body.to_owned() }
}

pub(crate) fn post(address: SocketAddr, query: &str, body: &[u8]) -> Response {
    sent(address, &format!("POST /v1/range{query}"), &[&format!("Content-Length: {}", body.len())], body)
}

pub(crate) fn get(address: SocketAddr, path: &str) -> Response {
    sent(address, &format!("GET {path}"), &[], b"")
}

/// Panics at `panic`, waits at `wait` until it is told to go on, and finds nothing in anything else.
pub(crate) struct StandIn {
    pub(crate) looks: AtomicUsize,
    pub(crate) images: Mutex<Vec<Vec<u8>>>,
    pub(crate) seen: Mutex<Vec<ViewSource>>,
    /// Sizes of the batches.
    pub(crate) batches: Mutex<Vec<usize>>,
    begun: Mutex<Sender<()>>,
    go_on: Mutex<Receiver<()>>,
}

impl Infer for StandIn {
    fn infer(&self, bytes: &[u8], name: &Path, views: &ViewSource) -> Result<Inference, RangeError> {
        self.looks.fetch_add(1, Ordering::SeqCst);
        self.seen.lock().unwrap().push(views.clone());
        self.images.lock().unwrap().push(bytes.to_vec());
        match bytes {
            b"panic" => panic!("a panic that the test asked for"),
            b"wait" => {
                self.begun.lock().unwrap().send(()).unwrap();
                self.go_on.lock().unwrap().recv().unwrap();
            }
            _ => {}
        }
        let record = format!(r#"{{"image": {:?}, "width": 1, "height": 1, "detections": []}}"#, name.to_string_lossy());
        let record: ImageRecord = serde_json::from_str(&record).unwrap();
        Ok(Inference { record, times: StageTimes::default() })
    }

    fn infer_batch(&self, images: &[AskedImage<'_>]) -> Vec<Result<Inference, RangeError>> {
        self.batches.lock().unwrap().push(images.len());
        images.iter().map(|AskedImage { bytes, name, views }| self.infer(bytes, name, views)).collect()
    }

    fn card(&self) -> ModelCard {
        ModelCard { name: "stand-in".to_owned(), version: "1".to_owned(), platform: "none".to_owned() }
    }
}

/// A service around a stand-in.
pub(crate) struct Stage {
    pub(crate) server: Server,
    pub(crate) stand_in: Arc<StandIn>,
    begun: Receiver<()>,
    pub(crate) go_on: Sender<()>,
}

impl Stage {
    pub(crate) fn new(config: Config) -> Self {
        let (tell_begun, begun) = channel();
        let (go_on, wait) = channel();
        let stand_in = Arc::new(StandIn {
            looks: AtomicUsize::new(0),
            images: Mutex::default(),
            seen: Mutex::default(),
            batches: Mutex::default(),
            begun: Mutex::new(tell_begun),
            go_on: Mutex::new(wait),
        });
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let infer: Arc<dyn Infer> = stand_in.clone();
        Self { server: Server::start(listener, &infer, config).unwrap(), stand_in, begun, go_on }
    }

    /// A request on its way whose work has begun and lasts until [`Stage::go_on`].
    pub(crate) fn waiting(&self) -> thread::JoinHandle<Response> {
        let address = self.server.address();
        let request = thread::spawn(move || post(address, "?hfov=65", b"wait"));
        self.begun.recv_timeout(Duration::from_secs(30)).unwrap();
        request
    }

    /// Waits until so many requests are inside.
    pub(crate) fn until_inside(&self, count: usize) {
        let line = format!("farsight_requests_inside {count}\n");
        let end = Instant::now() + Duration::from_secs(30);
        while !get(self.server.address(), "/metrics").body.contains(&line) {
            assert!(Instant::now() < end, "never {line}");
        }
    }
}
