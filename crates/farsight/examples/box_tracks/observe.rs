//! Tracks as a network sees them: one row of numbers for each detection of a track, and what is true then.

use std::collections::BTreeMap;

use farsight::{Box3d, Detection, ObjectClass, Track, Tracker};
use farsight_core::overlap::iou_2d;
use farsight_eval::tracks::JudgedSequence;

use crate::data::{Sequence, judged, options, told, update};

/// Numbers of a row that come from detections and from the camera's motion; and from the filter.
const SEEN: usize = 21;
pub(crate) const FILTERED: usize = 5;
pub(crate) const FEATURES: usize = SEEN + FILTERED;

/// Usual height, width and length of cars, metres.
const USUAL_HWL: [f64; 3] = [1.53, 1.65, 4.1];

/// Changes of logarithms in a second that are larger than this are an accident.
const MAX_RATE: f64 = 3.0;

/// The detection before a track is told overlaps its next one by this share at least.
const MIN_OVERLAP: f64 = 0.1;

/// One detection of a track.
#[derive(Debug, Clone)]
pub(crate) struct Step {
    pub(crate) frame: usize,
    pub(crate) features: [f64; FEATURES],
    /// Depth as the single image has it, metres.
    pub(crate) depth_m: f64,
    /// Standard deviation of its logarithm, as the single image has it.
    pub(crate) log_sigma: f64,
    /// From the nearest face to the centre, metres.
    pub(crate) half_m: f64,
    /// Of the filter: by how much the depth's logarithm is corrected, and the change in a second of that of the nearest
    /// face's depth, where it is known.
    pub(crate) filter: [Option<f64>; 2],
    /// The same, as they are; where the object counts (a Moderate car).
    pub(crate) truth: Option<[f64; 2]>,
}

/// A track of a sequence.
#[derive(Debug, Clone)]
pub(crate) struct BoxTrack {
    pub(crate) id: u64,
    pub(crate) steps: Vec<Step>,
}

/// What the tracker says of a sequence, and its tracks for a network.
pub(crate) struct Observed {
    /// The tracks of each frame that were seen in it.
    pub(crate) frames: Vec<Vec<Track>>,
    pub(crate) judged: JudgedSequence,
    pub(crate) tracks: Vec<BoxTrack>,
}

impl Observed {
    pub(crate) fn new(sequence: &Sequence) -> Self {
        let mut tracker = Tracker::new(options());
        let frame = |number: usize| {
            let mut tracks = update(&mut tracker, sequence, number);
            tracks.retain(|track| !track.coasting);
            tracks
        };
        let frames: Vec<Vec<Track>> = (0..sequence.detections.len()).map(frame).collect();
        let predicted: Vec<_> = frames.iter().enumerate().map(|(n, all)| Some(told(sequence, n, all))).collect();
        let judged = judged(sequence, &predicted);
        let identities: BTreeMap<(usize, u64), u64> =
            judged.samples.iter().map(|one| ((one.frame, one.ids[1]), one.ids[0])).collect();
        let mut of_id: BTreeMap<u64, Vec<(usize, &Track)>> = BTreeMap::new();
        for (number, tracks) in frames.iter().enumerate() {
            for track in tracks {
                of_id.entry(track.id).or_default().push((number, track));
            }
        }
        let track = |(id, seen): (&u64, &Vec<(usize, &Track)>)| {
            let mut steps: Vec<Step> = Vec::new();
            let mut last: Option<(usize, &Detection)> = None;
            let (first, track) = seen[0];
            let begun = (first + 1).checked_sub(track.age as usize).filter(|begun| *begun < first);
            if let Some((number, detection)) = begun.and_then(|n| Some((n, before(&sequence.detections[n], track)?))) {
                steps.push(step(sequence, number, detection, None, None, None));
                last = Some((number, detection));
            }
            for (number, track) in seen {
                let Some(detection) = matched(sequence, &sequence.detections[*number], track) else { continue };
                let truth = identities.get(&(*number, *id)).and_then(|truth| truth_of(sequence, *number, *truth));
                steps.push(step(sequence, *number, detection, last, Some(track), truth));
                last = Some((*number, detection));
            }
            BoxTrack { id: *id, steps }
        };
        let tracks = of_id.iter().map(track).collect();
        Self { frames, judged, tracks }
    }
}

/// The detection of a track that was seen.
fn matched<'a>(sequence: &Sequence, detections: &'a [Detection], track: &Track) -> Option<&'a Detection> {
    let [width, height] = sequence.image_size.map(|side| side as f64);
    detections.iter().find(|one| one.box2d.clamped(width, height) == track.box2d)
}

