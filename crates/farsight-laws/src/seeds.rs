//! Good files to begin with, where none are in `fuzz/corpus`: they follow from the code, so that they are always of
//! today's format.

use std::fs;
use std::path::{Path, PathBuf};

use farsight_graph::init::initial_weights;
use farsight_graph::layers::{NeckKind, NormKind};
use farsight_graph::model::{CONFIG_KEY, METHOD_KEY, Model, NetworkConfig};
use farsight_graph::weights::{FILE_SHA256_KEY, Weights};
use farsight_methods::method::{DetectorMethod, DetectorVisitor, Method, MethodVisitor};
use farsight_methods::plate_reader::PlateReaderConfig;
use farsight_methods::refiner::RefinerConfig;
use farsight_methods::smoke::{DetectorFile, SmokeConfig};
use farsight_methods::{each_detector, each_method};
use farsight_onnx::Target;
use farsight_synth::SceneConfig;
use image::ImageFormat;

use crate::film::PIXELS;
use crate::mutate;

/// A car, a van and a region without labels.
pub(crate) fn labels() -> Vec<Vec<u8>> {
    let text = "\
Car 0.00 0 1.55 608.40 182.50 719.60 281.90 1.52 1.66 4.07 0.80 1.71 13.60 1.62
Van 0.10 1 1.55 400.00 150.00 500.00 250.00 2.10 1.90 5.00 -3.00 1.75 15.00 0.10
DontCare -1 -1 -10 498.20 171.30 585.40 189.60 -1 -1 -1 -1000 -1000 -1000 -10
";
    vec![text.as_bytes().to_vec()]
}

/// A car, and a pedestrian with an error bar.
pub(crate) fn results() -> Vec<Vec<u8>> {
    let text = "\
Car -1 -1 1.5500 614.0000 181.0000 727.0000 284.0000 1.5700 1.7300 4.1500 1.0000 1.7500 13.3000 1.6200 0.9000
Pedestrian -1 -1 0.1000 10.0000 20.0000 30.0000 44.0000 1.7000 0.6000 0.8000 -9.0000 1.7000 20.0000 0.3000 0.5000 1.2000
";
    vec![text.as_bytes().to_vec()]
}

pub(crate) fn calibration() -> Vec<Vec<u8>> {
    vec![b"P2: 721.5 0 609.6 44.9 0 721.5 172.9 0.2 0 0 1 0.003\nroad: 0.01 0.0 1.5 0.01 0.01 0.1\n".to_vec()]
}

/// Labels of two frames; velocities.
pub(crate) fn track_labels() -> Vec<Vec<u8>> {
    let car = "Car 0 0 -1.5 600 170 700 230 1.5 1.6 4.0 1.0 1.7 20.0 -1.57";
    let dont_care = "1 -1 DontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10";
    let velocities = "frame,time_s,id,vx_mps,vy_mps,vz_mps,speed_mps\n0,0.0,1,0.5,0,-3,9\n";
    vec![format!("0 7 {car}\n2 7 {car}\n{dont_care}\n").into_bytes(), velocities.as_bytes().to_vec()]
}

/// Oxts, poses and CSV.
pub(crate) fn ego() -> Vec<Vec<u8>> {
    let oxts = ["1.25"; 30].join(" ") + "\n";
    let pose = |z: f64| format!("1 0 0 0 0 1 0 0 0 0 1 {z}\n");
    let csv = "time_s,speed_mps,yaw_rate\n0.0,10.5,0.01\n0.1,10.6,-0.01\n";
    vec![oxts.repeat(3).into_bytes(), (pose(0.0) + &pose(1.5)).into_bytes(), csv.as_bytes().to_vec()]
}

