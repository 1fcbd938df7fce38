//! Measures odometry against rendered sequences, whose motion is known, and against real ones:
//! `cargo run --release -p farsight-odometry --example measure_odometry -- [--table FILE] [--sequences N] [--seed N
//! ...] [--readout S] [NAME=FOLDER:HEIGHT_M:FPS ...]`.
//!
//! A FOLDER holds `image_02`, `calib/000000.txt` and, where speeds are to be judged, `label_02.txt` (KITTI's tracking
//! labels): the camera's speed is then that at which most labelled objects come nearer, as they are parked. Boxes of
//! labels are left out of the pictures, as detections are in `farsight track`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "an example")]

use std::collections::BTreeMap;
use std::error::Error;
use std::fs::{read_dir, read_to_string};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::Instant;

use farsight_core::{Box2d, Camera};
use farsight_data::kitti::Calibration;
use farsight_data::{ImageLimits, load_image};
use farsight_files::MeasuredTable;
use farsight_odometry::{CameraMotion, HeightEstimator, Odometry, OdometryFrame};
use farsight_synth::{SceneConfig, SequenceStream};

/// Frames of a rendered sequence, and frames a second.
const FRAMES: usize = 40;
const FPS: f64 = 10.0;

/// How well a height that somebody measured is known, metres.
const HEIGHT_SIGMA_M: f64 = 0.05;

/// 90% of a normal distribution lie within so many standard deviations.
const SIGMAS_90: f64 = 1.645;

/// A frame with what is known of it.
struct Known {
    image_size: [usize; 2],
    rgb: Vec<u8>,
    objects: Vec<Box2d>,
    /// Speed and yaw rate.
    motion: [Option<f64>; 2],
    pitch: Option<f64>,
}

impl Known {
    fn seen<'a>(&'a self, number: usize, fps: f64, camera: &'a Camera) -> OdometryFrame<'a> {
        OdometryFrame {
            time_s: number as f64 / fps,
            image_size: self.image_size,
            rgb: &self.rgb,
            camera,
            objects: &self.objects,
            looks_cut: false,
        }
    }
}

/// Errors with their standard deviations.
#[derive(Default)]
struct Figures {
    speeds: Vec<[f64; 2]>,
    shares: Vec<f64>,
    yaw_rates: Vec<[f64; 2]>,
    nods: Vec<[f64; 2]>,
    told: usize,
    asked: usize,
    speed_sum: f64,
    /// Errors of heights and their standard deviations, both as shares.
    heights: Vec<[f64; 2]>,
    cpu_s: f64,
    frames: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let (mut table, mut count, mut seeds, mut readout_s, mut real) = (None, 8, Vec::new(), 0.0, Vec::new());
    let mut rest = words.iter();
    while let Some(word) = rest.next() {
        let mut value = || rest.next().expect("a value");
        match word.as_str() {
            "--table" => table = Some(PathBuf::from(value())),
            "--sequences" => count = value().parse()?,
            "--seed" => seeds.push(value().parse()?),
            "--readout" => readout_s = value().parse()?,
            _ => real.push(word.split(['=', ':']).map(str::to_owned).collect::<Vec<_>>()),
        }
    }
    let command = "cargo run --release -p farsight-odometry --example measure_odometry";
    let mut rows = MeasuredTable::new(command, ["what", "figure"]);
    let mut tell = |what: String, figure: String| {
        println!("{what}: {figure}");
        rows.put([what, figure]);
    };
    for seed in seeds {
        let [masked, bare] = rendered(count, seed, readout_s);
        masked.tell(&format!("seed {seed}, "), &mut tell);
        tell(format!("seed {seed}, speed, boxes of traffic not left out: MAE"), bare.speed());
    }
    for one in real {
        let [name, folder, height_m, fps] = &one[..] else { return Err("expected NAME=FOLDER:HEIGHT_M:FPS".into()) };
        video(Path::new(folder), height_m.parse()?, fps.parse()?)?.tell(&format!("{name}, "), &mut tell);
    }
    if let Some(path) = table {
        rows.write(&path)?;
    }
    Ok(())
}

