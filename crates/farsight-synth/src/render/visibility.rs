//! Which triangle each sample of the image sees.

use wide::{bytemuck::cast, f32x4, u32x4};

use super::pattern::Holes;
use super::projected::{draw, project};
use super::raster::{Grid, Target};
use super::samples::{OFFSETS, SAMPLES};
use super::surface::Cutout;
use super::view::View;
use crate::scene::{InstanceId, Object, Scene};

/// The number of "nothing there".
pub(crate) const NOTHING: u32 = 0;

/// A triangle that was drawn.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DrawnTriangle {
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
    width: usize,
    pixels: Vec<Samples>,
    tiles: Tiles,
    drawn: Vec<DrawnTriangle>,
}

impl Visibility {
    /// Draws all triangles of the scene.
    pub(crate) fn of(scene: &Scene, view: &View) -> Self {
        let [width, height] = scene.image_size;
        let empty = Samples { nearness: f32x4::ZERO, numbers: u32x4::splat(NOTHING) };
        let tiles = Tiles::new(scene.image_size);
        let mut seen = Self { width, pixels: vec![empty; width * height], tiles, drawn: Vec::new() };
        let grid = Grid::new(scene.image_size, OFFSETS);
        let mut corners = Vec::new();
        let all_holes = Holes::of_all(&scene.materials);
        let mut summed_up = 0;
        // What has no holes first and what is near first: most of what is hidden then needs no second look.
        for with_holes in [false, true] {
            for &number in &nearest_first(scene) {
                let object = &scene.objects[number];
                if with_holes && !has_holes(&all_holes, object) {
                    continue;
                }
                if seen.drawn.len() > summed_up + SUM_UP_EVERY {
                    seen.tiles.sum_up(&seen.pixels);
                    summed_up = seen.drawn.len();
                }
                project(view, object, &mut corners);
                for (index, triangle) in object.mesh.triangles.iter().enumerate() {
                    let holes = all_holes[usize::from(triangle.material)];
                    if holes.is_some() != with_holes {
                        continue;
                    }
                    let cutout = holes.map(|holes| Cutout::new(holes, object, triangle, &corners));
                    seen.drawn.push(DrawnTriangle { object: number as u32, triangle: index as u32 });
                    let number = seen.drawn.len() as u32;
                    let mut layer = Layer { width, pixels: &mut seen.pixels, tiles: &seen.tiles, number, cutout };
                    draw(&grid, triangle, &corners, &mut layer);
                }
            }
        }
        seen
    }

    /// The number that all samples of four pixels from `column` on see, if it is one.
    #[inline]
    pub(crate) fn one_in_four(&self, row: usize, column: usize) -> Option<u32> {
        let start = row * self.width + column;
        let first = self.pixels[start].numbers;
        let number = first.to_array()[0];
        let same = u32x4::splat(number);
        if column + 4 > self.width || !first.simd_eq(same).all() {
            return None;
        }
        let others = self.pixels[start + 1..start + 4].iter().map(|pixel| pixel.numbers.simd_eq(same));
        others.fold(u32x4::splat(u32::MAX), |all, one| all & one).all().then_some(number)
    }

    /// The numbers of the triangles that the samples of a pixel see.
    #[inline]
    pub(crate) fn numbers(&self, pixel: usize) -> [u32; SAMPLES] {
        self.pixels[pixel].numbers.to_array()
    }

    /// The triangle with this number, which is not [`NOTHING`].
    #[inline]
    pub(crate) fn drawn(&self, number: u32) -> DrawnTriangle {
        self.drawn[number as usize - 1]
    }
}

/// The objects in the order of their nearest corners.
fn nearest_first(scene: &Scene) -> Vec<usize> {
    let nearest = |object: &Object| object.mesh.vertices.iter().fold(f32::MAX, |z, v| z.min(v.position[2].abs()));
    let mut order: Vec<(f32, usize)> = scene.objects.iter().map(nearest).zip(0..).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    order.into_iter().map(|(_, number)| number).collect()
}

fn has_holes(holes: &[Option<Holes>], object: &Object) -> bool {
    object.mesh.triangles.iter().any(|triangle| holes[usize::from(triangle.material)].is_some())
}

/// One triangle on its way into the image.
struct Layer<'a> {
    width: usize,
    pixels: &'a mut [Samples],
    tiles: &'a Tiles,
    number: u32,
    cutout: Option<Cutout>,
}

