//! The law of requests to the service.

use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use farsight::service::{Config, Infer, Inference, MAX_PIXELS, ModelCard, Server};
use farsight::{ImageLimits, RangeError, StageTimes, ViewSource};
use farsight_data::decode_image;

/// Longer than anything that the service waits for here.
const PATIENCE: Duration = Duration::from_secs(4);

/// Reads the image as the pipeline would, and finds nothing.
struct Reader;

impl Infer for Reader {
    fn infer(&self, bytes: &[u8], name: &Path, views: &ViewSource) -> Result<Inference, RangeError> {
        let image = decode_image(bytes, name, ImageLimits { max_pixels: MAX_PIXELS })?;
        views.view(name, &image.pixels, &image.exif)?;
        let record = r#"{"image": "image", "width": 1, "height": 1, "detections": []}"#;
        Ok(Inference { record: serde_json::from_str(record).expect("a record"), times: StageTimes::default() })
    }

    fn card(&self) -> ModelCard {
        ModelCard { name: "reader".to_owned(), version: "1".to_owned(), platform: "none".to_owned() }
    }
}

/// Where the one service of this process listens.
fn address() -> SocketAddr {
    static SERVER: OnceLock<Server> = OnceLock::new();
    let server = SERVER.get_or_init(|| {
        let infer: Arc<dyn Infer> = Arc::new(Reader);
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port of the loopback");
        let config = Config { deadline: Duration::from_millis(200), ..Config::default() };
        Server::start(listener, &infer, config).expect("a service")
    });
    server.address()
}

/// All that comes back for `bytes`. Nothing more comes after them if they are `all`, which the service takes for a
/// client that went away.
fn answer(bytes: &[u8], all: bool) -> Vec<u8> {
    let mut stream = TcpStream::connect(address()).expect("the service accepts");
    stream.set_read_timeout(Some(PATIENCE)).expect("a time limit");
    // The service may have heard enough before the end.
    let sent = stream.write_all(bytes);
    drop(sent.and_then(|()| if all { stream.shutdown(Shutdown::Write) } else { Ok(()) }));
    let mut answer = Vec::new();
    if let Err(error) = stream.read_to_end(&mut answer) {
        // Who is answered may ask more, and is waited for.
        let is_over = error.kind() == std::io::ErrorKind::ConnectionReset || !answer.is_empty();
        assert!(is_over, "the service neither answers nor ends: {error}");
    }
    answer
}

/// Whether nothing is missing of a request: it says that it is the last of its connection, and its body is as long as
/// it says. The service takes a client that sends no more for one that went away, and looks at no image then.
fn is_complete(bytes: &[u8]) -> bool {
    const END: &[u8] = b"\r\n\r\n";
    let Some(at) = bytes.windows(END.len()).position(|window| window == END) else { return false };
    let (head, body) = (String::from_utf8_lossy(&bytes[..at]), &bytes[at + END.len()..]);
    let length_of = |line: &str| {
        let (name, value) = line.split_once(':')?;
        name.trim().eq_ignore_ascii_case("content-length").then(|| value.trim().parse::<usize>().ok())?
    };
    let length = head.lines().find_map(length_of);
    head.contains("Connection: close") && length.unwrap_or(0) == body.len()
}

/// Any bytes from a stranger: the service answers in HTTP or hangs up, panics at nothing, and goes on.
pub(crate) fn request(bytes: &[u8]) -> bool {
    let told = answer(bytes, !is_complete(bytes));
    if !told.is_empty() {
        let text = String::from_utf8_lossy(&told);
        assert!(text.starts_with("HTTP/1."), "no HTTP: {text}");
        assert!(!text.starts_with("HTTP/1.1 500"), "a request that the service panics at: {text}");
    }
    let alive = answer(b"GET /v2/health/live HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", false);
    assert!(alive.starts_with(b"HTTP/1.1 200"), "the service is gone: {}", String::from_utf8_lossy(&alive));
    told.starts_with(b"HTTP/1.1 2")
}
