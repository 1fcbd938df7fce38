//! What all requests share.

use std::sync::Arc;

use axum::extract::State;
use tokio::sync::watch;

use super::metrics::Metrics;
use super::queue::Queue;
use super::videos::Videos;
use super::{Config, ModelCard};

/// What all requests share.
pub(super) struct Shared {
    pub(super) queue: Queue,
    pub(super) metrics: Arc<Metrics>,
    pub(super) config: Config,
    pub(super) card: ModelCard,
    pub(super) videos: Videos,
    pub(super) stopped: watch::Receiver<bool>,
}

/// [`Shared`], as handlers get it.
pub(super) type Service = State<Arc<Shared>>;