impl Target for Layer<'_> {
    #[inline]
    fn put(&mut self, pixel: usize, inside: f32x4, nearness: f32x4) {
        let samples = &mut self.pixels[pixel];
        let mut nearer = inside & nearness.simd_gt(samples.nearness);
        if nearer.to_bitmask() == 0 {
            return;
        }
        if let Some(cutout) = &self.cutout {
            nearer &= cutout.kept(pixel % self.width, pixel / self.width);
        }
        samples.nearness = nearer.bitselect(nearness, samples.nearness);
        let mask: u32x4 = cast(nearer);
        samples.numbers = mask.bitselect(u32x4::splat(self.number), samples.numbers);
    }

    #[inline]
    fn hides(&self, columns: [usize; 2], rows: [usize; 2], nearness: f32) -> bool {
        self.tiles.hide(columns, rows, nearness)
    }
}

/// Side of the tiles of pixels that hide small triangles behind them all at once, pixels.
const TILE: usize = 16;

/// Triangles between two looks at how far the tiles can be seen through.
const SUM_UP_EVERY: usize = 4000;

/// A triangle that may touch more tiles than this is drawn without a look at them.
const MAX_TILES: usize = 12;

/// How far one can see in each tile of pixels.
struct Tiles {
    size: [usize; 2],
    columns: usize,
    /// The nearness of the farthest sample in each tile, when last looked at; it can only have come nearer since.
    farthest: Vec<f32>,
}

impl Tiles {
    fn new(size: [usize; 2]) -> Self {
        let [columns, rows] = size.map(|s| s.div_ceil(TILE));
        Self { size, columns, farthest: vec![0.0; columns * rows] }
    }

    fn sum_up(&mut self, pixels: &[Samples]) {
        self.farthest.fill(f32::MAX);
        for (y, row) in pixels.chunks_exact(self.size[0]).enumerate() {
            let tiles = &mut self.farthest[y / TILE * self.columns..][..self.columns];
            for (farthest, pixels) in tiles.iter_mut().zip(row.chunks(TILE)) {
                let least = pixels.iter().fold(f32x4::splat(*farthest), |least, p| least.fast_min(p.nearness));
                let [a, b, c, d] = least.to_array();
                *farthest = a.min(b).min(c.min(d));
            }
        }
    }

    #[inline]
    fn hide(&self, columns: [usize; 2], rows: [usize; 2], nearness: f32) -> bool {
        let ([x0, x1], [y0, y1]) = (columns.map(|c| c / TILE), rows.map(|r| r / TILE));
        if (x1 - x0 + 1) * (y1 - y0 + 1) > MAX_TILES {
            return false;
        }
        (y0..=y1).all(|y| self.farthest[y * self.columns..][x0..=x1].iter().all(|&farthest| nearness <= farthest))
    }
}

/// How many samples of the image each instance would fill if nothing hid it.
pub(crate) fn amodal(scene: &Scene, view: &View) -> Vec<u32> {
    let instances = scene.objects.iter().map(|o| o.instance).max().unwrap_or(0);
    let grid = Grid::new(scene.image_size, OFFSETS);
    let [width, height] = scene.image_size;
    let mut mask = Mask { width, owners: vec![(0, 0); width * height], instance: 0, cutout: None, count: 0 };
    let mut corners = Vec::new();
    let all_holes = Holes::of_all(&scene.materials);
    let mut counts = vec![0; usize::from(instances) + 1];
    for instance in 1..=instances {
        mask.instance = instance;
        mask.count = 0;
        for object in scene.objects.iter().filter(|o| o.instance == instance) {
            project(view, object, &mut corners);
            for triangle in &object.mesh.triangles {
                let holes = all_holes[usize::from(triangle.material)];
                mask.cutout = holes.map(|holes| Cutout::new(holes, object, triangle, &corners));
                draw(&grid, triangle, &corners, &mut mask);
            }
        }
        counts[usize::from(instance)] = mask.count;
    }
    counts
}

/// Samples covered so far by one instance.
struct Mask {
    width: usize,
    /// The last instance that covered each pixel, and which samples: one bit each. Never cleared between instances.
    owners: Vec<(InstanceId, u16)>,
    instance: InstanceId,
    cutout: Option<Cutout>,
    count: u32,
}

impl Target for Mask {
    #[inline]
    fn put(&mut self, pixel: usize, inside: f32x4, _: f32x4) {
        let kept = |cutout: &Cutout| inside & cutout.kept(pixel % self.width, pixel / self.width);
        let kept = self.cutout.as_ref().map_or(inside, kept);
        let (owner, covered) = &mut self.owners[pixel];
        let before = if *owner == self.instance { *covered } else { 0 };
        let bits = kept.to_bitmask() as u16;
        self.count += (bits & !before).count_ones();
        (*owner, *covered) = (self.instance, before | bits);
    }
}
