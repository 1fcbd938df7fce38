//! `farsight calibrate`: how a camera stands over its road, from the traffic that it sees and from how fast it drives.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use farsight::video::{EgoFile, EgoHeight, VideoFrame, VideoOptions, VideoSource, is_video};
use farsight::{
    CalibrateError, CameraStand, Exif, ImageLimits, RgbImage, Road, RoadCalibrator, View, ViewSource, load_image,
};
use farsight_data::kitti::Calibration;

use super::Outcome;
use super::track::fps;
use crate::camera_args::{ViewArgs, with_hint};
use crate::inputs;
use crate::pipeline_args::{self, PipelineArgs};
use crate::printer::{Printer, counted, progress_bar};

/// Arguments of `farsight calibrate`.
#[derive(Debug, Args)]
#[command(after_help = "\
The camera must stay as it is mounted, on a mast or in a car. Traffic tells pitch, roll and height; the height is as sure as
sizes of vehicles are, unless --above-road says it, or the speed of a camera that drives (--ego). It does not tell the
field of view, which the camera options must.
farsight calibrate pole/*.jpg --hfov 70 --out pole.txt
farsight calibrate pole.mp4 --hfov 70 --out pole.txt
farsight calibrate drive.mp4 --hfov 70 --ego speeds.csv --out car.txt
farsight range pole/0001.jpg --calib pole.txt")]
pub(crate) struct CalibrateArgs {
    /// Images of one camera that stays as it is mounted, folders of images, patterns; or one video or address (rtsp,
    /// http), of which two frames a second are looked at
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    pipeline: PipelineArgs,
    /// Write the calibration, for --calib of other commands
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// The images are the frames of a film, so many a second; two of them a second are looked at
    #[arg(long, value_name = "N", value_parser = fps, allow_negative_numbers = true)]
    fps: Option<f64>,
    /// How fast the camera of a film drives, which tells its height in the first minute: rows of KITTI's oxts, poses of
    /// KITTI's odometry, or CSV with columns `time_s`, `speed_mps` and `yaw_rate`; of images with --fps
    #[arg(long, value_name = "FILE|DIR", conflicts_with = "above_road")]
    ego: Option<PathBuf>,
    /// Of a video look at so many frames
    #[arg(long, value_name = "N", default_value_t = 120, value_parser = clap::value_parser!(u16).range(1..))]
    frames: u16,
    /// The ffmpeg program
    #[arg(long, value_name = "FILE", default_value = "ffmpeg")]
    ffmpeg: PathBuf,
    // Last, because its help heading would go on to what follows.
    #[command(flatten)]
    view: ViewArgs,
}

/// The traffic is looked at so often.
const ROUNDS: usize = 2;

/// Frames of a video that are looked at are so far apart, seconds: nearer ones show the same.
const BETWEEN_FRAMES_S: f64 = 0.5;

/// Runs the command.
pub(crate) fn run(args: &CalibrateArgs, printer: &mut Printer) -> Result<Outcome> {
    let source = Source::of(args, printer)?;
    let views = args.view.source(source.images())?;
    let ego = args.ego.as_deref().map(EgoFile::read).transpose()?;
    let road = args.pipeline.road.above_road().unwrap_or(Road::Below);
    // What no image can mend is told before any is looked at.
    ensure!(road != Road::Ignored, CalibrateError::NoRoad);
    let pipeline = pipeline_args::open_and_tell(&args.pipeline.builder(printer)?, printer)?;
    ensure!(pipeline.has_error_bars(), CalibrateError::NoErrorBars { model: pipeline.info().name.clone() });

    let road = match ego {
        Some(ego) => road_by_speed(ego, &source, &views, printer)?,
        None => road,
    };
    let mut first: Option<(View, [u32; 2])> = None;
    let mut calibrator: Option<RoadCalibrator> = None;
    let (mut stand, mut failed, mut seen) = (None, 0, 0);
    // Networks know cameras in level coordinates better, so what the first round finds makes the second one better.
    for round in 0..ROUNDS {
        let bar = progress_bar(source.count());
        (failed, seen) = (source.problems, 0);
        source.for_each(&mut |taken| {
            bar.inc(1);
            let looked = taken.and_then(|Taken { path, place, image, exif }| {
                let known = known_view(&path, &place, &image, &exif, &views, first.as_ref())?;
                let (view, _) = first.get_or_insert(known);
                let looker = match &mut calibrator {
                    Some(calibrator) => calibrator,
                    none => none.insert(RoadCalibrator::new(pipeline.clone(), *view.camera(), road)?),
                };
                let image = view.straightened(&image).with_context(|| place.clone())?;
                looker.add(&image).with_context(|| place.clone())
            });
            match looked {
                Ok(()) => seen += 1,
                Err(error) => {
                    failed += 1;
                    if round == 0 {
                        bar.suspend(|| printer.failure(&error));
                    }
                }
            }
        })?;
        bar.finish_and_clear();
        let Some(calibrator) = &mut calibrator else { bail!("no image could be looked at") };
        let told = told(calibrator.objects(), seen);
        stand = Some(calibrator.end_round().with_context(|| told.clone())?);
    }
    let Some(stand) = stand else { bail!("no image could be looked at") };
    tell(&stand, seen, printer);
    if let Some(out) = &args.out {
        let calibration = Calibration { road: Some(stand.road), ..Calibration::from_camera(&stand.camera) };
        calibration.write(out)?;
        printer.status(&format!("{}: written; give it to --calib", out.display()));
    }
    Ok(if failed > 0 { Outcome::Told } else { Outcome::Done })
}

/// The road, as high as the speed says.
fn road_by_speed(ego: EgoFile, source: &Source, views: &ViewSource, printer: &mut Printer) -> Result<Road> {
    let Kind::Film { source, options, .. } = &source.kind else { return Ok(Road::Below) };
    let (mut first, mut seen) = (None, 0_usize);
    let view = |frame: &VideoFrame| {
        let known = known_view(&frame.path, &frame.place(), &frame.image, &frame.exif, views, first.as_ref()).ok()?;
        seen += 1;
        Some(first.get_or_insert(known).0.clone())
    };
    let height = EgoHeight::of_film(ego, source, options, view)?;
    let told = format!("{} of {} tell the height", height.frames(), counted(seen, "frame"));
    let Some([height_m, sigma_m]) = height.height_m() else {
        bail!("--ego: {told}; expected ten that show the road from above 3 m/s");
    };
    printer.status(&format!("by its speed the camera is {height_m:.2} ±{sigma_m:.2} m above the road; {told}"));
    let [lowest_m, highest_m] = Road::HEIGHTS_M;
    ensure!(
        (lowest_m..=highest_m).contains(&height_m),
        "--ego: {height_m:.2} m above the road; expected {lowest_m} to {highest_m}: are the speeds metres a second?"
    );
    Ok(Road::measured(height_m, sigma_m))
}

fn tell(stand: &CameraStand, images: usize, printer: &mut Printer) {
    let CameraStand { pitch_rad, roll_rad, height_m: [height, height_sigma], objects, carried, .. } = stand;
    let [pitch, pitch_sigma] = pitch_rad.map(f64::to_degrees);
    let [roll, roll_sigma] = roll_rad.map(f64::to_degrees);
    printer.line(&format!("pitch   {pitch:6.2} ±{pitch_sigma:.2} degrees (positive looks down)"));
    printer.line(&format!("roll    {roll:6.2} ±{roll_sigma:.2} degrees (positive leans right)"));
    printer.line(&format!("height  {height:6.2} ±{height_sigma:.2} m above the road"));
    printer.status(&format!("{}; the field of view is as given: traffic does not tell it", told(*objects, images)));
    if stand.is_doubtful() {
        printer.warning(&format!(
            "only {:.0}% of what was found stands on this road: does the camera move, or is there another road?",
            100.0 * carried
        ));
    }
}

/// How much there was, for people.
fn told(objects: usize, images: usize) -> String {
    format!("{} at places of their own in {}", counted(objects, "object"), counted(images, "image"))
}

/// What is looked at.
struct Source {
    kind: Kind,
    /// Arguments without images, which were told.
    problems: usize,
}

enum Kind {
    Images(Vec<PathBuf>),
    Film { source: VideoSource, options: VideoOptions, frames: usize },
}

/// An image, or a frame of a video.
struct Taken {
    path: PathBuf,
    /// What errors call it.
    place: String,
    image: RgbImage,
    exif: Exif,
}

impl Source {
    fn of(args: &CalibrateArgs, printer: &mut Printer) -> Result<Self> {
        let options = VideoOptions { ffmpeg: args.ffmpeg.clone(), ..VideoOptions::default() };
        let film = |source| Kind::Film { source, options, frames: usize::from(args.frames) };
        if let Some(video) = args.inputs.iter().find(|input| is_video(input)) {
            ensure!(args.inputs.len() == 1, "{}: a video beside other inputs; expected it alone", video.display());
            ensure!(args.fps.is_none(), "--fps is for images; {} has times of its own", video.display());
            return Ok(Self { kind: film(VideoSource::Video(video.clone())), problems: 0 });
        }
        let found = inputs::find(&args.inputs);
        for problem in &found.problems {
            printer.error(problem);
        }
        ensure!(!found.images.is_empty(), "no image to look at");
        let problems = found.problems.len();
        let kind = if let Some(fps) = args.fps {
            // A list with holes has wrong times.
            ensure!(problems == 0, "--fps: some of its frames cannot be read");
            film(VideoSource::Images { files: found.images, fps })
        } else {
            let of_a_film = "expected a video, or --fps N for images that are the frames of one";
            ensure!(args.ego.is_none(), "--ego is for films; {of_a_film}");
            Kind::Images(found.images)
        };
        Ok(Self { kind, problems })
    }

    fn images(&self) -> &[PathBuf] {
        match &self.kind {
            Kind::Images(images) => images,
            Kind::Film { source, .. } => source.images(),
        }
    }

    /// The most that it has.
    fn count(&self) -> usize {
        match &self.kind {
            Kind::Images(images) => images.len(),
            Kind::Film { frames, .. } => *frames,
        }
    }

    /// Hands each image over, or why there is none.
    fn for_each(&self, take: &mut dyn FnMut(Result<Taken>)) -> Result<()> {
        match &self.kind {
            Kind::Images(images) => {
                for path in images {
                    take(load_image(path, ImageLimits::default()).map_err(Into::into).map(|loaded| Taken {
                        path: path.clone(),
                        place: path.display().to_string(),
                        image: loaded.pixels,
                        exif: loaded.exif,
                    }));
                }
            }
            Kind::Film { source, options, frames } => {
                let (mut taken, mut next_s) = (0, f64::NEG_INFINITY);
                for frame in source.clone().frames(options)? {
                    match frame {
                        Ok(frame) if frame.time_s < next_s => {}
                        Ok(frame) => {
                            next_s = frame.time_s + BETWEEN_FRAMES_S;
                            taken += 1;
                            take(Ok(Taken {
                                place: frame.place(),
                                path: frame.path,
                                image: frame.image,
                                exif: frame.exif,
                            }));
                        }
                        Err(error) => take(Err(error.into())),
                    }
                    if taken == *frames {
                        break;
                    }
                }
            }
        }
        Ok(())
    }
}

/// How an image was taken, and its size; both must be those of the `first` one.
fn known_view(
    path: &Path,
    place: &str,
    image: &RgbImage,
    exif: &Exif,
    views: &ViewSource,
    first: Option<&(View, [u32; 2])>,
) -> Result<(View, [u32; 2])> {
    let size = [image.width(), image.height()];
    if let Some((first, _)) = first.filter(|(first, its_size)| first.estimate().is_some() && *its_size == size) {
        return Ok((first.clone(), size));
    }
    let view = views.view(path, image, exif).map_err(with_hint)?;
    ensure!(
        first.is_none_or(|(first, its_size)| (first.camera(), its_size) == (view.camera(), &size)),
        "{place}: another camera or size than the images before; expected images of one camera"
    );
    Ok((view, size))
}
