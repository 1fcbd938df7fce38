//! MCAP files.

use std::collections::BTreeMap;
use std::io::{Seek, Write};

use foxglove::Encode;
use foxglove::messages::{
    CameraCalibration, Color, CompressedImage, CubePrimitive, Duration, FrameTransform, KeyValuePair, Pose, Quaternion,
    SceneEntity, SceneEntityDeletion, SceneUpdate, TextPrimitive, Timestamp, Vector3, scene_entity_deletion,
};
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

use crate::boxes::Placed;
use crate::detection3d;
use crate::error::RecordingError;
use crate::geometry::{OPTICAL_FROM_LINK, Parts};
use crate::recorded_frame::{RecordedFrame, RecordedObject};

/// Letters of labels, metres high.
const FONT_M: f64 = 0.6;

/// Blue, seen through.
const COLOR: Color = Color { r: 0.16, g: 0.5, b: 0.9, a: 0.4 };

const WHITE: Color = Color { r: 1.0, g: 1.0, b: 1.0, a: 1.0 };

/// Frames of reference, as the crate's documentation says.
const LINK: &str = "camera_link";
const CAMERA: &str = "camera";
const OPTICAL: &str = "camera_optical";

/// A recording for Foxglove (protobuf: image, calibration, transforms, boxes) and for ROS 2
/// (`vision_msgs/Detection3DArray`).
///
/// Topics are `/camera/image`, `/camera/calibration`, `/tf`, `/scene` and `/detections`. Chunks are not compressed, as
/// images are already.
pub struct McapRecording<W: Write + Seek> {
    writer: Writer<W>,
    image: Topic,
    calibration: Topic,
    transform: Topic,
    scene: Topic,
    detections: u16,
    messages: u32,
}

/// A channel and its name.
#[derive(Clone, Copy)]
struct Topic {
    name: &'static str,
    channel: u16,
}

impl<W: Write + Seek> McapRecording<W> {
    /// Begins a recording.
    ///
    /// # Errors
    /// When `out` cannot be written to.
    pub fn new(out: W) -> Result<Self, RecordingError> {
        let options = WriteOptions::new().compression(None).library("farsight");
        let mut writer = options.create(out)?;
        let detections = {
            let schema = writer.add_schema(detection3d::NAME, "ros2msg", detection3d::SCHEMA.as_bytes())?;
            writer.add_channel(schema, "/detections", "cdr", &BTreeMap::new())?
        };
        Ok(Self {
            image: topic::<CompressedImage, W>(&mut writer, "/camera/image")?,
            calibration: topic::<CameraCalibration, W>(&mut writer, "/camera/calibration")?,
            transform: topic::<FrameTransform, W>(&mut writer, "/tf")?,
            scene: topic::<SceneUpdate, W>(&mut writer, "/scene")?,
            detections,
            writer,
            messages: 0,
        })
    }

    /// Adds an image and what was found in it.
    ///
    /// # Errors
    /// When it cannot be written, or its time is negative.
    pub fn add(&mut self, frame: &RecordedFrame<'_>) -> Result<(), RecordingError> {
        let time_ns = (frame.time_s * 1e9).round();
        if !(0.0..=f64::from(u32::MAX) * 1e9).contains(&time_ns) {
            return Err(RecordingError::Time(frame.time_s));
        }
        let time_ns = time_ns as u64;
        let stamp = ((time_ns / 1_000_000_000) as u32, (time_ns % 1_000_000_000) as u32);
        let timestamp = Some(Timestamp::new(stamp.0, stamp.1));
        let parts = Parts::of(frame.camera);
        for transform in transforms(timestamp, &parts) {
            self.log(self.transform, time_ns, &transform)?;
        }
        self.log(self.calibration, time_ns, &calibration(timestamp, frame, &parts))?;
        let data = frame.jpeg()?;
        let frame_id = OPTICAL.to_owned();
        self.log(
            self.image,
            time_ns,
            &CompressedImage { timestamp, frame_id, data: data.into(), format: "jpeg".to_owned() },
        )?;
        self.log(self.scene, time_ns, &scene(timestamp, frame.found))?;
        self.write(self.detections, time_ns, &detection3d::message(stamp, CAMERA, frame.found))
    }

    /// Ends the recording, and hands the writer back.
    ///
    /// # Errors
    /// When its index cannot be written.
    pub fn finish(mut self) -> Result<W, RecordingError> {
        self.writer.finish()?;
        Ok(self.writer.into_inner())
    }

