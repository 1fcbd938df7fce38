//! Boxes and distances on the image.

use farsight_core::{Box2d, Box3d, Detection, ObjectClass};
use image::RgbImage;

use crate::canvas::{Canvas, Pen, Point};
use crate::label_layout::LabelLayout;
use crate::legend::legend;
use crate::options::{DrawOptions, Names, Scene};
use crate::palette::{Rgba, SHADOW, WHITE};
use crate::scale::drawing_scale;
use crate::text::{CAP_HEIGHT, text_width, write};
use crate::wireframe::{Optics, Wireframe};

/// Height of the text on KITTI's images, pixels.
const TEXT_PX: f64 = 16.0;

/// The same where objects have names or words: labels are more, or longer, then.
const NAMED_TEXT_PX: f64 = 13.0;

/// Width of the lines of a large box on KITTI's images, pixels.
const LINE_PX: f64 = 2.2;

/// A box this high in the image, in heights of the text, has lines of full width; smaller ones have thinner lines.
const FULL_WIDTH_HEIGHT: f64 = 5.0;

/// `image` with the 3D box, class and distance of every detection, and a legend.
///
/// Near boxes are drawn over far ones, ground truth over both, labels over everything. Boxes that cross the camera's
/// own plane are cut there.
pub fn annotate(image: &RgbImage, scene: &Scene, options: &DrawOptions) -> RgbImage {
    let annotated = annotated(image, scene, options, &Tags::Classes, true);
    annotated.unwrap_or_else(|| image.clone())
}

/// What labels say.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Tags<'a> {
    /// Class and distance of each detection.
    Classes,
    /// Name and distance of each detection and of each object of the ground truth.
    Names(&'a Names<'a>),
    /// These words of each detection.
    Words(&'a [String]),
}

/// [`annotate`] with a name and a distance on every detection and every object of the ground truth, so that one can
/// talk about them.
pub fn annotate_named(image: &RgbImage, scene: &Scene, options: &DrawOptions, names: &Names) -> RgbImage {
    let annotated = annotated(image, scene, options, &Tags::Names(names), true);
    annotated.unwrap_or_else(|| image.clone())
}

/// `None` for an image that cannot be drawn on.
pub(crate) fn annotated(
    image: &RgbImage,
    scene: &Scene,
    options: &DrawOptions,
    says: &Tags,
    with_legend: bool,
) -> Option<RgbImage> {
    let mut drawing = Drawing {
        canvas: Canvas::from_image(image)?,
        scene,
        options,
        says,
        scale: drawing_scale([image.width(), image.height()]),
    };
    for detection in far_to_near(scene.detections) {
        drawing.detection(detection);
    }
    for label in scene.truth.iter().filter(|label| label.class != ObjectClass::DontCare) {
        drawing.truth(&label.box3d);
    }
    drawing.labels();
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
    says: &'a Tags<'a>,
    scale: f64,
}

/// What a label says, of what part of the image.
struct Tag {
    text: String,
    color: Rgba,
    depth_m: f64,
    area: Box2d,
}

