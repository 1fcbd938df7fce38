//! From what the samples see to what the pixels show.

use super::Rendered;
use super::lamps::Lamps;
use super::shade::{self, Fragment, Light};
use super::shadow::Shadows;
use super::sky;
use super::surface::{Weights, vertices};
use super::view::View;
use super::visibility::{NOTHING, OFFSETS, SAMPLES, Visibility};
use crate::scene::{Color, InstanceId, Material, Scene, Triangle, Vec3};
use crate::vector::{add_scaled, dot, normalized, scale, sub};

/// Triangles kept ready for shading; neighbouring pixels mostly show the same few.
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
    faces: Vec<(u32, Option<Face<'a>>)>,
}

/// A triangle prepared for shading.
#[derive(Clone)]
struct Face<'a> {
    weights: Weights,
    positions: [Vec3; 3],
    normals: [Vec3; 3],
    uv: [[f32; 2]; 3],
    material: &'a Material,
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

/// What one group gives to a pixel.
#[derive(Clone, Copy)]
struct Shown {
    color: Color,
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
        Self { scene, view, seen, shadows, lamps, ambient: shade::ambient(scene), faces: vec![(NOTHING, None); KEPT] }
    }

    /// Adds all pixels to `rendered`.
    pub(crate) fn resolve(&mut self, rendered: &mut Rendered) {
        let [width, height] = self.scene.image_size;
        for y in 0..height {
            for x in 0..width {
                let numbers = self.seen.numbers(y * width + x);
                if numbers == [numbers[0]; SAMPLES] {
                    let shown = self.shown(numbers[0], [x, y], [0.0; 2]);
                    rendered.visible[usize::from(shown.instance)] += SAMPLES as u32;
                    rendered.push(shown.color, shown.depth_m, shown.instance);
                } else {
                    self.mixed(&numbers, [x, y], rendered);
                }
            }
        }
    }

    /// A pixel that shows several triangles.
    fn mixed(&mut self, numbers: &[u32; SAMPLES], pixel: [usize; 2], rendered: &mut Rendered) {
        let (groups, count) = self.groups(numbers);
        let groups = &groups[..count];
        let mut color = [0.0; 3];
        let mut instances = [0; SAMPLES];
        for (group, instance) in groups.iter().zip(&mut instances) {
            *instance = self.instance(group.number);
        }
        let mut most = (0, 0, f32::INFINITY, 0);
        for (group, &instance) in groups.iter().zip(&instances) {
            let scale = 1.0 / group.own as f32;
            let shown = self.shown(group.number, pixel, [group.offset[0] * scale, group.offset[1] * scale]);
            color = add_scaled(color, shown.color, group.samples as f32 / SAMPLES as f32);
            rendered.visible[usize::from(instance)] += group.samples;
            let same = groups.iter().zip(&instances).filter(|(_, other)| **other == instance);
            let of_instance: u32 = same.map(|(other, _)| other.samples).sum();
            if (of_instance, group.samples) > (most.0, most.1) {
                most = (of_instance, group.samples, shown.depth_m, instance);
            }
        }
        rendered.push(color, most.2, most.3);
    }

    /// Whose triangle it is.
    fn instance(&self, number: u32) -> InstanceId {
        if number == NOTHING { 0 } else { self.scene.objects[self.seen.drawn(number).object as usize].instance }
    }

    /// The samples of a pixel in up to four groups, and how many.
    fn groups(&self, numbers: &[u32; SAMPLES]) -> ([Group; SAMPLES], usize) {
        let mut groups = [Group::default(); SAMPLES];
        let mut count = 0;
        for (&number, offset) in numbers.iter().zip(OFFSETS) {
            let known = groups[..count].iter().position(|g| g.number == number);
            let known = known.or_else(|| groups[..count].iter().position(|g| self.alike(g.number, number)));
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
    fn alike(&self, a: u32, b: u32) -> bool {
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

    /// What a triangle, or the sky, looks like in a pixel, `offset` from its centre.
    #[inline]
    fn shown(&mut self, number: u32, [x, y]: [usize; 2], offset: [f32; 2]) -> Shown {
        let (u, v) = (x as f32 + offset[0], y as f32 + offset[1]);
        if number == NOTHING {
            let color = sky::color(self.scene, normalized(self.view.direction(u, v)));
            return Shown { color, depth_m: f32::INFINITY, instance: 0 };
        }
        let light = Light {
            scene: self.scene,
            shadows: self.shadows,
            lamps: self.lamps.at(x, y),
            ambient: self.ambient,
            eye: self.view.eye,
        };
        let face = self.face(number);
        let at = face.weights.at(u, v);
        let position = at.vector(&face.positions);
        let normal = normalized(at.vector(&face.normals));
        let towards_eye = sub(light.eye, position);
        let normal = if dot(normal, towards_eye) < 0.0 { scale(normal, -1.0) } else { normal };
        let (uv, footprint) = at.uv(&face.uv);
        let fragment = Fragment { position, normal, uv, footprint, material: face.material };
        Shown { color: shade::color(&light, &fragment), depth_m: position[2], instance: face.instance }
    }

    #[inline]
    fn face(&mut self, number: u32) -> &Face<'a> {
        let (scene, view, seen) = (self.scene, self.view, self.seen);
        let (kept, face) = &mut self.faces[number as usize % KEPT];
        if *kept != number {
            (*kept, *face) = (number, None);
        }
        face.get_or_insert_with(|| Face::new(scene, view, seen, number))
    }
}

impl<'a> Face<'a> {
    fn new(scene: &'a Scene, view: &View, seen: &Visibility, number: u32) -> Self {
        let drawn = seen.drawn(number);
        let object = &scene.objects[drawn.object as usize];
        let triangle = &object.mesh.triangles[drawn.triangle as usize];
        let [a, b, c] = vertices(object, triangle);
        let corners = [view.homogeneous(a.position), view.homogeneous(b.position), view.homogeneous(c.position)];
        Self {
            weights: Weights::new(corners),
            positions: [a.position, b.position, c.position],
            normals: [a.normal, b.normal, c.normal],
            uv: [a.uv, b.uv, c.uv],
            material: &scene.materials[usize::from(triangle.material)],
            instance: object.instance,
        }
    }
}
