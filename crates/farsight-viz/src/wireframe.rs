//! A box as the camera sees it: lines and faces in pixels, cut at the near plane and at the border of the picture.

use farsight_core::box3d::{EDGES, FRONT_FACE, NEAR_PLANE_M, near_plane_crossing};
use farsight_core::pitch::camera_from_level;
use farsight_core::{Box2d, Box3d, Camera, Lens};

use crate::canvas::Point;

/// The six faces as indices into [`Box3d::corners`], in order around each: front, rear, both sides, top, bottom.
const FACES: [[usize; 4]; 6] = [FRONT_FACE, [0, 5, 6, 7], [0, 1, 2, 7], [3, 4, 5, 6], [0, 1, 4, 5], [2, 3, 6, 7]];

/// Pieces of an edge that a lens bends.
const BENT_PIECES: usize = 12;

/// What makes pixels of points: a pinhole, and the lens before it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Optics<'a> {
    pub(crate) camera: &'a Camera,
    pub(crate) lens: Option<Lens>,
    /// How far down the camera looks against the road on which boxes stand upright, radians.
    pub(crate) pitch_rad: f64,
}

impl Optics<'_> {
    /// The pixel that shows `point` (metres); none for a point not in front of the camera.
    fn pixel(&self, point: [f64; 3]) -> Option<Point> {
        let pixel = self.camera.pixel_from_point(point)?;
        Some(self.lens.map_or(pixel, |lens| lens.distorted_pixel(self.camera, pixel)))
    }

    /// Corners of `object` where it stands upright on its road.
    fn corners(&self, object: &Box3d) -> [[f64; 3]; 8] {
        if self.pitch_rad == 0.0 {
            return object.corners();
        }
        let camera_from_level = camera_from_level(self.pitch_rad);
        object.moved_back(&camera_from_level).corners().map(|corner| camera_from_level.apply(corner))
    }

    /// The places along the line from `a` to `b` that are joined by straight lines.
    fn places(&self, a: [f64; 3], b: [f64; 3]) -> Vec<[f64; 3]> {
        let pieces = if self.lens.is_some() { BENT_PIECES } else { 1 };
        let share = |i: usize| i as f64 / pieces as f64;
        let between = |t: f64| [0, 1, 2].map(|axis| a[axis] + t * (b[axis] - a[axis]));
        // The ends exactly.
        (0..=pieces).map(|i| if i == pieces { b } else { between(share(i)) }).collect()
    }
}

/// What to draw of a box.
#[derive(Debug, Default)]
pub(crate) struct Wireframe {
    /// Edges of faces that look towards the camera.
    pub(crate) near_edges: Vec<[Point; 2]>,
    /// Edges behind the box.
    pub(crate) far_edges: Vec<[Point; 2]>,
    /// The front face; no points when it is out of sight of the lens.
    pub(crate) front: Vec<Point>,
    /// Both diagonals of the front face.
    pub(crate) cross: Vec<[Point; 2]>,
    /// Whether the front looks towards the camera.
    pub(crate) faces_camera: bool,
}

impl Wireframe {
    /// The part of `object` that is shown within `window`.
    pub(crate) fn new(object: &Box3d, optics: &Optics, window: &Box2d) -> Self {
        let corners = optics.corners(object);
        let center = [0, 1, 2].map(|axis| corners.iter().map(|corner| corner[axis]).sum::<f64>() / 8.0);
        let towards = FACES.map(|face| looks_at_camera(&corners, face, center));
        let line = |[a, b]: [usize; 2]| projected_line(corners[a], corners[b], optics, window);
        let mut wireframe = Self { faces_camera: towards[0], ..Self::default() };
        for edge in EDGES {
            let near =
                FACES.iter().zip(towards).any(|(face, towards)| towards && edge.iter().all(|c| face.contains(c)));
            let edges = if near { &mut wireframe.near_edges } else { &mut wireframe.far_edges };
            edges.extend(line(edge));
        }
        let [a, b, c, d] = FRONT_FACE;
        wireframe.cross.extend([[a, c], [b, d]].into_iter().flat_map(line));
        wireframe.front = projected_face(FRONT_FACE.map(|i| corners[i]), optics, window);
        wireframe
    }

    /// Whether nothing of the box is in the picture.
    pub(crate) fn is_empty(&self) -> bool {
        self.near_edges.is_empty() && self.far_edges.is_empty()
    }
}

