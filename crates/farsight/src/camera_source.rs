//! Where the camera of an image comes from.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use farsight_core::Camera;
use farsight_data::kitti::Calibration;

use crate::names::stem;

/// Horizontal field of view of KITTI's camera, degrees, for images whose camera does not matter.
pub(crate) const KITTI_HFOV_DEG: f64 = 81.4;

/// Cameras that have all their numbers already. `requires` alone lets them pass, as clap asks for nothing that conflicts with what is there.
const NO_INTRINSICS: [&str; 2] = ["calib", "hfov"];

/// The camera options, of which one is needed for images that do not lie in KITTI's layout.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Camera (images in KITTI's layout bring their own)")]
pub(crate) struct CameraArgs {
    /// Calibration in KITTI's format (its row P2), or a folder with one for each image (IMAGE.txt)
    #[arg(long, value_name = "FILE", conflicts_with_all = ["fx", "hfov"])]
    pub(crate) calib: Option<PathBuf>,
    /// Horizontal focal length, pixels
    #[arg(long, value_name = "F", conflicts_with = "hfov", value_parser = focal, allow_negative_numbers = true)]
    pub(crate) fx: Option<f64>,
    /// Vertical focal length, pixels [default: the horizontal one]
    #[arg(long, value_name = "F", requires = "fx", conflicts_with_all = NO_INTRINSICS, value_parser = focal, allow_negative_numbers = true)]
    pub(crate) fy: Option<f64>,
    /// Column of the principal point, pixels [default: the middle of the image]
    #[arg(long, value_name = "X", requires = "fx", conflicts_with_all = NO_INTRINSICS, value_parser = finite, allow_negative_numbers = true)]
    pub(crate) cx: Option<f64>,
    /// Row of the principal point, pixels [default: the middle of the image]
    #[arg(long, value_name = "Y", requires = "fx", conflicts_with_all = NO_INTRINSICS, value_parser = finite, allow_negative_numbers = true)]
    pub(crate) cy: Option<f64>,
    /// Horizontal field of view of the whole image, degrees
    #[arg(long, value_name = "DEG", value_parser = field_of_view, allow_negative_numbers = true)]
    pub(crate) hfov: Option<f64>,
}

/// What to do when there is no camera.
const HINT: &str = "give one of --calib FILE, --fx PIXELS or --hfov DEGREES";

fn number(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| "expected a number".to_owned())
}

fn finite(text: &str) -> Result<f64, String> {
    number(text)
        .and_then(|value| if value.is_finite() { Ok(value) } else { Err("expected a finite number".to_owned()) })
}

fn focal(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err("expected a positive number of pixels".to_owned()) }
}

fn field_of_view(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    Camera::from_hfov(value, 1, 1).map(|_| value).map_err(|error| error.to_string())
}

/// Knows the camera of every image.
#[derive(Debug)]
pub(crate) enum CameraSource {
    /// The same projection for all.
    Same(Camera),
    /// A calibration file for each image, in this folder.
    Folder(PathBuf),
    /// A calibration file for each image, in the folder `calib` beside the image's folder.
    Kitti,
    /// Focal lengths and principal point; what is missing comes from the size of the image.
    Intrinsics { fx: f64, fy: f64, cx: Option<f64>, cy: Option<f64> },
    /// Horizontal field of view, degrees.
    FieldOfView(f64),
}

impl CameraSource {
    /// The source that the options name, or KITTI's layout when there are none and at least one of `images` lies in it.
    pub(crate) fn new(args: &CameraArgs, images: &[PathBuf]) -> Result<Self> {
        if let Some(calib) = &args.calib {
            return Ok(if calib.is_dir() { Self::Folder(calib.clone()) } else { Self::Same(read(calib)?) });
        }
        if let Some(fx) = args.fx {
            return Ok(Self::Intrinsics { fx, fy: args.fy.unwrap_or(fx), cx: args.cx, cy: args.cy });
        }
        if let Some(degrees) = args.hfov {
            return Ok(Self::FieldOfView(degrees));
        }
        if let Some(cameras) = Self::of_layout(images) {
            return Ok(cameras);
        }
        if let Some((image, calibration)) = images.iter().find_map(|image| Some((image, in_layout(image)?))) {
            bail!("{}", missing(image, &calibration));
        }
        bail!("no camera: distances need its focal length; {HINT} (images in KITTI's layout bring their own)")
    }

    /// KITTI's layout, when at least one of `images` lies in it.
    pub(crate) fn of_layout(images: &[PathBuf]) -> Option<Self> {
        images.iter().any(|image| kitti_calibration(image).is_some()).then_some(Self::Kitti)
    }

