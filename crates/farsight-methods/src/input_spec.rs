//! What a network's input is of an image: its size, and which cameras it was made for.

use std::ops::RangeInclusive;

use farsight_core::detection::View;
use farsight_core::input::InputRules;
use farsight_core::linear::norm;
use farsight_core::{Affine2, Camera};
use farsight_data::network_input_into;
use image::RgbImage;

use crate::UnfamiliarCamera;

/// Side by which an input must be divisible: the stride of the coarsest level of every backbone here.
pub const SIZE_STEP: usize = 32;

/// How images become inputs of a network.
#[derive(Debug, Clone, PartialEq)]
pub struct InputSpec {
    /// Size that the network was trained with, and conventions.
    pub rules: InputRules,
    /// Whether the network sees cameras without the fourth column of their projection.
    pub camera_3x3: bool,
    /// Smallest and largest focal length that the model was trained with, pixels of the network's input.
    pub focal_range_px: Option<[f64; 2]>,
}

/// An input grows at most so many times to bring a wide camera into the trained range: time and memory grow with the
/// square.
const MAX_ENLARGEMENT: usize = 2;

impl InputSpec {
    /// The input for an image of `image_size` (width and height, pixels) taken by `camera`.
    ///
    /// The width is the model's, or the one nearest to it that brings the camera's focal length into the trained range.
    /// The height is the model's too (in proportion), the image centred and cropped or padded, as SMOKE does, as long
    /// as that loses at most 16 rows at the top and at the bottom: images of KITTI's shape. A higher image gets an
    /// input as high as it needs, in steps of 32, because the network is fully convolutional; at most as high as wide,
    /// as beyond that the time grows and a road fills no picture. A portrait image is cropped to that square.
    pub fn input_for(&self, image_size: [usize; 2], camera: &Camera) -> InputRules {
        let width = self.input_width(image_size, camera);
        let in_proportion = |side: usize| (side * width).div_ceil(self.rules.size[0] * SIZE_STEP) * SIZE_STEP;
        let height = in_proportion(self.rules.size[1]);
        let scaled_height = image_size[1] as f64 * width as f64 / image_size[0].max(1) as f64;
        if scaled_height <= (height + SIZE_STEP) as f64 {
            return InputRules { size: [width, height], ..self.rules };
        }
        let whole = (scaled_height / SIZE_STEP as f64).ceil().min((width / SIZE_STEP) as f64) as usize * SIZE_STEP;
        InputRules { size: [width, whole.max(height)], ..self.rules }
    }

    /// Makes inputs of this width, whatever the camera.
    pub fn fix_size(&mut self, size: [usize; 2]) {
        self.rules.size = size;
        self.focal_range_px = None;
    }

    /// Writes the network's input for `image`, taken by `camera`, to `input`; returns its width and height and how it
    /// sees the image.
    ///
    /// # Shapes
    /// `[3, height, width]`, planar and normalised.
    pub fn input_into(&self, input: &mut Vec<f32>, image: &RgbImage, camera: &Camera) -> ([usize; 2], View) {
        let image_size = [image.width() as usize, image.height() as usize];
        let rules = self.input_for(image_size, camera);
        let affine = rules.whole_image(image_size);
        network_input_into(input, image, &affine, &rules, None);
        (rules.size, self.view_through(&affine, image_size, camera))
    }

    /// How the network sees an image of `image_size` (width and height, pixels) taken by `camera`.
    pub fn view(&self, image_size: [usize; 2], camera: &Camera) -> View {
        self.view_through(&self.input_for(image_size, camera).whole_image(image_size), image_size, camera)
    }

    fn view_through(&self, affine: &Affine2, image_size: [usize; 2], camera: &Camera) -> View {
        View { image_size, camera: *camera, input_camera: self.camera(camera).transformed(affine) }
    }

    /// The camera as the model sees it: complete, or without its fourth column.
    pub fn camera(&self, camera: &Camera) -> Camera {
        if self.camera_3x3 { camera.without_fourth_column() } else { *camera }
    }

    /// What to tell the user of `camera` (of an image of `image_size`), if the model never saw one like it.
    pub fn unfamiliar(&self, image_size: [usize; 2], camera: &Camera) -> Option<UnfamiliarCamera> {
        let center_px = camera.principal_point();
        let is_inside = |axis: usize| (-0.5..image_size[axis] as f64 - 0.5).contains(&center_px[axis]);
        if !(is_inside(0) && is_inside(1)) {
            return Some(UnfamiliarCamera::Center { center_px, image_size });
        }
        if let Some(absurd) = absurd(image_size, camera) {
            return Some(absurd);
        }
        let range_px @ [low, high] = self.focal_range_px?;
        let focal_px = camera.focal_y() * self.input_width(image_size, camera) as f64 / image_size[0].max(1) as f64;
        // Widths come in steps, so the focal length can end up one step outside.
        let step = 1.0 + SIZE_STEP as f64 / self.rules.size[0] as f64;
        (focal_px < low / step || focal_px > high * step).then_some(UnfamiliarCamera::Focal { focal_px, range_px })
    }

    fn input_width(&self, image_size: [usize; 2], camera: &Camera) -> usize {
        let width = self.rules.size[0];
        let focal_px = camera.focal_y() * width as f64 / image_size[0].max(1) as f64;
        let Some([low, high]) = self.focal_range_px else { return width };
        let scale = focal_px.clamp(low, high) / focal_px;
        let steps = (width as f64 * scale / SIZE_STEP as f64).round();
        (steps as usize * SIZE_STEP).clamp(SIZE_STEP, MAX_ENLARGEMENT * width)
    }
}

