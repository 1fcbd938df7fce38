//! The camera options.

use std::path::PathBuf;

use anyhow::{Error, anyhow};
use clap::Args;
use farsight::{Camera, CameraSource, CameraSourceError, Lens, ViewSource};

/// Cameras that have all their numbers already. `requires` alone lets them pass, as clap asks for nothing that
/// conflicts with what is there.
const NO_INTRINSICS: [&str; 2] = ["calib", "hfov"];

/// The camera options, of which one is needed for images that neither lie in KITTI's layout nor tell their focal length
/// (EXIF).
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Camera (photos with EXIF data and images in KITTI's layout bring their own)")]
pub(crate) struct CameraArgs {
    /// Calibration in KITTI's format (its row P2, and the row road of `farsight calibrate`), or a folder with one for
    /// each image (IMAGE.txt)
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
    /// Horizontal field of view of the whole image, degrees; "auto" estimates it from each image that does not tell,
    /// with an error bar that goes into the distances'
    #[arg(long, value_name = "DEG", value_parser = field_of_view, allow_negative_numbers = true)]
    pub(crate) hfov: Option<FieldOfView>,
}

/// What `--hfov` takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum FieldOfView {
    /// So many degrees.
    Degrees(f64),
    /// What the image says.
    Estimated,
}

/// The camera options and the lens.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct ViewArgs {
    /// What the lens does to the image, in OpenCV's order: brown:k1,k2,p1,p2,k3 or kb4:k1,k2,k3,k4 (fisheye). Camera
    /// options then tell the pinhole
    #[arg(
        long,
        value_name = "LENS",
        help_heading = "Camera (photos with EXIF data and images in KITTI's layout bring their own)"
    )]
    lens: Option<Lens>,
    // Last, because its help heading would go on to what follows.
    #[command(flatten)]
    pub(crate) camera: CameraArgs,
}

impl ViewArgs {
    /// How images are taken: as the options say; where they do not, what the `images` say themselves.
    pub(crate) fn source(&self, images: &[PathBuf]) -> anyhow::Result<ViewSource> {
        Ok(ViewSource::from(self.camera.source(images)?).with_lens(self.lens))
    }
}

/// What to do when there is no camera.
const HINT: &str = "give one of --calib FILE, --fx PIXELS, --hfov DEGREES or --hfov auto";

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

fn field_of_view(text: &str) -> Result<FieldOfView, String> {
    if text == "auto" {
        return Ok(FieldOfView::Estimated);
    }
    let value = text.parse().map_err(|_| "expected a number or auto".to_owned())?;
    Camera::from_hfov(value, 1, 1).map(|_| FieldOfView::Degrees(value)).map_err(|error| error.to_string())
}

impl CameraArgs {
    /// The cameras that the options name; when there are none, what the `images` say themselves.
    pub(crate) fn source(&self, images: &[PathBuf]) -> anyhow::Result<CameraSource> {
        let Self { calib, fx, fy, cx, cy, hfov } = self;
        if let Some(calib) = calib {
            return CameraSource::from_calibration(calib).map_err(with_hint);
        }
        Ok(match (*fx, *hfov) {
            (Some(fx), _) => CameraSource::Intrinsics { fx, fy: fy.unwrap_or(fx), cx: *cx, cy: *cy },
            (None, Some(FieldOfView::Degrees(degrees))) => CameraSource::FieldOfView(degrees),
            (None, Some(FieldOfView::Estimated)) => CameraSource::of_layout(images).unwrap_or(CameraSource::Estimated),
            (None, None) => CameraSource::of_images(images).map_err(with_hint)?,
        })
    }
}

