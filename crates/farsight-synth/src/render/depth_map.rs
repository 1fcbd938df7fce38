//! A depth map: what is nearest to a light that is infinitely far away.

use wide::f32x4;

use super::lanes::{self, Lanes, Vec3s, all, all3, integers};
use super::noise::{hash, mask, unit};
use super::pattern::Holes;
use super::raster::{Grid, Target, fill};
use crate::scene::{Object, Scene, Vec3};
use crate::vector::{dot, scale};

/// Samples of four neighbouring texels: the rasteriser takes four at a time.
const TEXELS: [[f32; 2]; 4] = [[0.0, 0.0], [0.25, 0.0], [0.5, 0.0], [0.75, 0.0]];

/// Side of the blocks of texels in which a look at one number often spares the look at all, texels.
const BLOCK: usize = 8;

/// Position of "nothing there" along the light.
const NOTHING_M: f32 = -1e6;

/// What is nearest to a light that is infinitely far away.
pub(crate) struct DepthMap {
    /// Texels across (a multiple of 4) and down.
    size: [usize; 2],
    /// Size of a texel, metres.
    pub(crate) texel_m: f32,
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
pub(crate) struct Region {
    axes: [Vec3; 3],
    least: [f32; 2],
    most: [f32; 2],
}

impl Region {
    /// Around `points`.
    pub(crate) fn around(axes: [Vec3; 3], points: &[Vec3]) -> Self {
        let mut region = Self { axes, least: [f32::INFINITY; 2], most: [f32::NEG_INFINITY; 2] };
        for &point in points {
            let at = [dot(point, axes[0]), dot(point, axes[1])];
            region.least = [region.least[0].min(at[0]), region.least[1].min(at[1])];
            region.most = [region.most[0].max(at[0]), region.most[1].max(at[1])];
        }
        region
    }
}

impl DepthMap {
    /// The map of what casts shadows in a region.
    pub(crate) fn new(scene: &Scene, region: &Region, texel_m: f32) -> Self {
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
        let holes = Holes::of_all(&scene.materials);
        for object in scene.objects.iter().filter(|object| object.casts_shadow) {
            map.draw(object, &holes, &mut corners);
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
                let fours = texels.as_chunks::<4>().0.iter();
                let most = fours.fold(Lanes::splat(*block), |most, &four| most.fast_max(four.into()));
                let [a, b, c, d] = most.to_array();
                *block = a.max(b).max(c.max(d));
            }
        }
        let at = |x: usize, y: usize| single[y.min(rows - 1) * columns + x.min(columns - 1)];
        let most = |x: usize, y: usize| at(x, y).max(at(x + 1, y)).max(at(x, y + 1)).max(at(x + 1, y + 1));
        self.blocks = (0..columns * rows).map(|i| most(i % columns, i / columns)).collect();
    }

    fn draw(&mut self, object: &Object, holes: &[Option<Holes>], corners: &mut Vec<[f64; 3]>) {
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
            let solid = holes[usize::from(triangle.material)].map_or(1.0, |holes| holes.shade());
            let [a, b, c] = triangle.vertices;
            let places = [corners[a as usize], corners[b as usize], corners[c as usize]];
            let (texels, _) = self.nearest.as_chunks_mut();
            fill(&grid, &places, 1.0, &mut Nearest { columns: self.size[0] / 4, texels, solid });
        }
    }

    /// Column and row of a point, in texels.
    #[inline]
    fn texel(&self, point: Vec3) -> [f32; 2] {
        let at = |axis: usize| dot(point, self.texel_axes[axis]) + self.texel_origin[axis];
        [at(0), at(1)]
    }

    /// Weighted mean of `hidden` over the three texels square around four points; 0 outside the map and in lanes that
    /// are not `wanted`.
    ///
    /// `hidden` is given how far the nearest surface lies before the point, metres; it must be 0 up to `margin_m`.
    #[inline]
    pub(crate) fn mean(&self, points: Vec3s, wanted: u32, margin_m: f32, hidden: impl Fn(Lanes) -> Lanes) -> Lanes {
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
    /// Groups of four texels in a row.
    columns: usize,
    texels: &'a mut [[f32; 4]],
    /// Share of the surface that is no hole.
    solid: f32,
}

impl Target for Nearest<'_> {
    #[inline]
    fn put(&mut self, pixel: usize, inside: f32x4, nearness: f32x4) {
        let texels = &mut self.texels[pixel];
        let before = f32x4::from(*texels);
        let mut nearer = inside & nearness.simd_gt(before);
        if self.solid < 1.0 {
            nearer &= speckles(pixel % self.columns, pixel / self.columns, self.solid);
        }
        *texels = nearer.bitselect(nearness, before).to_array();
    }
}

/// A mask that is set in a share of all squares of 4x4 texels, without order.
fn speckles(x: usize, y: usize, share: f32) -> f32x4 {
    let solid = unit(hash(x as i32, (y / 4) as i32, 77)) < share;
    mask(if solid { 0b1111 } else { 0 })
}
