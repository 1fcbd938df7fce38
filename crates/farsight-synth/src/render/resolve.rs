//! From what the samples see to what the pixels show.
//!
//! Row by row, four at a time: neighbouring pixels that show one triangle and nothing else are shaded together. Of the
//! other pixels each distinct triangle gives a piece of surface; the row's pieces are sorted by material before they
//! are shaded.

use super::lamps::Lamps;
use super::lanes::{self, Lanes, all};
use super::pieces::{END, Piece, Pieces};
use super::rendered::Rendered;
use super::samples::{OFFSETS, SAMPLES};
use super::shade::{self, Light};
use super::shadow::Shadows;
use super::sky;
use super::surface::{Interpolated, Varying, vertices};
use super::view::View;
use super::visibility::{NOTHING, Visibility};
use crate::scene::{Color, InstanceId, Scene, Triangle};
use crate::vector::{dot, float};

/// Triangles kept ready; neighbouring pixels mostly show the same few.
const KEPT: usize = 64;

/// Triangles of one object and material whose normals are closer than this (cosine) are shaded as one within a pixel.
const ALIKE: f32 = 0.96;

/// Shades the samples of all pixels.
pub(crate) struct Resolver<'a> {
    scene: &'a Scene,
    view: &'a View,
    seen: &'a Visibility,
    shadows: &'a Shadows,
    lamps: &'a Lamps<'a>,
    ambient: [Color; 2],
    faces: Vec<(u32, Face)>,
    pieces: Pieces,
}

/// A triangle prepared for shading.
#[derive(Debug, Clone, Copy)]
struct Face {
    varying: Varying,
    material: usize,
    instance: InstanceId,
}

/// Samples of a pixel that are shaded together.
#[derive(Clone, Copy, Default)]
struct Group {
    /// The triangle that stands for all of them.
    number: u32,
    samples: u32,
    /// How many samples see that triangle itself, and the sum of their offsets.
    own: u32,
    offset: [f32; 2],
}

/// What one group shows, but for its colour.
#[derive(Clone, Copy)]
struct Shown {
    depth_m: f32,
    instance: InstanceId,
}

impl<'a> Resolver<'a> {
    pub(crate) fn new(
        scene: &'a Scene,
        view: &'a View,
        seen: &'a Visibility,
        shadows: &'a Shadows,
        lamps: &'a Lamps<'a>,
    ) -> Self {
        let pieces = Pieces::new(scene.materials.len() + 1);
        let (ambient, faces) = (shade::ambient(scene), Vec::new());
        Self { scene, view, seen, shadows, lamps, ambient, faces, pieces }
    }

    /// Adds all pixels to `rendered`.
    pub(crate) fn resolve(&mut self, rendered: &mut Rendered) {
        let [width, height] = self.scene.image_size;
        let mut colors = vec![[0.0; 3]; width];
        for row in 0..height {
            self.collect(row, &mut colors, rendered);
            self.shade(row, &mut colors);
            rendered.color.extend_from_slice(&colors);
            colors.fill([0.0; 3]);
        }
    }

    /// Shades what takes no sorting, collects the other pieces of a row, and adds depth and instance of its pixels to
    /// `rendered`.
    fn collect(&mut self, row: usize, colors: &mut [Color], rendered: &mut Rendered) {
        let width = self.scene.image_size[0];
        let mut column = 0;
        while column < width {
            if let Some(number) = self.seen.one_in_four(row, column) {
                self.shade_four(number, column, row, &mut colors[column..column + 4], rendered);
                column += 4;
                continue;
            }
            let numbers = self.seen.numbers(row * width + column);
            let shown = if numbers == [numbers[0]; SAMPLES] {
                let shown = self.add_piece(numbers[0], column, row, [0.0; 2], 1.0);
                rendered.visible[usize::from(shown.instance)] += SAMPLES as u32;
                shown
            } else {
                self.collect_mixed(&numbers, column, row, &mut rendered.visible)
            };
            rendered.depth_m.push(shown.depth_m);
            rendered.instance.push(shown.instance);
            column += 1;
        }
    }

    /// Four pixels from `column` on that show one triangle, or the sky, and nothing else.
    fn shade_four(&mut self, number: u32, column: usize, row: usize, colors: &mut [Color], rendered: &mut Rendered) {
        let (seen, depths, instance) = if number == NOTHING {
            let columns = all(float(column)) + Lanes::from([0.0, 1.0, 2.0, 3.0]);
            let direction = self.view.directions(columns, float(row));
            (sky::color(self.scene, lanes::normalized(direction)), [f32::INFINITY; 4], 0)
        } else {
            let face = self.face(number);
            let (material, instance) = (face.material, face.instance);
            let fragments = face.varying.at_four(column as u32, float(row));
            let seen = shade::color(&self.light(row), &self.scene.materials[material], &fragments);
            (seen, fragments.position[2].to_array(), instance)
        };
        let [red, green, blue] = [seen[0].to_array(), seen[1].to_array(), seen[2].to_array()];
        for lane in 0..4 {
            colors[lane] = [red[lane], green[lane], blue[lane]];
        }
        rendered.visible[usize::from(instance)] += 4 * SAMPLES as u32;
        rendered.depth_m.extend_from_slice(&depths);
        rendered.instance.extend_from_slice(&[instance; 4]);
    }

