//! Images without the distortion of their lens, as a pinhole would have taken them.

use farsight_core::lens::LensError;
use farsight_core::{Box2d, Camera, Lens};
use image::RgbImage;

/// Points along each edge of a box whose distorted places are looked at.
const EDGE_POINTS: usize = 9;

/// Takes the distortion of one lens out of images of one size.
#[derive(Debug, Clone)]
pub struct Undistorter {
    camera: Camera,
    lens: Lens,
    size: [u32; 2],
    /// Where in the distorted image each pixel comes from, row by row.
    sources: Vec<[f32; 2]>,
}

impl Undistorter {
    /// For images of `size` (width, height; pixels) whose pinhole would be `camera`.
    ///
    /// # Errors
    /// When the lens folds such an image.
    pub fn new(camera: &Camera, lens: Lens, size: [u32; 2]) -> Result<Self, LensError> {
        let [width, height] = size;
        lens.check(camera, [width as usize, height as usize])?;
        let places = (0..height).flat_map(|row| (0..width).map(move |column| [f64::from(column), f64::from(row)]));
        let sources = places.map(|pixel| lens.distorted_pixel(camera, pixel).map(|value| value as f32)).collect();
        Ok(Self { camera: *camera, lens, size, sources })
    }

    /// The pinhole that its images are made for.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The lens whose distortion it takes out.
    pub fn lens(&self) -> Lens {
        self.lens
    }

    /// Width and height of its images, pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The pinhole's image, of the same size: bilinear, black where `image` shows nothing. None for another size.
    pub fn undistorted(&self, image: &RgbImage) -> Option<RgbImage> {
        let [width, height] = self.size;
        if image.dimensions() != (width, height) {
            return None;
        }
        let pixels = self.sources.iter().flat_map(|source| sampled(image, *source)).collect();
        RgbImage::from_raw(width, height, pixels)
    }

    /// The box around what the lens makes of a box in the pinhole's image, within the distorted image.
    pub fn distorted_box(&self, found: &Box2d) -> Box2d {
        let at = |i: usize| i as f64 / (EDGE_POINTS - 1) as f64;
        let across = |i: usize| found.x1 + at(i) * (found.x2 - found.x1);
        let down = |i: usize| found.y1 + at(i) * (found.y2 - found.y1);
        let edges = (0..EDGE_POINTS)
            .flat_map(|i| [[across(i), found.y1], [across(i), found.y2], [found.x1, down(i)], [found.x2, down(i)]]);
        let nothing = Box2d::new(f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY);
        let around = edges.fold(nothing, |around, pixel| {
            let [x, y] = self.lens.distorted_pixel(&self.camera, pixel);
            Box2d::new(around.x1.min(x), around.y1.min(y), around.x2.max(x), around.y2.max(y))
        });
        let [width, height] = self.size.map(|side| f64::from(side) - 1.0);
        let within = |value: f64, most: f64| value.clamp(0.0, most);
        Box2d::new(
            within(around.x1, width),
            within(around.y1, height),
            within(around.x2, width),
            within(around.y2, height),
        )
    }
}

/// The colour between the pixels around `place`.
fn sampled(image: &RgbImage, place: [f32; 2]) -> [u8; 3] {
    let (width, height) = image.dimensions();
    let [x, y] = place;
    let is_inside = x >= -0.5 && y >= -0.5 && x <= width as f32 - 0.5 && y <= height as f32 - 0.5;
    if !is_inside {
        return [0; 3];
    }
    let (x, y) = (x.clamp(0.0, width as f32 - 1.0), y.clamp(0.0, height as f32 - 1.0));
    let (left, top) = (x as u32, y as u32);
    let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (by_x, by_y) = (x - left as f32, y - top as f32);
    let [a, b, c, d] = [(left, top), (right, top), (left, bottom), (right, bottom)]
        .map(|(column, row)| image.get_pixel(column, row).0);
    std::array::from_fn(|channel| {
        let [a, b, c, d] = [a, b, c, d].map(|pixel| f32::from(pixel[channel]));
        let (upper, lower) = (a + by_x * (b - a), c + by_x * (d - c));
        (upper + by_y * (lower - upper)).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    const SIZE: [u32; 2] = [320, 180];

    fn camera() -> Camera {
        Camera::from_hfov(80.0, SIZE[0], SIZE[1]).unwrap()
    }

    /// A smooth picture, so that sampling it twice loses little.
    fn picture(pixel: [f64; 2]) -> [f64; 3] {
        let [x, y] = pixel;
        [127.0 + 90.0 * (x / 25.0).sin(), 127.0 + 90.0 * (y / 19.0).cos(), 60.0 + x / 3.0]
    }

    #[test]
    fn what_a_lens_bent_is_straight_again() {
        for lens in ["brown:-0.25,0.06,0.001,-0.002,0.0", "kb4:-0.02,0.01,0,0"] {
            let lens: Lens = lens.parse().unwrap();
            let undistorter = Undistorter::new(&camera(), lens, SIZE).unwrap();
            // Each pixel of the bent image shows what the pinhole shows at the ray that is bent there.
            let bent = RgbImage::from_fn(SIZE[0], SIZE[1], |column, row| {
                let shown = [f64::from(column), f64::from(row)];
                Rgb(picture(undone(&lens, shown)).map(|value| value.round().clamp(0.0, 255.0) as u8))
            });
            let straight = undistorter.undistorted(&bent).unwrap();
            let mut worst = 0.0_f64;
            // The middle, as the pinhole's corners lie outside of what the lens shows.
            for (row, column) in (40..140).flat_map(|row| (60..260).map(move |column| (row, column))) {
                let expected = picture([f64::from(column), f64::from(row)]);
                for (found, expected) in straight.get_pixel(column, row).0.into_iter().zip(expected) {
                    worst = worst.max((f64::from(found) - expected).abs());
                }
            }
            assert!(worst < 3.0, "{lens}: {worst}");
            assert_eq!(undistorter.undistorted(&RgbImage::new(10, 10)), None);
        }
    }

    /// The place in the pinhole's image, by fixed-point iteration: another way than the one under test.
    fn undone(lens: &Lens, shown: [f64; 2]) -> [f64; 2] {
        let mut pixel = shown;
        for _ in 0..60 {
            let there = lens.distorted_pixel(&camera(), pixel);
            pixel = [0, 1].map(|axis| pixel[axis] + shown[axis] - there[axis]);
        }
        pixel
    }

    #[test]
    fn a_box_is_around_its_distorted_edges_and_within_the_image() {
        let lens = Lens::Brown([-0.25, 0.06, 0.0, 0.0, 0.0]);
        let undistorter = Undistorter::new(&camera(), lens, SIZE).unwrap();
        let found = undistorter.distorted_box(&Box2d::new(0.0, 60.0, 50.0, 120.0));
        // A barrel draws what is far from the middle towards it.
        assert!(found.x1 > 5.0 && found.x2 > 50.0 && found.y2 - found.y1 < 60.0, "{found:?}");
        let pincushion = Undistorter::new(&camera(), Lens::Brown([0.3, 0.0, 0.0, 0.0, 0.0]), SIZE).unwrap();
        let found = pincushion.distorted_box(&Box2d::new(-5.0, 60.0, 50.0, 120.0));
        assert!(found.x1 == 0.0 && found.x2 < 50.0, "{found:?}");
    }
}