/// What is told of a camera that no photograph was taken with, whatever the model was trained with.
fn absurd(image_size: [usize; 2], camera: &Camera) -> Option<UnfamiliarCamera> {
    let focals_px @ [across, down] = [camera.focal_x(), camera.focal_y()];
    let offset_m = camera.origin().map_or(f64::INFINITY, |origin| norm(&origin));
    if offset_m.is_nan() || offset_m > FARTHEST_M {
        return Some(UnfamiliarCamera::Offset { offset_m });
    }
    if across > MAX_STRETCHED * down || down > MAX_STRETCHED * across {
        return Some(UnfamiliarCamera::Stretched { focals_px });
    }
    let width_px = image_size[0];
    let hfov_deg = 2.0 * (width_px as f64 / 2.0 / across).atan().to_degrees();
    (!FIELDS_DEG.contains(&hfov_deg)).then_some(UnfamiliarCamera::Field { focal_px: across, width_px, hfov_deg })
}

/// Cameras of one vehicle stand closer to each other, metres.
const FARTHEST_M: f64 = 10.0;

/// Nobody's pixels are longer than this times their width.
const MAX_STRETCHED: f64 = 1.5;

/// From the longest telephoto lens to the widest that still makes straight lines of straight lines, degrees.
const FIELDS_DEG: RangeInclusive<f64> = 0.5..=170.0;

#[cfg(test)]
mod tests {
    use crate::smoke::SmokeConfig;
    use farsight_core::Camera;

    #[test]
    fn input_sizes() {
        let spec = SmokeConfig::default().input_spec();
        let table = [
            ("KITTI", [1242, 375], [1280, 384]),
            ("KITTI, the smallest", [1224, 370], [1280, 384]),
            ("full HD", [1920, 1080], [1280, 736]),
            ("4:3", [640, 480], [1280, 960]),
            ("a panorama", [4000, 500], [1280, 384]),
            ("32 rows too high", [1280, 416], [1280, 384]),
            ("33 rows too high", [1280, 417], [1280, 448]),
            ("a square", [1, 1], [1280, 1280]),
            ("portrait", [1080, 1920], [1280, 1280]),
        ];
        for (name, image_size, expected) in table {
            assert_eq!(spec.input_for(image_size, &camera(60.0, image_size)).size, expected, "{name}");
        }
    }

    fn camera(hfov_deg: f64, [width, height]: [usize; 2]) -> Camera {
        Camera::from_hfov(hfov_deg, width, height).unwrap()
    }

    #[test]
    fn other_cameras_are_scaled_into_the_trained_range() {
        let config = SmokeConfig { input: [640, 192], focal_range_px: Some([230.0, 750.0]), ..SmokeConfig::default() };
        let spec = config.input_spec();
        let full_hd = [1920, 1080];
        // Field of view, input, whether the user is warned.
        let table = [
            (81.0, [640, 384], false),
            (40.0, [544, 320], false),
            (110.0, [672, 384], false),
            (160.0, [1280, 736], true),
            (5.0, [64, 32], false),
        ];
        for (hfov_deg, size, warned) in table {
            let camera = camera(hfov_deg, full_hd);
            assert_eq!(spec.input_for(full_hd, &camera).size, size, "{hfov_deg} degrees");
            assert_eq!(spec.unfamiliar(full_hd, &camera).is_some(), warned, "{hfov_deg} degrees");
        }
    }

    #[test]
    fn absurd_cameras_are_told() {
        let spec = SmokeConfig::default().input_spec();
        let size = [1242, 375];
        let table = [
            ([721.5, 721.5, 0.06], None),
            ([721.5, 721.5, 5000.0], Some("stands 5000.000 m from the origin")),
            ([721.5, 721.5, -11.0], Some("stands 11.000 m from the origin")),
            ([721.5, 300.0, 0.0], Some("focal lengths are 722 and 300 pixels")),
            ([1e6, 1e6, 0.0], Some("focal length is 1000000.0 pixels for an image 1242 pixels wide")),
            ([20.0, 20.0, 0.0], Some("focal length is 20.0 pixels")),
        ];
        for ([fx, fy, offset_m], expected) in table {
            let (cx, cy) = (609.6, 172.9);
            let rows = [[fx, 0.0, cx, fx * offset_m], [0.0, fy, cy, 0.0], [0.0, 0.0, 1.0, 0.0]];
            let camera = Camera::from_projection(rows).unwrap();
            let told = spec.unfamiliar(size, &camera).map(|camera| camera.to_string());
            assert!(expected.is_none_or(|text| told.as_deref().is_some_and(|told| told.contains(text))), "{told:?}");
            assert_eq!(told.is_some(), expected.is_some(), "{told:?}");
        }
    }

    #[test]
    fn a_camera_that_looks_past_its_image_is_told() {
        let spec = SmokeConfig::default().input_spec();
        for ([cx, cy], warned) in
            [([609.6, 172.9], false), ([-0.5, 479.0], false), ([640.0, 100.0], true), ([9.0, -1.0], true)]
        {
            let camera = Camera::from_intrinsics(700.0, 700.0, cx, cy).unwrap();
            let told = spec.unfamiliar([640, 480], &camera).map(|camera| camera.to_string());
            assert_eq!(told.is_some(), warned, "({cx}, {cy}): {told:?}");
        }
    }
}
