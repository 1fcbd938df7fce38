//! What comes with the program: a trained model and scenes to try it on. Both are in the executable, so that it works
//! wherever it is copied to.

use std::fs;
use std::path::{Path, PathBuf};

use farsight_files::{WriteError, write_quickly};
use farsight_graph::model::ModelError;
use farsight_methods::camera_estimator::CameraEstimatorModel;
use farsight_methods::plate_reader::PlateReaderModel;
use farsight_methods::refiner::RefinerModel;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::ssd::SsdModel;

/// What comes with the library: a detector, and a refiner that is fitted to it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Family {
    /// An SSD that learnt from photographs, and a refiner that learnt from rendered scenes of the world: what is used
    /// unless another is named. The card is `models/farsight-w.md`.
    #[default]
    FarsightW,
    /// SMOKE that learnt from rendered scenes of one city, and its refiner. The card is `models/farsight-s.md`.
    FarsightS,
    /// A small SMOKE for small computers, on a backbone that has seen photographs, and the refiner of farsight-s fitted
    /// to it. The card is `models/farsight-n.md`.
    FarsightN,
}

impl Family {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::FarsightW, Self::FarsightS, Self::FarsightN];

    /// The name of its detector, which is its word in options.
    pub const fn name(self) -> &'static str {
        match self {
            Self::FarsightW => "farsight-w",
            Self::FarsightS => "farsight-s",
            Self::FarsightN => "farsight-n",
        }
    }

    /// SHA-256 of the weights of its detector. It is kept, because computing it takes longer than looking at an image.
    pub const fn weights_sha256(self) -> &'static str {
        match self {
            Self::FarsightW => farsight_weights_w::DETECTOR_SHA256,
            Self::FarsightS => farsight_weights_s::DETECTOR_SHA256,
            Self::FarsightN => farsight_weights_n::DETECTOR_SHA256,
        }
    }
}

const SSD: &[u8] = farsight_weights_w::DETECTOR;

const SMOKE: &[u8] = farsight_weights_s::DETECTOR;

const SMALL: &[u8] = farsight_weights_n::DETECTOR;

/// Name of the refiner; its page is `docs/refiner.md`.
pub const REFINER_NAME: &str = "farsight-refiner";

const REFINER: &[u8] = farsight_weights_stages::W_REFINER;
const SMOKE_REFINER: &[u8] = farsight_weights_stages::S_REFINER;
const SMALL_REFINER: &[u8] = farsight_weights_n::REFINER;

/// Name of the plate reader; its page is `docs/plates.md`.
pub const PLATES_NAME: &str = "farsight-plates";

const PLATES: &[u8] = farsight_weights_stages::PLATES;

/// Name of the camera estimator; its page is `docs/cameras.md`.
pub const CAMERA_NAME: &str = "farsight-camera";

const CAMERA: &[u8] = farsight_weights_camera::ESTIMATOR;

/// One scene's name, image and calibration.
macro_rules! scene {
    ($id:literal) => {
        (
            $id,
            include_bytes!(concat!("../assets/scenes/image_2/", $id, ".jpg")).as_slice(),
            include_str!(concat!("../assets/scenes/calib/", $id, ".txt")),
        )
    };
}
/// Images and calibrations, rendered by Farsight (`assets/scenes/README.md`).
const SCENES: [(&str, &[u8], &str); 4] = [scene!("000000"), scene!("000001"), scene!("000002"), scene!("000003")];

/// The SSD that comes with the library: boxes of a network that has seen photographs.
///
/// # Errors
/// Never of a library that was built whole.
pub fn ssd() -> Result<SsdModel, ModelError> {
    SsdModel::from_safetensors(SSD, Path::new(Family::FarsightW.name()))
}

/// The SMOKE that comes with the library: trained on rendered scenes alone, and the start of a fine-tuning.
///
/// # Errors
/// Never of a library that was built whole.
pub fn smoke() -> Result<SmokeModel, ModelError> {
    SmokeModel::from_safetensors(SMOKE, Path::new(Family::FarsightS.name()))
}

/// The small SMOKE that comes with the library.
///
/// # Errors
/// Never of a library that was built whole.
pub fn small_smoke() -> Result<SmokeModel, ModelError> {
    SmokeModel::from_safetensors(SMALL, Path::new(Family::FarsightN.name()))
}

/// The family of a detector with these weights (SHA-256), if it comes with the library.
pub fn family_of(sha256: &str) -> Option<Family> {
    Family::ALL.into_iter().find(|family| family.weights_sha256() == sha256)
}

/// The refiner of a family.
///
/// # Errors
/// Never of a library that was built whole.
pub fn refiner(family: Family) -> Result<RefinerModel, ModelError> {
    let bytes = match family {
        Family::FarsightW => REFINER,
        Family::FarsightS => SMOKE_REFINER,
        Family::FarsightN => SMALL_REFINER,
    };
    RefinerModel::from_safetensors(bytes, Path::new(REFINER_NAME))
}

/// The plate reader that comes with the program.
///
/// # Errors
/// Never of a library that was built whole.
pub fn plates() -> Result<PlateReaderModel, ModelError> {
    PlateReaderModel::from_safetensors(PLATES, Path::new(PLATES_NAME))
}

/// The camera estimator that comes with the library.
///
/// # Errors
/// Never of a library that was built whole.
pub fn camera_estimator() -> Result<CameraEstimatorModel, ModelError> {
    CameraEstimatorModel::from_safetensors(CAMERA, Path::new(CAMERA_NAME))
}

/// Writes the scenes to `folder` in KITTI's layout and returns the folder of the images.
///
/// # Errors
/// When a folder cannot be made or a file cannot be written.
pub fn write_scenes(folder: &Path) -> Result<PathBuf, WriteError> {
    let [images, calibrations] = ["image_2", "calib"].map(|name| folder.join(name));
    for made in [&images, &calibrations] {
        fs::create_dir_all(made).map_err(|source| WriteError { path: made.clone(), step: "make it", source })?;
    }
    for (id, image, calibration) in SCENES {
        write_quickly(&images.join(format!("{id}.jpg")), |file| file.write_all(image))?;
        write_quickly(&calibrations.join(format!("{id}.txt")), |file| file.write_all(calibration.as_bytes()))?;
    }
    Ok(images)
}
