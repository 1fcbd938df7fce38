//! A car's body as a skin over cross-sections along its length.
//!
//! Shares along the length (`t`) run from 0 at the front to 1 at the rear; heights are shares of the height, above the
//! ground.

use super::context::Detail;
use super::paint::VehicleMaterials;
use crate::mesh_builder::MeshBuilder;
use crate::scene::{MaterialId, Vec3};

/// Half of a cross-section has this many points, from the middle of the floor to the middle of the roof.
const HALF: usize = 10;

/// Where there are windows behind the front doors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Glazing {
    /// All around.
    Full,
    /// In the rear only.
    Rear,
    /// Nowhere.
    None,
}

/// The side view and the plan of a body.
#[derive(Debug, Clone, Copy)]
pub(super) struct Profile {
    /// Height of the bonnet at the nose and at the foot of the windscreen.
    pub(super) nose: f32,
    pub(super) cowl: f32,
    /// Where the windscreen starts and ends.
    pub(super) screen: [f32; 2],
    /// Where the rear window starts (end of the roof) and ends.
    pub(super) rear: [f32; 2],
    /// Height of the boot behind the rear window, and at the tail.
    pub(super) deck: f32,
    pub(super) tail: f32,
    /// Height of the roof over the windscreen, and over the rear window; 1 in between.
    pub(super) roof: [f32; 2],
    /// Lower edge of the body.
    pub(super) sill: f32,
    /// Centres of the axles.
    pub(super) axles: [f32; 2],
    /// Radius of a wheel, metres: wheels differ less than cars do, and so say how large a car is.
    pub(super) wheel_m: f32,
    /// Width over the roof and over the shoulders, shares of the width.
    pub(super) roof_width: f32,
    pub(super) shoulder_width: f32,
    /// Width of the nose and the tail, shares of the width.
    pub(super) nose_width: f32,
    pub(super) tail_width: f32,
    /// Where the pillar between the doors stands, and its thickness.
    pub(super) pillar: f32,
    /// Where the side windows end.
    pub(super) window_end: f32,
    pub(super) glazing: Glazing,
    /// Black lower edge, as on cross-country cars.
    pub(super) black_sill: bool,
    /// Rear lamps stand upright.
    pub(super) upright_lamps: bool,
}

impl Profile {
    /// Height of the top line.
    fn top(&self, t: f32) -> f32 {
        let [screen_start, screen_end] = self.screen;
        let [rear_start, rear_end] = self.rear;
        if t < screen_start {
            let share = t / screen_start;
            // A bonnet is round: it rises quickly behind the nose.
            self.nose + (self.cowl - self.nose) * (share * (2.0 - share)).sqrt()
        } else if t < screen_end {
            lerp(self.cowl, self.roof[0], (t - screen_start) / (screen_end - screen_start))
        } else if t < rear_start {
            let share = (t - screen_end) / (rear_start - screen_end);
            let line = lerp(self.roof[0], self.roof[1], share);
            line + (1.0 - self.roof[0].max(self.roof[1])) * 4.0 * share * (1.0 - share)
        } else if t < rear_end {
            lerp(self.roof[1], self.deck, (t - rear_start) / (rear_end - rear_start))
        } else {
            let share = (t - rear_end) / (1.0 - rear_end).max(1e-3);
            lerp(self.deck, self.tail, share * share)
        }
    }

    /// Where the glass of the windscreen ends, below the edge of the roof.
    fn screen_top(&self) -> f32 {
        lerp(self.screen[0], self.screen[1], 0.93)
    }

    /// Where the glass of the rear window starts.
    fn rear_top(&self) -> f32 {
        lerp(self.rear[0], self.rear[1], 0.16)
    }

    /// Height of the shoulder, under the windows.
    fn belt(&self, t: f32) -> f32 {
        let [start, end] = [self.screen[0], self.rear[1]];
        let line = lerp(self.cowl, self.deck.max(self.cowl * 0.98), ((t - start) / (end - start)).clamp(0.0, 1.0));
        line.min(self.top(t) - 0.025)
    }

    /// Share of the full width at the shoulders, seen from above.
    fn plan(&self, t: f32) -> f32 {
        let ends = |distance: f32, narrow: f32, reach: f32| {
            let share = (1.0 - distance / reach).clamp(0.0, 1.0);
            1.0 - (1.0 - narrow) * share * share * share
        };
        ends(t, self.nose_width, 0.2).min(ends(1.0 - t, self.tail_width, 0.16))
    }
}

fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// A body of a profile and a size.
pub(super) struct Body {
    pub(super) profile: Profile,
    height: f32,
    width: f32,
    length: f32,
    stations: Vec<f32>,
}

impl Body {
    pub(super) fn new(profile: Profile, [height, width, length]: [f32; 3], detail: Detail) -> Self {
        let mut body = Self { profile, height, width, length, stations: Vec::new() };
        body.stations = body.stations(detail);
        body
    }

    pub(super) fn wheel_radius(&self) -> f32 {
        self.profile.wheel_m.min(0.25 * self.height).min(0.12 * self.length)
    }

    fn arch_radius(&self) -> f32 {
        self.wheel_radius() * 1.14
    }

    /// Position along x of a share of the length.
    pub(super) fn x(&self, t: f32) -> f32 {
        self.length * (0.5 - t)
    }

    fn stations(&self, detail: Detail) -> Vec<f32> {
        let p = &self.profile;
        let mut stations = vec![0.0, 0.03, 0.09, p.screen[0], p.screen[1], p.rear[0], p.rear[1], 0.92, 0.975, 1.0];
        stations.extend([p.pillar - 0.012, p.pillar + 0.012, p.window_end, p.screen_top(), p.rear_top()]);
        if detail > Detail::Far {
            stations.extend([0.01, 0.18, 0.99, f32::midpoint(p.screen[1], p.rear[0])]);
            stations.extend([lerp(p.screen[0], p.screen[1], 0.5), lerp(p.rear[0], p.rear[1], 0.5)]);
            stations.push(lerp(p.screen[0], p.screen[1], 0.85));
        }
        let steps = detail.sides(8);
        for axle in p.axles {
            for k in 0..=steps {
                let angle = std::f32::consts::PI * k as f32 / steps as f32;
                let offset = self.arch_radius() * libm::cosf(angle) * 1.0001;
                stations.push(axle + offset / self.length);
            }
        }
        stations.retain(|t| (0.0..=1.0).contains(t));
        stations.sort_by(f32::total_cmp);
        stations.dedup_by(|a, b| (*a - *b).abs() < 0.002);
        stations
    }

    /// Lower edge at `t`, metres above the ground, with the openings for the wheels.
    fn floor(&self, t: f32) -> f32 {
        let p = &self.profile;
        let overhang = (0.06 - t).max(t - 0.93).max(0.0) / 0.07;
        let plain = (p.sill + 0.05 * overhang.min(1.0)) * self.height;
        let arch = |axle: f32| {
            let offset = (t - axle) * self.length;
            let inside = self.arch_radius() * self.arch_radius() - offset * offset;
            if inside > 0.0 { self.wheel_radius() + inside.sqrt() } else { 0.0 }
        };
        plain.max(arch(p.axles[0])).max(arch(p.axles[1]))
    }

    /// Half a cross-section: (z, height) from the middle of the floor to the middle of the roof.
    fn half_section(&self, t: f32) -> [[f32; 2]; HALF] {
        let p = &self.profile;
        let half = self.width / 2.0 * p.plan(t);
        let (floor, belt, top) = (self.floor(t), p.belt(t) * self.height, p.top(t) * self.height);
        let shoulder = p.shoulder_width;
        // Where there is no cabin the top is a bonnet that spans the shoulders.
        let cabin = ((top - belt) / (self.height - p.cowl * self.height)).clamp(0.0, 1.0);
        let roof = lerp(shoulder * 0.93, p.roof_width, cabin);
        let rise = top - belt;
        let bulge = lerp(floor, belt, 0.45).max(0.36 * self.height).max(floor + 0.02);
        let edge = lerp(bulge, belt, 0.82).max(bulge + 0.02);
        [
            [0.0, floor],
            [0.86 * half, floor],
            [0.965 * half, floor + 0.015],
            [half, bulge],
            [(shoulder + 0.02) * half, edge],
            [shoulder * half, belt.max(edge + 0.005)],
            [roof * half, belt + rise * 0.86],
            [roof * 0.89 * half, belt + rise * 0.955],
            [roof * 0.62 * half, belt + rise * 0.99],
            [0.0, top],
        ]
    }

    fn section(&self, t: f32) -> Vec<Vec3> {
        let half = self.half_section(t);
        let x = self.x(t);
        let right = half.iter().map(|[z, h]| [x, -h, *z]);
        let left = half.iter().rev().skip(1).map(|[z, h]| [x, -h, -z]);
        right.chain(left).collect()
    }

