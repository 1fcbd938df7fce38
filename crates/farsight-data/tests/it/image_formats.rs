//! Every format that is read, in the depths and colours that it has; limits; what EXIF data say.

use std::path::Path;

use farsight_data::{ImageError, ImageLimits, ImageWarning, LoadedImage, decode_image, focal};
use image::codecs::gif::GifEncoder;
use image::{DynamicImage, Frame, ImageFormat, Rgb, RgbImage, RgbaImage};

use crate::image_bytes::{crc32, exif_block, jpeg_with_exif, png, png_with_exif, tiff_rows};

fn loaded(bytes: &[u8]) -> Result<LoadedImage, ImageError> {
    decode_image(bytes, Path::new("a"), ImageLimits::default())
}

/// What is told of a file; "read" when it is read.
fn told(bytes: &[u8]) -> String {
    loaded(bytes).map_or_else(|error| error.to_string(), |_| "read".to_owned())
}

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// 256 colours at most, so that GIF can hold it.
fn colourful() -> RgbImage {
    RgbImage::from_fn(9, 7, |x, y| Rgb([(x * 30) as u8, (y * 40) as u8, ((x + y) % 3 * 100) as u8]))
}

#[test]
fn lossless_formats_give_the_same_pixels() {
    let image = colourful();
    for format in [ImageFormat::Png, ImageFormat::WebP, ImageFormat::Bmp, ImageFormat::Tiff, ImageFormat::Pnm] {
        let found = loaded(&encoded(&image.clone().into(), format)).unwrap();
        assert_eq!((found.pixels, found.warnings), (image.clone(), vec![]), "{format:?}");
    }
    let grey = DynamicImage::from(image.clone()).into_luma8();
    for format in [ImageFormat::Pnm, ImageFormat::Tiff, ImageFormat::Bmp] {
        let found = loaded(&encoded(&grey.clone().into(), format)).unwrap();
        assert_eq!(found.pixels, DynamicImage::from(grey.clone()).into_rgb8(), "{format:?}");
    }
    assert_eq!(loaded(b"P1 # bits\n3 1\n1 0 1\n").unwrap().pixels.into_raw(), [0, 0, 0, 255, 255, 255, 0, 0, 0]);
    assert_eq!(loaded(b"P2\n2 1\n15\n0 15\n").unwrap().pixels.into_raw(), [0, 0, 0, 255, 255, 255]);
}

#[test]
fn of_an_animation_the_first_frame_is_read() {
    let frames =
        [[200, 10, 10, 255], [10, 200, 10, 255]].map(|colour| RgbaImage::from_pixel(6, 4, image::Rgba(colour)));
    let gif = |count: usize| {
        let mut bytes = Vec::new();
        let mut encoder = GifEncoder::new(&mut bytes);
        encoder.encode_frames(frames[..count].iter().cloned().map(Frame::new)).unwrap();
        drop(encoder);
        bytes
    };
    let one = loaded(&gif(1)).unwrap();
    let two = loaded(&gif(2)).unwrap();
    assert_eq!((one.warnings, two.warnings), (vec![], vec![ImageWarning::Animation]));
    assert_eq!(one.pixels, two.pixels);
    let pixel = two.pixels.get_pixel(3, 2).0;
    assert!(pixel[0] > 190 && pixel[1] < 20, "{pixel:?}");
}

/// Bits of a row of pixels, packed as PNG has them.
fn packed(values: &[u8], bits: usize) -> Vec<u8> {
    values
        .chunks(8 / bits)
        .map(|chunk| {
            chunk.iter().fold(0_u32, |byte, value| byte << bits | u32::from(*value))
                << (bits * (8 / bits - chunk.len()))
        })
        .map(|byte| byte as u8)
        .collect()
}