/// Three frames of a film as ffmpeg tells of them, and of a larger one.
pub(crate) fn film() -> Vec<Vec<u8>> {
    let film = |[width, height]: [usize; 2]| {
        let stream = "[info]   Stream #0:0: Video: h264 (High), yuv420p, 40 kb/s, 25 fps, 25 tbr, 12800 tbn\n";
        let frame = |number: usize| {
            let time_s = number as f64 / 25.0;
            format!(
                "[Parsed_showinfo_0 @ 0x5] [info] n: {number} pts: 1 pts_time:{time_s} fmt:yuv420p s:{width}x{height} i:P\n"
            )
        };
        let complaint = "[mov,mp4 @ 0x5] [error] a packet is broken\n";
        let log: String = [stream.to_owned(), frame(0), frame(1), complaint.to_owned(), frame(2)].concat();
        [log.as_bytes(), PIXELS, &vec![7; 3 * 3 * width * height]].concat()
    };
    vec![film([4, 2]), film([64, 36])]
}

/// An image of each kind that is written here, with and without colours.
pub(crate) fn images() -> Vec<Vec<u8>> {
    let pixels = image::RgbImage::from_fn(12, 9, |x, y| image::Rgb([(20 * x) as u8, (25 * y) as u8, 90]));
    let kinds = [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Bmp, ImageFormat::Tiff];
    let written = |format| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        pixels.write_to(&mut bytes, format).ok().map(|()| bytes.into_inner())
    };
    kinds.into_iter().filter_map(written).collect()
}

/// An image as a body and as a form, a question of the Open Inference Protocol, four points, what has no body.
pub(crate) fn requests() -> Vec<Vec<u8>> {
    let mut png = std::io::Cursor::new(Vec::new());
    if image::RgbImage::new(4, 3).write_to(&mut png, image::ImageFormat::Png).is_err() {
        return Vec::new();
    }
    let post = |path: &str, kind: &str, body: &[u8]| {
        let head = format!(
            "POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
            body.len()
        );
        [head.as_bytes(), body].concat()
    };
    let form = [
        &b"--x\r\nContent-Disposition: form-data; name=\"image\"; filename=\"a.png\"\r\n\r\n"[..],
        png.get_ref(),
        b"\r\n--x--\r\n",
    ]
    .concat();
    let infer = br#"{"id":"1","inputs":[{"name":"image","shape":[2,2,3],"datatype":"UINT8","data":[1,2,3,4,5,6,7,8,9,10,11,12]}],"parameters":{"hfov":65}}"#;
    let corners =
        br#"{"width":1280,"height":720,"corners_px":[[500,400],[700,400],[900,600],[300,600]],"sides_m":[3.5,12]}"#;
    let get = |path: &str| format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").into_bytes();
    vec![
        post("/v1/range?hfov=65", "image/png", png.get_ref()),
        post("/v1/range?fx=1000&cx=640", "multipart/form-data; boundary=x", &form),
        post("/v2/models/reader/infer", "application/json", infer),
        post("/v1/calibrate", "application/json", corners),
        get("/openapi.json"),
        get("/metrics"),
    ]
}

pub(crate) fn split() -> Vec<Vec<u8>> {
    vec![b"000000\n000001\n000002\n".to_vec(), b"0\r\n1\r\n".to_vec()]
}

pub(crate) fn class_map() -> Vec<Vec<u8>> {
    vec![b"Bus Truck\nRider Cyclist # on a bicycle\n".to_vec()]
}

pub(crate) fn plates_rows() -> Vec<Vec<u8>> {
    vec![b"0 0.5 1.2 12.5 1.6 0.52 0.11\n".to_vec(), b"0 100.5 120.25 110.5 122.75 0.9 12.25\n".to_vec()]
}

pub(crate) fn scene_config() -> Vec<Vec<u8>> {
    let configs = [SceneConfig::default(), SceneConfig::generic()];
    configs.iter().filter_map(|config| Some(toml::to_string(config).ok()?.into_bytes())).collect()
}

fn toml_of<C: NetworkConfig>(config: &C) -> Vec<u8> {
    toml::to_string(config).unwrap_or_default().into_bytes()
}

pub(crate) fn model_config() -> Vec<Vec<u8>> {
    let mut defaults = Defaults(Vec::new());
    each_method(&mut defaults);
    defaults.0.into_iter().chain(train_config()).collect()
}

struct Defaults(Vec<Vec<u8>>);

impl MethodVisitor for Defaults {
    fn visit<C: Method>(&mut self) {
        self.0.push(toml_of(&C::default()));
    }
}

