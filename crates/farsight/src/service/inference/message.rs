//! Requests and responses of `infer`, in JSON and with binary tensors after it.

use axum::Json;
use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::super::infer::ModelCard;
use super::super::rejection::Rejection;
use super::tensor::{OUTPUTS, Output, file_from_element, file_from_pixels};

/// How long the JSON is where binary tensors follow it.
const JSON_LENGTH: HeaderName = HeaderName::from_static("inference-header-content-length");

/// Parameters that are about the form of messages.
const BINARY_OUTPUT: &str = "binary_data_output";
const BINARY_DATA: &str = "binary_data";
const BINARY_SIZE: &str = "binary_data_size";

type Parameters = Map<String, Value>;

#[derive(Debug, Deserialize)]
struct Head {
    id: Option<String>,
    #[serde(default)]
    parameters: Parameters,
    inputs: Vec<Input>,
    outputs: Option<Vec<Wanted>>,
}

#[derive(Debug, Deserialize)]
struct Input {
    name: String,
    shape: Vec<usize>,
    datatype: String,
    #[serde(default)]
    parameters: Parameters,
    data: Option<Value>,
}

#[derive(Debug, Deserialize)]
struct Wanted {
    name: String,
    #[serde(default)]
    parameters: Parameters,
}

/// A request.
#[derive(Debug)]
pub(super) struct Question {
    head: Head,
    /// What follows the JSON.
    binary: Bytes,
}

/// An output that is wanted, and whether in bytes.
pub(super) struct Asked {
    name: String,
    is_binary: bool,
}

impl Question {
    /// The request in a body.
    pub(super) fn read(headers: &HeaderMap, body: &Bytes) -> Result<Self, Rejection> {
        let length = match headers.get(JSON_LENGTH) {
            None => body.len(),
            Some(length) => length
                .to_str()
                .ok()
                .and_then(|length| length.parse().ok())
                .filter(|length| *length <= body.len())
                .ok_or_else(|| {
                    Rejection::bad_request("Inference-Header-Content-Length is no length of JSON in the body")
                })?,
        };
        let head = serde_json::from_slice(&body[..length])
            .map_err(|error| Rejection::bad_request(format!("the request is no such JSON: {error}")))?;
        Ok(Self { head, binary: body.slice(length..) })
    }

    pub(super) fn id(&self) -> Option<&str> {
        self.head.id.as_deref()
    }

    /// What the parameters say of the camera.
    pub(super) fn camera_parameters(&self) -> Value {
        let mut parameters = self.head.parameters.clone();
        parameters.remove(BINARY_OUTPUT);
        Value::Object(parameters)
    }

    /// The outputs that are asked for; none is all of them, in JSON.
    pub(super) fn wanted(&self) -> Result<Option<Vec<Asked>>, Rejection> {
        let is = |parameters: &Parameters, name: &str| parameters.get(name).and_then(Value::as_bool);
        let by_default = is(&self.head.parameters, BINARY_OUTPUT).unwrap_or(false);
        let Some(outputs) = &self.head.outputs else {
            let all = || OUTPUTS.iter().map(|(name, ..)| Asked { name: (*name).to_owned(), is_binary: true });
            return Ok(by_default.then(|| all().collect()));
        };
        let asked = |wanted: &Wanted| {
            let Wanted { name, parameters } = wanted;
            let names = OUTPUTS.map(|(name, ..)| name);
            if !names.contains(&name.as_str()) {
                let message = format!("no output {name:?}; expected some of {}", names.join(", "));
                return Err(Rejection::bad_request(message));
            }
            Ok(Asked { name: name.clone(), is_binary: is(parameters, BINARY_DATA).unwrap_or(by_default) })
        };
        outputs.iter().map(asked).collect::<Result<_, _>>().map(Some)
    }

