//! What can be chosen about the ranging protocol.

use farsight_core::depth_fusion::NORMAL_INTERVAL_SIGMAS;

use crate::bootstrap::Bootstrap;

/// A detection finds an object when their 2D boxes overlap by at least this much, unless the options say otherwise.
pub const MATCH_IOU: f64 = 0.5;

/// The ranging protocol with what can be chosen about it.
#[derive(Debug, Clone, PartialEq)]
pub struct RangingOptions {
    /// Detections with a lower score take no part; `None` takes all.
    pub min_score: Option<f64>,
    /// Smallest 2D overlap (`IoU`) at which a detection finds an object; [`MATCH_IOU`] in the protocol.
    pub min_iou: f64,
    /// How intervals are found; `None` leaves them out.
    pub bootstrap: Option<Bootstrap>,
    /// Half the widths of the intervals that are said to hold 50 and 90% of the distances, error bars. A model may know
    /// its own ([`farsight_core::DepthFusion::interval_sigmas`]); else those of a normal distribution.
    pub interval_sigmas: [f64; 2],
}

impl Default for RangingOptions {
    /// All detections, 1,000 resamples.
    fn default() -> Self {
        Self {
            min_score: None,
            min_iou: MATCH_IOU,
            bootstrap: Some(Bootstrap::default()),
            interval_sigmas: NORMAL_INTERVAL_SIGMAS,
        }
    }
}
