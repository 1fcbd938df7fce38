//! The scene from above: the camera at the bottom looking up, rings of equal distance, boxes as they stand on the
//! ground.

use farsight_core::{Box2d, Box3d, Detection, ObjectClass};
use image::RgbImage;

use crate::annotate::far_to_near;
use crate::canvas::{Canvas, Pen, Point};
use crate::label_layout::LabelLayout;
use crate::legend::legend;
use crate::options::{DrawOptions, Scene};
use crate::palette::{GROUND, MUTED, NIGHT, RING, SHADOW, WHITE};
use crate::scale::drawing_scale;
use crate::text::{text_width, write};

/// Height of the text in a panel as wide as KITTI's images, pixels.
const TEXT_PX: f64 = 15.0;

/// Ranges that a panel may show, metres, and the distance between its rings.
const RANGES_M: [(f64, f64); 11] = [
    (10.0, 2.0),
    (20.0, 5.0),
    (30.0, 5.0),
    (40.0, 10.0),
    (50.0, 10.0),
    (60.0, 10.0),
    (80.0, 20.0),
    (100.0, 20.0),
    (120.0, 20.0),
    (160.0, 40.0),
    (240.0, 40.0),
];

/// What an empty scene shows, metres.
const EMPTY_RANGE_M: f64 = 40.0;

/// Corners of the footprint, front edge first, as indices into [`Box3d::corners`].
const FOOTPRINT: [usize; 4] = [2, 3, 6, 7];

/// The scene from above in a panel of `panel_size` (width and height, pixels), for an image of `image_size`.
///
/// The lit wedge is what the camera sees. The range is the nearest round number that holds every detection, at most
/// 240 m; text is sized for the panel. A panel without pixels is answered by an empty image.
pub fn birds_eye(scene: &Scene, image_size: [u32; 2], panel_size: [u32; 2], options: &DrawOptions) -> RgbImage {
    panel(scene, image_size, panel_size, drawing_scale(panel_size), options).unwrap_or_default()
}

/// [`birds_eye`] with a given factor on lines and text; `None` for a panel that cannot be drawn on.
pub(crate) fn panel(
    scene: &Scene,
    image_size: [u32; 2],
    panel_size: [u32; 2],
    scale: f64,
    options: &DrawOptions,
) -> Option<RgbImage> {
    let canvas = Canvas::filled(panel_size, NIGHT)?;
    let map = GroundMap::new(scene, panel_size, TEXT_PX * scale);
    let mut panel = Panel { canvas, scene, options, map, text_px: TEXT_PX * scale, line_px: 1.6 * scale };
    panel.ground(view_angles(scene, image_size));
    panel.headline();
    let far_to_near = far_to_near(scene.detections);
    for detection in &far_to_near {
        panel.detection(detection);
    }
    for label in scene.truth.iter().filter(|label| label.class != ObjectClass::DontCare) {
        let footprint = panel.map.footprint(&label.box3d);
        panel.canvas.outline(&footprint, Pen::dashed(WHITE.faded(0.9), 0.6 * panel.line_px));
    }
    panel.ego();
    panel.distances(&far_to_near);
    legend(&mut panel.canvas, scene, options, 0.85 * panel.text_px);
    Some(panel.canvas.into_image())
}

/// From metres on the ground to pixels of the panel.
struct GroundMap {
    origin: Point,
    px_per_m: f64,
    range_m: f64,
    step_m: f64,
}

impl GroundMap {
    fn new(scene: &Scene, panel_size: [u32; 2], text_px: f64) -> Self {
        let [width, height] = panel_size.map(f64::from);
        // Room for the ego marker below, for half a label above and beside.
        let origin = [width / 2.0, height - 2.6 * text_px];
        let ahead_px = (origin[1] - 1.6 * text_px).max(1.0);
        let aside_px = (width / 2.0 - 2.0 * text_px).max(1.0);
        let ahead_m = farthest(scene, |[x, z]| x.hypot(z).min(z.max(0.0) * 1.2));
        let aside_m = farthest(scene, |[x, _]| x.abs());
        // The range is up the page; what stands far aside needs a range whose scale still shows it.
        let needed_m = ahead_m.max(aside_m * ahead_px / aside_px);
        let needed_m = if scene.detections.is_empty() { EMPTY_RANGE_M } else { needed_m };
        let (range_m, step_m) =
            RANGES_M.into_iter().find(|(range, _)| *range >= needed_m).unwrap_or(RANGES_M[RANGES_M.len() - 1]);
        Self { origin, px_per_m: ahead_px / range_m, range_m, step_m }
    }

