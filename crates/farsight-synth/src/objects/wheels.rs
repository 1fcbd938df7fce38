//! Wheels: tyre, rim and spokes.

use super::context::Detail;
use super::paint::VehicleMaterials;
use crate::mesh_builder::MeshBuilder;
use crate::scene::Vec3;
use crate::vector::add;

/// One wheel whose outer face looks along z.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wheel {
    /// Centre of the outer face.
    pub(super) center: Vec3,
    pub(super) radius: f32,
    pub(super) width: f32,
    /// Share of the radius that the rim takes.
    pub(super) rim: f32,
    pub(super) spokes: usize,
}

impl Wheel {
    pub(super) fn build(&self, shape: &mut MeshBuilder, materials: &VehicleMaterials, detail: Detail) {
        let side = self.center[2].signum();
        let axis = [0.0, 0.0, side];
        let sides = detail.sides(18);
        let inner = add(self.center, [0.0, 0.0, -side * self.width]);
        shape.tube(inner, self.center, [self.radius; 2], sides, materials.tyre);
        let rim_radius = self.radius * self.rim;
        shape.disc(self.center, axis, [rim_radius, self.radius], sides, &[materials.tyre]);
        let sunk = add(self.center, [0.0, 0.0, -side * 0.02]);
        match detail {
            Detail::Near => self.spoked(shape, materials, sunk, axis),
            _ => shape.disc(sunk, axis, [0.0, rim_radius], sides, &[materials.rim]),
        }
    }

    /// A dark dish with a bright edge, a hub and spokes.
    fn spoked(&self, shape: &mut MeshBuilder, materials: &VehicleMaterials, center: Vec3, axis: Vec3) {
        let rim_radius = self.radius * self.rim;
        let behind = add(center, [0.0, 0.0, -axis[2] * 0.03]);
        shape.disc(behind, axis, [0.0, rim_radius], 16, &[materials.under]);
        shape.disc(center, axis, [rim_radius * 0.88, rim_radius], 16, &[materials.rim]);
        shape.disc(center, axis, [0.0, rim_radius * 0.3], 8, &[materials.rim]);
        for spoke in 0..self.spokes {
            let angle = std::f32::consts::TAU * spoke as f32 / self.spokes as f32;
            let (sin, cos) = crate::mesh_builder::sin_cos(angle);
            let half = rim_radius * if self.spokes > 7 { 0.09 } else { 0.16 };
            let at =
                |along: f32, across: f32| add(center, [cos * along - sin * across, sin * along + cos * across, 0.0]);
            let end = rim_radius * 0.9;
            let points = [at(0.0, -half), at(end, -half), at(end, half), at(0.0, half)];
            shape.quad(points, materials.rim, 0);
        }
    }
}
