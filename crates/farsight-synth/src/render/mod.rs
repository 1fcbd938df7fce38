//! From a [`Scene`] to an image, with depth and instances.
//!
//! The same scene gives the same bytes on every machine and for any number of threads: one frame is one thread's work
//! in a fixed order (frames go to different threads), and only operations that IEEE 754 defines to the last bit are
//! used.
//!
//! # Why our own
//! Looked for first was a maintained crate that renders triangles without a graphics driver (pictures differ from
//! driver to driver):
//! - `euc` 0.5.3 (the newest release) fills every pixel of a triangle's bounding box with two divisions each, has no
//!   anti-aliasing and no clipping. A visibility pass alone (ids and depth, 100,000 triangles of 75 samples on
//!   average, 2484x750 for 2x2 samples) took 580 to 690 ms on one core, with 30 samples a triangle 280 to 340 ms. The
//!   budget of a whole frame is 130 ms.
//! - `tiny-skia` and its like are 2D, without depth. `wgpu` and `three-d` need a driver. Ray tracers would need 1.9
//!   million primary rays a frame.
//!
//! # How
//! 1. `visibility`: which triangle each of a pixel's four samples sees, with 1/w as depth. Near objects first, holes
//!    last.
//! 2. `shadow`: depth maps from the sun (near and far) and from above, for the shade beneath and beside things.
//!    `lamps`: which lamps to ask.
//! 3. Each distinct triangle in a pixel is shaded once and weighted with its samples; four of one material at a time:
//!    `resolve`, `pattern`, `shade`, `sky`.
//!
//! # What it costs
//! A finished frame of 1242x375 pixels (scene, picture, sensor, labels) takes 1.0 thousand million instructions,
//! of which the picture takes four fifths: a median of 168 ms on one core of a busy EPYC that ran at 3.1 GHz and
//! shared its caches with four other programs (`cargo run --release -p farsight-synth --example render_speed -- 16
//! 11`).

mod depth_map;
mod lamps;
mod lanes;
mod noise;
mod pattern;
mod photographs;
mod pieces;
mod projected;
mod raster;
mod rendered;
mod resolve;
mod samples;
mod shade;
mod shadow;
mod sky;
mod surface;
mod view;
mod visibility;

pub use rendered::Rendered;

use lamps::Lamps;
use resolve::Resolver;
use shadow::Shadows;
use view::View;
use visibility::Visibility;

use crate::scene::Scene;

/// Renders a scene.
///
/// # Panics
/// When a triangle names a vertex or a material that is not there.
pub fn render(scene: &Scene) -> Rendered {
    let view = View::new(&scene.camera);
    let seen = Visibility::of(scene, &view);
    let amodal = visibility::amodal(scene, &view);
    let [width, height] = scene.image_size;
    let mut rendered = Rendered {
        size: scene.image_size,
        color: Vec::with_capacity(width * height),
        depth_m: Vec::with_capacity(width * height),
        instance: Vec::with_capacity(width * height),
        visible: vec![0; amodal.len()],
        amodal,
    };
    let (shadows, lamps) = (Shadows::of(scene, &view), Lamps::of(scene, &view));
    Resolver::new(scene, &view, &seen, &shadows, &lamps).resolve(&mut rendered);
    rendered
}
