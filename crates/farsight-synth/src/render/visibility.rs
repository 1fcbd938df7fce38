//! Which triangle each sample of the image sees.

use wide::{bytemuck::cast, f32x4, u32x4};

use super::raster::{Corner, Grid, Target, fill};
use super::surface::Cutout;
use super::view::{NEAR_M, View};
use crate::scene::{Object, Scene, Triangle};

/// Samples a pixel.
pub(crate) const SAMPLES: usize = 4;

/// Where they lie, relative to the pixel's centre: a rotated grid, which smooths nearly level and nearly upright edges best.
pub(crate) const OFFSETS: [[f32; 2]; SAMPLES] = [[-0.125, -0.375], [0.375, -0.125], [-0.375, 0.125], [0.125, 0.375]];

/// How much nearer each layer of paint counts than the surface below: bridges 3 mm of height seen from 1.5 m above.
const NEARER_PER_LAYER: f32 = 0.002;

/// The number of "nothing there".
pub(crate) const NOTHING: u32 = 0;

/// A triangle that was drawn.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drawn {
    /// Index of its object.
    pub(crate) object: u32,
    /// Index in the object's mesh.
    pub(crate) triangle: u32,
}

/// What the samples of one pixel see.
#[derive(Clone, Copy)]
pub(crate) struct Samples {
    /// 1 / w of the nearest surface; 0 where there is none.
    nearness: f32x4,
    /// [`NOTHING`], or 1 more than an index into [`Visibility::drawn`].
    numbers: u32x4,
}

/// What every sample of the image sees.
pub(crate) struct Visibility {
    grid: Grid,
    pixels: Vec<Samples>,
    drawn: Vec<Drawn>,
}

impl Visibility {
    /// Draws all triangles of the scene.
    pub(crate) fn of(scene: &Scene, view: &View) -> Self {
        let [width, height] = scene.image_size;
        let empty = Samples { nearness: f32x4::splat(0.0), numbers: u32x4::splat(NOTHING) };
        let grid = Grid { size: scene.image_size, samples: OFFSETS };
        let mut seen = Self { grid, pixels: vec![empty; width * height], drawn: Vec::new() };
        let mut corners = Vec::new();
        for (number, object) in scene.objects.iter().enumerate() {
            seen.draw_object(scene, view, number as u32, object, &mut corners);
        }
        seen
    }

    fn draw_object(&mut self, scene: &Scene, view: &View, number: u32, object: &Object, corners: &mut Vec<[f64; 3]>) {
        project(view, object, corners);
        for (index, triangle) in object.mesh.triangles.iter().enumerate() {
            self.drawn.push(Drawn { object: number, triangle: index as u32 });
            let mut layer = Layer {
                width: self.grid.size[0],
                pixels: &mut self.pixels,
                number: self.drawn.len() as u32,
                cutout: Cutout::of(scene, object, triangle, corners),
            };
            draw(&self.grid, triangle, corners, &mut layer);
        }
    }

    /// The numbers of the triangles that the samples of a pixel see.
    #[inline]
    pub(crate) fn numbers(&self, pixel: usize) -> [u32; SAMPLES] {
        self.pixels[pixel].numbers.to_array()
    }

    /// The triangle with this number, which is not [`NOTHING`].
    #[inline]
    pub(crate) fn drawn(&self, number: u32) -> Drawn {
        self.drawn[number as usize - 1]
    }
}

/// Homogeneous pixels of all the object's corners.
pub(crate) fn project(view: &View, object: &Object, corners: &mut Vec<[f64; 3]>) {
    corners.clear();
    corners.extend(object.mesh.vertices.iter().map(|vertex| view.homogeneous(vertex.position)));
}

/// Gives `target` what the camera sees of a triangle, were it alone.
pub(crate) fn draw(grid: &Grid, triangle: &Triangle, corners: &[[f64; 3]], target: &mut impl Target) {
    let nearer = 1.0 + NEARER_PER_LAYER * f32::from(triangle.layer);
    let corners = triangle.vertices.map(|v| corners[v as usize]);
    if corners.iter().all(|c| c[2] >= NEAR_M) {
        fill(grid, corners.map(divided), nearer, target);
        return;
    }
    let (clipped, count) = clipped(corners);
    for i in 2..count {
        fill(grid, [clipped[0], clipped[i - 1], clipped[i]].map(divided), nearer, target);
    }
}

