//! The Open Inference Protocol, version 2 (<https://github.com/kserve/open-inference-protocol>), with its extension for
//! binary tensors: what clients of Triton and `KServe` speak.
//!
//! One request is one image: `image` as a file's bytes (`BYTES [1]`, base64 in JSON) or as pixels
//! (`UINT8 [height, width, 3]`, RGB). Its camera stands in the request's parameters, by the names that `/v1/range` has.

mod message;
mod tensor;

use std::path::PathBuf;

use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use super::camera_query::CameraQuery;
use super::guard::drain;
use super::queue::{Task, deadline_in};
use super::range::{UNNAMED, admitted, read};
use super::rejection::Rejection;
use super::shared::{Service, Shared};
use message::Question;
use tensor::outputs;

/// A rejection in the protocol's form: `{"error": "message"}`.
pub(super) struct ProtocolRefusal(Rejection);

impl From<Rejection> for ProtocolRefusal {
    fn from(rejection: Rejection) -> Self {
        Self(rejection)
    }
}

impl IntoResponse for ProtocolRefusal {
    fn into_response(self) -> Response {
        self.0.response(&json!({"error": self.0.message}))
    }
}

/// `GET /v2`.
pub(super) async fn server() -> Json<Value> {
    Json(json!({"name": "farsight", "version": crate::VERSION, "extensions": ["binary_tensor_data"]}))
}

/// `GET /v2/health/live`.
pub(super) async fn live() -> Json<Value> {
    Json(json!({"live": true}))
}

/// `GET /v2/health/ready`.
pub(super) async fn ready(State(shared): Service) -> Result<Json<Value>, Rejection> {
    if *shared.stopped.borrow() { Err(Rejection::ending()) } else { Ok(Json(json!({"ready": true}))) }
}

/// `GET /v2/models/{model}`.
pub(super) async fn model(State(shared): Service, Path(name): Path<String>) -> Result<Json<Value>, ProtocolRefusal> {
    check_model(&shared, &name)?;
    let tensor =
        |(name, datatype, shape): &(&str, &str, &[i64])| json!({"name": name, "datatype": datatype, "shape": shape});
    Ok(Json(json!({
        "name": name,
        "versions": [shared.card.version],
        "platform": shared.card.platform,
        "inputs": [tensor(&("image", "BYTES", &[1]))],
        "outputs": tensor::OUTPUTS.iter().map(tensor).collect::<Vec<_>>(),
    })))
}

/// `GET /v2/models/{model}/ready`.
pub(super) async fn model_ready(
    State(shared): Service,
    Path(name): Path<String>,
) -> Result<Json<Value>, ProtocolRefusal> {
    check_model(&shared, &name)?;
    if *shared.stopped.borrow() {
        return Err(Rejection::ending().into());
    }
    Ok(Json(json!({"name": name, "ready": true})))
}

/// `POST /v2/models/{model}/infer`.
pub(super) async fn infer(
    State(shared): Service,
    Path(name): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, ProtocolRefusal> {
    let deadline = deadline_in(shared.config.deadline);
    if let Err(rejection) = check_model(&shared, &name) {
        drain(body);
        return Err(rejection.into());
    }
    let (body, place) = admitted(&shared, &headers, body)?;
    let bytes: Bytes = read(body, deadline).await?;
    let question = Question::read(&headers, &bytes)?;
    let query = CameraQuery::from_parameters(question.camera_parameters())?;
    let views = query.views(&shared.config)?;
    let wanted = question.wanted()?;
    let task = Task { bytes: question.image()?, name: PathBuf::from(UNNAMED), views };
    let record = shared.queue.answer(task, place, deadline).await?;
    Ok(message::answer(&shared.card, question.id(), &outputs(&record), wanted.as_deref()))
}

fn check_model(shared: &Shared, name: &str) -> Result<(), Rejection> {
    let own = &shared.card.name;
    if name == own {
        return Ok(());
    }
    let message = format!("no model {name:?}; expected {own:?}");
    Err(Rejection::new(StatusCode::NOT_FOUND, "no_model", message))
}
