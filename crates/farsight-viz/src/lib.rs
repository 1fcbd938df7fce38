//! Detections drawn on the image and seen from above.
//!
//! [`picture`] is the one to show: the annotated image with the bird's-eye view beside or below it. [`annotate`] and
//! [`birds_eye`] are its two halves. All of them take a [`Scene`] and answer an RGB image; sizes of lines and text
//! follow the size of the image. No fonts or libraries of the system are needed. What does not fit in the picture is
//! cut off; nothing here fails or panics on odd input.
//!
//! The front of a vehicle is its crossed, tinted face in the image and its arrow head from above. In the bird's-eye
//! view the camera looks up the page, the rings are distances over the ground.

mod annotate;
mod birds_eye;
mod canvas;
mod label_layout;
mod legend;
mod options;
mod palette;
mod picture;
mod scale;
mod text;
mod wireframe;

pub use annotate::{annotate, annotate_named};
pub use birds_eye::birds_eye;
pub use options::{ColorBy, DrawOptions, Names, Scene};
pub use palette::distance_text;
pub use picture::{picture, picture_divisor, picture_with_words};
