//! Reading images: kinds that must work and files that must be refused with a word about them.

use std::path::{Path, PathBuf};

use farsight_data::read_image;
use image::{DynamicImage, GrayImage, ImageBuffer, ImageFormat, Luma, Rgb, RgbImage, Rgba};
use tempfile::TempDir;

use crate::image_bytes::crc32;

fn saved(folder: &TempDir, name: &str, image: &DynamicImage, format: ImageFormat) -> PathBuf {
    let path = folder.path().join(name);
    image.save_with_format(&path, format).unwrap();
    path
}

fn written(folder: &TempDir, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn message(path: &Path) -> String {
    let error = read_image(path).err().unwrap_or_else(|| panic!("{} was read", path.display()));
    let text = error.to_string();
    text.strip_prefix(&path.display().to_string()).expect("the error names the file").to_owned()
}

#[test]
fn every_kind_becomes_eight_bit_rgb() {
    let folder = tempfile::tempdir().unwrap();
    let grey = GrayImage::from_pixel(5, 3, Luma([77]));
    let deep = ImageBuffer::from_pixel(5, 3, Rgb([0x4d4d_u16; 3]));
    let clear = ImageBuffer::from_pixel(5, 3, Rgba([77_u8, 77, 77, 0]));
    let images: [(&str, DynamicImage); 3] =
        [("grey.png", grey.into()), ("deep.png", deep.into()), ("clear.png", clear.into())];
    for (name, image) in images {
        let path = saved(&folder, name, &image, ImageFormat::Png);
        assert_eq!(read_image(&path).unwrap(), RgbImage::from_pixel(5, 3, Rgb([77; 3])), "{name}");
    }
}

#[test]
fn the_content_decides_and_not_the_name() {
    let folder = tempfile::tempdir().unwrap();
    let image = DynamicImage::from(RgbImage::from_pixel(6, 4, Rgb([10, 200, 30])));
    let path = saved(&folder, "a_jpeg.png", &image, ImageFormat::Jpeg);
    assert_eq!(read_image(&path).unwrap().dimensions(), (6, 4));
}

/// An EXIF segment that says "turn me a quarter to the right" (orientation 6).
const TURNED: [u8; 36] = [
    0xFF, 0xE1, 0, 34, b'E', b'x', b'i', b'f', 0, 0, b'I', b'I', 42, 0, 8, 0, 0, 0, 1, 0, 0x12, 0x01, 3, 0, 1, 0, 0, 0,
    6, 0, 0, 0, 0, 0, 0, 0,
];

#[test]
fn the_orientation_of_a_phone_picture_is_applied() {
    let folder = tempfile::tempdir().unwrap();
    let image = RgbImage::from_fn(32, 16, |x, _| Rgb(if x < 16 { [255; 3] } else { [0; 3] }));
    let path = saved(&folder, "phone.jpg", &image.into(), ImageFormat::Jpeg);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes.splice(2..2, TURNED);
    let turned = read_image(&written(&folder, "turned.jpg", &bytes)).unwrap();
    assert_eq!(turned.dimensions(), (16, 32));
    assert!(turned.get_pixel(8, 4).0[0] > 200 && turned.get_pixel(8, 28).0[0] < 50, "the left is now the top");
}

/// A PNG that claims to be this large.
fn giant(folder: &TempDir, side: u32) -> PathBuf {
    let path = saved(folder, "small.png", &RgbImage::new(1, 1).into(), ImageFormat::Png);
    let mut bytes = std::fs::read(path).unwrap();
    bytes[16..20].copy_from_slice(&side.to_be_bytes());
    bytes[20..24].copy_from_slice(&side.to_be_bytes());
    let sum = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&sum.to_be_bytes());
    written(folder, "giant.png", &bytes)
}

#[test]
fn files_that_are_no_images_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let noise = RgbImage::from_fn(64, 64, |x, y| Rgb([(x * y) as u8, (x * 7) as u8, (y * 13) as u8]));
    let [png, jpeg] = [("a.png", ImageFormat::Png), ("a.jpg", ImageFormat::Jpeg)]
        .map(|(name, format)| std::fs::read(saved(&folder, name, &noise.clone().into(), format)).unwrap());
    let unknown = ": no image that is known here; expected PNG, JPEG, WebP, BMP, TIFF, GIF, PPM or PGM";
    let cases = [
        ("empty.png", &[][..], ": an empty file; expected an image (PNG, JPEG, WebP, BMP, TIFF, GIF, PPM or PGM)"),
        ("text.png", b"not an image", unknown),
        ("calibration.txt", b"P2: 721.5 0 609.6 44.9", unknown),
        ("gif.gif", b"GIF89a\x01\x00\x01\x00", ": damaged image: "),
        ("cut.png", &png[..png.len() / 2], ": damaged image: "),
        ("head.png", &png[..20], ": damaged image: "),
        ("head.jpg", &jpeg[..20], ": truncated: its end is missing"),
        ("cut.jpg", &jpeg[..jpeg.len() / 2], ": truncated: its end is missing"),
        ("almost.jpg", &jpeg[..jpeg.len() - 2], ": truncated: its end is missing"),
    ];
    for (name, bytes, expected) in cases {
        let text = message(&written(&folder, name, bytes));
        assert!(text.starts_with(expected), "{name}: {text}");
    }
    assert!(message(&folder.path().join("missing.png")).starts_with(": cannot be read: "));
    assert_eq!(message(folder.path()), ": a folder; expected a file with an image");
    let text = message(&giant(&folder, 20_000));
    assert_eq!(text, ": 20000 x 20000 pixels; expected at most 100000000 pixels (--max-pixels)");
}

#[test]
fn pictures_and_films_of_other_kinds_are_named_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [(&[u8], &str); 7] = [
        (
            b"\0\0\0\x18ftypheic\0\0\0\0mif1heic",
            ": a HEIC picture, which is not read here; convert it to JPEG: heif-convert ",
        ),
        (
            b"\0\0\0\x18ftypmif1\0\0\0\0mif1heic",
            ": a HEIC picture, which is not read here; convert it to JPEG: heif-convert ",
        ),
        (
            b"\0\0\0\x1cftypavif\0\0\0\0avifmif1",
            ": an AVIF picture, which is not read here; convert it to PNG: avifdec ",
        ),
        (
            b"\0\0\0\x1cftypmif1\0\0\0\0mif1avif",
            ": an AVIF picture, which is not read here; convert it to PNG: avifdec ",
        ),
        (b"\0\0\0\x20ftypisom\0\0\x02\0isomiso2", ": a video, which is not read here; take its frames out: ffmpeg "),
        (b"RIFF\0\0\0\0AVI LIST", ": a video, which is not read here; take its frames out: ffmpeg "),
        (b"\x1a\x45\xdf\xa3", ": a video, which is not read here; take its frames out: ffmpeg "),
    ];
    for (bytes, expected) in cases {
        let text = message(&written(&folder, "photo.jpg", bytes));
        assert!(text.starts_with(expected), "{text}");
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_or_socket_is_refused_and_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let expected = ": a pipe, socket or device; expected a file with an image";
    let socket = folder.path().join("socket.png");
    let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    assert_eq!(message(&socket), expected);
    let pipe = folder.path().join("pipe.png");
    if std::process::Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success()) {
        assert_eq!(message(&pipe), expected);
        assert!(farsight_data::read_header(&pipe, farsight_data::ImageLimits::default()).is_err());
    }
    if Path::new("/dev/zero").exists() {
        assert_eq!(message(Path::new("/dev/zero")), expected);
    }
}
