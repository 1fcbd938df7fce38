//! Where the camera of an image comes from.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use farsight_core::Camera;
use farsight_data::kitti::Calibration;
use farsight_data::{Exif, FocalFromExif, FocalProblem, ImageError, ImageLimits, focal, read_header};

use crate::model_files::signature;
use crate::names::stem;
use crate::outputs::start_of;

/// Horizontal field of view of KITTI's camera, degrees, for images whose camera does not matter.
pub(crate) const KITTI_HFOV_DEG: f64 = 81.4;

/// Cameras that have all their numbers already. `requires` alone lets them pass, as clap asks for nothing that conflicts with what is there.
const NO_INTRINSICS: [&str; 2] = ["calib", "hfov"];

/// Images that are looked at before it is said that none has a camera.
const PROBED_IMAGES: usize = 200;

/// The camera options, of which one is needed for images that neither lie in KITTI's layout nor tell their focal length (EXIF).
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Camera (photos with EXIF data and images in KITTI's layout bring their own)")]
pub(crate) struct CameraArgs {
    /// Calibration in KITTI's format (its row P2), or a folder with one for each image (IMAGE.txt)
    #[arg(long, value_name = "FILE", conflicts_with_all = ["fx", "hfov"])]
    pub(crate) calib: Option<PathBuf>,
    /// Horizontal focal length, pixels
    #[arg(long, value_name = "F", conflicts_with = "hfov", value_parser = focal_length, allow_negative_numbers = true)]
    pub(crate) fx: Option<f64>,
    /// Vertical focal length, pixels [default: the horizontal one]
    #[arg(long, value_name = "F", requires = "fx", conflicts_with_all = NO_INTRINSICS, value_parser = focal_length, allow_negative_numbers = true)]
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

fn focal_length(text: &str) -> Result<f64, String> {
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
    /// What each image's EXIF data say.
    Exif,
}

impl CameraSource {
    /// The source that the options name; when there are none, KITTI's layout when at least one of `images` lies in it, else EXIF data.
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
        Self::of_exif(images)
    }

    /// EXIF data, unless it is plain from the first images that there are none.
    fn of_exif(images: &[PathBuf]) -> Result<Self> {
        let mut told = None;
        for image in images.iter().take(PROBED_IMAGES) {
            match read_header(image, ImageLimits { max_pixels: u64::MAX }) {
                Ok(header) => match focal(&header.exif, header.size) {
                    Ok(_) => return Ok(Self::Exif),
                    Err(FocalProblem::Missing) => {}
                    Err(problem) => {
                        told.get_or_insert_with(|| unknown(image, &problem));
                    }
                },
                // What it is matters more than its camera, and is told when it is its turn.
                Err(ImageError::Foreign { .. } | ImageError::NoFile { .. }) => return Ok(Self::Exif),
                Err(_) => {}
            }
        }
        match told {
            _ if images.len() > PROBED_IMAGES => Ok(Self::Exif),
            Some(problem) => bail!("{problem}"),
            None => bail!(
                "no camera: distances need its focal length; {HINT} (photos with EXIF data and images in KITTI's layout bring their own)"
            ),
        }
    }

    /// KITTI's layout, when at least one of `images` lies in it.
    pub(crate) fn of_layout(images: &[PathBuf]) -> Option<Self> {
        images.iter().any(|image| kitti_calibration(image).is_some()).then_some(Self::Kitti)
    }

    /// What the EXIF data say about the camera of an image, where nothing else does.
    pub(crate) fn from_exif(
        &self,
        path: &Path,
        size: [usize; 2],
        exif: &Exif,
    ) -> Option<Result<FocalFromExif, FocalProblem>> {
        let asked = match self {
            Self::Exif => true,
            Self::Kitti => in_layout(path).is_none(),
            _ => false,
        };
        // Sides of images are 32-bit numbers.
        asked.then(|| focal(exif, size.map(|side| side as u32)))
    }

    /// The camera of the image at `path`, which has `size` (width and height, pixels) and `exif` data.
    pub(crate) fn camera(&self, path: &Path, size: [usize; 2], exif: &Exif) -> Result<Camera> {
        let [width, height] = size;
        match self.from_exif(path, size, exif) {
            Some(Ok(found)) => return Ok(Camera::from_hfov(found.hfov_deg, width, height)?),
            Some(Err(FocalProblem::Missing)) | None => {}
            Some(Err(problem)) => bail!("{}", unknown(path, &problem)),
        }
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
            Self::Exif => bail!("{}", unknown(path, &FocalProblem::Missing)),
        }
    }
}

