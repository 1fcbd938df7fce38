//! What is written down of requests: no picture, no name of a file, no address of a client.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::Serialize;

/// Something that happened.
#[derive(Debug, Clone, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
#[non_exhaustive]
pub enum LogRecord {
    /// A request was answered.
    Request {
        /// When, seconds since 1970 (UTC).
        time_s: f64,
        /// The request's identity: what it brought as `X-Request-Id`, or a new one. The response has it, too.
        id: String,
        /// GET or POST.
        method: String,
        /// The path as docs/service.md has it, with names in braces; empty for others.
        route: String,
        /// Status of the response.
        status: u16,
        /// One word for what went wrong; `ok`.
        reason: &'static str,
        /// From the head of the request to the head of the response, milliseconds.
        took_ms: f64,
    },
    /// A video began, ended or failed.
    Video {
        /// When, seconds since 1970 (UTC).
        time_s: f64,
        /// Its name.
        video: String,
        /// What happened, for the people who run the service: it may name files and addresses.
        message: String,
    },
}

/// Who is told of each [`LogRecord`].
#[derive(Clone)]
pub struct Log(Arc<dyn Fn(&LogRecord) + Send + Sync>);

impl Log {
    /// A log that hands everything to `tell`.
    pub fn new(tell: impl Fn(&LogRecord) + Send + Sync + 'static) -> Self {
        Self(Arc::new(tell))
    }

    pub(super) fn tell(&self, record: &LogRecord) {
        (self.0)(record);
    }
}

impl Default for Log {
    /// A log that nobody reads.
    fn default() -> Self {
        Self::new(|_| {})
    }
}

impl fmt::Debug for Log {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Log")
    }
}

/// Seconds since 1970.
pub(super) fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs_f64()
}
