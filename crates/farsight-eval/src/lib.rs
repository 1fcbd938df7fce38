//! The KITTI evaluation and ranging errors.
//!
//! Nothing here needs the disk: a trainer hands in [`Frame`]s as they come and asks for the report.
//!
//! ```
//! use farsight_core::{Box2d, Box3d, Detection, Dimensions, Label, ObjectClass};
//! use farsight_eval::ap::{Metric, OverlapSet};
//! use farsight_eval::ranging::{RangingMetric, Group, RangingOptions};
//! use farsight_eval::{Difficulty, EvaluatedClass, Evaluation, Frame};
//!
//! # fn validation_set() -> impl Iterator<Item = (String, Vec<Label>)> {
//! #     let car = |i: i32| {
//! #         let x = f64::from(i % 5) * 6.0 - 12.0;
//! #         let dimensions = Dimensions { height: 1.5, width: 1.6, length: 4.0 };
//! #         let box3d = Box3d { dimensions, location: [x, 1.7, 20.0], yaw: 0.0 };
//! #         let box2d = Box2d::new(600.0 + 36.0 * x - 50.0, 170.0, 600.0 + 36.0 * x + 50.0, 225.0);
//! #         Label { class: ObjectClass::Car, truncation: 0.0, occlusion: 0, alpha: box3d.alpha(), box2d, box3d }
//! #     };
//! #     (0..50).map(move |i| (format!("{i:06}"), vec![car(i)]))
//! # }
//! # fn detect(labels: &[Label]) -> Vec<Detection> {
//! #     let near = |label: &Label| {
//! #         let Label { class, box2d, mut box3d, .. } = label.clone();
//! #         box3d.location[2] += 0.2;
//! #         Detection { class, score: 0.8, box2d, box3d, range_sigma_m: None }
//! #     };
//! #     labels.iter().map(near).collect()
//! # }
//! // Intervals take most of the time of a small set; after an epoch nobody needs them.
//! let mut evaluation = Evaluation::new(RangingOptions { bootstrap: None, ..RangingOptions::default() });
//! for (id, labels) in validation_set() {
//!     let detections = detect(&labels); // The network under training.
//!     evaluation.add(&Frame::new(id, labels, detections));
//! }
//! let report = evaluation.report();
//!
//! let ap = report.ap.ap(OverlapSet::Strict, Metric::Box3d, EvaluatedClass::Car).ok_or("no car was detected")?;
//! println!("3D AP, moderate: {:.2} (R40), {:.2} (R11)", ap.r40[1], ap.r11[1]);
//! let moderate = Group::Level(Difficulty::Moderate);
//! let ranging = &report.ranging.group(EvaluatedClass::Car, moderate).ok_or("there is no car")?.whole;
//! println!("{} of {} found, MAE {:?} m", ranging.found, ranging.objects, ranging.metrics.get(RangingMetric::MaeZ));
//! # assert!((ap.r40[1] - 100.0).abs() < 1e-9);
//! # assert!((ranging.metrics.get(RangingMetric::MaeZ).unwrap() - 0.2).abs() < 1e-9);
//! # assert_eq!((ranging.found, ranging.objects), (50, 50));
//! # Ok::<(), &str>(())
//! ```
//!
//! | module | what it is for |
//! |---|---|
//! | [`ap`] | how good is the detector by KITTI's average precision? |
//! | [`ranging`] | how far off are the distances, and of how many objects? |
//! | [`evaluation`] | frames in, report out: both of the above |
//! | [`compare`], [`paired`] | do two result sets, or two arms of an experiment, differ? |
//! | [`oracle`] | what would AP be if one part of each detection were true? |
//! | [`explain`] | what became of each object and detection of one frame? |
//! | [`frame`], [`class`], [`difficulty`] | what is evaluated, and the devkit's rules of what counts |
//! | [`files`], [`findings`] | folders of label and result files, and what is odd about them |
//! | [`tracking`] | how good are tracks: HOTA, CLEAR, identity metrics |
//! | [`tracks`] | tracks of sequences against labels: these metrics, errors of distance, speed, time to collision |
//! | [`text`], `page` | the report for people: tables and notes, HTML and charts |

pub mod ap;
mod bootstrap;
pub mod class;
pub mod compare;
pub mod difficulty;
pub mod evaluation;
pub mod explain;
pub mod files;
pub mod findings;
pub mod frame;
mod label_source;
pub mod oracle;
#[cfg(feature = "page")]
pub mod page;
pub mod paired;
mod parts;
pub mod ranging;
pub mod text;
pub mod tracking;
pub mod tracks;

pub use bootstrap::{Bootstrap, Interval};
pub use class::EvaluatedClass;
pub use difficulty::Difficulty;
pub use evaluation::{Evaluation, Report};
pub use files::{FilesError, FrameFiles, Scores};
pub use findings::{Finding, Findings};
pub use frame::{Frame, Prediction};
pub use label_source::LabelSource;
pub use parts::{DISTANCE_BINS, HEIGHT_BINS, OCCLUSIONS, Part, TRUNCATIONS};