#[inline]
fn divided([u, v, w]: [f64; 3]) -> Corner {
    let nearness = 1.0 / w;
    [u * nearness, v * nearness, nearness]
}

/// The part of a triangle beyond the near plane: up to four corners, and how many.
pub(crate) fn clipped(corners: [[f64; 3]; 3]) -> ([[f64; 3]; 4], usize) {
    let mut kept = [[0.0; 3]; 4];
    let mut count = 0;
    let mut keep = |corner| {
        kept[count] = corner;
        count += 1;
    };
    for i in 0..3 {
        let (here, next) = (corners[i], corners[(i + 1) % 3]);
        let (inside, next_inside) = (here[2] >= NEAR_M, next[2] >= NEAR_M);
        if inside {
            keep(here);
        }
        if inside != next_inside {
            // Always from the inner end, so that neighbours cut their common edge at the same point.
            keep(if inside { crossing(here, next) } else { crossing(next, here) });
        }
    }
    (kept, count)
}

fn crossing(inner: [f64; 3], outer: [f64; 3]) -> [f64; 3] {
    let t = (inner[2] - NEAR_M) / (inner[2] - outer[2]);
    [inner[0] + (outer[0] - inner[0]) * t, inner[1] + (outer[1] - inner[1]) * t, NEAR_M]
}

/// One triangle on its way into the image.
struct Layer<'a> {
    width: usize,
    pixels: &'a mut [Samples],
    number: u32,
    cutout: Option<Cutout>,
}

impl Target for Layer<'_> {
    #[inline]
    fn put(&mut self, x: usize, y: usize, inside: f32x4, nearness: f32x4) {
        let samples = &mut self.pixels[y * self.width + x];
        let mut nearer = inside & nearness.simd_gt(samples.nearness);
        if nearer.to_bitmask() == 0 {
            return;
        }
        if let Some(cutout) = &self.cutout {
            nearer &= cutout.kept(x, y);
        }
        samples.nearness = nearer.bitselect(nearness, samples.nearness);
        let mask: u32x4 = cast(nearer);
        samples.numbers = mask.bitselect(u32x4::splat(self.number), samples.numbers);
    }
}

/// How many samples of the image each instance would fill if nothing hid it.
pub(crate) fn alone(scene: &Scene, view: &View) -> Vec<u32> {
    let instances = scene.objects.iter().map(|o| usize::from(o.instance)).max().unwrap_or(0);
    let grid = Grid { size: scene.image_size, samples: OFFSETS };
    let mut corners = Vec::new();
    let mut mask = Mask { width: grid.size[0], samples: vec![0; grid.size[0] * grid.size[1]], cutout: None, count: 0 };
    let mut counts = vec![0; instances + 1];
    for instance in 1..=instances {
        mask.count = 0;
        for object in scene.objects.iter().filter(|o| usize::from(o.instance) == instance) {
            project(view, object, &mut corners);
            for triangle in &object.mesh.triangles {
                mask.cutout = Cutout::of(scene, object, triangle, &corners);
                draw(&grid, triangle, &corners, &mut mask);
            }
        }
        counts[instance] = mask.count;
        mask.samples.fill(0);
    }
    counts
}

/// Samples covered so far by one instance.
struct Mask {
    width: usize,
    /// One bit a sample.
    samples: Vec<u8>,
    cutout: Option<Cutout>,
    count: u32,
}

impl Target for Mask {
    #[inline]
    fn put(&mut self, x: usize, y: usize, inside: f32x4, _: f32x4) {
        let kept = self.cutout.as_ref().map_or(inside, |cutout| inside & cutout.kept(x, y));
        let covered = &mut self.samples[y * self.width + x];
        let new = kept.to_bitmask() as u8 & !*covered;
        self.count += new.count_ones();
        *covered |= new;
    }
}
