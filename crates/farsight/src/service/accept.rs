//! Connections: accepting, TLS, and cutting off those who are slow.

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tokio::time::{sleep, timeout};
use tokio_rustls::TlsAcceptor;

use super::patience::Patience;
use super::shared::Shared;
use super::{Config, PAUSE, http, unless};

/// How long requests that are inside have when the service ends.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(30);

/// Accepts connections until the service ends, and waits for what is inside then.
pub(super) async fn accept(listener: TcpListener, shared: Arc<Shared>, mut stopped: watch::Receiver<bool>) {
    let connections = Arc::new(Semaphore::new(shared.config.max_connections.max(1)));
    let (service, graceful) = (http::router(Arc::clone(&shared)), GracefulShutdown::new());
    let acceptor = shared.config.tls.as_ref().map(super::Tls::acceptor);
    let mut stopping = Box::pin(async move {
        // A server that is gone has been stopped, too.
        let _ = stopped.wait_for(|stopped| *stopped).await;
    });
    loop {
        let next = Box::pin(async {
            let permit = Arc::clone(&connections).acquire_owned().await;
            (permit, listener.accept().await)
        });
        let Some((permit, accepted)) = unless(&mut stopping, next).await else { break };
        let (Ok(permit), Ok((stream, _))) = (permit, accepted) else {
            sleep(PAUSE).await;
            continue;
        };
        let open = shared.metrics.connections().clone();
        let connection =
            Connection { service: service.clone(), watcher: graceful.watcher(), shared: Arc::clone(&shared) };
        let acceptor = acceptor.clone();
        tokio::spawn(async move {
            open.inc();
            connection.serve(stream, acceptor).await;
            open.dec();
            drop(permit);
        });
    }
    drop(listener);
    // What is inside after this long is cut off with the runtime.
    let _ = timeout(DRAIN_TIMEOUT, graceful.shutdown()).await;
}

/// What a connection needs.
struct Connection {
    service: Router,
    watcher: Watcher,
    shared: Arc<Shared>,
}

impl Connection {
    async fn serve(self, stream: TcpStream, acceptor: Option<TlsAcceptor>) {
        // Answers are written in one piece; waiting for more only makes them late.
        let _ = stream.set_nodelay(true);
        let Config { write_timeout, least_write_rate, header_timeout, .. } = self.shared.config;
        let stream = Patience::new(stream, write_timeout, least_write_rate);
        let Some(acceptor) = acceptor else { return self.answer(stream).await };
        // A client that speaks no TLS, or none that is spoken here, has nothing to wait for.
        if let Ok(Ok(stream)) = timeout(header_timeout, acceptor.accept(stream)).await {
            self.answer(stream).await;
        }
    }

    async fn answer(self, stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static) {
        let mut builder = http1::Builder::new();
        builder.timer(TokioTimer::new()).header_read_timeout(self.shared.config.header_timeout);
        let service = TowerToHyperService::new(self.service);
        // A client that went away, reads too slowly, or speaks no HTTP.
        let _ = self.watcher.watch(builder.serve_connection(TokioIo::new(stream), service)).await;
    }
}