/// Whether the camera, at the origin, is on the outer side of `face` of the box with this centre.
fn looks_at_camera(corners: &[[f64; 3]; 8], face: [usize; 4], center: [f64; 3]) -> bool {
    let middle = [0, 1, 2].map(|axis| face.iter().map(|&i| corners[i][axis]).sum::<f64>() / 4.0);
    (0..3).map(|axis| -middle[axis] * (middle[axis] - center[axis])).sum::<f64>() > 0.0
}

/// The visible pieces of a line; one without a lens.
fn projected_line(a: [f64; 3], b: [f64; 3], optics: &Optics, window: &Box2d) -> Vec<[Point; 2]> {
    let [a, b] = match near_plane_crossing(a, b) {
        Some(cut) if a[2] < NEAR_PLANE_M => [cut, b],
        Some(cut) => [a, cut],
        None => [a, b],
    };
    if a[2] < NEAR_PLANE_M {
        return Vec::new();
    }
    let pixels: Vec<Option<Point>> = optics.places(a, b).into_iter().map(|place| optics.pixel(place)).collect();
    pixels.windows(2).filter_map(|pair| clipped_line([pair[0]?, pair[1]?], window)).collect()
}

fn projected_face(face: [[f64; 3]; 4], optics: &Optics, window: &Box2d) -> Vec<Point> {
    let mut visible = Vec::new();
    for (i, &corner) in face.iter().enumerate() {
        if corner[2] >= NEAR_PLANE_M {
            visible.push(corner);
        }
        visible.extend(near_plane_crossing(corner, face[(i + 1) % face.len()]));
    }
    let sides_of = |i: usize| optics.places(visible[i], visible[(i + 1) % visible.len()]);
    // The end of a side is the start of the next one.
    let outline = (0..visible.len()).flat_map(|i| sides_of(i).into_iter().rev().skip(1).rev());
    let Some(points) = outline.map(|place| optics.pixel(place)).collect::<Option<Vec<_>>>() else {
        return Vec::new();
    };
    sides(window).iter().fold(points, |polygon, side| side.clipped_polygon(&polygon))
}

/// One border of a window: what is kept has `sign * coordinate >= sign * bound`.
struct Side {
    axis: usize,
    bound: f64,
    sign: f64,
}

fn sides(window: &Box2d) -> [Side; 4] {
    let side = |axis, bound, sign| Side { axis, bound, sign };
    [side(0, window.x1, 1.0), side(0, window.x2, -1.0), side(1, window.y1, 1.0), side(1, window.y2, -1.0)]
}

impl Side {
    /// Distance inside, negative outside.
    fn depth(&self, point: Point) -> f64 {
        self.sign * (point[self.axis] - self.bound)
    }

    fn crossing(&self, a: Point, b: Point) -> Point {
        let (da, db) = (self.depth(a), self.depth(b));
        let t = da / (da - db);
        [0, 1].map(|axis| a[axis] + t * (b[axis] - a[axis]))
    }

    fn clipped_polygon(&self, polygon: &[Point]) -> Vec<Point> {
        let mut kept = Vec::with_capacity(polygon.len() + 1);
        for (i, &point) in polygon.iter().enumerate() {
            let next = polygon[(i + 1) % polygon.len()];
            let (inside, next_inside) = (self.depth(point) >= 0.0, self.depth(next) >= 0.0);
            if inside {
                kept.push(point);
            }
            if inside != next_inside {
                kept.push(self.crossing(point, next));
            }
        }
        kept
    }
}

/// The part of `line` inside `window`. The rasteriser's own clipping is exact only for coordinates that fit its small
/// integers.
fn clipped_line(line: [Point; 2], window: &Box2d) -> Option<[Point; 2]> {
    sides(window).iter().try_fold(line, |[a, b], side| match (side.depth(a) >= 0.0, side.depth(b) >= 0.0) {
        (true, true) => Some([a, b]),
        (true, false) => Some([a, side.crossing(a, b)]),
        (false, true) => Some([side.crossing(a, b), b]),
        (false, false) => None,
    })
}

#[cfg(test)]
mod tests {
    use farsight_core::box3d::EDGES;
    use farsight_core::pitch::camera_from_level;
    use farsight_core::{Box2d, Box3d, Camera, Dimensions, Lens};
    use proptest::prelude::*;

    use super::{FACES, Optics, Wireframe};

    const WINDOW: Box2d = Box2d::new(0.0, 0.0, 1242.0, 375.0);