/// An answer as a line and in an array, a frame of tracks, the manifest of a part, results of an experiment.
pub(crate) fn answers() -> Vec<Vec<u8>> {
    let record = r#"{"image":"a.jpg","width":1242,"height":375,"camera":{"projection":[[721.5,0.0,609.5,44.8],[0.0,721.5,172.8,0.2],[0.0,0.0,1.0,0.003]],"from":"exif"},"detections":[],"model":{"name":"farsight-s","weights_sha256":"00","refiner_sha256":null,"plates_sha256":null}}"#;
    let frame = r#"{"frame":0,"time_s":0.0,"tracks":[{"id":1,"class":"Car","score":0.9,"age":3,"box2d":[600.0,170.0,700.0,230.0],"dimensions_hwl":[1.5,1.6,4.0],"location":[1.0,1.7,20.0],"rotation_y":-1.57,"range_m":20.0,"range_sigma_m":1.0,"range_interval_m":[18.4,21.6],"velocity_mps":[0.0,0.0,-3.0],"velocity_sigma_mps":[0.1,0.1,0.5],"closing_mps":3.0,"closing_sigma_mps":0.5,"ttc_s":6.0,"ttc_interval_s":[5.0,8.0],"coasting":false}]}"#;
    let manifest = r#"{"program_version":"0.1.0","words":["range","a.jpg"],"model":null,"shared":[{"name":"c.txt","sha256":"00"}],"items":1,"items_sha256":"00","parts":1,"part":1,"first_item":0,"inputs":[{"name":"a.jpg","sha256":null}],"done":1,"failed":[],"outputs":[{"path":"a.json","join":"array","bytes":2,"sha256":"00"}]}"#;
    let results = r#"{"cells":[{"arm":"smoke","seed":1,"steps":1856,"ap3d":3.5,"mae":1.5}],"comparisons":[{"arm":"both","against":"smoke","metric":"mae","seeds":2,"difference":-0.1,"interval":[-0.2,0.0],"verdict":"undecided"}]}"#;
    let lines = [record, "\n", record, "\n"].concat();
    let array = ["[", record, ",", record, "]"].concat();
    vec![lines.into_bytes(), array.into_bytes(), [frame, "\n"].concat().into_bytes(), manifest.into(), results.into()]
}

/// The model file of a network with fresh weights, with its hash and as from before there were hashes: mutants of the
/// latter get further.
fn model_file<C: NetworkConfig>(config: C) -> Vec<Vec<u8>> {
    let weights = initial_weights(&config.graph(), 1);
    let Ok(mut model) = Model::new(config, weights) else { return Vec::new() };
    let Ok(json) = serde_json::to_string(&model.config) else { return Vec::new() };
    model.weights.metadata.insert(CONFIG_KEY.to_owned(), json);
    model.weights.metadata.insert(METHOD_KEY.to_owned(), C::METHOD.to_owned());
    let with = written(&model.weights);
    vec![without_hash(&with), with]
}

fn written(weights: &Weights) -> Vec<u8> {
    let mut bytes = Vec::new();
    weights.write_safetensors(&mut bytes).map_or_else(|_| Vec::new(), |()| bytes)
}

/// The same file with another key in the place of the hash's.
fn without_hash(bytes: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let key = FILE_SHA256_KEY.as_bytes();
    if let Some(at) = bytes.windows(key.len()).position(|window| window == key) {
        bytes[at + key.len() - 1] = b'x';
    }
    bytes
}

fn small_smoke() -> SmokeConfig {
    let (norm, neck) = (NormKind::Batch, NeckKind::Plain);
    SmokeConfig {
        input: [96, 64],
        level_channels: Some([16; 6]),
        head_channels: Some(16),
        norm,
        neck,
        ..SmokeConfig::default()
    }
}

/// A small network of each method; the methods without such are left to mutants of the others' headers.
pub(crate) fn detector() -> Vec<Vec<u8>> {
    let mut small = Small(model_file(small_smoke()));
    each_detector(&mut small);
    small.0
}

struct Small(Vec<Vec<u8>>);

