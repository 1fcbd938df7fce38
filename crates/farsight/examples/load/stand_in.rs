//! The service around a stand-in for the pipeline.

use std::error::Error;
use std::io::Read;
use std::net::TcpListener;
use std::path::Path;
use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;

use farsight::service::{Config, Infer, Inference, ModelCard, Server};
use farsight::{ImageLimits, RangeError, StageTimes, ViewSource};
use farsight_data::decode_image;

/// What the stand-in takes for an image that it does not like, and one at which it panics.
pub(crate) const NO_IMAGE: &[u8] = b"no image";
pub(crate) const PANIC: &[u8] = b"panic";

/// Takes 1 ms and finds nothing.
struct StandIn;

impl Infer for StandIn {
    fn infer(&self, bytes: &[u8], name: &Path, _: &ViewSource) -> Result<Inference, RangeError> {
        sleep(Duration::from_millis(1));
        assert!(bytes != PANIC, "a panic that was asked for");
        if bytes == NO_IMAGE {
            decode_image(bytes, name, ImageLimits::default())?;
        }
        let record = r#"{"image": "image", "width": 1, "height": 1, "detections": []}"#;
        let record = serde_json::from_str(record).unwrap_or_else(|error| panic!("{error}"));
        Ok(Inference { record, times: StageTimes::default() })
    }

    fn card(&self) -> ModelCard {
        ModelCard { name: "stand-in".to_owned(), version: "1".to_owned(), platform: "none".to_owned() }
    }
}

/// What the words ask for; a queue as `farsight serve` has it.
fn config(words: &[String]) -> Result<Config, Box<dyn Error>> {
    let mut config = Config::default();
    for pair in words.chunks(2) {
        let number = pair.get(1).and_then(|number| number.parse().ok()).filter(|number| *number > 0);
        match (pair[0].as_str(), number) {
            ("--workers", Some(number)) => config.workers = number,
            ("--batch", Some(number)) => config.batch = number,
            _ => return Err(format!("{pair:?}; expected --workers N or --batch N").into()),
        }
    }
    Ok(config)
}

/// Answers until standard input ends.
pub(crate) fn serve(words: &[String]) -> Result<(), Box<dyn Error>> {
    let config = config(words)?;
    // Thousands of panics are asked for.
    std::panic::set_hook(Box::new(|_| {}));
    let infer: Arc<dyn Infer> = Arc::new(StandIn);
    let server = Server::start(TcpListener::bind("127.0.0.1:0")?, &infer, config)?;
    println!("{}", server.address());
    std::io::stdin().read_to_end(&mut Vec::new())?;
    server.stop();
    Ok(())
}
