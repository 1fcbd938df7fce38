//! From a [`Scene`] to an image, with depth and instances.
//!
//! The same scene gives the same bytes on every machine and for any number of threads: one frame is one thread's work in a fixed order (frames go
//! to different threads), and only operations that IEEE 754 defines to the last bit are used.
//!
//! # Why our own
//! Looked for first was a maintained crate that renders triangles without a graphics driver, whose output differs between drivers:
//! - `euc` 0.5.3 (the last release; 2021) fills every pixel of a triangle's bounding box with two divisions each, has no anti-aliasing and no
//!   clipping. A visibility pass alone (ids and depth, 100,000 triangles of 75 samples on average, 2484x750 for 2x2 samples) took 580 to 690 ms on
//!   one core, with 30 samples a triangle 280 to 340 ms. The budget of a whole frame is 130 ms.
//! - `tiny-skia` and its like are 2D, without depth. `wgpu` and `three-d` need a driver. Ray tracers would need 1.9 million primary rays a frame.
//!
//! # How
//! 1. [`visibility`]: which triangle each of a pixel's four samples sees, with 1/w as depth.
//! 2. [`shadow`]: depth maps from the sun (near and far) and from above, for the shade beneath and beside things. [`lamps`]: which lamps to ask.
//! 3. Each distinct triangle in a pixel is shaded once and weighted with its samples: [`pattern`], [`shade`], [`sky`].

mod lamps;
mod noise;
mod pattern;
mod raster;
mod shade;
mod shadow;
mod sky;
mod surface;
pub(crate) mod view;
pub(crate) mod visibility;

use lamps::Lamps;
use shade::Light;
use shadow::Shadows;
use surface::{Weights, vertices};
use view::View;
use visibility::{Drawn, NOTHING, OFFSETS, SAMPLES, Visibility};

use crate::scene::{Color, InstanceId, Scene, Triangle, Vec3};
use crate::vector::{add_scaled, dot, normalized, scale, sub};

/// A rendered scene. Images are row by row from the top left, `width * height` values.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Colour, linear light, not limited to 1.
    pub color: Vec<Color>,
    /// z of what most of the pixel shows, metres; infinite for the sky. At the pixel's centre, or amid the samples that see it.
    pub depth_m: Vec<f32>,
    /// Instance that most of the pixel shows; 0 for the world and the sky.
    pub instance: Vec<InstanceId>,
    /// Samples (four a pixel) in which each instance is seen, by instance.
    pub visible: Vec<u32>,
    /// Samples inside the image that each instance would fill if nothing hid it, by instance; 0 for the world.
    pub alone: Vec<u32>,
}

/// Renders a scene.
///
/// # Panics
/// When a triangle names a vertex or a material that is not there.
pub fn render(scene: &Scene) -> Rendered {
    let view = View::new(&scene.camera);
    let seen = Visibility::of(scene, &view);
    let alone = visibility::alone(scene, &view);
    let [width, height] = scene.image_size;
    let mut rendered = Rendered {
        size: scene.image_size,
        color: Vec::with_capacity(width * height),
        depth_m: Vec::with_capacity(width * height),
        instance: Vec::with_capacity(width * height),
        visible: vec![0; alone.len()],
        alone,
    };
    let (shadows, lamps) = (Shadows::of(scene, &view), Lamps::of(scene, &view));
    let mut shader = Shader { scene, view: &view, seen: &seen, shadows: &shadows, lamps: &lamps, last: None };
    for y in 0..height {
        for x in 0..width {
            rendered.push(&shader.pixel(x, y));
        }
    }
    rendered
}

impl Rendered {
    fn push(&mut self, pixel: &Pixel) {
        let shares = &pixel.shares[..pixel.count];
        let mut color = [0.0; 3];
        for share in shares {
            color = add_scaled(color, share.color, share.samples as f32 / SAMPLES as f32);
            self.visible[usize::from(share.instance)] += share.samples;
        }
        let of_instance = |i: InstanceId| shares.iter().filter(|s| s.instance == i).map(|s| s.samples).sum::<u32>();
        let most = shares.iter().rev().max_by_key(|s| (of_instance(s.instance), s.samples));
        self.color.push(color);
        self.depth_m.push(most.map_or(f32::INFINITY, |s| s.depth_m));
        self.instance.push(most.map_or(0, |s| s.instance));
    }
}

