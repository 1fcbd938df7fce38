//! Building meshes: flat faces, blocks, tubes, balls and skins over cross-sections.

use crate::scene::{MaterialId, Mesh, Triangle, Vec3, Vertex};
use crate::vector::{add, cross, dot, length, scale, sub, unit};

/// Faces whose normals differ by more than this are not smoothed into each other (cosine of 40 degrees).
const CREASE_COS: f32 = 0.766;

/// Adds shapes to a mesh.
#[derive(Debug, Default)]
pub(crate) struct MeshBuilder {
    pub(crate) mesh: Mesh,
}

impl MeshBuilder {
    fn vertex(&mut self, position: Vec3, normal: Vec3, uv: [f32; 2]) -> u32 {
        self.mesh.vertices.push(Vertex { position, normal, uv });
        self.mesh.vertices.len() as u32 - 1
    }

    pub(crate) fn triangle(&mut self, points: [Vec3; 3], uvs: [[f32; 2]; 3], material: MaterialId, layer: u8) {
        let normal = unit(cross(sub(points[1], points[0]), sub(points[2], points[0])));
        let vertices = [0, 1, 2].map(|i| self.vertex(points[i], normal, uvs[i]));
        self.mesh.triangles.push(Triangle { vertices, material, layer });
    }

    /// A flat four-cornered face, corners in order around it; the pattern runs along its first side from its first
    /// corner.
    pub(crate) fn quad(&mut self, points: [Vec3; 4], material: MaterialId, layer: u8) {
        let along = length(sub(points[1], points[0]));
        let up = length(sub(points[3], points[0]));
        self.quad_uv(points, [[0.0, 0.0], [along, 0.0], [along, up], [0.0, up]], material, layer);
    }

    pub(crate) fn quad_uv(&mut self, points: [Vec3; 4], uvs: [[f32; 2]; 4], material: MaterialId, layer: u8) {
        let normal = unit(cross(sub(points[2], points[0]), sub(points[3], points[1])));
        let v = [0, 1, 2, 3].map(|i| self.vertex(points[i], normal, uvs[i]));
        self.mesh.triangles.push(Triangle { vertices: [v[0], v[1], v[2]], material, layer });
        self.mesh.triangles.push(Triangle { vertices: [v[0], v[2], v[3]], material, layer });
    }

    /// A block between two corners (smaller and larger coordinates).
    pub(crate) fn cuboid(&mut self, low: Vec3, high: Vec3, material: MaterialId) {
        self.block_of(low, high, [Some(material); 6]);
    }

    /// A block with a material for each face: -x, +x, top (-y), bottom (+y), -z, +z.
    pub(crate) fn block_of(&mut self, low: Vec3, high: Vec3, faces: [Option<MaterialId>; 6]) {
        let p = |x: usize, y: usize, z: usize| [[low, high][x][0], [low, high][y][1], [low, high][z][2]];
        // Each starts at a bottom corner and runs along the bottom, so that patterns stand upright.
        let corners = [
            [p(0, 1, 1), p(0, 1, 0), p(0, 0, 0), p(0, 0, 1)],
            [p(1, 1, 0), p(1, 1, 1), p(1, 0, 1), p(1, 0, 0)],
            [p(0, 0, 0), p(1, 0, 0), p(1, 0, 1), p(0, 0, 1)],
            [p(0, 1, 0), p(1, 1, 0), p(1, 1, 1), p(0, 1, 1)],
            [p(0, 1, 0), p(1, 1, 0), p(1, 0, 0), p(0, 0, 0)],
            [p(1, 1, 1), p(0, 1, 1), p(0, 0, 1), p(1, 0, 1)],
        ];
        for (points, material) in corners.into_iter().zip(faces) {
            if let Some(material) = material {
                self.quad(points, material, 0);
            }
        }
    }