    /// The pixel of the ground point `x` metres to the right and `z` metres ahead.
    fn pixel(&self, [x, z]: Point) -> Point {
        [self.origin[0] + x * self.px_per_m, self.origin[1] - z * self.px_per_m]
    }

    fn footprint(&self, object: &Box3d) -> [Point; 4] {
        let corners = object.corners();
        FOOTPRINT.map(|i| self.pixel([corners[i][0], corners[i][2]]))
    }

    /// The arc around the camera from one angle to another (radians, 0 ahead, positive to the right).
    fn arc(&self, radius_m: f64, from: f64, to: f64) -> Vec<Point> {
        const PIECES: i32 = 96;
        (0..=PIECES)
            .map(|i| from + (to - from) * f64::from(i) / f64::from(PIECES))
            .map(|angle| self.pixel([radius_m * angle.sin(), radius_m * angle.cos()]))
            .collect()
    }
}

/// The largest value of `measure` over the ground points (x, z, metres) of all detections; 0 without any.
fn farthest(scene: &Scene, measure: impl Fn(Point) -> f64) -> f64 {
    let corners = scene.detections.iter().flat_map(|d| d.box3d.corners());
    corners.map(|[x, _, z]| measure([x, z])).filter(|v| v.is_finite()).fold(0.0, f64::max)
}

/// Angles of the left and right border of the image, radians, 0 ahead.
fn view_angles(scene: &Scene, image_size: [u32; 2]) -> [f64; 2] {
    let [width, height] = image_size.map(f64::from);
    // From far away the camera's offset from the origin does not matter.
    [-0.5, width - 0.5].map(|u| {
        let [x, _, z] = scene.camera.point_from_pixel([u, height / 2.0], 1000.0);
        x.atan2(z)
    })
}

struct Panel<'a> {
    canvas: Canvas,
    scene: &'a Scene<'a>,
    options: &'a DrawOptions,
    map: GroundMap,
    text_px: f64,
    line_px: f64,
}

