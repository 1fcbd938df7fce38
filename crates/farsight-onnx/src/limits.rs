//! How much memory a file's numbers ask for, before an engine asks for it: an engine that gets none ends the whole
//! process.

use std::collections::HashMap;

use farsight_graph::model::MAX_ENLARGEMENT;
use serde_json::Value;

use crate::bounded::{counted, shortened, text_in};
use crate::error::OnnxProblem;
use crate::field;
use crate::wire::{self, Message, WireError};

/// No window of a network of ours is wider, and nothing is moved, spread or enlarged by more.
const MAX_SETTING: i64 = 128;

/// No network of ours has more groups, or axes of this number.
const MAX_COUNT: i64 = 65_536;

/// Bytes of one map of the largest input: five times the largest map of SMOKE.
const MAX_MAP: f64 = (2_u64 << 30) as f64;

/// Pixels of inputs whose size is no number of the description: the most that the SSD makes of an image.
const USUAL_PX: f64 = 1.0e6;

/// Descriptions with longer sides are refused by whoever reads them.
const MAX_SIDE_PX: u64 = 8192;

/// No input is larger, pixels: five times the largest of SMOKE, which is 2560 pixels wide and high.
const MAX_INPUT_PX: f64 = (1_u64 << 25) as f64;

/// Channels of an image.
const IMAGE_CHANNELS: f64 = 3.0;

/// How large a value is.
#[derive(Debug, Clone, Copy)]
struct Size {
    channels: f64,
    /// Its sides relative to the image's.
    scale: f64,
}

impl Size {
    /// For an input of so many pixels.
    fn bytes(self, input_px: f64) -> f64 {
        self.channels * self.scale * self.scale * input_px * size_of::<f32>() as f64
    }
}

/// Pixels of the largest input that a network with this description ([`crate::key::MODEL`]) makes of an image: an input
/// grows to [`MAX_ENLARGEMENT`] times its width for a wide camera where the range of focal lengths is known, and is at
/// most as high as wide for a high image.
pub(super) fn largest_input_px(description: Option<&str>) -> f64 {
    let Some(description) = description.and_then(|text| serde_json::from_str::<Value>(text).ok()) else {
        return USUAL_PX;
    };
    let side = |place: usize| description["input"][place].as_u64().filter(|side| *side <= MAX_SIDE_PX);
    let (Some(width), Some(height)) = (side(0), side(1)) else { return USUAL_PX };
    let growth = if description["focal_range_px"].is_array() { MAX_ENLARGEMENT as u64 } else { 1 };
    ((width * growth) as f64 * (width.max(height) * growth) as f64).max(USUAL_PX)
}

/// The settings of a node that decide about sizes.
#[derive(Debug, Default)]
struct Settings {
    strides: Vec<i64>,
    group: i64,
    block: i64,
}

/// Refuses graphs whose maps for an input of so many pixels no machine has room for.
pub(super) fn check(graph: Message<'_>, image: &str, input_px: f64) -> Result<(), OnnxProblem> {
    let input = Size { channels: IMAGE_CHANNELS, scale: 1.0 };
    let fits = |size: Size, name: &str, limit: f64| {
        let bytes = size.bytes(input_px);
        let too_large = || OnnxProblem::Memory { name: shortened(name), megabytes: bytes / 1e6, limit: limit / 1e6 };
        if bytes > limit { Err(too_large()) } else { Ok(()) }
    };
    fits(input, image, input.bytes(MAX_INPUT_PX))?;
    let mut constants = HashMap::new();
    for tensor in graph.all(field::GRAPH_CONSTANT) {
        let tensor = tensor?;
        constants.insert(text_in(tensor, field::TENSOR_NAME)?, tensor);
    }
    let mut sizes = HashMap::from([(image, input)]);
    for node in graph.all(field::GRAPH_NODE) {
        let node = node?;
        let operator = text_in(node, field::NODE_OPERATOR)?;
        let inputs = node.all(field::NODE_INPUT).map(|name| name?.text()).collect::<Result<Vec<_>, _>>()?;
        let settings = settings(node, operator)?;
        let given: Vec<Option<Message<'_>>> = inputs.iter().map(|name| constants.get(name).copied()).collect();
        let constant = |place: usize| given.get(place).copied().flatten();
        if operator == "Range" {
            (0..inputs.len()).filter_map(constant).try_for_each(check_range)?;
        }
        let outputs = node.all(field::NODE_OUTPUT).map(|name| name?.text()).collect::<Result<Vec<_>, _>>()?;
        // A weight in 8 bits is as large as the weight that comes of it.
        if operator == "DequantizeLinear"
            && let (Some(constant), Some(output)) = (constant(0), outputs.first())
        {
            constants.insert(output, constant);
            continue;
        }
        let known: Vec<Size> = inputs.iter().filter_map(|name| sizes.get(name)).copied().collect();
        let enlarged = if operator == "Resize" { Some(resize_factor(constant(2))?) } else { None };
        let Some(size) = size_of_output(operator, &known, &settings, constant(1), enlarged)? else { continue };
        fits(size, outputs.first().copied().unwrap_or_default(), MAX_MAP)?;
        sizes.extend(outputs.into_iter().map(|name| (name, size)));
    }
    Ok(())
}

