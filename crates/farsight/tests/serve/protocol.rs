//! The Open Inference Protocol, the description of all paths, calibration.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use farsight::service::Config;
use farsight::{CameraSource, Lens, RoadPlane, ViewSource};
use serde_json::{Value, json};

use crate::client::{Response, Stage, get, sent};

const INFER: &str = "POST /v2/models/stand-in/infer";

fn infer(stage: &Stage, question: &Value) -> Response {
    let body = question.to_string();
    sent(stage.server.address(), INFER, &[&format!("Content-Length: {}", body.len())], body.as_bytes())
}

fn image(file: &[u8]) -> Value {
    json!({"name": "image", "datatype": "BYTES", "shape": [1], "data": [STANDARD.encode(file)]})
}

#[test]
fn clients_of_the_protocol_find_the_model_and_get_tensors() {
    let stage = Stage::new(Config::default());
    let address = stage.server.address();
    let server = get(address, "/v2").json();
    assert_eq!((server["name"].as_str(), &server["extensions"]), (Some("farsight"), &json!(["binary_tensor_data"])));
    let model = get(address, "/v2/models/stand-in").json();
    assert_eq!(model["inputs"], json!([{"name": "image", "datatype": "BYTES", "shape": [1]}]));
    assert_eq!(model["outputs"][2], json!({"name": "box2d", "datatype": "FP64", "shape": [-1, 4]}));
    assert_eq!(get(address, "/v2/models/stand-in/ready").json(), json!({"name": "stand-in", "ready": true}));
    let question = json!({"id": "7", "parameters": {"hfov": 65.5}, "inputs": [image(b"an image")]});
    let answer = infer(&stage, &question);
    assert_eq!(answer.status, 200, "{answer:?}");
    let answer = answer.json();
    assert_eq!(
        (&answer["id"], &answer["model_name"], &answer["model_version"]),
        (&json!("7"), &json!("stand-in"), &json!("1"))
    );
    let names: Vec<_> = answer["outputs"].as_array().unwrap().iter().map(|one| one["name"].clone()).collect();
    let described: Vec<_> = model["outputs"].as_array().unwrap().iter().map(|one| one["name"].clone()).collect();
    assert_eq!(names, described);
    assert_eq!(answer["outputs"][2], json!({"name": "box2d", "datatype": "FP64", "shape": [0, 4], "data": []}));
    assert_eq!(*stage.stand_in.images.lock().unwrap(), [b"an image"]);
    let seen = stage.stand_in.seen.lock().unwrap();
    assert_eq!(seen.iter().map(ViewSource::cameras).collect::<Vec<_>>(), [&CameraSource::FieldOfView(65.5)]);
}

#[test]
fn pixels_and_binary_tensors_are_taken_and_given() {
    let stage = Stage::new(Config::default());
    let pixels: Vec<u8> = (0..18).collect();
    let rows: Vec<Vec<&[u8]>> = pixels.chunks(9).map(|row| row.chunks(3).collect()).collect();
    let in_json = json!({"inputs": [{"name": "image", "datatype": "UINT8", "shape": [2, 3, 3], "data": rows}]});
    assert_eq!(infer(&stage, &in_json).status, 200);
    let head = json!({
        "inputs": [{"name": "image", "datatype": "UINT8", "shape": [2, 3, 3], "parameters": {"binary_data_size": 18}}],
        "outputs": [{"name": "projection", "parameters": {"binary_data": true}}, {"name": "score"}],
    })
    .to_string();
    let body = [head.as_bytes(), &pixels].concat();
    let lengths =
        [format!("Content-Length: {}", body.len()), format!("Inference-Header-Content-Length: {}", head.len())];
    let answer = sent(stage.server.address(), INFER, &[&lengths[0], &lengths[1]], &body);
    assert_eq!(answer.status, 200, "{answer:?}");
    // Pixels go the way of every other image file.
    let file = [b"P6\n3 2\n255\n", &pixels[..]].concat();
    assert_eq!(*stage.stand_in.images.lock().unwrap(), [file.clone(), file]);
    let length = answer.head.split("inference-header-content-length: ").nth(1).unwrap();
    let length: usize = length.split("\r\n").next().unwrap().parse().unwrap();
    let told: Value = serde_json::from_str(&answer.body[..length]).unwrap();
    let projection =
        json!({"name": "projection", "datatype": "FP64", "shape": [3, 4], "parameters": {"binary_data_size": 96}});
    assert_eq!(told["outputs"], json!([projection, {"name": "score", "datatype": "FP64", "shape": [0], "data": []}]));
}