    /// A pixel that shows several triangles. Returns what most of it shows.
    fn collect_mixed(&mut self, numbers: &[u32; SAMPLES], column: usize, row: usize, visible: &mut [u32]) -> Shown {
        let (groups, count) = self.groups(numbers);
        let nothing = Shown { depth_m: f32::INFINITY, instance: 0 };
        let mut shown = [nothing; SAMPLES];
        for (group, shown) in groups[..count].iter().zip(&mut shown) {
            let scale = 1.0 / group.own as f32;
            let offset = [group.offset[0] * scale, group.offset[1] * scale];
            *shown = self.add_piece(group.number, column, row, offset, group.samples as f32 / SAMPLES as f32);
            visible[usize::from(shown.instance)] += group.samples;
        }
        let (mut most, mut result) = ((0, 0, f32::NEG_INFINITY), nothing);
        for (group, one) in groups.iter().zip(&shown).take(count) {
            let same = groups.iter().zip(&shown).filter(|(_, other)| other.instance == one.instance);
            let of_instance: u32 = same.map(|(group, _)| group.samples).sum();
            // Where a window shows as much of what is behind it as of itself, the pixel is the window's.
            let rank = (of_instance, group.samples, -one.depth_m);
            if rank > most {
                (most, result) = (rank, *one);
            }
        }
        result
    }

    /// The samples of a pixel in up to four groups, and how many.
    fn groups(&self, numbers: &[u32; SAMPLES]) -> ([Group; SAMPLES], usize) {
        let mut groups = [Group::default(); SAMPLES];
        let mut count = 0;
        for (&number, offset) in numbers.iter().zip(OFFSETS) {
            let known = groups[..count].iter().position(|g| g.number == number);
            let known = known.or_else(|| groups[..count].iter().position(|g| self.are_one_surface(g.number, number)));
            let group = &mut groups[known.unwrap_or(count)];
            if known.is_none() {
                group.number = number;
                count += 1;
            }
            group.samples += 1;
            if group.number == number {
                group.own += 1;
                group.offset = [group.offset[0] + offset[0], group.offset[1] + offset[1]];
            }
        }
        (groups, count)
    }

    /// Whether two triangles look the same but for the pattern within a pixel.
    fn are_one_surface(&self, a: u32, b: u32) -> bool {
        if a == NOTHING || b == NOTHING {
            return false;
        }
        let (a, b) = (self.seen.drawn(a), self.seen.drawn(b));
        if a.object != b.object {
            return false;
        }
        let mesh = &self.scene.objects[a.object as usize].mesh;
        let (a, b) = (&mesh.triangles[a.triangle as usize], &mesh.triangles[b.triangle as usize]);
        let normal = |triangle: &Triangle| mesh.vertices[triangle.vertices[0] as usize].normal;
        a.material == b.material && a.layer == b.layer && dot(normal(a), normal(b)) > ALIKE
    }

    /// Adds what a pixel shows of a triangle, or of the sky, `offset` from its centre.
    #[inline]
    fn add_piece(&mut self, number: u32, column: usize, row: usize, offset: [f32; 2], share: f32) -> Shown {
        let (u, v) = (float(column) + offset[0], float(row) + offset[1]);
        let column = column as u32;
        if number == NOTHING {
            let [x, y, z] = self.view.direction(u, v);
            let interpolated = Interpolated { place: [x, y, z, 0.0], facing: [0.0; 4], slopes: [0.0; 4] };
            self.pieces.push(self.scene.materials.len(), Piece { interpolated, column, share, next: END });
            return Shown { depth_m: f32::INFINITY, instance: 0 };
        }
        let face = self.face(number);
        let (interpolated, material, instance) = (face.varying.at(u, v), face.material, face.instance);
        self.pieces.push(material, Piece { interpolated, column, share, next: END });
        Shown { depth_m: interpolated.place[2], instance }
    }

    #[inline]
    fn face(&mut self, number: u32) -> &Face {
        if self.faces.is_empty() {
            self.faces = vec![(number, self.prepared(number)); KEPT];
        }
        let slot = number as usize % KEPT;
        if self.faces[slot].0 != number {
            self.faces[slot] = (number, self.prepared(number));
        }
        &self.faces[slot].1
    }

    fn prepared(&self, number: u32) -> Face {
        let drawn = self.seen.drawn(number);
        let object = &self.scene.objects[drawn.object as usize];
        let triangle = &object.mesh.triangles[drawn.triangle as usize];
        let corners = vertices(object, triangle);
        let [a, b, c] = corners;
        let homogeneous = [a, b, c].map(|corner| self.view.homogeneous(corner.position));
        Face {
            varying: Varying::new(corners, homogeneous),
            material: usize::from(triangle.material),
            instance: object.instance,
        }
    }

    /// What lights a row.
    fn light(&self, row: usize) -> Light<'a> {
        Light {
            scene: self.scene,
            shadows: self.shadows,
            lamps: self.lamps.in_row(row),
            ambient: self.ambient,
            eye: self.view.eye,
        }
    }

    /// Adds the light of the collected pieces to the pixels of their row, and forgets the pieces.
    fn shade(&mut self, row: usize, colors: &mut [Color]) {
        let light = self.light(row);
        for number in 0..self.pieces.chains() {
            let (material, mut next) = self.pieces.chain(number);
            while next != END {
                let batch = self.pieces.batch(&mut next);
                let seen = match self.scene.materials.get(material) {
                    Some(material) => shade::color(&light, material, &batch.fragments),
                    None => sky::color(self.scene, lanes::normalized(batch.fragments.position)),
                };
                batch.add_to(colors, seen);
            }
        }
        self.pieces.clear();
    }
}