/// The size of what a node makes of values of the sizes `known`; none of what does not follow from the image.
fn size_of_output(
    operator: &str,
    known: &[Size],
    settings: &Settings,
    weight: Option<Message<'_>>,
    enlarged: Option<f64>,
) -> Result<Option<Size>, OnnxProblem> {
    let Some(&first) = known.first() else { return Ok(None) };
    let largest = |of: fn(&Size) -> f64| known.iter().map(of).fold(0.0, f64::max);
    let (channels, scale) = (largest(|size| size.channels), largest(|size| size.scale));
    let stride = |of: fn(i64, i64) -> i64| settings.strides.iter().copied().reduce(of).unwrap_or(1).max(1) as f64;
    let axes = weight.map(axes).transpose()?.unwrap_or_default();
    let axis = |place: usize| axes.get(place).map(|&side| side as f64);
    Ok(Some(match operator {
        "Conv" | "DeformConv" => {
            Size { channels: axis(0).unwrap_or(first.channels), scale: first.scale / stride(i64::min) }
        }
        "ConvTranspose" => {
            let channels = axis(1).map_or(first.channels, |side| side * settings.group.max(1) as f64);
            Size { channels, scale: first.scale * stride(i64::max) }
        }
        "MaxPool" => Size { channels, scale: scale / stride(i64::min) },
        "GlobalAveragePool" => Size { channels, scale: 0.0 },
        "Resize" => Size { channels, scale: scale * enlarged.unwrap_or(1.0) },
        "DepthToSpace" => {
            let block = settings.block.max(1) as f64;
            Size { channels: channels / (block * block), scale: scale * block }
        }
        "Concat" => Size { channels: known.iter().map(|size| size.channels).sum(), scale },
        _ => Size { channels, scale },
    }))
}

/// The settings of a node; those that are out of all proportion are refused.
fn settings(node: Message<'_>, operator: &str) -> Result<Settings, OnnxProblem> {
    let mut settings = Settings::default();
    for attribute in counted(node.all(field::NODE_ATTRIBUTE), "settings") {
        let attribute = attribute?;
        let name = text_in(attribute, field::ATTRIBUTE_NAME)?;
        let refused = |value: i64, limit: i64| {
            let (operator, setting) = (operator.to_owned(), shortened(name));
            OnnxProblem::Setting { operator, setting, value, limit }
        };
        let list = whole_numbers(attribute, field::ATTRIBUTE_INTS)?;
        if let Some(&value) = list.iter().find(|value| value.unsigned_abs() > MAX_SETTING.unsigned_abs()) {
            return Err(refused(value, MAX_SETTING));
        }
        let single = attribute.number(field::ATTRIBUTE_INT)?.cast_signed();
        let limit = if name == "blocksize" { MAX_SETTING } else { MAX_COUNT };
        if single.unsigned_abs() > limit.unsigned_abs() {
            return Err(refused(single, limit));
        }
        match name {
            "strides" => settings.strides = list,
            "group" => settings.group = single,
            "blocksize" => settings.block = single,
            _ => {}
        }
    }
    Ok(settings)
}

/// The whole numbers of a field, one by one or packed.
pub(super) fn whole_numbers(message: Message<'_>, number: u64) -> Result<Vec<i64>, WireError> {
    let mut numbers = Vec::new();
    for part in message.fields() {
        let part = part?;
        match part.value {
            wire::Value::Number(value) if part.number == number => numbers.push(value.cast_signed()),
            wire::Value::Bytes(packed) if part.number == number => {
                for value in packed.varints() {
                    numbers.push(value?.cast_signed());
                }
            }
            _ => {}
        }
    }
    Ok(numbers)
}

/// Sides of a constant.
fn axes(constant: Message<'_>) -> Result<Vec<i64>, WireError> {
    whole_numbers(constant, field::TENSOR_AXIS)
}

/// By how much a `Resize` enlarges, which files of ours say with a constant.
fn resize_factor(scales: Option<Message<'_>>) -> Result<f64, OnnxProblem> {
    let raw = scales.map(|scales| scales.last(field::TENSOR_RAW)).transpose()?.flatten();
    let Some(raw) = raw else { return Err(OnnxProblem::Resize) };
    let factors: Vec<f32> = raw.bytes().as_chunks().0.iter().map(|factor| f32::from_le_bytes(*factor)).collect();
    if factors.iter().all(|factor| *factor > 0.0 && f64::from(*factor) <= MAX_SETTING as f64) {
        return Ok(factors.into_iter().map(f64::from).fold(0.0, f64::max));
    }
    Err(OnnxProblem::Resize)
}

/// Refuses a constant end of a `Range` that makes an endless list.
fn check_range(end: Message<'_>) -> Result<(), OnnxProblem> {
    let raw = end.last(field::TENSOR_RAW)?.map_or(&[][..], Message::bytes);
    let values = raw.as_chunks().0.iter().map(|value| i64::from_le_bytes(*value));
    match values.into_iter().find(|value| value.unsigned_abs() > MAX_COUNT.unsigned_abs()) {
        Some(value) => {
            let (operator, setting, limit) = ("Range".to_owned(), "end".to_owned(), MAX_COUNT);
            Err(OnnxProblem::Setting { operator, setting, value, limit })
        }
        None => Ok(()),
    }
}