    /// The skin with its windows, lamps and ends.
    pub(super) fn build(&self, shape: &mut MeshBuilder, materials: &VehicleMaterials) {
        let sections: Vec<Vec<Vec3>> = self.stations.iter().map(|&t| self.section(t)).collect();
        shape.loft(&sections, |i, j| Some(self.material(i, j, materials)));
        self.end(shape, 0.0, materials);
        self.end(shape, 1.0, materials);
    }

    fn material(&self, station: usize, point: usize, materials: &VehicleMaterials) -> MaterialId {
        let p = &self.profile;
        // Both halves alike, counted from the floor.
        let band = if point < HALF - 1 { point } else { 2 * (HALF - 1) - 1 - point };
        let t = f32::midpoint(self.stations[station], self.stations[station + 1]);
        let in_screen = p.screen[0] < t && t < p.screen_top();
        let in_rear = p.rear_top() < t && t < p.rear[1];
        match band {
            0 | 1 => materials.under,
            2 if p.black_sill => materials.trim,
            4 if t < 0.09 => materials.head_lamp,
            4 if t > 0.955 => materials.tail_lamp,
            5 => self.side_window(t, materials),
            8 | 7 if in_screen => materials.window,
            8 | 7 if in_rear && p.glazing != Glazing::None => materials.rear_window,
            _ => materials.body,
        }
    }

    /// Between shoulder and roof: window, pillar or body.
    fn side_window(&self, t: f32, materials: &VehicleMaterials) -> MaterialId {
        let p = &self.profile;
        let start = lerp(p.screen[0], p.screen[1], 0.4);
        let is_pillar = (t - p.pillar).abs() < 0.012;
        if t < start || t > p.window_end || (t > p.pillar && p.glazing != Glazing::Full) {
            materials.body
        } else if is_pillar {
            materials.trim
        } else if t < p.pillar {
            materials.window
        } else {
            materials.rear_window
        }
    }

    /// The inside of the cabin: cloth behind metal, nothing behind windows and on the floor.
    pub(super) fn line(&self, shape: &mut MeshBuilder, materials: &VehicleMaterials) {
        let cabin = self.profile.screen[0]..=self.profile.rear[1];
        let first = self.stations.iter().take_while(|t| !cabin.contains(t)).count();
        let stations = self.stations.iter().filter(|t| cabin.contains(t));
        let inset = |[x, y, z]: Vec3| [0.98 * x, 0.97 * (y + 0.5 * self.height) - 0.5 * self.height, 0.95 * z];
        let sections: Vec<Vec<Vec3>> = stations.map(|&t| self.section(t).into_iter().map(inset).collect()).collect();
        // The floor is its own lining: over the wheels the two would lie in one place.
        let bare = [materials.window, materials.rear_window, materials.under];
        shape.loft(&sections, |i, j| {
            let is_bare = bare.contains(&self.material(first + i, j, materials));
            (!is_bare).then_some(materials.lining)
        });
    }

    /// Closes the front (`t` 0) or the rear (1).
    fn end(&self, shape: &mut MeshBuilder, t: f32, materials: &VehicleMaterials) {
        let half = self.half_section(t);
        let x = self.x(t);
        for (band, pair) in half.windows(2).enumerate().skip(1) {
            let [[z0, h0], [z1, h1]] = [pair[0], pair[1]];
            let points = [[x, -h0, -z0], [x, -h0, z0], [x, -h1, z1], [x, -h1, -z1]];
            let material = if band == 2 && self.profile.black_sill { materials.trim } else { materials.body };
            shape.quad(points, material, 0);
        }
    }

    /// Height and half width of the side at `t`, along the points of the cross-section above the sill.
    pub(super) fn flank(&self, t: f32) -> Vec<[f32; 2]> {
        self.half_section(t)[2..=5].to_vec()
    }

    pub(super) fn roof_height(&self, t: f32) -> f32 {
        self.profile.top(t) * self.height
    }

    /// Half width and height of the end at `t` (0 front, 1 rear): lower edge, widest place, shoulder.
    pub(super) fn end_frame(&self, t: f32) -> [[f32; 2]; 3] {
        let half = self.half_section(t);
        [half[2], half[3], half[5]]
    }

    pub(super) fn shoulder(&self, t: f32) -> [f32; 2] {
        self.half_section(t)[5]
    }
}