#[test]
fn questions_that_are_none_are_told_what_was_expected() {
    let stage = Stage::new(Config::default());
    let with = |change: Value| {
        let mut question = json!({"inputs": [image(b"an image")]});
        for (name, value) in change.as_object().unwrap() {
            question[name] = value.clone();
        }
        question
    };
    let input = |change: Value| {
        let mut input = image(b"an image");
        for (name, value) in change.as_object().unwrap() {
            input[name] = value.clone();
        }
        with(json!({"inputs": [input]}))
    };
    for (question, told) in [
        (json!({}), "missing field `inputs`"),
        (with(json!({"inputs": []})), "expected one input"),
        (with(json!({"parameters": {"fov": 65}})), "unknown field `fov`"),
        (with(json!({"parameters": {"camera": "rear"}})), "no camera \"rear\""),
        (with(json!({"outputs": [{"name": "speed"}]})), "no output \"speed\"; expected some of class, score"),
        (input(json!({"name": "picture"})), "expected \"image\""),
        (input(json!({"datatype": "FP32"})), "expected the datatype BYTES or UINT8"),
        (input(json!({"shape": [2]})), "expected one image"),
        (input(json!({"data": ["%"]})), "expected an image file in base64"),
        (input(json!({"data": null})), "no data"),
        (input(json!({"parameters": {"binary_data_size": 9}})), "binary_data_size is not what follows"),
        (input(json!({"datatype": "UINT8", "shape": [2, 2, 3], "data": [1, 2]})), "expected [height, width, 3]"),
        (input(json!({"datatype": "UINT8", "shape": [1, 1, 3], "data": [1, 2, 256]})), "whole numbers from 0 to 255"),
    ] {
        let answer = infer(&stage, &question);
        let error = answer.json()["error"].as_str().unwrap_or_else(|| panic!("{answer:?}")).to_owned();
        assert!(answer.status >= 400 && error.contains(told), "{question}: {answer:?}");
    }
    let other = get(stage.server.address(), "/v2/models/other");
    assert_eq!((other.status, other.json()), (404, json!({"error": "no model \"other\"; expected \"stand-in\""})));
    let panicked = infer(&stage, &json!({"inputs": [image(b"panic")]}));
    assert_eq!((panicked.status, panicked.json()["error"].is_string()), (500, true));
    assert_eq!(stage.stand_in.images.lock().unwrap().len(), 1);
}

#[test]
fn the_description_says_what_answers_are() {
    let stage = Stage::new(Config::default());
    let address = stage.server.address();
    let described = get(address, "/openapi.json");
    assert!(described.head.contains("content-type: application/json"), "{}", described.head);
    let described = described.json();
    let answer = infer(&stage, &json!({"inputs": [image(b"an image")]})).json();
    let rectangle = json!({"width": 1280, "height": 720, "corners_px": CORNERS, "sides_m": [3.5, 8.0]});
    for (schema, answer) in [
        ("Cameras", get(address, "/v1/cameras").json()),
        ("Error", get(address, "/none").json()),
        ("InferResponse", answer.clone()),
        ("Tensor", answer["outputs"][0].clone()),
        ("RoadCamera", calibrated(&stage, &rectangle).json()),
        ("ImageRecord", crate::client::post(address, "?hfov=65", b"an image").json()),
    ] {
        let schema = &described["components"]["schemas"][schema];
        let known = schema["properties"].as_object().unwrap();
        let unknown: Vec<_> = answer.as_object().unwrap().keys().filter(|name| !known.contains_key(*name)).collect();
        assert!(unknown.is_empty(), "{unknown:?} are not in {schema}");
        for name in schema["required"].as_array().unwrap() {
            assert!(answer.get(name.as_str().unwrap()).is_some(), "{name} is not in {answer}");
        }
    }
}