    /// A round rod, open at both ends, that may taper.
    pub(crate) fn tube(&mut self, from: Vec3, to: Vec3, radii: [f32; 2], sides: usize, material: MaterialId) {
        let axis = unit(sub(to, from));
        let [across, up] = across(axis);
        let span = length(sub(to, from));
        let rim = |k: usize, end: usize| {
            let (sin, cos) = sin_cos(std::f32::consts::TAU * k as f32 / sides as f32);
            let out = add(scale(across, cos), scale(up, sin));
            let center = [from, to][end];
            let round = std::f32::consts::TAU * radii[end] * k as f32 / sides as f32;
            (add(center, scale(out, radii[end])), out, [round, span * end as f32])
        };
        for k in 0..sides {
            let v = [(k, 0), (k + 1, 0), (k + 1, 1), (k, 1)].map(|(k, end)| {
                let (position, normal, uv) = rim(k, end);
                self.vertex(position, normal, uv)
            });
            self.mesh.triangles.push(Triangle { vertices: [v[0], v[1], v[2]], material, layer: 0 });
            self.mesh.triangles.push(Triangle { vertices: [v[0], v[2], v[3]], material, layer: 0 });
        }
    }

    /// A flat disc, or a ring where the inner radius is not 0; `materials` take turns around it.
    pub(crate) fn disc(&mut self, center: Vec3, axis: Vec3, radii: [f32; 2], sides: usize, materials: &[MaterialId]) {
        let [across, up] = across(axis);
        let at = |k: usize, radius: f32| {
            let (sin, cos) = sin_cos(std::f32::consts::TAU * k as f32 / sides as f32);
            add(center, add(scale(across, cos * radius), scale(up, sin * radius)))
        };
        for k in 0..sides {
            let material = materials[k % materials.len()];
            if radii[0] > 0.0 {
                let points = [at(k, radii[0]), at(k, radii[1]), at(k + 1, radii[1]), at(k + 1, radii[0])];
                self.quad(points, material, 0);
            } else {
                self.triangle([center, at(k, radii[1]), at(k + 1, radii[1])], [[0.0; 2]; 3], material, 0);
            }
        }
    }

    /// An upright ellipsoid; `bumps` shifts each corner by a share of the radius that it is given.
    pub(crate) fn ellipsoid(
        &mut self,
        center: Vec3,
        radii: Vec3,
        [rings, sides]: [usize; 2],
        material: MaterialId,
        mut bump: impl FnMut() -> f32,
    ) {
        let bumps: Vec<f32> = (0..(rings + 1) * sides).map(|_| bump()).collect();
        let section = |ring: usize| {
            let (sin, cos) = sin_cos(std::f32::consts::PI * ring as f32 / rings as f32);
            let point = move |side: usize, bumps: &[f32]| {
                let (s, c) = sin_cos(std::f32::consts::TAU * side as f32 / sides as f32);
                let pole = ring == 0 || ring == rings;
                let grown = 1.0 + if pole { bumps[ring * sides] } else { bumps[ring * sides + side % sides] };
                let out = [sin * c, -cos, sin * s];
                add(center, [0, 1, 2].map(|i| out[i] * radii[i] * grown))
            };
            (0..=sides).map(|side| point(side, &bumps)).collect::<Vec<_>>()
        };
        let sections: Vec<Vec<Vec3>> = (0..=rings).map(section).collect();
        let first = self.mesh.vertices.len();
        self.loft(&sections, |_, _| Some(material));
        self.project_patterns(first);
    }

    /// Lays the patterns of the four-cornered faces from vertex `first` on straight, along the axes that each face
    /// looks least along.
    ///
    /// Wrapped around a ball a pattern would be drawn out into streaks.
    pub(crate) fn project_patterns(&mut self, first: usize) {
        for corners in self.mesh.vertices[first..].chunks_exact_mut(4) {
            let normal =
                cross(sub(corners[2].position, corners[0].position), sub(corners[3].position, corners[1].position));
            let [x, y, z] = normal.map(f32::abs);
            let axes = if x > y && x > z {
                [2, 1]
            } else if y > z {
                [0, 2]
            } else {
                [0, 1]
            };
            for corner in corners {
                corner.uv = axes.map(|axis| corner.position[axis]);
            }
        }
    }

