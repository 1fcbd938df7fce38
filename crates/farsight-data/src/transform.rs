//! The fixed transform: image, camera and labels move together.

use std::f64::consts::PI;

use farsight_core::input::InputRules;
use farsight_core::{Affine2, Camera, Label, ObjectClass, wrapped_angle};
use image::RgbImage;

use crate::annotations::DepthMap;
use crate::{ColorJitter, Degradation, Frame, Reflections, Shadow, Sharpness, network_input};

/// What is done to one frame to make a network's input of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transform {
    /// Whether image and world are mirrored left to right, before anything else.
    pub mirror: bool,
    /// From pixels of the (mirrored) image to pixels of the input.
    pub window: Affine2,
    /// Change of colours.
    pub jitter: Option<ColorJitter>,
    /// What shines through what.
    pub reflections: Option<Reflections>,
    /// What lies in a shadow.
    pub shadow: Option<Shadow>,
    /// More or less fine detail.
    pub sharpness: Option<Sharpness>,
    /// What the camera adds.
    pub degradation: Option<Degradation>,
    /// Whether the window is shifted or scaled, not the whole image.
    pub scaled: bool,
    /// Whether the regression head may learn from the result.
    pub regress: bool,
}

/// One input of the network and what is to be seen in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Name of the frame.
    pub id: String,
    /// Normalised planes `[3, height, width]`.
    pub input: Vec<f32>,
    /// Width and height of the input, pixels.
    pub size: [usize; 2],
    /// The camera of the input.
    pub camera: Camera,
    /// The objects as `camera` sees them, with boxes in pixels of the input.
    pub labels: Vec<Label>,
    /// Whether the regression head may learn from it.
    pub regress: bool,
}

impl Transform {
    /// The whole image of `image_size` (width, height), nothing varied: for validation and use (spec 5.2).
    pub fn identity(image_size: [usize; 2], rules: &InputRules) -> Self {
        Self {
            mirror: false,
            window: rules.whole_image(image_size),
            jitter: None,
            reflections: None,
            shadow: None,
            sharpness: None,
            degradation: None,
            scaled: false,
            regress: true,
        }
    }

    /// From pixels of an image `image_width` pixels wide to pixels of the input, mirror included.
    pub fn input_from_image(&self, image_width: usize) -> Affine2 {
        if self.mirror { Affine2::mirror(image_width).then(&self.window) } else { self.window }
    }

    /// The camera of the input, from the camera of an image `image_width` pixels wide.
    pub fn camera(&self, camera: &Camera, image_width: usize) -> Camera {
        let seen = if self.mirror { camera.mirrored(image_width) } else { *camera };
        seen.transformed(&self.window)
    }

    /// A label as the camera of the input sees it.
    ///
    /// The 2D box is moved and clipped to the centres of the input's outermost pixels, as KITTI clips its own; one that
    /// lies outside becomes empty. Truncation and occlusion stay as annotated. `DontCare` has no 3D box to be mirrored.
    pub fn label(&self, label: &Label, image_width: usize, input_size: [usize; 2]) -> Label {
        let [max_x, max_y] = input_size.map(|side| side as f64 - 1.0);
        let box2d = label.box2d.transformed(&self.input_from_image(image_width)).clamped(max_x, max_y);
        let moved = Label { box2d, ..label.clone() };
        if self.mirror && label.class != ObjectClass::DontCare {
            Label { alpha: wrapped_angle(PI - label.alpha), box3d: label.box3d.mirrored(), ..moved }
        } else {
            moved
        }
    }

    /// The network's input from the image alone.
    pub fn input(&self, image: &RgbImage, rules: &InputRules) -> Vec<f32> {
        let affine = self.input_from_image(image.width() as usize);
        let mut input = network_input(image, &affine, rules, self.jitter.as_ref());
        if let Some(reflections) = &self.reflections {
            reflections.apply(&mut input, rules.size);
        }
        if let Some(shadow) = &self.shadow {
            shadow.apply(&mut input, rules.size);
        }
        if let Some(sharpness) = &self.sharpness {
            sharpness.apply(&mut input, rules.size);
        }
        if let Some(degradation) = &self.degradation {
            degradation.apply(&mut input, rules.size);
        }
        input
    }

    /// Image, camera and labels of `frame`, moved together.
    pub fn apply(&self, frame: &Frame, rules: &InputRules) -> Sample {
        let width = frame.image.width() as usize;
        Sample {
            id: frame.id.clone(),
            input: self.input(&frame.image, rules),
            size: rules.size,
            camera: self.camera(&frame.camera, width),
            labels: frame.labels.iter().map(|label| self.label(label, width, rules.size)).collect(),
            regress: self.regress,
        }
    }

    /// z of what is seen amid each cell of a map with a cell for `stride` pixels of the input a side, metres, row by
    /// row; infinite where nothing is. None where `frame` does not know it.
    pub fn surface_m(&self, frame: &Frame, rules: &InputRules, stride: usize) -> Option<Vec<f32>> {
        let DepthMap { depth_m } = frame.annotation()?;
        let (width, height) = frame.image.dimensions();
        let map_size = rules.size.map(|side| side / stride);
        let Some(image_from_input) = self.input_from_image(width as usize).inverse() else {
            return Some(vec![f32::INFINITY; map_size[0] * map_size[1]]);
        };
        let amid = |cell: usize| (cell * stride) as f64 + (stride as f64 - 1.0) / 2.0;
        let cells = (0..map_size[1]).flat_map(|row| (0..map_size[0]).map(move |column| [column, row]));
        let depth_at = |cell: [usize; 2]| {
            let [x, y] = image_from_input.apply(cell.map(amid)).map(f64::round);
            let inside = x >= 0.0 && y >= 0.0 && x < f64::from(width) && y < f64::from(height);
            if inside { depth_m[y as usize * width as usize + x as usize] } else { f32::INFINITY }
        };
        Some(cells.map(depth_at).collect())
    }
}
