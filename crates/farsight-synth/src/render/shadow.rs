//! What stands between a surface and the light: depth maps seen from the sun and from straight above.

use wide::f32x4;

use super::lanes::{self, Lanes, Vec3s, all, all3, integers};
use super::noise::{hash, mask, unit};
use super::pattern::Holes;
use super::raster::{Grid, Target, fill};
use super::view::View;
use crate::scene::{Material, Object, Scene, Vec3};
use crate::vector::{add_scaled, cross, dot, normalized, scale};

/// Samples of four neighbouring texels: the rasteriser takes four at a time.
const TEXELS: [[f32; 2]; 4] = [[0.0, 0.0], [0.25, 0.0], [0.5, 0.0], [0.75, 0.0]];

/// Side of the blocks of texels in which a look at one number often spares the look at all, texels.
const BLOCK: usize = 8;

/// Position of "nothing there" along the light.
const NOTHING_M: f32 = -1e6;

/// What is nearest to a light that is infinitely far away.
struct DepthMap {
    /// Texels across (a multiple of 4) and down.
    size: [usize; 2],
    /// Size of a texel, metres.
    texel_m: f32,
    /// Unit vectors across, down, and towards the light.
    axes: [Vec3; 3],
    /// The first two axes in texels a metre, and the place of the origin of coordinates in texels.
    texel_axes: [Vec3; 2],
    texel_origin: [f32; 2],
    /// Position of the nearest surface along the third axis, metres.
    nearest: Vec<f32>,
    /// The most of them in each block of texels and the blocks to the right and below it.
    blocks: Vec<f32>,
    block_columns: usize,
}

/// How wide a region is in the map's axes.
struct Region {
    axes: [Vec3; 3],
    least: [f32; 2],
    most: [f32; 2],
}

impl Region {
    /// Around `points`.
    fn around(axes: [Vec3; 3], points: &[Vec3]) -> Self {
        let mut region = Self { axes, least: [f32::INFINITY; 2], most: [f32::NEG_INFINITY; 2] };
        for &point in points {
            for axis in 0..2 {
                let at = dot(point, axes[axis]);
                region.least[axis] = region.least[axis].min(at);
                region.most[axis] = region.most[axis].max(at);
            }
        }
        region
    }
}

impl DepthMap {
    fn new(scene: &Scene, region: &Region, texel_m: f32) -> Self {
        let texels =
            [0, 1].map(|axis| ((region.most[axis] - region.least[axis]) / texel_m).clamp(4.0, 2044.0) as usize + 4);
        let size = [texels[0].next_multiple_of(4), texels[1]];
        let nearest = vec![NOTHING_M; size[0] * size[1]];
        let per_metre = 1.0 / texel_m;
        let mut map = Self {
            size,
            texel_m,
            axes: region.axes,
            texel_axes: [scale(region.axes[0], per_metre), scale(region.axes[1], per_metre)],
            texel_origin: [-region.least[0] * per_metre, -region.least[1] * per_metre],
            nearest,
            blocks: Vec::new(),
            block_columns: size[0].div_ceil(BLOCK),
        };
        let mut corners = Vec::new();
        for object in scene.objects.iter().filter(|object| object.casts_shadow) {
            map.draw(object, &scene.materials, &mut corners);
        }
        map.sum_up_blocks();
        map
    }

    fn sum_up_blocks(&mut self) {
        let (columns, rows) = (self.block_columns, self.size[1].div_ceil(BLOCK));
        let mut single = vec![NOTHING_M; columns * rows];
        for (y, row) in self.nearest.chunks_exact(self.size[0]).enumerate() {
            let blocks = &mut single[y / BLOCK * columns..][..columns];
            for (block, texels) in blocks.iter_mut().zip(row.chunks(BLOCK)) {
                *block = texels.iter().fold(*block, |most, &texel| most.max(texel));
            }
        }
        let at = |x: usize, y: usize| single[y.min(rows - 1) * columns + x.min(columns - 1)];
        let most = |x: usize, y: usize| at(x, y).max(at(x + 1, y)).max(at(x, y + 1)).max(at(x + 1, y + 1));
        self.blocks = (0..columns * rows).map(|i| most(i % columns, i / columns)).collect();
    }

