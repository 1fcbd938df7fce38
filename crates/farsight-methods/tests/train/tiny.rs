//! A data set of noise with one car a frame, and a network small enough for it.

use std::fs;
use std::path::Path;

use farsight_core::{Box3d, Camera, Dimensions, Label, ObjectClass};
use farsight_data::AugmentationConfig;
use farsight_data::kitti::{Calibration, write_labels};
use farsight_graph::layers::{NeckKind, NormKind};
use farsight_methods::smoke::SmokeConfig;
use farsight_methods::smoke::targets::Targets;
use farsight_methods::smoke::train::{SmokeRun, SmokeTaskConfig};
use farsight_train::config::{DataConfig, TrainConfig, ValidateConfig};
use farsight_train::metrics::StepSummary;
use farsight_train::training::{Callback, Start};
use image::{Rgb, RgbImage};

const IMAGE_SIZE: [u32; 2] = [200, 64];

/// Keeps the losses, shows nothing.
#[derive(Default)]
pub(crate) struct Silent {
    pub(crate) losses: Vec<f64>,
}

impl Callback for Silent {
    fn on_start(&mut self, _: Start) {}

    fn validate(&mut self, _: u64, _: &Path, _: &ValidateConfig) -> Result<Vec<(String, f64)>, String> {
        Ok(Vec::new())
    }

    fn on_step(&mut self, record: &StepSummary) {
        self.losses.push(record.loss);
    }
}

pub(crate) fn camera() -> Camera {
    Camera::from_intrinsics(110.0, 110.0, 100.0, 28.0).unwrap()
}

pub(crate) fn car(frame: usize) -> Label {
    let box3d = Box3d {
        dimensions: Dimensions { height: 1.5, width: 1.6, length: 3.9 },
        location: [frame as f64 - 2.0, 1.6, 8.0 + 3.0 * frame as f64],
        yaw: 0.3 * frame as f64 - 1.0,
    };
    let box2d = box3d.projected(&camera()).unwrap().clamped(199.0, 63.0);
    Label { class: ObjectClass::Car, truncation: 0.0, occlusion: 0, alpha: box3d.alpha(), box2d, box3d }
}

/// A folder in KITTI's layout with so many frames.
pub(crate) fn data_set(frames: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    for name in ["training/image_2", "training/label_2", "training/calib", "ImageSets"] {
        fs::create_dir_all(root.join(name)).unwrap();
    }
    let ids: Vec<String> = (0..frames).map(|i| format!("{i:06}")).collect();
    for (i, id) in ids.iter().enumerate() {
        let [width, height] = IMAGE_SIZE;
        let noise = |x: u32, y: u32| ((x * 7919 + y * 104_729 + i as u32 * 1_299_709) % 251) as u8;
        let image = RgbImage::from_fn(width, height, |x, y| Rgb([noise(x, y), noise(y, x), noise(x + y, x)]));
        image.save(root.join(format!("training/image_2/{id}.png"))).unwrap();
        write_labels(&root.join(format!("training/label_2/{id}.txt")), &[car(i)]).unwrap();
        Calibration::from_camera(&camera()).write(&root.join(format!("training/calib/{id}.txt"))).unwrap();
    }
    fs::write(root.join("ImageSets/train.txt"), ids.join("\n") + "\n").unwrap();
    folder
}

/// A run of a few steps on the data set in `root`.
pub(crate) fn run_config(root: &Path) -> SmokeRun {
    SmokeRun {
        method: "smoke".to_owned(),
        model: SmokeConfig {
            input: [192, 64],
            level_channels: Some([16; 6]),
            head_channels: Some(16),
            norm: NormKind::Batch,
            neck: NeckKind::Plain,
            ..SmokeConfig::default()
        },
        data: DataConfig { root: Some(root.to_path_buf()), ..DataConfig::default() },
        augmentation: AugmentationConfig::default(),
        train: TrainConfig {
            epochs: 3,
            batch_size: 2,
            checkpoint_steps: 1,
            log_steps: 1,
            threads: 1,
            ..TrainConfig::default()
        },
        task: SmokeTaskConfig::default(),
        validate: None,
    }
}

/// Targets of one frame under the model of [`run_config`].
pub(crate) fn targets(model: &SmokeConfig) -> Targets {
    model.target_rules().targets(&[car(1)], &camera(), model.input)
}
