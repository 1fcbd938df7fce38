//! Boxes and distances on the image.

use farsight_core::{Box2d, Box3d, Detection, ObjectClass};
use image::RgbImage;

use crate::canvas::{Canvas, Pen, Point};
use crate::legend::legend;
use crate::palette::{Ink, SHADOW, WHITE};
use crate::placing::Placing;
use crate::text::{CAP_HEIGHT, text_width, write};
use crate::wireframe::Wireframe;
use crate::{DrawOptions, Scene, drawing_scale};

/// Height of the text on KITTI's images, pixels.
const TEXT_PX: f64 = 16.0;

/// Width of the lines of a large box on KITTI's images, pixels.
const LINE_PX: f64 = 2.2;

/// A box this high in the image, in heights of the text, has lines of full width; smaller ones have thinner lines.
const FULL_WIDTH_HEIGHT: f64 = 5.0;

/// `image` with the 3D box, class and distance of every detection, and a legend.
///
/// Near boxes are drawn over far ones, ground truth over both, labels over everything. Boxes that cross the camera's own plane are cut there.
pub fn annotate(image: &RgbImage, scene: &Scene, options: &DrawOptions) -> RgbImage {
    let annotated = annotated(image, scene, options, true);
    annotated.unwrap_or_else(|| image.clone())
}

/// `None` for an image that cannot be drawn on.
pub(crate) fn annotated(image: &RgbImage, scene: &Scene, options: &DrawOptions, with_legend: bool) -> Option<RgbImage> {
    let mut drawing = Drawing {
        canvas: Canvas::from_image(image)?,
        scene,
        options,
        scale: drawing_scale([image.width(), image.height()]),
    };
    let far_to_near = far_to_near(scene.detections);
    for detection in &far_to_near {
        drawing.detection(detection);
    }
    for label in scene.truth.iter().filter(|label| label.class != ObjectClass::DontCare) {
        drawing.truth(&label.box3d);
    }
    drawing.labels(&far_to_near);
    if with_legend {
        let text_px = TEXT_PX * 0.85 * drawing.scale;
        legend(&mut drawing.canvas, scene, options, text_px);
    }
    Some(drawing.canvas.into_image())
}

pub(crate) fn far_to_near(detections: &[Detection]) -> Vec<&Detection> {
    let mut sorted: Vec<_> = detections.iter().collect();
    sorted.sort_by(|a, b| b.box3d.depth_m().total_cmp(&a.box3d.depth_m()));
    sorted
}

struct Drawing<'a> {
    canvas: Canvas,
    scene: &'a Scene<'a>,
    options: &'a DrawOptions,
    scale: f64,
}

impl Drawing<'_> {
    fn detection(&mut self, detection: &Detection) {
        let Some((wireframe, line_px)) = self.wireframe(&detection.box3d) else { return };
        let ink = self.options.ink(detection);
        self.canvas.polygon(&wireframe.front, ink.faded(if wireframe.faces_camera { 0.36 } else { 0.16 }));
        self.lines(&wireframe.far_edges, ink.faded(0.45), 0.55 * line_px);
        self.lines(&wireframe.cross, ink.faded(if wireframe.faces_camera { 0.9 } else { 0.45 }), 0.55 * line_px);
        self.lines(&wireframe.near_edges, SHADOW.faded(0.5), 1.9 * line_px);
        self.lines(&wireframe.near_edges, ink, line_px);
    }

    fn truth(&mut self, object: &Box3d) {
        let Some((wireframe, line_px)) = self.wireframe(object) else { return };
        for edge in wireframe.near_edges.iter().chain(&wireframe.far_edges) {
            self.canvas.polyline(edge, Pen::dashed(WHITE.faded(0.9), 0.6 * line_px));
        }
    }

    /// The lines of `object` and their width; `None` when nothing of it is in the picture.
    fn wireframe(&self, object: &Box3d) -> Option<(Wireframe, f64)> {
        let margin = 4.0 * LINE_PX * self.scale;
        let bounds = self.canvas.bounds();
        let window = Box2d::new(-margin, -margin, bounds.x2 + margin, bounds.y2 + margin);
        let wireframe = Wireframe::new(object, self.scene.camera, &window);
        let height = object.projected(self.scene.camera)?.height();
        let fullness = (height / (FULL_WIDTH_HEIGHT * TEXT_PX * self.scale)).clamp(0.5, 1.0);
        (!wireframe.is_empty()).then_some((wireframe, LINE_PX * self.scale * fullness))
    }

    fn lines(&mut self, lines: &[[Point; 2]], ink: Ink, width_px: f64) {
        for line in lines {
            self.canvas.polyline(line, Pen::solid(ink, width_px));
        }
    }

    /// Places the labels of near objects first, and draws them last.
    fn labels(&mut self, far_to_near: &[&Detection]) {
        let window = self.canvas.bounds();
        let shown: Vec<(&Detection, Box2d)> = far_to_near
            .iter()
            .rev()
            .filter_map(|detection| Some((*detection, visible_part(&detection.box3d, self.scene, &window)?)))
            .collect();
        let objects: Vec<Box2d> = shown.iter().map(|(_, area)| *area).collect();
        let text_px = TEXT_PX * self.scale;
        let mut placing = Placing::new(window, &objects, 0.15 * text_px);
        let placed: Vec<_> = shown
            .iter()
            .map(|(detection, area)| {
                let text = format!("{} {}", detection.class, self.options.distance_text(detection));
                let size = [text_width(&text, text_px) + text_px, 1.3 * text_px];
                (detection, area, placing.place(area, size), text)
            })
            .collect();
        for (detection, area, place, text) in placed.into_iter().rev() {
            let ink = self.options.ink(detection);
            self.leader(area, &place, ink);
            label(&mut self.canvas, &text, &place, text_px, ink);
        }
    }

    /// A thin line from a label that had to move away to its object.
    fn leader(&mut self, object: &Box2d, place: &Box2d, ink: Ink) {
        let x = f64::midpoint(place.x1, place.x2);
        let from = [x, if place.y2 < object.y1 { place.y2 } else { place.y1 }];
        let to = [x.clamp(object.x1, object.x2), if place.y2 < object.y1 { object.y1 } else { object.y2 }];
        let apart = place.y2 < object.y1 || place.y1 > object.y2;
        if apart && (from[1] - to[1]).abs() > 0.5 * TEXT_PX * self.scale {
            self.canvas.polyline(&[from, to], Pen::solid(SHADOW.faded(0.5), 2.2 * self.scale));
            self.canvas.polyline(&[from, to], Pen::solid(ink, 1.1 * self.scale));
        }
    }
}

/// The part of the projection inside `window`; `None` when there is none.
fn visible_part(object: &Box3d, scene: &Scene, window: &Box2d) -> Option<Box2d> {
    let whole = object.projected(scene.camera)?;
    let part = whole.clamped(window.x2, window.y2);
    (part.area() > 0.0).then_some(part)
}

/// A dark plate with a bar in the colour of the box and the text in white.
fn label(canvas: &mut Canvas, text: &str, place: &Box2d, text_px: f64, ink: Ink) {
    let inset = 0.2 * text_px;
    let bar = Box2d::new(place.x1 + inset, place.y1 + inset, place.x1 + 2.2 * inset, place.y2 - inset);
    canvas.plate(place, 0.25 * text_px, SHADOW.faded(0.85));
    canvas.plate(&bar, 0.6 * inset, ink);
    let baseline = f64::midpoint(place.y1, place.y2) + CAP_HEIGHT * text_px / 2.0;
    write(canvas, text, [place.x1 + 0.65 * text_px, baseline], text_px, WHITE);
}
