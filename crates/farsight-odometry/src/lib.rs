//! How a camera drives, from what it sees: speed, yaw rate and nodding from the road and the standing world, each with
//! its error bar.
//!
//! [`Odometry::update`] takes one picture after the other and answers how the camera moved between the last two. No
//! file is read here. An image knows no metres: scale comes from the camera's height above the road. Where the speed is
//! known instead, [`HeightEstimator`] tells that height.
//!
//! Frames of reference are KITTI's: x right, y down, z forward, metres. Turns are to the left, nods downwards, rolls to
//! the right side.
//!
//! # Method
//! Two pictures, grey and about 640 pixels wide (`grey`). Of each cell of the first the patch with most texture
//! (`corners`) is looked for in the second: pyramidal Lucas and Kanade's method, forwards and backwards (`flow`). A
//! patch of the road is warped on its way as the road would be, by the motion that the last frames let expect. Each
//! flow has the covariance that its patch's texture gives it: along an edge it says nothing.
//!
//! A flow is of the road, of something else that stands still at an unknown distance, or wrong: a mixture (`mixture`).
//! Of the road, plane and motion tell both its components. Of other things that stand, the component across the line
//! to where the camera drives is known, and both if they are far. `fit` looks for the likeliest motion: from the one
//! that was expected and from some that few flows suggest, by expectation and maximisation (Gauss and Newton). What is
//! known before (`prior`): cars go forwards, do not jump, and move much as they did in the last frame.
//!
//! | module | what it is for |
//! |---|---|
//! | `grey` | grey pictures and their pyramids |
//! | `corners` | where a picture has texture |
//! | `flow` | where a patch went |
//! | `motion` | where a motion sends a point |
//! | `prior` | what is known before a picture is looked at |
//! | `mixture` | road, something else that stands, or wrong |
//! | `fit` | the likeliest motion |
//! | `tracking` | from two pictures to flows |
//! | `odometry` | picture after picture |
//! | `height` | how high the camera is, from how fast it drives |

mod corners;
mod fit;
mod flow;
mod grey;
mod height;
mod mixture;
mod motion;
mod odometry;
mod prior;
mod tracking;

pub use height::HeightEstimator;
pub use odometry::{CameraMotion, Odometry, OdometryFrame};