    /// The camera of the image at `path`, which has `size` (width and height, pixels).
    pub(crate) fn camera(&self, path: &Path, [width, height]: [usize; 2]) -> Result<Camera> {
        match self {
            Self::Same(camera) => Ok(*camera),
            Self::Folder(folder) => read(&folder.join(format!("{}.txt", stem(path)))),
            Self::Kitti => {
                let file = in_layout(path)
                    .with_context(|| format!("{}: no camera, and no calibration beside it; {HINT}", path.display()))?;
                ensure!(file.is_file(), missing(path, &file));
                read(&file)
            }
            Self::Intrinsics { fx, fy, cx, cy } => {
                let middle = |side: usize| (side as f64 - 1.0) / 2.0;
                let (cx, cy) = (cx.unwrap_or_else(|| middle(width)), cy.unwrap_or_else(|| middle(height)));
                Ok(Camera::from_intrinsics(*fx, *fy, cx, cy)?)
            }
            Self::FieldOfView(degrees) => Ok(Camera::from_hfov(*degrees, width, height)?),
        }
    }
}

fn read(path: &Path) -> Result<Camera> {
    Ok(Calibration::read(path)?.camera())
}

fn missing(image: &Path, calibration: &Path) -> String {
    format!("{}: no camera; expected its calibration {}, or {HINT}", image.display(), calibration.display())
}

/// The calibration of an image in KITTI's layout, when it is there.
fn kitti_calibration(image: &Path) -> Option<PathBuf> {
    in_layout(image).filter(|file| file.is_file())
}

/// `calib/ID.txt` beside the folder `image_2` of `image`, when both folders are there.
fn in_layout(image: &Path) -> Option<PathBuf> {
    // A relative path such as `000001.png` has its folder's name only after this.
    let image = image.canonicalize().ok()?;
    let folder = image.parent().filter(|folder| folder.ends_with("image_2"))?;
    let calibrations = Some(folder.with_file_name("calib")).filter(|folder| folder.is_dir())?;
    Some(calibrations.join(format!("{}.txt", stem(&image))))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::{CameraArgs, CameraSource};

    const CALIBRATION: &str = "P2: 700 0 600 45 0 700 170 0.2 0 0 1 0.003\n";

    fn source(args: &CameraArgs, images: &[&Path]) -> anyhow::Result<CameraSource> {
        let images: Vec<_> = images.iter().map(|path| path.to_path_buf()).collect();
        CameraSource::new(args, &images)
    }

    #[test]
    fn kitti_layout_is_found() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["image_2", "calib"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        let image = folder.path().join("image_2/000007.png");
        fs::write(&image, "").unwrap();
        fs::write(folder.path().join("calib/000007.txt"), CALIBRATION).unwrap();
        let found = source(&CameraArgs::default(), &[&image]).unwrap();
        assert!((found.camera(&image, [1242, 375]).unwrap().focal_x() - 700.0).abs() < 1.0);

        let other = folder.path().join("image_2/000008.png");
        fs::write(&other, "").unwrap();
        let error = found.camera(&other, [1242, 375]).unwrap_err().to_string();
        let expected = "calib/000008.txt, or give one of --calib FILE, --fx PIXELS or --hfov DEGREES";
        assert!(error.contains("000008.png: no camera; expected its calibration ") && error.ends_with(expected));
        let error = source(&CameraArgs::default(), &[&other]).unwrap_err().to_string();
        assert!(error.contains("000008.png: no camera; expected its calibration ") && error.ends_with(expected));
        let elsewhere = folder.path().join("000009.png");
        let error = found.camera(&elsewhere, [1242, 375]).unwrap_err().to_string();
        assert!(error.contains("000009.png: no camera, and no calibration beside it; give one of"), "{error}");
    }

    #[test]
    fn a_folder_of_calibrations_goes_by_the_name_of_the_image() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("front.txt"), CALIBRATION).unwrap();
        let args = CameraArgs { calib: Some(folder.path().to_owned()), ..CameraArgs::default() };
        let found = source(&args, &[]).unwrap();
        assert!(found.camera(Path::new("elsewhere/front.jpg"), [10, 10]).is_ok());
        let error = found.camera(Path::new("rear.jpg"), [10, 10]).unwrap_err().to_string();
        assert!(error.contains("rear.txt: cannot be read"), "{error}");
    }

    #[test]
    fn missing_intrinsics_come_from_the_image() {
        let args = CameraArgs { fx: Some(1000.0), cy: Some(500.0), ..CameraArgs::default() };
        let camera = source(&args, &[]).unwrap().camera(Path::new("a.png"), [1921, 1081]).unwrap();
        assert_eq!(camera, farsight_core::Camera::from_intrinsics(1000.0, 1000.0, 960.0, 500.0).unwrap());
    }
}