#[test]
fn png_in_all_depths_and_colours() {
    // Grey in 1, 2 and 4 bits: all values, spread over black to white.
    for bits in [1, 2, 4] {
        let most = (1_u8 << bits) - 1;
        let values: Vec<u8> = (0..=most).chain([most, 0, most]).collect();
        let file = png([values.len() as u32, 1], bits as u8, 0, None, &[&packed(&values, bits)]);
        let expected: Vec<u8> = values.iter().flat_map(|value| [value * (255 / most); 3]).collect();
        assert_eq!(loaded(&file).unwrap().pixels.into_raw(), expected, "{bits} bits of grey");
    }
    let colours = [[255, 0, 0], [0, 255, 0], [1, 2, 3], [250, 251, 252]];
    for bits in [1, 2, 4, 8] {
        let count = colours.len().min(1 << bits);
        let values: Vec<u8> = (0..count as u8).rev().collect();
        let palette = colours[..count].concat();
        let file = png([count as u32, 1], bits as u8, 3, Some(&palette), &[&packed(&values, bits)]);
        let expected: Vec<u8> = values.iter().flat_map(|&value| colours[usize::from(value)]).collect();
        assert_eq!(loaded(&file).unwrap().pixels.into_raw(), expected, "a palette of {bits} bits");
    }
    let deep = [0x12, 0x34, 0xAB, 0xCD, 0xFF, 0xFF];
    assert_eq!(loaded(&png([1, 1], 16, 2, None, &[&deep])).unwrap().pixels.into_raw(), [0x12, 0xAB, 0xFF]);
    assert_eq!(loaded(&png([2, 1], 8, 4, None, &[&[7, 0, 9, 255]])).unwrap().pixels.into_raw(), [7, 7, 7, 9, 9, 9]);
    let clear = [[1, 2, 3, 0], [4, 5, 6, 255]].concat();
    assert_eq!(loaded(&png([2, 1], 8, 6, None, &[&clear])).unwrap().pixels.into_raw(), [1, 2, 3, 4, 5, 6]);
    let deep_and_clear: Vec<u8> = clear.iter().flat_map(|&byte| [byte; 2]).collect();
    assert_eq!(loaded(&png([2, 1], 16, 6, None, &[&deep_and_clear])).unwrap().pixels.into_raw(), [1, 2, 3, 4, 5, 6]);
}

#[test]
fn pixels_are_counted_as_they_unpack() {
    let refused = |file: &[u8], most: u64| {
        let error = decode_image(file, Path::new("a"), ImageLimits { max_pixels: most }).unwrap_err();
        error.to_string()
    };
    // 100 rows of 100 pixels: 1 bit each as little as 8, but 16 bits and four channels are 8 bytes.
    let rows = |bytes: usize| vec![vec![0; bytes]; 100];
    let file = |bits, colour, bytes| {
        let rows = rows(bytes);
        png([100, 100], bits, colour, None, &rows.iter().map(Vec::as_slice).collect::<Vec<_>>())
    };
    for (bits, colour, bytes) in [(1, 0, 13), (8, 0, 100), (16, 0, 200), (8, 2, 300)] {
        let file = file(bits, colour, bytes);
        assert!(decode_image(&file, Path::new("a"), ImageLimits { max_pixels: 10_000 }).is_ok());
        assert_eq!(refused(&file, 9_999), "a: 100 x 100 pixels; expected at most 9999 pixels (--max-pixels)");
    }
    for (bits, colour, bytes, counted) in [(8, 6, 400, 13_334), (16, 2, 600, 20_000), (16, 6, 800, 26_667)] {
        let file = file(bits, colour, bytes);
        assert!(decode_image(&file, Path::new("a"), ImageLimits { max_pixels: counted }).is_ok());
        let expected = format!(
            "a: 100 x 100 pixels, which count as {counted} when unpacked; expected at most {} pixels (--max-pixels)",
            counted - 1
        );
        assert_eq!(refused(&file, counted - 1), expected);
    }
    // The header alone is enough, whatever follows.
    for (name, header) in [
        (
            "bmp",
            [
                &b"BM\0\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0"[..],
                &[0x40, 0x9C, 0, 0, 0x40, 0x9C, 0, 0, 1, 0, 24, 0],
                &[0; 24],
            ]
            .concat(),
        ),
        ("gif", [&b"GIF89a"[..], &[0xFF; 4], &[0; 3], &[0x2C, 0, 0, 0, 0], &[0xFF; 4], &[0, 2, 0, 0x3B]].concat()),
        ("ppm", b"P6\n40000 40000\n255\n".to_vec()),
        (
            "jpeg",
            [&[0xFF, 0xD8, 0xFF, 0xC0, 0, 11, 8, 0xFF, 0xFF, 0xFF, 0xFF, 1, 1, 0x11, 0][..], &[0xFF, 0xD9]].concat(),
        ),
    ] {
        let error = loaded(&header).unwrap_err();
        assert!(matches!(error, ImageError::TooLarge { .. }), "{name}: {error}");
    }
}