impl Drawing<'_> {
    fn detection(&mut self, detection: &Detection) {
        let Some((wireframe, line_px)) = self.wireframe(&detection.box3d) else { return };
        let color = self.options.color(detection);
        self.canvas.polygon(&wireframe.front, color.faded(if wireframe.faces_camera { 0.36 } else { 0.16 }));
        self.lines(&wireframe.far_edges, color.faded(0.45), 0.55 * line_px);
        self.lines(&wireframe.cross, color.faded(if wireframe.faces_camera { 0.9 } else { 0.45 }), 0.55 * line_px);
        self.lines(&wireframe.near_edges, SHADOW.faded(0.5), 1.9 * line_px);
        self.lines(&wireframe.near_edges, color, line_px);
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
        let optics = Optics { camera: self.scene.camera, lens: self.options.lens, pitch_rad: self.options.pitch_rad };
        let wireframe = Wireframe::new(object, &optics, &window);
        let height = object.projected(self.scene.camera)?.height();
        let fullness = (height / (FULL_WIDTH_HEIGHT * TEXT_PX * self.scale)).clamp(0.5, 1.0);
        (!wireframe.is_empty()).then_some((wireframe, LINE_PX * self.scale * fullness))
    }

    fn lines(&mut self, lines: &[[Point; 2]], color: Rgba, width_px: f64) {
        for line in lines {
            self.canvas.polyline(line, Pen::solid(color, width_px));
        }
    }

    /// Places the labels of near objects first, and draws them last.
    fn labels(&mut self) {
        let mut tags = self.tags();
        tags.sort_by(|a, b| a.depth_m.total_cmp(&b.depth_m));
        let objects: Vec<Box2d> = tags.iter().map(|tag| tag.area).collect();
        let text_px = self.scale * if matches!(self.says, Tags::Classes) { TEXT_PX } else { NAMED_TEXT_PX };
        let mut layout = LabelLayout::new(self.canvas.bounds(), &objects, 0.15 * text_px);
        let place = |tag: &Tag| layout.place(&tag.area, [text_width(&tag.text, text_px) + text_px, 1.3 * text_px]);
        let places: Vec<_> = tags.iter().map(place).collect();
        for (tag, place) in tags.iter().zip(&places).rev() {
            self.leader(&tag.area, place, tag.color);
            label(&mut self.canvas, &tag.text, place, text_px, tag.color);
        }
    }

    /// The labels of what can be seen: class and distance of each detection, or name and distance of everything that
    /// has a name.
    fn tags(&self) -> Vec<Tag> {
        let window = self.canvas.bounds();
        let tag = |object: &Box3d, color, text| {
            Some(Tag { text, color, depth_m: object.depth_m(), area: visible_part(object, self.scene, &window)? })
        };
        let detections = self.scene.detections.iter().enumerate().filter_map(|(position, detection)| {
            let distance = self.options.distance_text(detection);
            let text = match self.says {
                Tags::Classes => format!("{} {distance}", detection.class),
                Tags::Names(names) => format!("{} {distance}", names.detections.get(position)?),
                Tags::Words(words) => words.get(position)?.clone(),
            };
            tag(&detection.box3d, self.options.color(detection), text)
        });
        let truth_names = if let Tags::Names(names) = self.says { names.truth } else { &[] };
        let truth = self.scene.truth.iter().zip(truth_names).filter(|(label, _)| label.class != ObjectClass::DontCare);
        let truth = truth.filter_map(|(label, name)| {
            let text = format!("{name} {:.1} m", self.options.distance_of(&label.box3d));
            tag(&label.box3d, WHITE, text)
        });
        detections.chain(truth).collect()
    }

    /// A thin line from a label that had to move away to its object.
    fn leader(&mut self, object: &Box2d, place: &Box2d, color: Rgba) {
        let x = f64::midpoint(place.x1, place.x2);
        let from = [x, if place.y2 < object.y1 { place.y2 } else { place.y1 }];
        let to = [x.clamp(object.x1, object.x2), if place.y2 < object.y1 { object.y1 } else { object.y2 }];
        let apart = place.y2 < object.y1 || place.y1 > object.y2;
        if apart && (from[1] - to[1]).abs() > 0.5 * TEXT_PX * self.scale {
            self.canvas.polyline(&[from, to], Pen::solid(SHADOW.faded(0.5), 2.2 * self.scale));
            self.canvas.polyline(&[from, to], Pen::solid(color, 1.1 * self.scale));
        }
    }
}

/// The part of the projection inside `window`; `None` when there is none.
fn visible_part(object: &Box3d, scene: &Scene, window: &Box2d) -> Option<Box2d> {
    let whole = object.projected(scene.camera)?;
    let part = whole.clamped(window.x2, window.y2);
    (part.area() > 0.0).then_some(part)
}

/// A dark background with a bar in the colour of the box and the text in white.
fn label(canvas: &mut Canvas, text: &str, place: &Box2d, text_px: f64, color: Rgba) {
    let inset = 0.2 * text_px;
    let bar = Box2d::new(place.x1 + inset, place.y1 + inset, place.x1 + 2.2 * inset, place.y2 - inset);
    canvas.rounded_rect(place, 0.25 * text_px, SHADOW.faded(0.85));
    canvas.rounded_rect(&bar, 0.6 * inset, color);
    let baseline = f64::midpoint(place.y1, place.y2) + CAP_HEIGHT * text_px / 2.0;
    write(canvas, text, [place.x1 + 0.65 * text_px, baseline], text_px, WHITE);
}
