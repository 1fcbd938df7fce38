//! Tensors: images in, numbers out.

use axum::body::Bytes;
use serde_json::{Value, json};

use super::super::rejection::Rejection;
use crate::json::{DetectionRecord, ImageRecord};

/// Name, datatype and shape of each output; -1 is the number of detections.
pub(super) const OUTPUTS: [(&str, &str, &[i64]); 11] = [
    ("class", "BYTES", &[-1]),
    ("score", "FP64", &[-1]),
    ("box2d", "FP64", &[-1, 4]),
    ("dimensions_hwl", "FP64", &[-1, 3]),
    ("location", "FP64", &[-1, 3]),
    ("rotation_y", "FP64", &[-1]),
    ("alpha", "FP64", &[-1]),
    ("range_m", "FP64", &[-1]),
    ("range_sigma_m", "FP64", &[-1]),
    ("range_interval_m", "FP64", &[-1, 2]),
    ("projection", "FP64", &[3, 4]),
];

/// Numbers or words, row by row.
pub(super) enum Data {
    Numbers(Vec<f64>),
    Words(Vec<String>),
}

/// One tensor of an answer.
pub(super) struct Output {
    pub(super) name: &'static str,
    pub(super) datatype: &'static str,
    pub(super) shape: Vec<usize>,
    pub(super) data: Data,
}

impl Output {
    /// As JSON has it; error bars that are not there are no numbers, so they are null.
    pub(super) fn json_data(&self) -> Value {
        match &self.data {
            Data::Numbers(numbers) => json!(numbers),
            Data::Words(words) => json!(words),
        }
    }

    /// As the extension for binary tensors has it: little-endian; words with their length before them.
    pub(super) fn bytes(&self) -> Vec<u8> {
        match &self.data {
            Data::Numbers(numbers) => numbers.iter().flat_map(|number| number.to_le_bytes()).collect(),
            Data::Words(words) => words.iter().flat_map(|word| element(word.as_bytes())).collect(),
        }
    }
}

/// A datum of BYTES.
fn element(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

/// What was found, as tensors.
pub(super) fn outputs(record: &ImageRecord) -> Vec<Output> {
    let found = &record.detections;
    let numbers = |number: fn(&DetectionRecord) -> Vec<f64>| Data::Numbers(found.iter().flat_map(number).collect());
    let output = |(name, datatype, shape): &(&'static str, &'static str, &[i64])| {
        let data = match *name {
            "class" => Data::Words(found.iter().map(|one| one.class.clone()).collect()),
            "score" => numbers(|one| vec![one.score]),
            "box2d" => numbers(|one| one.box2d.to_vec()),
            "dimensions_hwl" => numbers(|one| one.dimensions_hwl.to_vec()),
            "location" => numbers(|one| one.location.to_vec()),
            "rotation_y" => numbers(|one| vec![one.rotation_y]),
            "alpha" => numbers(|one| vec![one.alpha]),
            "range_m" => numbers(|one| vec![one.range_m]),
            "range_sigma_m" => numbers(|one| vec![one.range_sigma_m.unwrap_or(f64::NAN)]),
            "range_interval_m" => numbers(|one| one.range_interval_m.unwrap_or([f64::NAN; 2]).to_vec()),
            _ => {
                let projection = record.camera.as_ref().map_or([[f64::NAN; 4]; 3], |camera| camera.projection);
                Data::Numbers(projection.into_iter().flatten().collect())
            }
        };
        let size = |side: &i64| usize::try_from(*side).unwrap_or(found.len());
        Output { name, datatype, shape: shape.iter().map(size).collect(), data }
    };
    OUTPUTS.iter().map(output).collect()
}

/// The file in a datum of BYTES of the extension for binary tensors.
pub(super) fn file_from_element(bytes: &Bytes) -> Result<Bytes, Rejection> {
    let length = bytes.first_chunk::<4>().map(|length| u32::from_le_bytes(*length) as usize);
    match length {
        Some(length) if length == bytes.len() - 4 && length > 0 => Ok(bytes.slice(4..)),
        _ => Err(Rejection::bad_request(
            "input \"image\": expected one datum with its length before it (4 bytes, little-endian)",
        )),
    }
}

/// Pixels as an image file (PPM): there is one way from bytes to an image.
pub(super) fn file_from_pixels(shape: &[usize], pixels: &[u8]) -> Result<Bytes, Rejection> {
    let is_whole = shape.iter().try_fold(1_usize, |size, side| size.checked_mul(*side)) == Some(pixels.len());
    let ([height, width, 3] | [1, height, width, 3], true) = (shape, is_whole) else {
        let message = format!(
            "input \"image\": {} bytes of shape {shape:?}; expected [height, width, 3] with as many values",
            pixels.len()
        );
        return Err(Rejection::bad_request(message));
    };
    let mut file = format!("P6\n{width} {height}\n255\n").into_bytes();
    file.extend_from_slice(pixels);
    Ok(file.into())
}
