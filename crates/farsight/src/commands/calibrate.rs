//! `farsight calibrate`: how a fixed camera stands over its road, from the traffic that it sees.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use farsight::{Camera, Detection, ImageLimits, Road, RoadPlane, View, ViewSource, load_image};
use farsight_core::overlap::iou_2d;
use farsight_data::kitti::Calibration;

use super::Outcome;
use crate::camera_args::{ViewArgs, with_hint};
use crate::inputs;
use crate::pipeline_args::{self, PipelineArgs};
use crate::printer::{Printer, counted, progress_bar};

/// Arguments of `farsight calibrate`.
#[derive(Debug, Args)]
#[command(after_help = "\
The camera must not move between the images. Traffic tells pitch, roll and height; the height is as sure as sizes of vehicles
are, unless --above-road says it. It does not tell the field of view, which the camera options must.
farsight calibrate pole/*.jpg --hfov 70 --out pole.txt
farsight range pole/0001.jpg --calib pole.txt")]
pub(crate) struct CalibrateArgs {
    /// Images of one camera that stays where it is, folders of images, patterns
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    pipeline: PipelineArgs,
    /// Write the calibration, for --calib of other commands
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    // Last, because its help heading would go on to what follows.
    #[command(flatten)]
    view: ViewArgs,
}

/// What overlaps by more than this with something in one of the last images stands still, and is no new witness.
const SAME_PLACE: f64 = 0.7;

/// So many images back is looked for what stands still.
const REMEMBERED_IMAGES: usize = 50;

/// On the road of a camera that does not move stands at least this share of what it sees.
const MIN_CARRIED: f64 = 0.8;

/// The traffic is looked at so often.
const ROUNDS: usize = 2;

/// Runs the command.
pub(crate) fn run(args: &CalibrateArgs, printer: &mut Printer) -> Result<Outcome> {
    let found = inputs::find(&args.inputs);
    for problem in &found.problems {
        printer.error(problem);
    }
    ensure!(!found.images.is_empty(), "no image to look at");
    let views = args.view.source(&found.images)?;
    let road = args.pipeline.road.above_road().unwrap_or(Road::Below);
    ensure!(road != Road::Ignored, "--above-road none leaves nothing to find; expected metres, or any");
    let pipeline = pipeline_args::open_and_tell(&args.pipeline.builder(printer)?, printer)?;
    ensure!(
        pipeline.has_error_bars(),
        "{}: a model without error bars, which calibration goes by",
        pipeline.info().name
    );

    let mut images = Vec::new();
    let mut failed = found.problems.len();
    let mut first = None;
    for path in &found.images {
        match known_view(path, &views, first.as_ref()) {
            Ok(known) => {
                first = Some(known);
                images.push(path);
            }
            Err(error) => {
                failed += 1;
                printer.failure(&error);
            }
        }
    }
    let Some((view, _)) = first else { bail!("no image could be looked at") };

    let given = *view.camera();
    let (mut camera, mut stands, mut carried) = (given, None, 0.0);
    // Networks know cameras in level coordinates better, so what the first round finds makes the second one better.
    for _ in 0..ROUNDS {
        let mut traffic = Traffic::default();
        let bar = progress_bar(images.len());
        for path in &images {
            let image = load_image(path, ImageLimits::default())?.pixels;
            let found = view.straightened(&image).and_then(|image| pipeline.detect_off_road(&image, &camera));
            traffic.add(found.with_context(|| path.display().to_string())?);
            bar.inc(1);
        }
        bar.finish_and_clear();
        let Some(plane) = RoadPlane::of(&traffic.images, road, &pipeline.scale()) else {
            bail!("{}: not enough to tell how the camera stands; expected more, at several distances", traffic.told());
        };
        let Some((level, road)) = plane.levelled(&camera) else {
            bail!("{}: the camera seems to look straight down; expected one that sees along its road", traffic.told());
        };
        carried = plane.carries(&traffic.images, &pipeline.scale());
        (camera, stands) = (level, Some((road, traffic.told())));
    }
    let stand = stands.and_then(|(plane, seen)| Some((plane, Stand::new(&given, &camera, &plane)?, seen)));
    let Some((plane, stand, seen)) = stand else { bail!("no image could be looked at") };
    tell(&stand, &seen, printer);
    if carried < MIN_CARRIED {
        printer.warning(&format!(
            "only {:.0}% of what was found stands on this road: does the camera move, or is there another road?",
            100.0 * carried
        ));
    }
    if let Some(out) = &args.out {
        let calibration = Calibration { road: Some(plane), ..Calibration::from_camera(&camera) };
        calibration.write(out)?;
        printer.status(&format!("{}: written; give it to --calib", out.display()));
    }
    Ok(if failed > 0 { Outcome::Told } else { Outcome::Done })
}

/// How a camera stands over its road; values with their standard deviations.
struct Stand {
    pitch_deg: [f64; 2],
    roll_deg: [f64; 2],
    height_m: [f64; 2],
}

impl Stand {
    /// Of the camera as it was `given` and the same in `level` coordinates, in which `plane` lies.
    fn new(given: &Camera, level: &Camera, plane: &RoadPlane) -> Option<Self> {
        // Straight down is far away in both: there it is a ray of the camera as it was given.
        let vanishing = level.projection.map(|row| row[1]);
        let down = given.direction(vanishing)?;
        let [slope, tilt] = [down[2] / down[1], down[0] / down[1]];
        let [slope_sigma, tilt_sigma, height_sigma] = plane.sigmas;
        let degrees = |tangent: f64, sigma: f64| [tangent.atan().to_degrees(), sigma.to_degrees()];
        Some(Self {
            pitch_deg: degrees(slope, slope_sigma),
            roll_deg: degrees(tilt, tilt_sigma),
            height_m: [plane.height_m, height_sigma],
        })
    }
}

fn tell(stand: &Stand, seen: &str, printer: &mut Printer) {
    let Stand { pitch_deg: [pitch, pitch_sigma], roll_deg: [roll, roll_sigma], height_m: [height, height_sigma] } =
        stand;
    printer.line(&format!("pitch   {pitch:6.2} ±{pitch_sigma:.2} degrees (positive looks down)"));
    printer.line(&format!("roll    {roll:6.2} ±{roll_sigma:.2} degrees (positive leans right)"));
    printer.line(&format!("height  {height:6.2} ±{height_sigma:.2} m above the road"));
    printer.status(&format!("{seen}; the field of view is as given: traffic does not tell it"));
}

/// How an image was taken, and its size; both must be those of the `first` one.
fn known_view(path: &Path, views: &ViewSource, first: Option<&(View, [u32; 2])>) -> Result<(View, [u32; 2])> {
    let loaded = load_image(path, ImageLimits::default())?;
    let size = [loaded.pixels.width(), loaded.pixels.height()];
    if let Some((first, _)) = first.filter(|(first, its_size)| first.estimate().is_some() && *its_size == size) {
        return Ok((first.clone(), size));
    }
    let view = views.view(path, &loaded.pixels, &loaded.exif).map_err(with_hint)?;
    ensure!(
        first.is_none_or(|(first, its_size)| (first.camera(), its_size) == (view.camera(), &size)),
        "{}: another camera or size than the images before; expected images of one camera",
        path.display()
    );
    Ok((view, size))
}

/// What one camera saw.
#[derive(Default)]
struct Traffic {
    /// By image; what stands still only once.
    images: Vec<Vec<Detection>>,
    /// All that was found in the last images.
    latest: VecDeque<Vec<Detection>>,
}

impl Traffic {
    fn add(&mut self, found: Vec<Detection>) {
        let stands_still =
            |one: &Detection| self.latest.iter().flatten().any(|other| iou_2d(&one.box2d, &other.box2d) > SAME_PLACE);
        self.images.push(found.iter().filter(|one| !stands_still(one)).cloned().collect());
        self.latest.push_back(found);
        if self.latest.len() > REMEMBERED_IMAGES {
            self.latest.pop_front();
        }
    }

    /// How much there was, for people.
    fn told(&self) -> String {
        let objects = self.images.iter().map(Vec::len).sum();
        format!("{} at places of their own in {}", counted(objects, "object"), counted(self.images.len(), "image"))
    }
}
