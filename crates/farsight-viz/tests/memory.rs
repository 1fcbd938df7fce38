//! A picture takes memory in proportion to its image: decoding, drawing and writing together at most four times the
//! decoded image and 64 MB, whatever the image's shape.
//!
//! The figures are printed (`-- --nocapture`) and stand in docs/reliability.md.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "the helpers of a test may panic and print")]

use std::io::Cursor;
use std::path::Path;

use farsight_core::{Box2d, Box3d, Camera, Detection, Dimensions, ObjectClass};
use farsight_data::{ImageLimits, decode_image};
use farsight_files::MeasuredTable;
use farsight_testing::{Counting, keep_table, peak};
use farsight_viz::{DrawOptions, Names, Scene, annotate_named, picture};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{GrayImage, ImageFormat, RgbImage};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Bytes that may be taken beside four times the decoded image.
const SPARE: usize = 64 << 20;

/// As a file, of the kind that a picture is written as, too.
fn file(size: [u32; 2], format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    GrayImage::new(size[0], size[1]).write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn written(picture: &RgbImage, format: ImageFormat) -> usize {
    let mut bytes = Vec::new();
    match format {
        ImageFormat::Png => picture.write_with_encoder(PngEncoder::new(&mut bytes)).unwrap(),
        _ => picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, 90)).unwrap(),
    }
    bytes.len()
}

fn detection(camera: &Camera) -> Detection {
    let dimensions = Dimensions { height: 1.5, width: 1.6, length: 3.9 };
    let box3d = Box3d { dimensions, location: [1.0, 1.65, 15.0], yaw: 0.4 };
    let box2d = box3d.projected(camera).unwrap_or(Box2d::new(0.0, 0.0, 1.0, 1.0));
    Detection { class: ObjectClass::Car, score: 0.9, box2d, box3d, range_sigma_m: Some(1.0) }
}

// One test: what is counted is counted for the whole process.
#[test]
fn pictures_take_memory_in_proportion_to_their_images() {
    // The first use of the font loads it.
    let camera = Camera::from_hfov(65.0, 64, 64).unwrap();
    let scene = Scene { camera: &camera, detections: &[detection(&camera)], truth: &[] };
    picture(&RgbImage::new(64, 64), &scene, &DrawOptions::default());
    let (limits, name) = (ImageLimits { max_pixels: 200_000_000 }, Path::new("image"));
    let cases: [([u32; 2], &str); 6] = [
        ([1242, 375], "a KITTI image"),
        ([100, 20_000], "a strip"),
        ([100, 60_000], "a longer strip"),
        ([60_000, 100], "the same, lying"),
        ([4000, 3000], "12 megapixels"),
        ([12_000, 9000], "108 megapixels"),
    ];
    let columns = ["image", "format", "decoded", "picture", "page"];
    let mut table = MeasuredTable::new("cargo test -p farsight-viz --test memory", columns);
    for (size @ [width, height], what) in cases {
        // The largest are photographs.
        let is_huge = u64::from(width) * u64::from(height) > 50_000_000;
        for format in [ImageFormat::Png, ImageFormat::Jpeg].into_iter().skip(usize::from(is_huge)) {
            let bytes = file(size, format);
            let camera = Camera::from_hfov(65.0, width as usize, height as usize).unwrap();
            let detections = [detection(&camera)];
            let scene = Scene { camera: &camera, detections: &detections, truth: &[] };
            let decoded = 3 * width as usize * height as usize;
            let most = 4 * decoded + SPARE;
            let (drawn, _) = peak(|| {
                let image = decode_image(&bytes, name, limits).unwrap();
                written(&picture(&image.pixels, &scene, &DrawOptions::default()), format)
            });
            // Pages of evaluations have their frames at full size.
            let (page, _) = peak(|| {
                let image = decode_image(&bytes, name, limits).unwrap();
                let names = Names { detections: &["1".to_owned()], truth: &[] };
                written(&annotate_named(&image.pixels, &scene, &DrawOptions::default(), &names), format)
            });
            let megabytes = |bytes: usize| format!("{} MB", bytes / 1_000_000);
            let (image, format) = (format!("{width} x {height}"), format!("{format:?}"));
            println!("{what}, {image}, {format}: picture {}, page {}", megabytes(drawn), megabytes(page));
            table.rows.push(vec![image, format.clone(), megabytes(decoded), megabytes(drawn), megabytes(page)]);
            assert!(drawn <= most, "{what}, {format}: {drawn} bytes");
            assert!(page <= most, "{what}, {format}, on a page: {page} bytes");
        }
    }
    keep_table("pictures", &table);
}