/// The detection that began a track.
fn before<'a>(detections: &'a [Detection], track: &Track) -> Option<&'a Detection> {
    let overlap = |one: &&Detection| iou_2d(&one.box2d, &track.box2d);
    let is_car = |one: &&Detection| one.class.is_like(&ObjectClass::Car);
    detections
        .iter()
        .filter(is_car)
        .max_by(|a, b| overlap(a).total_cmp(&overlap(b)))
        .filter(|one| overlap(one) > MIN_OVERLAP)
}

/// Half the extent of a box along the optical axis, metres.
pub(crate) fn half_m(box3d: &Box3d) -> f64 {
    let (sin, cos) = box3d.yaw.sin_cos();
    f64::midpoint(sin.abs() * box3d.dimensions.length, cos.abs() * box3d.dimensions.width)
}

/// Depth and velocity ahead, metres and m/s, and the half extent, metres.
fn truth_of(sequence: &Sequence, frame: usize, id: u64) -> Option<[f64; 3]> {
    let one = sequence.truth[frame].tracks.iter().find(|one| one.id == id)?;
    Some([one.label.box3d.depth_m(), one.velocity_mps?[2], half_m(&one.label.box3d)])
}

fn step(
    sequence: &Sequence,
    frame: usize,
    detection: &Detection,
    last: Option<(usize, &Detection)>,
    track: Option<&Track>,
    truth: Option<[f64; 3]>,
) -> Step {
    let Detection { box2d, box3d, score, range_sigma_m, .. } = detection;
    let camera = &sequence.camera;
    let depth_m = box3d.depth_m();
    let log_sigma = range_sigma_m.map_or(0.05, |sigma| sigma / depth_m);
    let [width, height] = sequence.image_size.map(|side| side as f64);
    let [_, centre_y] = camera.principal_point();
    let hwl = [box3d.dimensions.height, box3d.dimensions.width, box3d.dimensions.length];
    let [h, w, l] = [0, 1, 2].map(|k| (hwl[k] / USUAL_HWL[k]).ln());
    let (sin, cos) = box3d.alpha().sin_cos();
    let ego = sequence.motion(frame);
    let dt_s = last.map_or(0.0, |(before, _)| (frame - before) as f64 / sequence.fps);
    let rate = |now: f64, before: f64| ((now / before).ln() / dt_s).clamp(-MAX_RATE, MAX_RATE);
    let rates = last
        .map_or([0.0; 2], |(_, one)| [rate(box2d.height(), one.box2d.height()), rate(depth_m, one.box3d.depth_m())]);
    let half_m = half_m(box3d).min(0.75 * depth_m);
    let near_m = depth_m - half_m;
    let is_cut = box2d.x1 <= 1.0 || box2d.y1 <= 1.0 || box2d.x2 >= width - 1.0 || box2d.y2 >= height - 1.0;
    let seen: [f64; SEEN] = [
        (box2d.height() / camera.focal_y()).ln(),
        (box2d.width() / camera.focal_x()).ln(),
        box3d.location[0] / depth_m,
        (box2d.y2 - centre_y) / camera.focal_y(),
        depth_m.ln(),
        log_sigma.ln(),
        h,
        w,
        l,
        sin,
        cos,
        dt_s,
        f64::from(u8::from(last.is_none())),
        ego.map_or(0.0, |ego| ego.speed_mps),
        ego.map_or(0.0, |ego| ego.yaw_rate),
        f64::from(u8::from(ego.is_some())),
        f64::from(u8::from(is_cut)),
        *score,
        camera.focal_x().ln(),
        rates[0],
        rates[1],
    ];
    let correction = track.map(|track| (track.range_m() / depth_m).ln());
    let moving =
        track.and_then(|track| Some((track.closing?, (track.range_m() - self::half_m(&track.box3d)).max(0.3))));
    let rate = moving.map(|(closing, filter_near_m)| -closing.mps / filter_near_m);
    let filtered: [f64; FILTERED] = [
        correction.unwrap_or(0.0),
        rate.map_or(0.0, |rate| rate * near_m),
        f64::from(u8::from(rate.is_some())),
        moving.map_or(2.0, |(closing, _)| closing.sigma_mps.ln()),
        track.map_or(-3.0, |track| (track.range_sigma_m / track.range_m()).ln()),
    ];
    let mut features = [0.0; FEATURES];
    for (place, value) in features.iter_mut().zip(seen.into_iter().chain(filtered)) {
        *place = value;
    }
    let truth = truth
        .map(|[true_m, ahead_mps, true_half_m]| [(true_m / depth_m).ln(), ahead_mps / (true_m - true_half_m).max(0.3)]);
    Step { frame, features, depth_m, log_sigma, half_m, filter: [correction, rate], truth }
}