impl DetectorVisitor for Small {
    /// The default of the method with every field that makes it large made small, where it still is a network.
    fn visit<C: DetectorMethod>(&mut self) {
        let Ok(serde_json::Value::Object(mut fields)) = serde_json::to_value(C::default()) else { return };
        for (name, small) in SMALL {
            if let (Some(field), Ok(small)) = (fields.get_mut(name), serde_json::from_str(small)) {
                *field = small;
            }
        }
        let Ok(config) = serde_json::from_value::<C>(fields.into()) else { return };
        if config.problem().is_none() {
            self.0.extend(model_file(config).into_iter().filter(|file| file.len() <= mutate::LARGEST));
        }
    }
}

/// Fields of configs, and values that make small networks, JSON.
const SMALL: [(&str, &str); 4] =
    [("input", "[96, 64]"), ("width", "0.125"), ("neck", "\"plain\""), ("norm", "\"batch\"")];

pub(crate) fn refiner() -> Vec<Vec<u8>> {
    model_file(RefinerConfig { side: 16, channels: [1, 2, 1, 2], hidden: 2, ..RefinerConfig::default() })
}

pub(crate) fn plate_reader() -> Vec<Vec<u8>> {
    model_file(PlateReaderConfig { side: 8, channels: [1, 2, 1], hidden: 2, ..PlateReaderConfig::default() })
}

/// The ONNX form of a small network.
pub(crate) fn onnx() -> Vec<Vec<u8>> {
    let config = small_smoke();
    let weights = initial_weights(&config.graph(), 1);
    let file = Model::new(config, weights).ok();
    let file = file.and_then(|model| DetectorFile::from_model(&model, Target::Portable, Path::new("seed")).ok());
    file.into_iter().map(|file| file.onnx.into_bytes()).collect()
}

/// The fixtures of the methods' tests with this ending.
fn fixtures(ending: &str) -> Vec<Vec<u8>> {
    files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../farsight-methods/tests/fixtures"), ending)
}

/// The files in a folder with this ending, by name.
fn files(folder: &Path, ending: &str) -> Vec<Vec<u8>> {
    let mut paths: Vec<PathBuf> =
        fs::read_dir(folder).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    paths.retain(|path| path.extension().is_some_and(|found| found == ending));
    paths.iter().filter_map(|path| fs::read(path).ok()).collect()
}

pub(crate) fn pickle() -> Vec<Vec<u8>> {
    fixtures("pth")
}

pub(crate) fn tflite() -> Vec<Vec<u8>> {
    fixtures("tflite")
}

/// The plans that come with the project.
pub(crate) fn experiment() -> Vec<Vec<u8>> {
    // What has no name is where the arms of a plan start.
    configs("experiments").into_iter().filter(|text| has_line(text, "name = ")).collect()
}

/// The training configs that come with the project.
pub(crate) fn train_config() -> Vec<Vec<u8>> {
    configs("").into_iter().filter(|text| has_line(text, "method = ")).collect()
}

/// Whether a line of the text starts so.
fn has_line(text: &[u8], start: &str) -> bool {
    String::from_utf8_lossy(text).lines().any(|line| line.starts_with(start))
}

/// The TOML files in a folder of `configs`.
fn configs(folder: &str) -> Vec<Vec<u8>> {
    files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs").join(folder), "toml")
}

/// A checkpoint of two tensors.
#[cfg(feature = "train")]
pub(crate) fn checkpoint() -> Vec<Vec<u8>> {
    use farsight_graph::weights::WeightTensor;
    let tensor = WeightTensor { shape: vec![2], values: vec![0.5, -1.5] };
    let mut weights = Weights::default();
    weights.tensors.insert("a".to_owned(), tensor.clone());
    weights.tensors.insert("adam.a".to_owned(), tensor);
    let data = r#"{"program":"0","frames":3,"names":"","images":"","labels":""}"#;
    let progress = r#"{"steps":3,"position":{"epoch":0,"batch":3}}"#;
    for (key, value) in [("farsight.progress", progress), ("farsight.run", "\"the run\""), ("farsight.data", data)] {
        weights.metadata.insert(key.to_owned(), value.to_owned());
    }
    vec![written(&weights)]
}
