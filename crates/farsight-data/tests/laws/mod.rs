//! What must hold for any bytes in an image file: nothing panics, limits hold, and what is read can be written and read
//! again. The fuzz target and the replay of its saved inputs share this.
#![allow(dead_code, unreachable_pub)] // Each user takes a part.
#![allow(clippy::expect_used)] // A broken law is a finding.

use std::io::Cursor;
use std::path::Path;

use farsight_data::{Exif, ImageLimits, decode_image, focal};
use image::ImageFormat;

/// Enough for every way through the decoders, and little enough for many inputs a second.
const MAX_PIXELS: u64 = 1 << 18;

/// Any bytes as an image file, and as EXIF data alone.
pub fn image(bytes: &[u8]) -> bool {
    let limits = ImageLimits { max_pixels: MAX_PIXELS };
    let name = Path::new("image");
    let read = decode_image(bytes, name, limits);
    let is_accepted = read.is_ok();
    match read {
        Ok(found) => {
            let size @ [width, height] = <[u32; 2]>::from(found.pixels.dimensions());
            let pixels = u64::from(width) * u64::from(height);
            assert!((1..=MAX_PIXELS).contains(&pixels), "{size:?}");
            focal_is_believable(&found.exif, size);
            let mut png = Cursor::new(Vec::new());
            found.pixels.write_to(&mut png, ImageFormat::Png).expect("memory takes all");
            let again = decode_image(png.get_ref(), name, limits).expect("what was written");
            assert_eq!(again.pixels, found.pixels);
        }
        Err(error) => assert!(error.to_string().starts_with("image: "), "{error}"),
    }
    focal_is_believable(&Exif::from_bytes(bytes), [4000, 3000]);
    is_accepted
}

/// A focal length is one that a camera can have, however odd the data are.
fn focal_is_believable(exif: &Exif, size: [u32; 2]) {
    if let Ok(found) = focal(exif, size) {
        assert!(found.focal_px.is_finite() && found.focal_px > 0.0, "{found:?}");
        assert!(found.hfov_deg > 0.0 && found.hfov_deg < 140.0, "{found:?}");
        assert!(!found.how.chars().any(char::is_control), "{found:?}");
    }
}
