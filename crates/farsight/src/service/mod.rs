//! The pipeline as a service over HTTP: what `farsight serve` runs.
//!
//! A [`Server`] looks at images with an [`Infer`], a [`Pipeline`](crate::Pipeline) in use. At most so many requests are
//! inside at once; one more is refused at once with 429, before its body is read. What waited past its deadline is
//! answered with 504 and never begun. A panic of one request answers 500 and harms no other. Films and cameras run
//! while somebody watches them. No image is kept.

mod accept;
mod calibrate;
mod camera_query;
mod guard;
mod http;
mod infer;
mod inference;
mod log;
mod metrics;
mod patience;
mod queue;
mod range;
mod rejection;
mod shared;
mod streams;
mod tls;
mod token;
mod videos;

use std::collections::BTreeMap;
use std::future::poll_fn;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::pin::Pin;
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;

use tokio::runtime::Runtime;
use tokio::sync::watch;
use tokio::task::JoinHandle;

use crate::ViewSource;
use metrics::Metrics;
use queue::Queue;
use shared::Shared;
use videos::Videos;

pub use infer::{AskedImage, Infer, Inference, ModelCard};
pub use log::{Log, LogRecord};
pub use rejection::Rejection;
pub use tls::{Tls, TlsError};
pub use token::{Token, TokenError};
pub use videos::{SourceFrame, SourceFrames, Video, VideoFailure};

/// Most pixels of an image, told from its header.
pub const MAX_PIXELS: u64 = 40_000_000;

/// Largest body of a request, bytes.
pub const MAX_BODY_BYTES: usize = 16 << 20;

/// How long the service waits after an error of the system, for want of file handles for instance.
const PAUSE: Duration = Duration::from_millis(50);

/// What a service promises.
#[derive(Debug, Clone)]
pub struct Config {
    /// Threads that look at images, each with networks of its own.
    pub workers: usize,
    /// Images that such a thread looks at together.
    pub batch: usize,
    /// How long the first image of such a batch waits for others, if nothing else holds it up.
    pub batch_wait: Duration,
    /// Requests that wait beside those that are looked at.
    pub queue: usize,
    /// Time from the request's head to the beginning of the work.
    pub deadline: Duration,
    /// What requests must bring, if anything.
    pub token: Option<Token>,
    /// Cameras by the names that requests may use.
    pub cameras: BTreeMap<String, ViewSource>,
    /// Films and cameras that may be watched, by their names.
    pub videos: BTreeMap<String, Arc<dyn Video>>,
    /// Names of hosts that requests may be for, beside addresses and localhost; any, where there is a token.
    pub hosts: Vec<String>,
    /// The certificate, if it speaks TLS.
    pub tls: Option<Tls>,
    /// Connections that are open at once; further ones wait to be accepted.
    pub max_connections: usize,
    /// How long a connection may take to say what it wants, and before that for the handshake of TLS.
    pub header_timeout: Duration,
    /// A client that takes nothing of its answer for so long is cut off.
    pub write_timeout: Duration,
    /// Bytes a second of which a client that lets answers wait must take more, or it is cut off some time later.
    pub least_write_rate: u64,
    /// Who is told of each request.
    pub log: Log,
}

impl Default for Config {
    /// One worker, no batches, 32 that wait, ten seconds, no token, no TLS.
    fn default() -> Self {
        Self {
            workers: 1,
            batch: 1,
            batch_wait: Duration::from_millis(5),
            queue: 32,
            deadline: Duration::from_secs(10),
            token: None,
            cameras: BTreeMap::new(),
            videos: BTreeMap::new(),
            hosts: Vec::new(),
            tls: None,
            max_connections: 256,
            header_timeout: Duration::from_secs(10),
            write_timeout: Duration::from_secs(10),
            least_write_rate: 8 << 10,
            log: Log::default(),
        }
    }
}

/// A running service.
pub struct Server {
    address: SocketAddr,
    runtime: Runtime,
    stop: watch::Sender<bool>,
    accepting: JoinHandle<()>,
}

impl Server {
    /// Begins to answer on `listener`.
    ///
    /// # Errors
    /// When the system gives no threads, or the listener is none.
    pub fn start(listener: TcpListener, infer: &Arc<dyn Infer>, config: Config) -> io::Result<Self> {
        let address = listener.local_addr()?;
        listener.set_nonblocking(true)?;
        let metrics = Arc::new(Metrics::new());
        let queue = Queue::start(infer, &config, Arc::clone(&metrics))?;
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
        let (stop, stopped) = watch::channel(false);
        let videos = Videos::new(&config.videos, &metrics, &config.log, &stopped);
        let card = infer.card();
        let shared = Arc::new(Shared { queue, metrics, config, card, videos, stopped: stopped.clone() });
        let listener = {
            let _inside = runtime.enter();
            tokio::net::TcpListener::from_std(listener)?
        };
        let accepting = runtime.spawn(accept::accept(listener, shared, stopped));
        Ok(Self { address, runtime, stop, accepting })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Accepts nothing more, answers what is inside, and ends.
    pub fn stop(self) {
        let Self { runtime, stop, accepting, .. } = self;
        stop.send_replace(true);
        // An accept loop that panicked has nothing left to wait for.
        let _ = runtime.block_on(accepting);
        runtime.shutdown_timeout(PAUSE);
    }

    /// Answers until the process is asked to end (SIGTERM, Ctrl-C), then stops as [`Server::stop`].
    ///
    /// # Errors
    /// When the system does not tell of signals; the service ends then.
    pub fn run_until_signal(self) -> io::Result<()> {
        let told = self.runtime.block_on(signal());
        self.stop();
        told
    }
}

#[cfg(unix)]
async fn signal() -> io::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let (mut terminate, mut interrupt) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
    let terminated = std::pin::pin!(terminate.recv());
    let interrupted = std::pin::pin!(interrupt.recv());
    unless(terminated, interrupted).await;
    Ok(())
}

#[cfg(not(unix))]
async fn signal() -> io::Result<()> {
    tokio::signal::ctrl_c().await
}

/// Waits for `work`, or for `end` if that comes first: then none. If both are there, it is the end.
async fn unless<A, B>(mut end: A, mut work: B) -> Option<B::Output>
where
    A: Future + Unpin,
    B: Future + Unpin,
{
    poll_fn(move |context| match Pin::new(&mut end).poll(context) {
        Poll::Ready(_) => Poll::Ready(None),
        Poll::Pending => Pin::new(&mut work).poll(context).map(Some),
    })
    .await
}