/// Rendered sequences, with boxes of traffic left out and without.
fn rendered(count: u64, seed: u64, readout_s: f64) -> [Figures; 2] {
    let config = SceneConfig { readout_s, ..SceneConfig::default() };
    let stream = SequenceStream { config, seed, frames: FRAMES, fps: FPS };
    let mut figures = [Figures::default(), Figures::default()];
    for index in 0..count {
        let sequence = stream.sequence(index);
        let height_m = sequence.camera_height_m();
        let mut odometries = [(); 2].map(|()| Odometry::above_road(height_m, HEIGHT_SIGMA_M));
        let (mut before, mut estimator) = (None, HeightEstimator::default());
        for number in 0..sequence.len() {
            let frame = sequence.frame(number);
            let known = Known {
                image_size: [frame.image.width(), frame.image.height()].map(|side| side as usize),
                objects: frame.tracks.iter().map(|track| track.label.box2d).collect(),
                rgb: frame.image.into_raw(),
                motion: [Some(frame.ego.speed_mps), Some(frame.ego.yaw_rate)],
                pitch: before.map(|before| frame.ego.pitch_rad - before),
            };
            before = Some(frame.ego.pitch_rad);
            estimator.add(&known.seen(number, FPS, &frame.camera), Some(frame.ego.speed_mps));
            let bare = Known { objects: Vec::new(), rgb: known.rgb.clone(), ..known };
            for (k, known) in [known, bare].into_iter().enumerate() {
                figures[k].look(&mut odometries[k], number, FPS, &frame.camera, &known);
            }
        }
        println!("sequence {index}, {height_m:.2} m: {} told of {}", figures[0].told, figures[0].asked);
        figures[0]
            .heights
            .extend(estimator.height_m().map(|[found, sigma]| [found / height_m - 1.0, sigma / height_m]));
    }
    figures
}

fn video(folder: &Path, height_m: f64, fps: f64) -> Result<Figures, Box<dyn Error>> {
    let camera = Calibration::read(&folder.join("calib/000000.txt"))?.camera();
    let mut images: Vec<PathBuf> =
        read_dir(folder.join("image_02"))?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
    images.sort();
    let labels = labels(&read_to_string(folder.join("label_02.txt")).unwrap_or_default());
    let (mut odometry, mut figures) = (Odometry::above_road(height_m, HEIGHT_SIGMA_M), Figures::default());
    for (number, path) in images.iter().enumerate() {
        let image = load_image(path, ImageLimits::default())?.pixels;
        let known = Known {
            image_size: [image.width(), image.height()].map(|side| side as usize),
            rgb: image.into_raw(),
            objects: labels.get(&number).into_iter().flatten().map(|(_, area, _)| *area).collect(),
            motion: [speed_of_parked(&labels, number, fps), None],
            pitch: None,
        };
        figures.look(&mut odometry, number, fps, &camera, &known);
    }
    Ok(figures)
}

/// Identity, box and depth of each label, by frames.
type Labels = BTreeMap<usize, Vec<(u32, Box2d, f64)>>;

fn labels(text: &str) -> Labels {
    let mut labels = Labels::new();
    for line in text.lines() {
        let fields: Vec<&str> = line.split_ascii_whitespace().collect();
        let number = |place: usize| fields[place].parse::<f64>().unwrap();
        let area = Box2d::new(number(6), number(7), number(8), number(9));
        labels.entry(number(0) as usize).or_default().push((number(1) as u32, area, number(15)));
    }
    labels
}

/// The median speed at which labelled objects came nearer over the last five frames, if there are at least three.
fn speed_of_parked(labels: &Labels, number: usize, fps: f64) -> Option<f64> {
    const OVER: usize = 5;
    let (now, before) = (labels.get(&number)?, labels.get(&number.checked_sub(OVER)?)?);
    let depth = |id: u32| before.iter().find(|(other, ..)| *other == id).map(|(.., z)| *z);
    let mut speeds: Vec<f64> =
        now.iter().filter_map(|(id, _, z)| Some((depth(*id)? - z) * fps / OVER as f64)).collect();
    speeds.sort_by(f64::total_cmp);
    (speeds.len() > 2).then(|| speeds[speeds.len() / 2])
}