    fn draw(&mut self, object: &Object, materials: &[Material], corners: &mut Vec<[f64; 3]>) {
        corners.clear();
        let (mut least, mut most) = ([f32::MAX; 2], [f32::MIN; 2]);
        for vertex in &object.mesh.vertices {
            let [across, down] = self.texel(vertex.position);
            least = [least[0].min(across), least[1].min(down)];
            most = [most[0].max(across), most[1].max(down)];
            let nearness = dot(vertex.position, self.axes[2]);
            corners.push([f64::from(across) * 0.25, f64::from(down), f64::from(nearness)]);
        }
        if (0..2).any(|axis| most[axis] < 0.0 || least[axis] > self.size[axis] as f32) {
            return;
        }
        let grid = Grid::new([self.size[0] / 4, self.size[1]], TEXELS);
        for triangle in &object.mesh.triangles {
            let holes = Holes::of(&materials[usize::from(triangle.material)].pattern);
            let solid = holes.map_or(1.0, |holes| holes.solid);
            let [a, b, c] = triangle.vertices;
            let places = [corners[a as usize], corners[b as usize], corners[c as usize]];
            fill(&grid, &places, 1.0, &mut Nearest { width: self.size[0], nearest: &mut self.nearest, solid });
        }
    }

    /// Column and row of a point, in texels.
    #[inline]
    fn texel(&self, point: Vec3) -> [f32; 2] {
        let at = |axis: usize| dot(point, self.texel_axes[axis]) + self.texel_origin[axis];
        [at(0), at(1)]
    }

    /// Weighted mean of `hidden` over the three texels square around four points; 0 outside the map and in lanes that are not `wanted`.
    ///
    /// `hidden` is given how far the nearest surface lies before the point, metres; it must be 0 up to `margin_m`.
    #[inline]
    fn mean(&self, points: Vec3s, wanted: u32, margin_m: f32, hidden: impl Fn(Lanes) -> Lanes) -> Lanes {
        let texel = |axis: usize| lanes::dot(points, all3(self.texel_axes[axis])) + all(self.texel_origin[axis] - 1.0);
        let (across, down) = (texel(0), texel(1));
        let (left, top) = (lanes::floor(across), lanes::floor(down));
        let (fx, fy) = ((across - left).to_array(), (down - top).to_array());
        let (columns, rows) = (integers(left).to_array(), integers(top).to_array());
        let own = lanes::dot(points, all3(self.axes[2])).to_array();
        let mut means = [0.0; 4];
        for lane in (0..4).filter(|lane| wanted >> lane & 1 == 1) {
            // A negative number becomes a very large one.
            let (column, row) = (columns[lane] as usize, rows[lane] as usize);
            let inside = column < self.size[0] - 3 && row < self.size[1] - 3;
            if inside && self.blocks[row / BLOCK * self.block_columns + column / BLOCK] - own[lane] > margin_m {
                let window = Window { start: row * self.size[0] + column, fx: fx[lane], fy: fy[lane], own: own[lane] };
                means[lane] = self.mean_in(&window, &hidden);
            }
        }
        means.into()
    }

    #[inline]
    fn mean_in(&self, window: &Window, hidden: &impl Fn(Lanes) -> Lanes) -> f32 {
        let &Window { start, fx, fy, own } = window;
        let columns = Lanes::from([1.0 - fx, 1.0, 1.0, fx]);
        let texels = &self.nearest[start..start + 3 * self.size[0] + 4];
        let row = |number: usize| {
            let row = &texels[number * self.size[0]..][..4];
            hidden(Lanes::from([row[0], row[1], row[2], row[3]]) - all(own))
        };
        let sum = (row(0) * all(1.0 - fy) + row(1) + row(2) + row(3) * all(fy)) * columns;
        let [a, b, c, d] = sum.to_array();
        (a + b + c + d) * (1.0 / 9.0)
    }
}

/// Four by four texels around a point.
struct Window {
    /// Index of the first.
    start: usize,
    /// How far the point is on the way from the second texel to the third.
    fx: f32,
    fy: f32,
    /// Position of the point towards the light.
    own: f32,
}

/// Keeps what is nearest to the light.
struct Nearest<'a> {
    width: usize,
    nearest: &'a mut [f32],
    /// Share of the surface that is no hole.
    solid: f32,
}

impl Target for Nearest<'_> {
    #[inline]
    fn put(&mut self, x: usize, y: usize, inside: f32x4, nearness: f32x4) {
        let start = y * self.width + 4 * x;
        let Some(texels) = self.nearest.get_mut(start..start + 4) else { return };
        let before = f32x4::from([texels[0], texels[1], texels[2], texels[3]]);
        let mut nearer = inside & nearness.simd_gt(before);
        if self.solid < 1.0 {
            nearer &= speckles(x, y, self.solid);
        }
        texels.copy_from_slice(&nearer.bitselect(nearness, before).to_array());
    }
}

/// A mask that is set in a share of all squares of 4x4 texels, without order.
fn speckles(x: usize, y: usize, share: f32) -> f32x4 {
    let solid = unit(hash(x as i32, (y / 4) as i32, 77)) < share;
    mask(if solid { 0b1111 } else { 0 })
}

