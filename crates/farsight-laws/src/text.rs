//! Laws of files of text: what is accepted says the same when it is printed and read again, and errors name the file.

// They are the program's, not the library's.
#[path = "../../farsight/src/untrained.rs"]
#[allow(dead_code, reason = "the program uses the rest")]
pub(crate) mod untrained;
#[path = "../../farsight/src/commands/synth/world.rs"]
pub(crate) mod world;

use std::fmt::Debug;
use std::path::{Path, PathBuf};

use farsight::video::EgoFile;
use farsight_core::ObjectClass;
use farsight_data::annotations::{Annotations, FileFormat, Plates};
use farsight_data::kitti::split::split_from_text;
use farsight_eval::tracks::{MAX_FRAMES, judge, read_sequence};
use farsight_methods::each_method;
use farsight_methods::method::{Method, MethodVisitor};
use farsight_synth::SceneConfig;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The bytes as a file called `name` in a folder of its own, as users have it.
pub(crate) fn as_file(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder for the file");
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("a file for the bytes");
    (folder, path)
}

/// Whether it was read; the error must name the file.
pub(crate) fn accepted<T, E: std::fmt::Display>(read: Result<T, E>, path: &Path) -> Option<T> {
    match read {
        Ok(read) => Some(read),
        Err(error) => {
            let (told, name) = (format!("{error:#}"), path.file_name().unwrap_or_default().to_string_lossy());
            assert!(told.contains(&*name), "no file in: {told}");
            None
        }
    }
}

/// A list of frames: each once, and each a good name of a file.
pub(crate) fn split(bytes: &[u8]) -> bool {
    let path = Path::new("input");
    let Some(ids) = accepted(split_from_text(&String::from_utf8_lossy(bytes), path), path) else { return false };
    let again = split_from_text(&(ids.join("\n") + "\n"), path).expect("what was accepted");
    assert_eq!(again, ids);
    assert!(ids.iter().all(|id| !id.contains('/') && id != ".." && !id.is_empty()), "{ids:?}");
    true
}

/// A map of class names, through a file as users have it.
pub(crate) fn class_map(bytes: &[u8]) -> bool {
    let (_folder, path) = as_file("classes.txt", bytes);
    let Some(map) = accepted(farsight_data::ClassMap::read(&path), &path) else { return false };
    let text = map.to_text();
    std::fs::write(&path, &text).expect("a file for the text");
    let again = farsight_data::ClassMap::read(&path).expect("what was printed");
    assert_eq!((&again, again.to_text()), (&map, text));
    drop(map.class("Car"));
    true
}

/// Number plates beside a label file, through a file as users have it.
pub(crate) fn plates(bytes: &[u8]) -> bool {
    let (folder, format) = (tempfile::tempdir().expect("a folder for the file"), FileFormat::of::<Plates>());
    let path = format.path(folder.path(), "input");
    std::fs::create_dir_all(path.parent().expect("a folder of its kind")).expect("a folder for the file");
    std::fs::write(&path, bytes).expect("a file for the bytes");
    let read = || {
        let mut annotations = Annotations::default();
        format.read(folder.path(), "input", &mut annotations).map(|()| annotations)
    };
    let Some(plates) = accepted(read(), &path) else { return false };
    format.write(folder.path(), "input", &plates).expect("a file for the text");
    let text = std::fs::read(&path).expect("what was printed");
    format.write(folder.path(), "input", &read().expect("what was printed")).expect("a file for the text");
    assert_eq!(std::fs::read(&path).expect("what was printed again"), text);
    true
}

/// Labels of KITTI's tracking benchmark, or their velocities, through files as users have them.
pub(crate) fn track_labels(bytes: &[u8]) -> bool {
    let (folder, path) = as_file("input.txt", bytes);
    let labels = accepted(read_sequence(&path, None), &path);
    if let Some(frames) = &labels {
        assert!(frames.len() <= MAX_FRAMES);
        let judged = judge("input", &ObjectClass::Car, frames, &[]);
        assert_eq!((judged.image.len(), judged.space.len()), (frames.len(), frames.len()));
    }
    let good = folder.path().join("labels.txt");
    std::fs::write(&good, "0 1 Car 0 0 -1.5 600 170 700 230 1.5 1.6 4.0 1.0 1.7 20.0 -1.57\n")
        .expect("a file of labels");
    let velocities = accepted(read_sequence(&good, Some(&path)), &path);
    if let Some([frame]) = velocities.as_deref() {
        assert!(frame.tracks[0].velocity_mps.is_none_or(|mps| mps.iter().all(|value| value.is_finite())));
    }
    labels.is_some() || velocities.is_some()
}

/// How a camera moves, through a file as users have it.
pub(crate) fn ego(bytes: &[u8]) -> bool {
    let (_folder, path) = as_file("input.txt", bytes);
    let Some(ego) = accepted(EgoFile::read(&path), &path) else { return false };
    for frame in [0, 1, 2, 1000, u64::MAX] {
        for time_s in [0.0, 0.1, 1e9] {
            let _ = ego.motion(frame, time_s);
        }
    }
    match &ego {
        EgoFile::Frames(rows) => assert!(rows.iter().flatten().all(|value| value.is_finite())),
        EgoFile::Times(rows) => {
            assert!(rows.iter().flatten().all(|value| value.is_finite()));
            assert!(rows.is_sorted_by(|a, b| a[0] < b[0]));
        }
        EgoFile::Poses(rows) => assert!(rows.iter().flatten().all(|value| value.is_finite())),
        _ => {}
    }
    true
}

/// What scenes look like, through a file as users have it.
pub(crate) fn scene_config(bytes: &[u8]) -> bool {
    drop(toml_round_trip::<SceneConfig>(bytes));
    let (_folder, path) = as_file("input.toml", bytes);
    let Some(config) = accepted(world::read_config(&path), &path) else { return false };
    // A config that is accepted can be drawn from.
    drop(farsight_synth::generate_scene(&config, 1, 0));
    true
}

/// What a network is made of, of every method.
pub(crate) fn model_config(bytes: &[u8]) -> bool {
    let mut configs = Configs { bytes, accepted: false };
    each_method(&mut configs);
    // As users have it: a table in the config of a training.
    let (_folder, path) = as_file("input.toml", bytes);
    accepted(untrained::read(&path), &path).is_some() || configs.accepted
}

struct Configs<'a> {
    bytes: &'a [u8],
    /// Whether it is the config of any method.
    accepted: bool,
}

impl MethodVisitor for Configs<'_> {
    fn visit<C: Method>(&mut self) {
        let Some(config) = toml_round_trip::<C>(self.bytes) else { return };
        if config.problem().is_none() {
            let graph = config.graph();
            assert!(C::OUTPUTS.iter().all(|output| graph.tap(output).is_some()));
            assert!(config.counted_input().iter().all(|side| *side > 0) && !config.facts().is_empty());
            self.accepted = true;
        }
    }
}

fn toml_round_trip<T: DeserializeOwned + Serialize + PartialEq + Debug>(bytes: &[u8]) -> Option<T> {
    let config: T = toml::from_str(std::str::from_utf8(bytes).ok()?).ok()?;
    // What is no number equals nothing, and TOML has no integers beyond 63 bits.
    let text = toml::to_string(&config).ok()?;
    let again: T = toml::from_str(&text).expect("what was printed");
    assert_eq!(toml::to_string(&again).expect("what was printed once"), text);
    Some(config)
}