    fn camera() -> Camera {
        Camera::from_intrinsics(721.5, 721.5, 609.6, 172.9).unwrap()
    }

    fn car(location: [f64; 3], yaw: f64) -> Box3d {
        Box3d { dimensions: Dimensions { height: 1.5, width: 1.6, length: 3.9 }, location, yaw }
    }

    #[test]
    fn every_edge_belongs_to_two_faces() {
        for edge in EDGES {
            let faces = FACES.iter().filter(|face| edge.iter().all(|c| face.contains(c))).count();
            assert_eq!(faces, 2, "edge {edge:?}");
        }
    }

    #[test]
    fn a_car_driving_away_shows_its_rear_and_roof_or_neither_side() {
        let away = Wireframe::new(
            &car([0.0, 1.65, 20.0], -std::f64::consts::FRAC_PI_2),
            &Optics { camera: &camera(), lens: None, pitch_rad: 0.0 },
            &WINDOW,
        );
        assert!(!away.faces_camera);
        let oncoming = Wireframe::new(
            &car([0.0, 1.65, 20.0], std::f64::consts::FRAC_PI_2),
            &Optics { camera: &camera(), lens: None, pitch_rad: 0.0 },
            &WINDOW,
        );
        assert!(oncoming.faces_camera);
        // Rear and roof are seen from 1.65 m over the ground: 4 + 3 edges.
        assert_eq!((away.near_edges.len(), away.far_edges.len()), (7, 5));
    }

    #[test]
    fn a_lens_bends_edges_and_moves_their_ends_to_where_it_shows_them() {
        let (camera, lens) = (camera(), Lens::Brown([-0.3, 0.08, 0.0, 0.0, 0.0]));
        let object = car([-3.5, 1.65, 12.0], 0.4);
        let bent = Wireframe::new(&object, &Optics { camera: &camera, lens: Some(lens), pitch_rad: 0.0 }, &WINDOW);
        let straight = Wireframe::new(&object, &Optics { camera: &camera, lens: None, pitch_rad: 0.0 }, &WINDOW);
        let ends = straight.near_edges.concat();
        assert!(!ends.is_empty() && bent.near_edges.len() == super::BENT_PIECES * straight.near_edges.len());
        let shown = |end: &[f64; 2]| lens.distorted_pixel(&camera, *end);
        let is_there =
            |end: &[f64; 2]| bent.near_edges.concat().iter().any(|p| (p[0] - end[0]).hypot(p[1] - end[1]) < 1e-6);
        assert!(ends.iter().map(shown).all(|end| is_there(&end)));
        assert!(bent.front.len() >= straight.front.len());
    }

    #[test]
    fn nothing_is_drawn_of_a_car_behind_the_camera() {
        assert!(
            Wireframe::new(
                &car([0.0, 1.65, -20.0], 0.3),
                &Optics { camera: &camera(), lens: None, pitch_rad: 0.0 },
                &WINDOW
            )
            .is_empty()
        );
    }

    proptest! {
        #[test]
        fn all_points_lie_in_the_window(x in -10.0..10.0, y in -2.0..3.0, z in -5.0..60.0, yaw in -3.2..3.2) {
            let wireframe = Wireframe::new(&car([x, y, z], yaw), &Optics { camera: &camera(), lens: None, pitch_rad: 0.0 }, &WINDOW);
            let lines = wireframe.near_edges.iter().chain(&wireframe.far_edges).chain(&wireframe.cross);
            for point in lines.flatten().chain(&wireframe.front) {
                prop_assert!((-1e-6..=WINDOW.x2 + 1e-6).contains(&point[0]), "{point:?}");
                prop_assert!((-1e-6..=WINDOW.y2 + 1e-6).contains(&point[1]), "{point:?}");
            }
        }
    }

    #[test]
    fn boxes_stand_on_the_road_of_a_camera_that_looks_down() {
        let optics = Optics { camera: &camera(), lens: None, pitch_rad: 0.2 };
        let dimensions = Dimensions { height: 1.5, width: 1.8, length: 4.0 };
        let standing = Box3d { dimensions, location: [1.0, 1.6, 20.0], yaw: 0.4 };
        let seen = standing.moved(&camera_from_level(0.2));
        for (corner, level) in optics.corners(&seen).into_iter().zip(standing.corners()) {
            let back = camera_from_level(0.2).inverse().apply(corner);
            assert!((0..3).all(|axis| (back[axis] - level[axis]).abs() < 1e-9), "{back:?}, {level:?}");
        }
    }
}