fn unknown(image: &Path, problem: &FocalProblem) -> String {
    format!("{}: no camera: {problem}; {HINT}", image.display())
}

fn read(path: &Path) -> Result<Camera> {
    if let Some(found) = start_of(path).ok().and_then(|start| signature(&start)) {
        bail!("{}: {found}; expected a calibration in KITTI's format, text with a row P2", path.display());
    }
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

    use farsight_data::Exif;

    use super::{CameraArgs, CameraSource};

    const NO_EXIF: Exif = Exif::NONE;

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
        assert!((found.camera(&image, [1242, 375], &NO_EXIF).unwrap().focal_x() - 700.0).abs() < 1.0);

        let other = folder.path().join("image_2/000008.png");
        fs::write(&other, "").unwrap();
        let error = found.camera(&other, [1242, 375], &NO_EXIF).unwrap_err().to_string();
        let expected = "calib/000008.txt, or give one of --calib FILE, --fx PIXELS or --hfov DEGREES";
        assert!(error.contains("000008.png: no camera; expected its calibration ") && error.ends_with(expected));
        let error = source(&CameraArgs::default(), &[&other]).unwrap_err().to_string();
        assert!(error.contains("000008.png: no camera; expected its calibration ") && error.ends_with(expected));
        let elsewhere = folder.path().join("000009.png");
        let error = found.camera(&elsewhere, [1242, 375], &NO_EXIF).unwrap_err().to_string();
        assert!(error.contains("000009.png: no camera, and no calibration beside it; give one of"), "{error}");
    }

    #[test]
    fn a_folder_of_calibrations_goes_by_the_name_of_the_image() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("front.txt"), CALIBRATION).unwrap();
        let args = CameraArgs { calib: Some(folder.path().to_owned()), ..CameraArgs::default() };
        let found = source(&args, &[]).unwrap();
        assert!(found.camera(Path::new("elsewhere/front.jpg"), [10, 10], &NO_EXIF).is_ok());
        let error = found.camera(Path::new("rear.jpg"), [10, 10], &NO_EXIF).unwrap_err().to_string();
        assert!(error.contains("rear.txt: cannot be read"), "{error}");
    }

    #[test]
    fn missing_intrinsics_come_from_the_image() {
        let args = CameraArgs { fx: Some(1000.0), cy: Some(500.0), ..CameraArgs::default() };
        let camera = source(&args, &[]).unwrap().camera(Path::new("a.png"), [1921, 1081], &NO_EXIF).unwrap();
        assert_eq!(camera, farsight_core::Camera::from_intrinsics(1000.0, 1000.0, 960.0, 500.0).unwrap());
    }

    #[test]
    fn exif_data_give_the_camera_when_nothing_else_does() {
        let exif = Exif { focal_35mm: Some(26.0), ..NO_EXIF };
        let camera = CameraSource::Exif.camera(Path::new("a.jpg"), [3024, 4032], &exif).unwrap();
        assert!((camera.focal_x() - 3028.6).abs() < 0.1);
        // KITTI's layout first, then EXIF data, for images that lie elsewhere.
        let camera = CameraSource::Kitti.camera(Path::new("a.jpg"), [4032, 3024], &exif).unwrap();
        assert!((camera.focal_x() - 3028.6).abs() < 0.1);
        let told =
            |exif: &Exif| CameraSource::Exif.camera(Path::new("a.jpg"), [400, 300], exif).unwrap_err().to_string();
        let hint = "give one of --calib FILE, --fx PIXELS or --hfov DEGREES";
        assert_eq!(told(&NO_EXIF), format!("a.jpg: no camera: no focal length in its EXIF data; {hint}"));
        let absurd = Exif { focal_35mm: Some(f64::INFINITY), ..NO_EXIF };
        assert!(
            told(&absurd).starts_with("a.jpg: no camera: its EXIF data are not to be believed: "),
            "{}",
            told(&absurd)
        );
        // What is said on the command line wins.
        let args = CameraArgs { hfov: Some(90.0), ..CameraArgs::default() };
        let camera = source(&args, &[]).unwrap().camera(Path::new("a.jpg"), [400, 300], &exif).unwrap();
        assert!((camera.focal_x() - 200.0).abs() < 1e-9);
    }
}