/// The part of the scene, ahead of the camera, that a map covers, metres: nearest and farthest depth.
type Reach = [f32; 2];

/// The two maps of the sun: a fine one for what is near and a coarse one.
const SUN_REACH_M: [Reach; 2] = [[0.5, 24.0], [20.0, 85.0]];

/// Size of their texels, metres.
const SUN_TEXEL_M: [f32; 2] = [0.045, 0.16];

/// Heights between which shadows are looked for, metres below the camera (y): from the eaves of a low house to a dip in the road.
const HEIGHTS_M: [f32; 2] = [-7.0, 3.5];

/// Reach, half width and texel of the map from above, metres.
const ABOVE_REACH_M: Reach = [-4.0, 105.0];
const ABOVE_HALF_WIDTH_M: f32 = 40.0;
const ABOVE_TEXEL_M: f32 = 0.25;

/// What hides the sun and the sky.
pub(crate) struct Shadows {
    sun: Vec<DepthMap>,
    above: DepthMap,
    strength: f32,
}

impl Shadows {
    /// The shadows of a scene.
    pub(crate) fn of(scene: &Scene, view: &View) -> Self {
        let needed = scene.sun.shadow > 0.0 && scene.sun.color.iter().any(|&c| c > 0.0);
        let sun = SUN_REACH_M.iter().zip(SUN_TEXEL_M).filter(|_| needed);
        Self {
            sun: sun.map(|(&reach, texel_m)| sun_map(scene, view, reach, texel_m)).collect(),
            above: map_from_above(scene, view),
            strength: scene.sun.shadow,
        }
    }

    /// Share of the sun's light that reaches surfaces, 0 to 1, in the lanes that are `wanted`.
    #[inline]
    pub(crate) fn sunlight(&self, position: Vec3s, normal: Vec3s, wanted: u32) -> Lanes {
        let near = position[2].simd_lt(all(SUN_REACH_M[0][1] - 1.0)).to_bitmask();
        let mut hidden = Lanes::ZERO;
        for (map, lanes) in self.sun.iter().zip([wanted & near, wanted & !near]) {
            if lanes != 0 {
                // Off the surface by its own texels, so that it does not shade itself.
                let points = lanes::add_scaled(position, normal, all(1.6 * map.texel_m));
                let margin_m = 0.4 * map.texel_m;
                hidden += map.mean(points, lanes, margin_m, |before| before.simd_gt(all(margin_m)) & Lanes::ONE);
            }
        }
        Lanes::ONE - hidden * all(self.strength)
    }

    /// Share of the sky's light that reaches surfaces, 0 to 1: less beneath and beside things.
    #[inline]
    pub(crate) fn skylight(&self, position: Vec3s, normal: Vec3s) -> Lanes {
        let points = lanes::add_scaled(position, normal, all(0.3));
        let hidden = self.above.mean(points, 0b1111, 0.0, |above| {
            // What hangs high leaves light from the sides.
            let low = lanes::clamp(Lanes::ONE - above * all(1.0 / 7.0), 0.3, 1.0);
            lanes::clamp(above * all(4.0), 0.0, 1.0) * low
        });
        Lanes::ONE - all(0.85) * hidden
    }
}

fn sun_map(scene: &Scene, view: &View, reach: Reach, texel_m: f32) -> DepthMap {
    let towards = normalized(scene.sun.direction);
    let ahead = if towards[2].abs() < 0.99 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
    let across = normalized(cross(ahead, towards));
    let axes = [across, cross(towards, across), towards];
    DepthMap::new(scene, &Region::around(axes, &seen_corners(scene, view, reach)), texel_m)
}

fn map_from_above(scene: &Scene, view: &View) -> DepthMap {
    let axes = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]];
    let [x, _, z] = view.eye;
    let corners = ABOVE_REACH_M.map(|ahead| [x, 0.0, z + ahead]);
    let wide = corners.map(|c| [-1.0, 1.0].map(|side| add_scaled(c, axes[0], side * ABOVE_HALF_WIDTH_M)));
    DepthMap::new(scene, &Region::around(axes, wide.as_flattened()), ABOVE_TEXEL_M)
}

/// Corners of what the camera sees between two depths.
fn seen_corners(scene: &Scene, view: &View, reach: Reach) -> Vec<Vec3> {
    let [width, height] = scene.image_size.map(|s| s as f32);
    let sides = [view.direction(0.0, height / 2.0), view.direction(width, height / 2.0)];
    let mut corners = Vec::new();
    for depth in reach {
        for side in sides {
            let [x, _, z] = add_scaled(view.eye, side, depth);
            corners.extend(HEIGHTS_M.map(|y| [x, y, z]));
        }
    }
    corners
}