impl Figures {
    fn look(&mut self, odometry: &mut Odometry, number: usize, fps: f64, camera: &Camera, known: &Known) {
        let start = cpu_s();
        let found = odometry.update(&known.seen(number, fps, camera));
        self.cpu_s += cpu_s() - start;
        self.frames += 1.0;
        self.asked += usize::from(number > 0);
        let Some(CameraMotion { speed_mps, speed_sigma_mps, yaw_rate, yaw_rate_sigma, .. }) = found else { return };
        self.told += 1;
        self.speed_sum += speed_mps;
        let [speed, turned] = known.motion;
        self.speeds.extend(speed.map(|known| [speed_mps - known, speed_sigma_mps]));
        self.shares.extend(speed.filter(|known| *known > 3.0).map(|known| (speed_mps / known - 1.0).abs()));
        self.yaw_rates.extend(turned.map(|known| [yaw_rate - known, yaw_rate_sigma]));
        let nod = found.map(|motion| [motion.pitch_rad, motion.pitch_sigma_rad]);
        self.nods.extend(known.pitch.zip(nod).map(|(known, [pitch, sigma])| [pitch - known, sigma]));
    }

    fn speed(&self) -> String {
        format!("{:.2} m/s", mae(&self.speeds))
    }

    fn tell(self, name: &str, tell: &mut impl FnMut(String, String)) {
        let mut row = |what: &str, figure: String| tell(format!("{name}{what}"), figure);
        row("frames that tell", format!("{} of {}", self.told, self.asked));
        row("mean speed told", format!("{:.2} m/s", self.speed_sum / self.told.max(1) as f64));
        if !self.speeds.is_empty() {
            row("speed: MAE", self.speed());
            row("speed: mean error", format!("{:+.2} m/s", mean(self.speeds.iter().map(|one| one[0]))));
            row("speed: 90% intervals hold", held(&self.speeds));
        }
        if !self.shares.is_empty() {
            row("speed above 3 m/s: mean relative error", format!("{:.1}%", 100.0 * mean(self.shares.iter().copied())));
        }
        if !self.heights.is_empty() {
            let count = self.heights.len();
            row("height from the speed: sequences that tell", count.to_string());
            let of = |share: f64| format!("{:.1}%", 100.0 * share);
            row("height from the speed: mean relative error", of(mae(&self.heights)));
            row("height from the speed: 90% intervals hold", held(&self.heights));
        }
        if !self.yaw_rates.is_empty() {
            row("yaw rate: MAE", format!("{:.4} rad/s", mae(&self.yaw_rates)));
            row("yaw rate: 90% intervals hold", held(&self.yaw_rates));
        }
        if !self.nods.is_empty() {
            row("change of pitch from frame to frame: MAE", format!("{:.2} mrad", 1e3 * mae(&self.nods)));
            row("change of pitch: 90% intervals hold", held(&self.nods));
        }
        row("time of the processor a frame", format!("{:.1} ms", 1e3 * self.cpu_s / self.frames.max(1.0)));
    }
}

/// Seconds that this thread has run, where the system tells (Linux), so that other programs do not count; else the time
/// of the clock.
fn cpu_s() -> f64 {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    let told = read_to_string("/proc/thread-self/schedstat").ok();
    let ns = told.and_then(|text| text.split_ascii_whitespace().next()?.parse::<f64>().ok());
    ns.map_or_else(|| START.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

fn mae(errors: &[[f64; 2]]) -> f64 {
    mean(errors.iter().map(|[error, _]| error.abs()))
}

fn held(errors: &[[f64; 2]]) -> String {
    let inside = errors.iter().filter(|[error, sigma]| error.abs() < SIGMAS_90 * sigma).count();
    format!("{:.0}%", 100.0 * inside as f64 / errors.len() as f64)
}
