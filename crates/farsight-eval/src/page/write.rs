//! The page and its pictures as files.

use std::path::{Path, PathBuf};
use std::{fs, io};

use farsight_files::write_quickly;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

use super::contents::{Page, Picture};
use super::error::PageError;
use super::{charts, html};

/// Quality of the photographs inside the page, of 100; the PNG files beside it lose nothing.
const JPEG_QUALITY: u8 = 80;

impl Page<'_> {
    /// Writes `index.html` and the pictures into `folder`, which is made if it is not there. Each file is there whole
    /// or not at all.
    ///
    /// # Errors
    /// When a picture cannot be made or a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, PageError> {
        fs::create_dir_all(folder).map_err(|source| PageError::Folder { path: folder.to_owned(), source })?;
        let charts = charts::charts(self.report);
        let charts: Vec<_> = charts
            .iter()
            .map(|(name, chart)| Ok(Picture { name: name.clone(), png: png(&chart.draw()?)?, jpeg: None }))
            .collect::<Result<_, PageError>>()?;
        let worst =
            self.worst.iter().map(|shown| photograph(&format!("worst_{}", shown.worst.id), shown.image.as_ref()));
        let worst: Vec<_> = worst.collect::<Result<_, _>>()?;
        let scenes = self.scenes.iter().map(|shown| {
            let of = |side: usize, name| {
                photograph(&format!("scene_{}_{name}", shown.results[side].id), shown.images[side].as_ref())
            };
            Ok::<_, PageError>([of(0, "ours")?, of(1, "against")?])
        });
        let scenes: Vec<_> = scenes.collect::<Result<_, _>>()?;
        for picture in charts.iter().chain(worst.iter().chain(scenes.iter().flatten()).flatten()) {
            write(&folder.join(format!("{}.png", picture.name)), &picture.png)?;
        }
        let page = folder.join("index.html");
        write(&page, html::page(self, &charts, &worst, &scenes).as_bytes())?;
        Ok(page)
    }
}

fn photograph(name: &str, image: Option<&RgbImage>) -> Result<Option<Picture>, PageError> {
    let picture = |image| Ok(Picture { name: name.to_owned(), png: png(image)?, jpeg: Some(jpeg(image)?) });
    image.map(picture).transpose()
}

fn png(image: &RgbImage) -> Result<Vec<u8>, PageError> {
    let mut bytes = io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

fn jpeg(image: &RgbImage) -> Result<Vec<u8>, PageError> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).encode_image(image)?;
    Ok(bytes)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), PageError> {
    Ok(write_quickly(path, |file| file.write_all(bytes))?)
}