    /// A skin over cross-sections of equally many points, smooth except over creases.
    ///
    /// `material` is asked for each face by its section and the point in it; faces without one are left out.
    pub(crate) fn loft(&mut self, sections: &[Vec<Vec3>], material: impl Fn(usize, usize) -> Option<MaterialId>) {
        let skin = Skin::new(sections);
        for i in 0..skin.rows {
            for j in 0..skin.columns {
                let Some(material) = material(i, j) else { continue };
                let corners = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)];
                let v = corners.map(|(a, b)| {
                    let uv = [skin.along[a], skin.around[a][b]];
                    self.vertex(sections[a][b], skin.normal([i, j], [a, b]), uv)
                });
                for vertices in [[v[0], v[1], v[2]], [v[0], v[2], v[3]]] {
                    self.mesh.triangles.push(Triangle { vertices, material, layer: 0 });
                }
            }
        }
    }

    /// Adds `other`, turned by `yaw_rad` about the vertical as boxes are, and moved to `to`.
    pub(crate) fn place(&mut self, other: &Mesh, yaw_rad: f64, to: Vec3) {
        let first = self.mesh.vertices.len() as u32;
        let turn = Turn::new(yaw_rad);
        self.mesh.vertices.extend(other.vertices.iter().map(|v| Vertex {
            position: add(turn.apply(v.position), to),
            normal: turn.apply(v.normal),
            uv: v.uv,
        }));
        let moved = |t: &Triangle| Triangle { vertices: t.vertices.map(|v| v + first), ..*t };
        self.mesh.triangles.extend(other.triangles.iter().map(moved));
    }
}

/// Turn about the vertical in the convention of `farsight_core::Box3d`.
pub(crate) struct Turn {
    sin: f32,
    cos: f32,
}

impl Turn {
    pub(crate) fn new(yaw_rad: f64) -> Self {
        Self { sin: libm::sin(yaw_rad) as f32, cos: libm::cos(yaw_rad) as f32 }
    }

    pub(crate) fn apply(&self, v: Vec3) -> Vec3 {
        [self.cos * v[0] + self.sin * v[2], v[1], self.cos * v[2] - self.sin * v[0]]
    }
}

/// Two unit vectors across `axis`.
fn across(axis: Vec3) -> [Vec3; 2] {
    let helper = if axis[1].abs() < 0.9 { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
    let first = unit(cross(axis, helper));
    [first, cross(axis, first)]
}

pub(crate) fn sin_cos(angle_rad: f32) -> (f32, f32) {
    (libm::sinf(angle_rad), libm::cosf(angle_rad))
}

/// Normals and pattern coordinates of a skin.
struct Skin {
    rows: usize,
    columns: usize,
    /// Area-weighted normals of the faces, row by row.
    faces: Vec<Vec3>,
    along: Vec<f32>,
    around: Vec<Vec<f32>>,
    closed: bool,
}

impl Skin {
    fn new(sections: &[Vec<Vec3>]) -> Self {
        let rows = sections.len().saturating_sub(1);
        let columns = sections.first().map_or(0, |s| s.len().saturating_sub(1));
        let face = |i: usize, j: usize| {
            let [a, b, c, d] = [sections[i][j], sections[i][j + 1], sections[i + 1][j + 1], sections[i + 1][j]];
            cross(sub(c, a), sub(d, b))
        };
        let faces = (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))).map(|(i, j)| face(i, j)).collect();
        let mut along = vec![0.0; sections.len()];
        for i in 1..sections.len() {
            along[i] = along[i - 1] + length(sub(sections[i][columns / 2], sections[i - 1][columns / 2]));
        }
        let distances = |section: &Vec<Vec3>| {
            let mut sums = vec![0.0; section.len()];
            for j in 1..section.len() {
                sums[j] = sums[j - 1] + length(sub(section[j], section[j - 1]));
            }
            sums
        };
        let closed = sections.iter().all(|s| length(sub(s[0], s[s.len() - 1])) < 1e-4);
        Self { rows, columns, faces, along, around: sections.iter().map(distances).collect(), closed }
    }

    /// Normal at a corner as seen from a face: the mean of the faces around it that bend less than a crease.
    fn normal(&self, [i, j]: [usize; 2], [a, b]: [usize; 2]) -> Vec3 {
        let own = self.faces[i * self.columns + j];
        let own_unit = unit(own);
        let mut sum = own;
        for (di, dj) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let Some(row) = (a + di).checked_sub(1).filter(|&r| r < self.rows) else { continue };
            let column = match (b + dj).checked_sub(1) {
                None if self.closed => self.columns - 1,
                Some(c) if c == self.columns && self.closed => 0,
                Some(c) if c < self.columns => c,
                _ => continue,
            };
            let face = self.faces[row * self.columns + column];
            if [row, column] != [i, j] && dot(unit(face), own_unit) > CREASE_COS {
                sum = add(sum, face);
            }
        }
        unit(sum)
    }
}