const JPEGS: [(&str, &[u8]); 3] = [
    ("progressive", include_bytes!("jpeg/progressive.jpg")),
    ("progressive-grey", include_bytes!("jpeg/progressive-grey.jpg")),
    ("restarts", include_bytes!("jpeg/restarts.jpg")),
];

fn jpegs() -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = JPEGS.iter().map(|(name, bytes)| ((*name).to_owned(), bytes.to_vec())).collect();
    let noise = RgbImage::from_fn(96, 64, |x, y| Rgb([(x * y) as u8, (x * 7) as u8, (y * 13) as u8]));
    files.push(("baseline".to_owned(), encoded(&noise.clone().into(), ImageFormat::Jpeg)));
    files.push(("grey".to_owned(), encoded(&DynamicImage::from(noise).into_luma8().into(), ImageFormat::Jpeg)));
    files
}

/// Where a segment of one of these kinds begins.
fn segment(bytes: &[u8], kinds: &[u8]) -> usize {
    bytes.windows(2).position(|pair| pair[0] == 0xFF && kinds.contains(&pair[1])).unwrap()
}

#[test]
fn a_cut_jpeg_is_told_although_it_ends_as_one_should() {
    for (name, whole) in jpegs() {
        assert!(loaded(&whole).is_ok(), "{name}");
        let data = segment(&whole, &[0xDA]) + 14;
        for percent in (2..=98).step_by(4) {
            let mut cut = data + (whole.len() - data) * percent / 100;
            while whole[cut - 1] == 0xFF {
                cut -= 1;
            }
            let bytes = [&whole[..cut], &[0xFF, 0xD9]].concat();
            let text = told(&bytes);
            assert!(text.starts_with("a: truncated: its "), "{name} cut at {percent}%: {text}");
            let text = told(&whole[..cut]);
            assert_eq!(text, "a: truncated: its end is missing", "{name} cut at {percent}%");
        }
    }
}

#[test]
fn a_header_that_lies_about_the_size_is_told() {
    for (name, whole) in jpegs() {
        let header = segment(&whole, &[0xC0, 0xC2]) + 5;
        let [height, width] = [0, 2].map(|at| u16::from_be_bytes([whole[header + at], whole[header + at + 1]]));
        let lie = |size: [u16; 2]| {
            let mut bytes = whole.clone();
            bytes[header..header + 4].copy_from_slice(&size.map(u16::to_be_bytes).concat());
            told(&bytes)
        };
        for size in [[height, width + 32], [height + 32, width], [2 * height, 2 * width]] {
            let text = lie(size);
            assert!(text.starts_with("a: truncated: its data end "), "{name} {size:?}: {text}");
        }
        for size in [[height / 2, width], [height, width / 2]] {
            let text = lie(size);
            // What is left over of a small progressive picture is little; its decoder trips over it.
            let told = text.ends_with("but more picture follows") || name.starts_with("progressive") && text != "read";
            assert!(told, "{name} {size:?}: {text}");
        }
    }
    let mut lie = png([2, 2], 8, 0, None, &[&[1, 2], &[3, 4]]);
    lie[20..24].copy_from_slice(&9_u32.to_be_bytes());
    let sum = crc32(&lie[12..29]);
    lie[29..33].copy_from_slice(&sum.to_be_bytes());
    let text = loaded(&lie).unwrap_err().to_string();
    assert!(text.starts_with("a: damaged image: "), "{text}");
}

#[test]
fn data_behind_the_end_and_padding_are_no_flaw() {
    for (name, whole) in jpegs() {
        let pixels = loaded(&whole).unwrap().pixels;
        let film = [&whole[..], &[7; 5000], b"ftypmp42"].concat();
        assert_eq!(loaded(&film).unwrap().pixels, pixels, "{name}");
        let padded = [&whole[..whole.len() - 2], &[0; 600], &[0xFF, 0xFF, 0xFF, 0xD9]].concat();
        assert_eq!(loaded(&padded).unwrap().pixels, pixels, "{name}");
    }
}