impl Panel<'_> {
    /// The wedge that the camera sees, with its rings and their distances.
    fn ground(&mut self, [left, right]: [f64; 2]) {
        let mut wedge = self.map.arc(self.map.range_m, left, right);
        wedge.push(self.map.origin);
        self.canvas.polygon(&wedge, GROUND);
        let rings = (self.map.range_m / self.map.step_m).round() as u32;
        for ring in 1..=rings {
            let radius = f64::from(ring) * self.map.step_m;
            let arc = self.map.arc(radius, left, right);
            self.canvas.polyline(&arc, Pen::solid(RING, 0.6 * self.line_px));
            self.ring_label(radius, right);
        }
        for angle in [left, right] {
            let end = self.map.pixel([self.map.range_m * angle.sin(), self.map.range_m * angle.cos()]);
            self.canvas.polyline(&[self.map.origin, end], Pen::solid(RING, 0.6 * self.line_px));
        }
        let ahead = self.map.pixel([0.0, self.map.range_m]);
        self.canvas.polyline(&[self.map.origin, ahead], Pen::dashed(RING.faded(0.8), 0.5 * self.line_px));
    }

    /// The ring's distance, outside the right border of the wedge or where the ring leaves the panel.
    fn ring_label(&mut self, radius_m: f64, right: f64) {
        let text = format!("{radius_m:.0} m");
        let size_px = 0.85 * self.text_px;
        let room = self.canvas.bounds().x2 - self.map.origin[0] - text_width(&text, size_px) - 0.5 * self.text_px;
        let aside_m = (radius_m * right.sin()).min(room / self.map.px_per_m);
        let ahead_m = (radius_m * radius_m - aside_m * aside_m).max(0.0).sqrt();
        let [x, y] = self.map.pixel([aside_m, ahead_m]);
        write(&mut self.canvas, &text, [x + 0.4 * self.text_px, y + 0.5 * self.text_px], size_px, MUTED);
    }

    fn detection(&mut self, detection: &Detection) {
        let color = self.options.color(detection);
        let footprint = self.map.footprint(&detection.box3d);
        let [front_a, front_b, rear_b, rear_a] = footprint;
        self.canvas.polygon(&footprint, color.faded(0.28));
        // The arrow head from the middle of the box to its front.
        let tip = midpoint(front_a, front_b);
        let [a, b] = [midpoint(front_a, rear_a), midpoint(front_b, rear_b)];
        self.canvas.polygon(&[tip, a, b], color.faded(0.85));
        self.canvas.outline(&footprint, Pen::solid(color, self.line_px));
        self.error_bar(detection);
    }

    /// One standard deviation to both sides along the ray from the camera, with a short bar across each end.
    fn error_bar(&mut self, detection: &Detection) {
        let [x, _, z] = detection.box3d.location;
        let distance = x.hypot(z).max(f64::MIN_POSITIVE);
        let Some(sigma) = detection.sigma_of_m(distance) else { return };
        let cap = 0.25 * self.text_px / self.map.px_per_m / distance;
        let pen = Pen::solid(WHITE.faded(0.95), 0.8 * self.line_px);
        let ends = [-sigma, sigma].map(|by| [x, z].map(|v| v * (1.0 + by / distance)));
        self.canvas.polyline(&ends.map(|end| self.map.pixel(end)), pen);
        for [end_x, end_z] in ends {
            let bar = [-cap, cap].map(|by| self.map.pixel([end_x + z * by, end_z - x * by]));
            self.canvas.polyline(&bar, pen);
        }
    }

    fn ego(&mut self) {
        let [x, y] = self.map.origin;
        let r = 0.55 * self.text_px;
        let arrow = [[x, y - r], [x + 0.75 * r, y + 0.9 * r], [x, y + 0.5 * r], [x - 0.75 * r, y + 0.9 * r]];
        self.canvas.polygon(&arrow, WHITE);
    }

    fn distances(&mut self, far_to_near: &[&Detection]) {
        let window = self.canvas.bounds();
        let inside = |area: &Box2d| area.clamped(window.x2, window.y2).area() > 0.0;
        let shown: Vec<(&Detection, Box2d)> = far_to_near
            .iter()
            .rev()
            .filter_map(|d| Some((*d, Box2d::bounding(self.map.footprint(&d.box3d)).filter(inside)?)))
            .collect();
        let areas: Vec<Box2d> = shown.iter().map(|(_, area)| *area).collect();
        let size_px = 0.85 * self.text_px;
        let mut layout = LabelLayout::new(window, &areas, 0.2 * size_px);
        for (detection, area) in shown {
            let text = self.options.distance_text(detection);
            let place = layout.place(&area, [text_width(&text, size_px) + 0.4 * size_px, size_px]);
            self.canvas.rounded_rect(&place, 0.2 * size_px, SHADOW.faded(0.55));
            write(&mut self.canvas, &text, [place.x1 + 0.2 * size_px, place.y2 - 0.2 * size_px], size_px, WHITE);
        }
    }

    /// In the upper left corner: how many there are and how near the nearest of them is.
    fn headline(&mut self) {
        let distances = self.scene.detections.iter().map(|d| self.options.distance_of(&d.box3d));
        let [first, second] = headline_of(distances);
        let [left, top] = [0.9 * self.text_px, 1.7 * self.text_px];
        write(&mut self.canvas, &first, [left, top], 1.2 * self.text_px, WHITE);
        write(&mut self.canvas, &second, [left, top + 1.3 * self.text_px], self.text_px, MUTED);
    }
}

/// What is said about objects at these distances, metres, in two lines.
///
/// Something that was not found may be nearer than what was, so the second line speaks of what was found.
fn headline_of(distances: impl ExactSizeIterator<Item = f64>) -> [String; 2] {
    let first = match distances.len() {
        0 => "nothing found".to_owned(),
        count => format!("{count} found"),
    };
    // Seen from above an object may stand beside or behind the camera, where a depth is negative and nearest to
    // nothing.
    let nearest = distances.filter(|&distance| distance >= 0.0).reduce(f64::min);
    [first, nearest.map_or_else(String::new, |nearest| format!("nearest found {nearest:.1} m"))]
}

fn midpoint(a: Point, b: Point) -> Point {
    [0, 1].map(|i| f64::midpoint(a[i], b[i]))
}

#[cfg(test)]
mod tests {
    use super::headline_of;

    #[test]
    fn the_headline_speaks_of_what_was_found() {
        for (distances, expected) in [
            (vec![], ["nothing found", ""]),
            (vec![31.26, 8.0, 12.5], ["3 found", "nearest found 8.0 m"]),
            (vec![-2.0, 40.0], ["2 found", "nearest found 40.0 m"]),
            (vec![-2.0, f64::NAN], ["2 found", ""]),
        ] {
            assert_eq!(headline_of(distances.into_iter()), expected);
        }
    }
}