/// What a camera of 65 degrees that is 5 m above the road and looks down by 0.3 rad sees of a rectangle of 3.5 x 8 m.
const CORNERS: [[f64; 2]; 4] = [[471.876, 487.394], [762.235, 526.805], [843.051, 336.062], [658.467, 321.342]];

fn calibrated(stage: &Stage, question: &Value) -> Response {
    let body = question.to_string();
    let headers = ["Content-Type: application/json", &format!("Content-Length: {}", body.len())];
    sent(stage.server.address(), "POST /v1/calibrate", &headers, body.as_bytes())
}

#[test]
fn four_points_make_a_camera_that_requests_and_files_take() {
    let stage = Stage::new(Config::default());
    let rectangle = json!({"width": 1280, "height": 720, "corners_px": CORNERS, "sides_m": [3.5, 8.0]});
    let answer = calibrated(&stage, &rectangle);
    assert_eq!(answer.status, 200, "{answer:?}");
    let answer = answer.json();
    let number = |name: &str| answer[name].as_f64().unwrap_or_else(|| panic!("{name}: {answer}"));
    assert!((number("hfov_deg") - 65.0).abs() < 0.2, "{answer}");
    assert!((number("height_m") - 5.0).abs() < 0.02, "{answer}");
    assert!((number("pitch_deg") - 17.19).abs() < 0.2, "{answer}");
    assert!(number("hfov_sigma_deg") > 0.1 && number("hfov_sigma_deg") < 10.0, "{answer}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("camera.txt");
    std::fs::write(&file, answer["calibration"].as_str().unwrap()).unwrap();
    let rows: Vec<String> = answer["projection"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| row.as_array().unwrap().iter().map(Value::to_string).collect::<Vec<_>>().join(","))
        .collect();
    let road: Vec<String> = answer["road"].as_array().unwrap().iter().map(Value::to_string).collect();
    let query = format!("?projection={}&road={}&lens=brown:-0.1,0,0,0", rows.join(","), road.join(","));
    let answer = crate::client::post(stage.server.address(), &query, b"an image");
    assert_eq!(answer.status, 200, "{answer:?}");
    let seen = stage.stand_in.seen.lock().unwrap();
    assert_eq!(seen[0].lens(), Some(Lens::Brown([-0.1, 0.0, 0.0, 0.0, 0.0])));
    let over_road = |source: &CameraSource| {
        let CameraSource::OverRoad(camera, road) = source else { panic!("{source:?}") };
        let RoadPlane { slope, tilt, height_m, sigmas } = road;
        assert!((height_m - 5.0).abs() < 0.02 && sigmas.iter().all(|sigma| *sigma > 0.0 && *sigma < 0.5), "{road:?}");
        [camera.projection.as_flattened(), &[*slope, *tilt, *height_m], sigmas].concat()
    };
    let of_file = over_road(&CameraSource::from_calibration(&file).unwrap());
    for (a, b) in over_road(seen[0].cameras()).iter().zip(of_file) {
        assert!((a - b).abs() < 1e-9 * a.abs().max(1.0), "{a} in the request, {b} in the file");
    }
}

#[test]
fn rectangles_that_are_none_are_told() {
    let stage = Stage::new(Config::default());
    let mut crossed = CORNERS;
    crossed.swap(1, 2);
    for (question, status, told) in [
        (json!({"width": 1280, "height": 720, "corners_px": crossed, "sides_m": [3.5, 8.0]}), 422, "no rectangle"),
        (
            json!({"width": 1280, "height": 720, "corners_px": CORNERS, "sides_m": [3.5, 0.0]}),
            422,
            "two positive numbers",
        ),
        (json!({"width": 0, "height": 720, "corners_px": CORNERS, "sides_m": [3.5, 8.0]}), 400, "no pixels"),
        (json!({"width": 1280, "height": 720, "corners_px": CORNERS[..3], "sides_m": [3.5, 8.0]}), 400, "corners_px"),
        (
            json!({"width": 1280, "height": 720, "corners_px": CORNERS, "sides": [3.5, 8.0]}),
            400,
            "unknown field `sides`",
        ),
    ] {
        let answer = calibrated(&stage, &question);
        assert_eq!(answer.status, status, "{answer:?}");
        assert!(answer.error().1.contains(told), "{answer:?}");
    }
}