    fn log(&mut self, topic: Topic, time_ns: u64, message: &impl Encode) -> Result<(), RecordingError> {
        let mut bytes = Vec::new();
        message
            .encode(&mut bytes)
            .map_err(|error| RecordingError::Message { topic: topic.name, problem: error.to_string() })?;
        self.write(topic.channel, time_ns, &bytes)
    }

    fn write(&mut self, channel_id: u16, time_ns: u64, bytes: &[u8]) -> Result<(), RecordingError> {
        let header = MessageHeader { channel_id, sequence: self.messages, log_time: time_ns, publish_time: time_ns };
        self.messages += 1;
        Ok(self.writer.write_to_known_channel(&header, bytes)?)
    }
}

fn topic<T: Encode, W: Write + Seek>(writer: &mut Writer<W>, name: &'static str) -> Result<Topic, RecordingError> {
    let problem = || RecordingError::Message { topic: name, problem: "its type has no schema".to_owned() };
    let schema = T::get_schema().ok_or_else(problem)?;
    let schema = writer.add_schema(&schema.name, &schema.encoding, &schema.data)?;
    let channel = writer.add_channel(schema, name, &T::get_message_encoding(), &BTreeMap::new())?;
    Ok(Topic { name, channel })
}

fn transforms(timestamp: Option<Timestamp>, parts: &Parts) -> [FrameTransform; 2] {
    let transform = |parent: &str, child: &str, translation_m: [f64; 3], rotation: [f64; 4]| FrameTransform {
        timestamp,
        parent_frame_id: parent.to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(vector(translation_m)),
        rotation: Some(quaternion(rotation)),
    };
    [transform(LINK, CAMERA, [0.0; 3], OPTICAL_FROM_LINK), transform(CAMERA, OPTICAL, parts.origin_m, parts.rotation)]
}

fn calibration(timestamp: Option<Timestamp>, frame: &RecordedFrame<'_>, parts: &Parts) -> CameraCalibration {
    let k = parts.k;
    let with_column = k.chunks(3).flat_map(|row| [row[0], row[1], row[2], 0.0]).collect();
    CameraCalibration {
        timestamp,
        frame_id: OPTICAL.to_owned(),
        width: frame.image.width(),
        height: frame.image.height(),
        // Images are taken for those of an ideal camera.
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: k.to_vec(),
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: with_column,
    }
}

/// All boxes of an image; those of the one before go.
fn scene(timestamp: Option<Timestamp>, found: &[RecordedObject]) -> SceneUpdate {
    let all = scene_entity_deletion::Type::All as i32;
    let deletion = SceneEntityDeletion { timestamp, r#type: all, id: String::new() };
    SceneUpdate { deletions: vec![deletion], entities: found.iter().map(|one| entity(timestamp, one)).collect() }
}

fn entity(timestamp: Option<Timestamp>, found: &RecordedObject) -> SceneEntity {
    let RecordedObject { id, detection, label } = found;
    let placed = Placed::of(&detection.box3d);
    let [x, y, z] = placed.center_m;
    let orientation = Some(quaternion(placed.rotation));
    let pose = |position: [f64; 3]| Some(Pose { position: Some(vector(position)), orientation });
    let text_pose = pose([x, y - placed.size_m[2] / 2.0 - FONT_M, z]);
    let entry = |key: &str, value: String| KeyValuePair { key: key.to_owned(), value };
    let sigma = detection.range_sigma_m.map(|sigma_m| entry("range_sigma_m", sigma_m.to_string()));
    let metadata = [
        entry("class", detection.class.to_string()),
        entry("score", detection.score.to_string()),
        entry("range_m", detection.box3d.depth_m().to_string()),
    ];
    SceneEntity {
        timestamp,
        frame_id: CAMERA.to_owned(),
        id: id.clone(),
        // Until the next image.
        lifetime: Some(Duration::new(0, 0)),
        metadata: metadata.into_iter().chain(sigma).collect(),
        cubes: vec![CubePrimitive {
            pose: pose(placed.center_m),
            size: Some(vector(placed.size_m)),
            color: Some(COLOR),
        }],
        texts: vec![TextPrimitive {
            pose: text_pose,
            billboard: true,
            font_size: FONT_M,
            scale_invariant: false,
            color: Some(WHITE),
            text: label.clone(),
        }],
        ..SceneEntity::default()
    }
}

fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

fn quaternion([x, y, z, w]: [f64; 4]) -> Quaternion {
    Quaternion { x, y, z, w }
}