/// An image whose left half is white, turned in the file as each orientation says, so that it is upright when it is
/// turned back.
#[test]
fn exif_turns_jpeg_png_webp_and_tiff() {
    let upright = RgbImage::from_fn(16, 8, |x, y| Rgb(if x < 8 && y < 4 { [255; 3] } else { [0; 3] }));
    // What EXIF calls orientation 6: the rows of the file are the columns of the picture, from right to left.
    let stored = image::imageops::rotate270(&upright);
    let block = exif_block(&[(0x0112, 3, &[6])], &[]);
    let mut webp = Vec::new();
    let mut encoder = image::codecs::webp::WebPEncoder::new_lossless(&mut webp);
    image::ImageEncoder::set_exif_metadata(&mut encoder, block.clone()).unwrap();
    encoder.encode(&stored, 8, 16, image::ExtendedColorType::Rgb8).unwrap();
    let rows: Vec<&[u8]> = stored.as_raw().chunks(24).collect();
    for (name, file) in [
        ("png", png_with_exif([8, 16], &rows, &block, false)),
        ("png, behind the pixels", png_with_exif([8, 16], &rows, &block, true)),
        ("webp", webp),
        ("tiff", tiff_rows([8, 16], stored.as_raw(), 6)),
    ] {
        let found = loaded(&file).unwrap();
        assert_eq!(found.pixels, upright, "{name}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, file).unwrap();
        let header = farsight_data::read_header(&path, ImageLimits::default()).unwrap();
        assert_eq!((header.size, header.exif.orientation), ([16, 8], Some(6)), "{name}");
    }
    let file = jpeg_with_exif(&encoded(&stored.into(), ImageFormat::Jpeg), &block);
    let found = loaded(&file).unwrap().pixels;
    assert_eq!(found.dimensions(), (16, 8));
    assert!(found.get_pixel(2, 1).0[0] > 200 && found.get_pixel(13, 6).0[0] < 50);
}

#[test]
fn the_focal_length_of_a_portrait_photo_comes_from_its_exif_data() {
    // 4032x3024 made smaller by 63, held upright: orientation 6, Apple, 4.25 mm, 26 mm equivalent, stored as 4032x3024.
    let image = encoded(&RgbImage::new(64, 48).into(), ImageFormat::Jpeg);
    let exif = |film: u32| {
        exif_block(
            &[(0x010F, 2, b"Apple\0"), (0x0110, 2, b"iPhone 11\0"), (0x0112, 3, &[6])],
            &[
                (0x920A, 5, &[425, 100].map(u32::to_le_bytes).concat()),
                (0xA002, 4, &4032_u32.to_le_bytes()),
                (0xA003, 4, &3024_u32.to_le_bytes()),
                (0xA405, 3, &film.to_le_bytes()[..2]),
            ],
        )
    };
    let photo = loaded(&jpeg_with_exif(&image, &exif(26))).unwrap();
    let size @ [width, height] = <[u32; 2]>::from(photo.pixels.dimensions());
    assert_eq!([width, height], [48, 64]);
    let found = focal(&photo.exif, size).unwrap();
    assert!((found.hfov_deg - 53.06).abs() < 0.01, "{found:?}");
    assert!((found.focal_px - 80.0 * 26.0 / 43.2666).abs() < 0.01, "{found:?}");
    // Zero is "unknown" in the standard; the lens and the known sensor are left.
    let photo = loaded(&jpeg_with_exif(&image, &exif(0))).unwrap();
    let found = focal(&photo.exif, size).unwrap();
    assert_eq!(found.how, "4.25 mm and the sensor of Apple iPhone 11");
    assert!((found.hfov_deg - 52.95).abs() < 0.01, "{found:?}");
}

#[test]
fn raw_files_of_cameras_are_not_taken_for_their_thumbnails() {
    let mut file = tiff_rows([8, 16], &[0; 8 * 16 * 3], 1);
    assert!(loaded(&file).is_ok());
    // NewSubfileType, the first entry: a smaller version of another page.
    assert_eq!(file[10..12], 254_u16.to_le_bytes());
    file[18] = 1;
    let text = loaded(&file).unwrap_err().to_string();
    assert!(text.starts_with("a: raw data of a camera, which is not read here; develop it to JPEG: "), "{text}");
}
