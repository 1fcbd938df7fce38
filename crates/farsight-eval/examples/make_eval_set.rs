//! Writes a made-up result set as large as KITTI's val split, to measure the evaluator on.
//!
//! `make_eval_set OUT [FRAMES] [SEED]` fills `OUT/label_2` and `OUT/results` with as many objects and detections a
//! frame as the set on which the official devkit was timed: 7 objects, 1.5 `DontCare` regions and 53 weak detections
//! (spec kitti-eval.md, section 3).

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::Path;
use std::{env, fs, io};

use rand::RngExt;
use rand_pcg::Pcg64;

/// Focal length and principal point of KITTI's camera, pixels.
const FOCAL_PX: f64 = 721.5;
const CENTER_PX: [f64; 2] = [609.6, 172.9];

/// Class, how often of 100, and height, width, length in metres.
const KINDS: [(&str, u32, [f64; 3]); 5] = [
    ("Car", 72, [1.53, 1.63, 3.88]),
    ("Van", 8, [2.2, 1.9, 5.1]),
    ("Pedestrian", 11, [1.76, 0.66, 0.84]),
    ("Cyclist", 5, [1.74, 0.6, 1.76]),
    ("Truck", 4, [3.25, 2.6, 10.1]),
];

#[derive(Clone)]
struct Thing {
    class: &'static str,
    size: [f64; 3],
    place: [f64; 3],
    yaw: f64,
}

fn main() -> io::Result<()> {
    let mut arguments = env::args().skip(1);
    let Some(out) = arguments.next() else {
        return Err(io::Error::other("usage: make_eval_set OUT [FRAMES] [SEED]"));
    };
    let mut number = |default: u64| arguments.next().map_or(Ok(default), |word| word.parse().map_err(io::Error::other));
    let (frames, seed) = (number(3769)?, number(1)?);
    let [labels, results] = ["label_2", "results"].map(|folder| Path::new(&out).join(folder));
    fs::create_dir_all(&labels)?;
    fs::create_dir_all(&results)?;
    for frame in 0..frames {
        let mut random = Pcg64::new(u128::from(seed), u128::from(frame));
        let (label_text, result_text) = frame_text(&mut random);
        fs::write(labels.join(format!("{frame:06}.txt")), label_text)?;
        fs::write(results.join(format!("{frame:06}.txt")), result_text)?;
    }
    Ok(())
}

fn frame_text(random: &mut Pcg64) -> (String, String) {
    let objects: Vec<_> = (0..random.random_range(2..=12)).map(|_| thing(random)).collect();
    let (mut labels, mut results) = (String::new(), String::new());
    for object in &objects {
        let occlusion = random.random_range(0..3);
        push(&mut labels, object, &format!("{:.2} {occlusion}", random.random_range(0.0..0.2)), None);
    }
    for _ in 0..random.random_range(0..=3) {
        let [x, y] = [random.random_range(0.0..1100.0), random.random_range(150.0..250.0)];
        let _ = writeln!(
            labels,
            "DontCare -1 -1 -10 {x:.2} {y:.2} {:.2} {:.2} -1 -1 -1 -1000 -1000 -1000 -10",
            x + 60.0,
            y + 30.0
        );
    }
    for _ in 0..random.random_range(40..=66) {
        // Two detections of five belong to an object, near it or not so near; the others are nothing.
        let is_near = random.random_range(0..5) < 2;
        let (prediction, score) = if is_near {
            let object = &objects[random.random_range(0..objects.len())];
            (disturbed(object, random), random.random_range(0.1..1.0))
        } else {
            (thing(random), random.random_range(0.0..0.5))
        };
        push(&mut results, &prediction, "-1 -1", Some(score));
    }
    (labels, results)
}

fn thing(random: &mut Pcg64) -> Thing {
    let mut draw = random.random_range(0..100);
    let kind = KINDS.iter().find(|(_, share, _)| {
        let is_this = draw < *share;
        draw = draw.saturating_sub(*share);
        is_this
    });
    let (class, _, size) = *kind.unwrap_or(&KINDS[0]);
    let z = random.random_range(5.0..70.0);
    let place = [random.random_range(-0.7..0.7) * z, 1.65, z];
    Thing { class, size, place, yaw: random.random_range(-PI..PI) }
}

fn disturbed(object: &Thing, random: &mut Pcg64) -> Thing {
    let mut near = object.clone();
    let spread = if random.random_range(0..2) == 0 { 0.01 } else { 0.04 };
    near.place[0] += random.random_range(-1.0..1.0) * spread * near.place[2];
    near.place[2] *= 1.0 + random.random_range(-1.0..1.0) * spread;
    near.size = near.size.map(|metres| metres * (1.0 + random.random_range(-0.1..0.1)));
    near.yaw += random.random_range(-0.2..0.2);
    near
}

/// Writes a row; the 2D box is the projection of an upright board as wide as the object is long or wide.
fn push(text: &mut String, thing: &Thing, flags: &str, score: Option<f64>) {
    let Thing { class, size: [h, w, l], place: [x, y, z], yaw } = thing;
    let scale = FOCAL_PX / z;
    let half_width = 0.5 * (l * yaw.cos().abs() + w * yaw.sin().abs());
    let [left, right] = [x - half_width, x + half_width].map(|at| (CENTER_PX[0] + scale * at).clamp(0.0, 1241.0));
    let [top, bottom] = [y - h, *y].map(|at| (CENTER_PX[1] + scale * at).clamp(0.0, 374.0));
    let alpha = yaw - x.atan2(*z);
    // Writing to a string cannot fail.
    let _ = write!(
        text,
        "{class} {flags} {alpha:.4} {left:.2} {top:.2} {right:.2} {bottom:.2} {h:.4} {w:.4} {l:.4} {x:.4} {y:.4} {z:.4} {yaw:.4}"
    );
    let _ = match score {
        Some(score) => writeln!(text, " {score:.4}"),
        None => writeln!(text),
    };
}