    /// The image file.
    pub(super) fn image(&self) -> Result<Bytes, Rejection> {
        let [Input { name, shape, datatype, parameters, data }] = &self.head.inputs[..] else {
            return Err(Rejection::bad_request("expected one input, \"image\""));
        };
        if name != "image" {
            return Err(Rejection::bad_request(format!("input {name:?}; expected \"image\"")));
        }
        let is_file = match datatype.as_str() {
            "BYTES" => true,
            "UINT8" => false,
            _ => return Err(Rejection::bad_request("input \"image\": expected the datatype BYTES or UINT8")),
        };
        if is_file && (shape.is_empty() || shape.iter().any(|side| *side != 1)) {
            return Err(Rejection::bad_request("input \"image\": expected one image, of shape [1]"));
        }
        if let Some(size) = parameters.get(BINARY_SIZE) {
            if size.as_u64() != Some(self.binary.len() as u64) {
                return Err(Rejection::bad_request("input \"image\": binary_data_size is not what follows the JSON"));
            }
            return if is_file { file_from_element(&self.binary) } else { file_from_pixels(shape, &self.binary) };
        }
        let Some(data) = data else {
            return Err(Rejection::bad_request("input \"image\": no data; expected them, or binary_data_size"));
        };
        if is_file { file_from_text(data) } else { file_from_pixels(shape, &pixels(data)?) }
    }
}

/// The file in a base64 text, alone or in a list.
fn file_from_text(data: &Value) -> Result<Bytes, Rejection> {
    let text = match data {
        Value::String(text) => Some(text),
        Value::Array(list) => match &list[..] {
            [Value::String(text)] => Some(text),
            _ => None,
        },
        _ => None,
    };
    let file = text.and_then(|text| STANDARD.decode(text).ok()).filter(|file| !file.is_empty());
    file.map(Bytes::from).ok_or_else(|| Rejection::bad_request("input \"image\": expected an image file in base64"))
}

/// Numbers from 0 to 255, in lists of lists or in one.
fn pixels(data: &Value) -> Result<Vec<u8>, Rejection> {
    fn add(data: &Value, pixels: &mut Vec<u8>) -> Option<()> {
        if let Value::Array(list) = data {
            return list.iter().try_for_each(|data| add(data, pixels));
        }
        pixels.push(u8::try_from(data.as_u64()?).ok()?);
        Some(())
    }
    let mut pixels = Vec::new();
    add(data, &mut pixels)
        .ok_or_else(|| Rejection::bad_request("input \"image\": expected whole numbers from 0 to 255"))?;
    Ok(pixels)
}

/// The response.
pub(super) fn answer(card: &ModelCard, id: Option<&str>, outputs: &[Output], wanted: Option<&[Asked]>) -> Response {
    let mut told = Vec::new();
    let mut binary = Vec::new();
    let mut tell = |output: &Output, is_binary: bool| {
        let Output { name, datatype, shape, .. } = output;
        let mut one = json!({"name": name, "datatype": datatype, "shape": shape});
        if is_binary {
            let bytes = output.bytes();
            one["parameters"] = json!({BINARY_SIZE: bytes.len()});
            binary.extend_from_slice(&bytes);
        } else {
            one["data"] = output.json_data();
        }
        told.push(one);
    };
    match wanted {
        None => outputs.iter().for_each(|output| tell(output, false)),
        Some(wanted) => {
            for Asked { name, is_binary } in wanted {
                outputs.iter().filter(|output| output.name == name).for_each(|output| tell(output, *is_binary));
            }
        }
    }
    let mut head = json!({"model_name": card.name, "model_version": card.version, "outputs": told});
    if let Some(id) = id {
        head["id"] = json!(id);
    }
    if binary.is_empty() {
        return Json(head).into_response();
    }
    let mut body = head.to_string().into_bytes();
    let length = HeaderValue::from(body.len());
    body.append(&mut binary);
    let kind = HeaderValue::from_static("application/octet-stream");
    ([(JSON_LENGTH, length), (header::CONTENT_TYPE, kind)], body).into_response()
}
