//! Views: parts of the image at the scales at which the network knows things.

use farsight_core::{Affine2, Camera};

use super::config::SsdView;

/// Inputs are whole multiples of this, pixels, and no side is smaller than the second number: the last maps need a
/// cell.
const SIZE_STEP: usize = 32;
const MIN_SIDE: usize = 320;

/// No input is larger, pixels; wide cameras are seen smaller.
const MAX_PIXELS: f64 = 1.0e6;

/// No image is enlarged more.
const MAX_ENLARGED: f64 = 2.0;

/// Rows of a view are around what lies so far from the axis towards the horizon: what is near stands high in the image
/// of a camera that looks down from a mast, and far below the horizon.
const ROWS_SHARE: f64 = 0.5;

/// What a view is of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// From pixels of the image to pixels of the input.
    pub affine: Affine2,
    /// Width and height of the input, pixels.
    pub size: [usize; 2],
    /// The first row of the image and the one behind the last.
    pub rows: [f64; 2],
    /// Pixels of the input for one of the image.
    pub scale: f64,
}

/// The tangent of how far down a turned `camera` looks: by so much its horizon lies above its axis. 0 of others.
pub fn pitch_tangent(camera: &Camera) -> f64 {
    let [pitch_rad, _] = camera.attitude();
    pitch_rad.tan()
}

/// The window of `view` of an image of `image_size` that `camera` takes, which looks down by `pitch_tangent`; none when
/// it shows nothing.
pub fn window(view: &SsdView, image_size: [usize; 2], camera: &Camera, pitch_tangent: f64) -> Option<Window> {
    let [width, height] = image_size.map(|side| side as f64);
    let focal_px = camera.focal_y();
    let center = camera.principal_point()[1];
    let row = |tangent: f64| (center + (tangent - ROWS_SHARE * pitch_tangent) * focal_px).clamp(0.0, height);
    let rows = view.rows.map_or([0.0, height], |[above, below]| [row(-above), row(below)]);
    let shown = rows[1] - rows[0];
    if !(shown >= 1.0 && width >= 1.0) {
        return None;
    }
    // A side of the least size may stand for less of the image.
    let longest = MAX_PIXELS / MIN_SIDE as f64 / width.max(shown);
    let largest = (MAX_PIXELS / (width * shown)).sqrt().min(longest);
    let scale = (view.focal_px / focal_px).min(MAX_ENLARGED).min(largest);
    let side = |pixels: f64| ((pixels * scale / SIZE_STEP as f64).ceil() as usize * SIZE_STEP).max(MIN_SIDE);
    let size = [side(width), side(shown)];
    // Pixel edges: the image's first edge is the input's; what lies behind the last is black.
    let edge = |first: f64| 0.5 * scale - 0.5 - first * scale;
    let affine = Affine2 { matrix: [[scale, 0.0, edge(0.0)], [0.0, scale, edge(rows[0])]] };
    Some(Window { affine, size, rows, scale })
}

#[cfg(test)]
mod tests {
    use farsight_core::pitch::camera_from_level;

    use super::*;

    #[test]
    fn a_view_shows_things_at_its_focal_length() {
        let camera = Camera::from_hfov(90.0, 1920, 1080).unwrap();
        let view = SsdView { focal_px: 480.0, rows: Some([0.25, 0.5]) };
        let found = window(&view, [1920, 1080], &camera, 0.0).unwrap();
        assert!((found.scale - 0.5).abs() < 1e-12);
        assert_eq!(found.size, [960, 384]);
        assert!((found.rows[0] - 300.0).abs() < 1.0 && (found.rows[1] - 1020.0).abs() < 1.0, "{found:?}");
        // The edges of the part that is shown are those of the input.
        let [x, y] = found.affine.apply([-0.5, found.rows[0] - 0.5]);
        assert!((x + 0.5).abs() < 1e-9 && (y + 0.5).abs() < 1e-9);
    }

    #[test]
    fn the_rows_of_a_camera_that_looks_down_are_nearer_to_its_horizon() {
        let camera = Camera::from_hfov(90.0, 1920, 1080).unwrap();
        let turned = camera.moved(&camera_from_level(0.2).inverse());
        assert!(pitch_tangent(&camera).abs() < 1e-12);
        assert!((pitch_tangent(&turned) - 0.2_f64.tan()).abs() < 1e-9);
        let view = SsdView { focal_px: 480.0, rows: Some([0.1, 0.1]) };
        let of = |camera: &Camera| window(&view, [1920, 1080], camera, pitch_tangent(camera)).unwrap();
        let higher = of(&camera).rows[0] - of(&turned).rows[0];
        assert!((higher - 0.5 * 0.2_f64.tan() * 960.0).abs() < 1e-6, "{higher}");
    }

    #[test]
    fn no_input_is_huge_and_none_too_small() {
        let view = SsdView { focal_px: 5000.0, rows: None };
        for (hfov, size) in [(120.0, [8000, 6000]), (2.0, [8000, 6000]), (60.0, [1, 1]), (170.0, [20, 4000])] {
            let camera = Camera::from_hfov(hfov, size[0], size[1]).unwrap();
            let found = window(&view, size, &camera, 0.0).unwrap();
            let pixels = found.size[0] * found.size[1];
            assert!(found.size.iter().all(|side| *side >= MIN_SIDE && side % 32 == 0), "{found:?}");
            assert!(pixels <= 1_300_000, "{found:?}");
        }
    }

    #[test]
    fn rows_outside_the_image_show_nothing() {
        let camera = Camera::from_intrinsics(700.0, 700.0, 640.0, 200.0).unwrap();
        let view = SsdView { focal_px: 700.0, rows: Some([-0.5, 0.6]) };
        assert_eq!(window(&view, [1280, 400], &camera, 0.0), None);
    }
}