/// What to do about a camera that is not known.
pub(crate) fn with_hint(error: CameraSourceError) -> Error {
    match error {
        CameraSourceError::Unknown => {
            anyhow!("{error}; {HINT} (photos with EXIF data and images in KITTI's layout bring their own)")
        }
        CameraSourceError::NoCalibration { .. } => anyhow!("{error}, or {HINT}"),
        CameraSourceError::OutsideLayout(_) | CameraSourceError::Exif { .. } => anyhow!("{error}; {HINT}"),
        _ => error.into(),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use farsight::{CameraSource, Exif};

    use super::{CameraArgs, FieldOfView, with_hint};

    const NO_EXIF: Exif = Exif::NONE;

    const CALIBRATION: &str = "P2: 700 0 600 45 0 700 170 0.2 0 0 1 0.003\n";

    fn source(args: &CameraArgs, images: &[&Path]) -> anyhow::Result<CameraSource> {
        let images: Vec<_> = images.iter().map(|path| path.to_path_buf()).collect();
        args.source(&images)
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
        let error = found.camera(&other, [1242, 375], &NO_EXIF).map_err(with_hint).unwrap_err().to_string();
        let expected = "calib/000008.txt, or give one of --calib FILE, --fx PIXELS, --hfov DEGREES or --hfov auto";
        assert!(error.contains("000008.png: no camera; expected its calibration ") && error.ends_with(expected));
        let error = source(&CameraArgs::default(), &[&other]).unwrap_err().to_string();
        assert!(error.contains("000008.png: no camera; expected its calibration ") && error.ends_with(expected));
        let elsewhere = folder.path().join("000009.png");
        let error = found.camera(&elsewhere, [1242, 375], &NO_EXIF).map_err(with_hint).unwrap_err().to_string();
        assert!(error.contains("000009.png: no camera, and no calibration beside it; give one of"), "{error}");
    }

    #[test]
    fn a_folder_of_calibrations_goes_by_the_name_of_the_image() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("front.txt"), CALIBRATION).unwrap();
        let args = CameraArgs { calib: Some(folder.path().to_owned()), ..CameraArgs::default() };
        let found = source(&args, &[]).unwrap();
        assert!(found.camera(Path::new("elsewhere/front.jpg"), [10, 10], &NO_EXIF).is_ok());
        let error = found.camera(Path::new("rear.jpg"), [10, 10], &NO_EXIF).map_err(with_hint).unwrap_err().to_string();
        assert!(error.contains("rear.txt: cannot be read"), "{error}");
    }

    #[test]
    fn missing_intrinsics_come_from_the_image() {
        let args = CameraArgs { fx: Some(1000.0), cy: Some(500.0), ..CameraArgs::default() };
        let camera = source(&args, &[]).unwrap().camera(Path::new("a.png"), [1921, 1081], &NO_EXIF).unwrap();
        assert_eq!(camera, farsight::Camera::from_intrinsics(1000.0, 1000.0, 960.0, 500.0).unwrap());
    }

    #[test]
    fn exif_data_give_the_camera_when_nothing_else_does() {
        let exif = Exif { focal_35mm: Some(26.0), ..NO_EXIF };
        let camera = CameraSource::Exif.camera(Path::new("a.jpg"), [3024, 4032], &exif).unwrap();
        assert!((camera.focal_x() - 3028.6).abs() < 0.1);
        // KITTI's layout first, then EXIF data, for images that lie elsewhere.
        let camera = CameraSource::Kitti.camera(Path::new("a.jpg"), [4032, 3024], &exif).unwrap();
        assert!((camera.focal_x() - 3028.6).abs() < 0.1);
        let told = |exif: &Exif| {
            CameraSource::Exif.camera(Path::new("a.jpg"), [400, 300], exif).map_err(with_hint).unwrap_err().to_string()
        };
        let hint = "give one of --calib FILE, --fx PIXELS, --hfov DEGREES or --hfov auto";
        assert_eq!(told(&NO_EXIF), format!("a.jpg: no camera: no focal length in its EXIF data; {hint}"));
        let absurd = Exif { focal_35mm: Some(f64::INFINITY), ..NO_EXIF };
        assert!(
            told(&absurd).starts_with("a.jpg: no camera: its EXIF data are not to be believed: "),
            "{}",
            told(&absurd)
        );
        // What is said on the command line wins.
        let args = CameraArgs { hfov: Some(FieldOfView::Degrees(90.0)), ..CameraArgs::default() };
        let camera = source(&args, &[]).unwrap().camera(Path::new("a.jpg"), [400, 300], &exif).unwrap();
        assert!((camera.focal_x() - 200.0).abs() < 1e-9);
    }
}