/// What one triangle, or the sky, gives to a pixel.
#[derive(Debug, Clone, Copy, Default)]
struct Share {
    samples: u32,
    color: Color,
    depth_m: f32,
    instance: InstanceId,
}

/// What a pixel shows.
#[derive(Default)]
struct Pixel {
    shares: [Share; SAMPLES],
    count: usize,
}

/// Shades pixels; neighbours mostly show the same triangle, so the last one is kept.
struct Shader<'a> {
    scene: &'a Scene,
    view: &'a View,
    seen: &'a Visibility,
    shadows: &'a Shadows,
    lamps: &'a Lamps<'a>,
    last: Option<(u32, Face<'a>)>,
}

/// A triangle prepared for shading.
#[derive(Clone, Copy)]
struct Face<'a> {
    weights: Weights,
    positions: [Vec3; 3],
    normals: [Vec3; 3],
    uv: [[f32; 2]; 3],
    material: &'a crate::scene::Material,
    instance: InstanceId,
}

impl<'a> Shader<'a> {
    fn pixel(&mut self, x: usize, y: usize) -> Pixel {
        let numbers = self.seen.numbers(y * self.scene.image_size[0] + x);
        let mut pixel = Pixel::default();
        for (sample, &number) in numbers.iter().enumerate() {
            if numbers[..sample].contains(&number) {
                continue;
            }
            let (samples, [dx, dy]) = centroid(&numbers, number);
            let light = Light { scene: self.scene, shadows: self.shadows, lamps: self.lamps.at(x, y) };
            let share = self.share(number, &light, [x as f32 + dx, y as f32 + dy]);
            pixel.shares[pixel.count] = Share { samples, ..share };
            pixel.count += 1;
        }
        pixel
    }

    /// What the triangle looks like at a place in the image.
    fn share(&mut self, number: u32, light: &Light, [u, v]: [f32; 2]) -> Share {
        if number == NOTHING {
            let direction = normalized(self.view.direction(u, v));
            let color = sky::color(self.scene, direction);
            return Share { color, depth_m: f32::INFINITY, ..Share::default() };
        }
        let face = self.face(number);
        let at = face.weights.at(u, v);
        let position = at.vector(face.positions);
        let normal = normalized(at.vector(face.normals));
        let towards_eye = sub(self.view.eye, position);
        let normal = if dot(normal, towards_eye) < 0.0 { scale(normal, -1.0) } else { normal };
        let (uv, footprint) = at.uv(face.uv);
        let fragment = shade::Fragment { position, normal, uv, footprint, material: face.material };
        let color = shade::color(light, self.view.eye, &fragment);
        Share { samples: 0, color, depth_m: position[2], instance: face.instance }
    }

    fn face(&mut self, number: u32) -> Face<'a> {
        if let Some((_, face)) = self.last.filter(|(last, _)| *last == number) {
            return face;
        }
        let face = self.prepared(self.seen.drawn(number));
        self.last = Some((number, face));
        face
    }

    fn prepared(&self, drawn: Drawn) -> Face<'a> {
        let object = &self.scene.objects[drawn.object as usize];
        let triangle: &Triangle = &object.mesh.triangles[drawn.triangle as usize];
        let corners = vertices(object, triangle);
        Face {
            weights: Weights::new(corners.map(|c| self.view.homogeneous(c.position))),
            positions: corners.map(|c| c.position),
            normals: corners.map(|c| c.normal),
            uv: corners.map(|c| c.uv),
            material: &self.scene.materials[usize::from(triangle.material)],
            instance: object.instance,
        }
    }
}

/// How many samples see `number`, and the middle of them.
fn centroid(numbers: &[u32; SAMPLES], number: u32) -> (u32, [f32; 2]) {
    let mut sum = [0.0, 0.0];
    let mut count = 0;
    for (offset, _) in OFFSETS.iter().zip(numbers).filter(|(_, n)| **n == number) {
        sum = [sum[0] + offset[0], sum[1] + offset[1]];
        count += 1;
    }
    (count, sum.map(|s| s / count as f32))
}
