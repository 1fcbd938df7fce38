//! Rendered sequences with what a model found in them, and tracks of that.

use std::path::Path;

use farsight::json::ImageRecord;
use farsight::video::EgoFile;
use farsight::{Box2d, Box3d, Camera, Detection, EgoMotion, Frame, ObjectClass, Track, Tracker, TrackerOptions};
use farsight_core::Dimensions;
use farsight_eval::tracks::{GroundTruthFrame, JudgedSequence, PredictedFrame, PredictedTrack, judge, read_sequence};

/// One sequence with its detections.
#[derive(Clone)]
pub(crate) struct Sequence {
    pub(crate) name: String,
    pub(crate) truth: Vec<GroundTruthFrame>,
    pub(crate) camera: Camera,
    pub(crate) image_size: [usize; 2],
    pub(crate) detections: Vec<Vec<Detection>>,
    /// How the camera moves, where that is known.
    pub(crate) ego: Option<EgoFile>,
    pub(crate) fps: f64,
}

impl Sequence {
    /// How the camera moves in a frame.
    pub(crate) fn motion(&self, number: usize) -> Option<EgoMotion> {
        self.ego.as_ref()?.motion(number as u64, number as f64 / self.fps)
    }
}

/// From this score on a detection counts where it is alone.
pub(crate) const BIRTH: f64 = 0.5;

/// The tracker's, for detections of scores from 0.2 on.
pub(crate) fn options() -> TrackerOptions {
    TrackerOptions { birth_score: BIRTH, low_score: 0.2, ..TrackerOptions::default() }
}

/// The sequences of a folder that were looked at.
pub(crate) fn sequences(data: &Path, folder: &Path) -> std::io::Result<Vec<Sequence>> {
    let plan: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(data.join("synth.json"))?).unwrap();
    let fps = plan["source"]["fps"].as_f64().unwrap();
    let root = data.join("training");
    let mut names: Vec<String> = std::fs::read_dir(root.join("label_02"))?
        .map(|entry| Path::new(&entry.unwrap().file_name()).file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names.retain(|name| folder.join(format!("{name}.json")).is_file());
    let sequence = |name: &String| {
        let velocities = root.join(format!("velocity_02/{name}.csv"));
        let truth = read_sequence(&root.join(format!("label_02/{name}.txt")), Some(&velocities)).unwrap();
        let answers = std::fs::read_to_string(folder.join(format!("{name}.json")))?;
        let records: Vec<ImageRecord> = serde_json::from_str(&answers).unwrap();
        let camera = Camera { projection: records[0].camera.as_ref().unwrap().projection };
        let image_size = [records[0].width, records[0].height].map(|side| side as usize);
        let detections = records.iter().map(detections).collect();
        let ego = Some(EgoFile::read(&root.join(format!("oxts/{name}.txt"))).unwrap());
        Ok(Sequence { name: name.clone(), truth, camera, image_size, detections, ego, fps })
    };
    names.iter().map(sequence).collect()
}

fn detections(record: &ImageRecord) -> Vec<Detection> {
    let detection = |one: &farsight::json::DetectionRecord| {
        let [x1, y1, x2, y2] = one.box2d;
        let [height, width, length] = one.dimensions_hwl;
        let box3d =
            Box3d { dimensions: Dimensions { height, width, length }, location: one.location, yaw: one.rotation_y };
        Detection {
            class: ObjectClass::from_name(&one.class),
            score: one.score,
            box2d: Box2d::new(x1, y1, x2, y2),
            box3d,
            range_sigma_m: one.range_sigma_m,
        }
    };
    let is_whole = |one: &Detection| one.box2d.width() > 0.0 && one.box2d.height() > 0.0 && one.box3d.depth_m() > 0.0;
    record.detections.iter().map(detection).filter(is_whole).collect()
}

pub(crate) fn judged(sequence: &Sequence, told: &[Option<PredictedFrame>]) -> JudgedSequence {
    judge(&sequence.name, &ObjectClass::Car, &sequence.truth, told)
}

/// The tracks of a sequence's next frame.
pub(crate) fn update(tracker: &mut Tracker, sequence: &Sequence, number: usize) -> Vec<Track> {
    let time_s = number as f64 / sequence.fps;
    let (camera, image_size) = (&sequence.camera, sequence.image_size);
    let (detections, ego) = (&sequence.detections[number], sequence.motion(number));
    tracker.update(&Frame { time_s, image_size, camera, detections, ego, looks_cut: false }).unwrap()
}

/// Tracks of a frame as they are judged.
pub(crate) fn told(sequence: &Sequence, number: usize, tracks: &[Track]) -> PredictedFrame {
    let time_s = number as f64 / sequence.fps;
    let ego = sequence.motion(number);
    let told = |track: &Track| PredictedTrack {
        id: track.id,
        class: track.class.clone(),
        box2d: track.box2d,
        box3d: track.box3d,
        range_sigma_m: Some(track.range_sigma_m),
        closing_mps: track.closing.map(|closing| [closing.mps, closing.sigma_mps]),
        ttc_s: track.closing.and_then(|closing| closing.ttc_s),
        ttc_interval_s: track.closing.and_then(|closing| closing.ttc_interval_s),
        speed_mps: ego.and_then(|ego| track.speed_mps(&ego)),
    };
    PredictedFrame { time_s, tracks: tracks.iter().map(told).collect() }
}
