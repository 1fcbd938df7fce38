//! The tracks of one camera, frame by frame.

use std::cmp::Ordering;

use farsight_core::overlap::covered_share_2d;
use farsight_core::{Box2d, Camera, Detection, ObjectClass};

use crate::acceleration::ClosingWindow;
use crate::assignment::assigned;
use crate::association::{Strictness, cost};
use crate::error::TrackError;
use crate::filter::{Filter, Measured, Moving};
use crate::options::TrackerOptions;
use crate::track::{Closing, EgoMotion, Track, Velocity};

/// One frame.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// Its time, seconds; later than the last one's.
    pub time_s: f64,
    /// Width and height of the image, pixels. Where it changes all tracks end.
    pub image_size: [usize; 2],
    /// Its camera.
    pub camera: &'a Camera,
    /// What was found in it.
    pub detections: &'a [Detection],
    /// How the camera moves over the ground; where that is known, what stands still tells its distance by how fast it
    /// comes nearer.
    pub ego: Option<EgoMotion>,
    /// Whether the picture looks like another scene. All tracks end where hardly one of them goes on, too.
    pub looks_cut: bool,
}

/// Follows what is seen from frame to frame.
#[derive(Debug, Clone)]
pub struct Tracker {
    options: TrackerOptions,
    entries: Vec<Entry>,
    next_id: u64,
    last_s: Option<f64>,
    image_size: Option<[usize; 2]>,
}

/// A track, told or not.
#[derive(Debug, Clone)]
struct Entry {
    /// 0 until it is told.
    id: u64,
    filter: Filter,
    /// Each class with the sum of its scores.
    classes: Vec<(ObjectClass, f64)>,
    score: f64,
    frames: u64,
    hits: u32,
    /// Frames without a detection since the last one.
    misses: u32,
    born_s: f64,
    seen_s: f64,
    /// Whether it is behind something.
    is_hidden: bool,
    anchor: Anchor,
    window: ClosingWindow,
    /// How it comes nearer, as of this frame.
    closing: Option<Closing>,
    /// Where it is expected now, not clipped.
    expected: Box2d,
}

/// Where a box was in the image when it was seen last.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    box2d: Box2d,
    pixel: [f64; 2],
    near_m: f64,
}

/// A detection with what it measures.
struct Seen<'a> {
    detection: &'a Detection,
    measured: Measured,
}

/// A scene is another one where fewer of its tracks go on, as a share of them.
const SAME_SCENE: f64 = 1.0 / 3.0;

/// So many boxes tell that the camera nodded, if they are so many pixels off.
const MIN_NODDED: usize = 3;
const MIN_NOD_PX: f64 = 2.0;

/// A track that is not confirmed yet may miss so many frames.
const TENTATIVE_MISSES: u32 = 1;

/// A track of which less than this share of its box is in the image has left it.
const MIN_IN_IMAGE: f64 = 0.2;

/// Behind something is what this covers by more than this share.
const HIDDEN_SHARE: f64 = 0.5;

/// A track coasts for at most these shares of the time for which it was seen: in sight, and behind an obstacle.
const COAST_SHARE: f64 = 0.25;
const HIDDEN_COAST_SHARE: f64 = 0.5;

/// From so fast a camera, m/s, what stands still can be told from what moves.
const MIN_EGO_MPS: f64 = 1.0;

/// Nothing is said of a velocity after fewer detections, nor after less time in seconds.
const KNOWN_HITS: u32 = 3;
const KNOWN_AFTER_S: f64 = 0.25;

/// Detections of low scores must lie closer than others, and what was lost may lie farther off.
const LOW_MIN_OVERLAP: f64 = 0.35;
const MARGIN: f64 = 0.3;
const LOST_MARGIN: f64 = 0.6;
const LOST_MIN_OVERLAP: f64 = 0.1;

impl Default for Tracker {
    fn default() -> Self {
        Self::new(TrackerOptions::default())
    }
}

impl Tracker {
    /// A tracker that has seen nothing.
    pub fn new(options: TrackerOptions) -> Self {
        Self { options, entries: Vec::new(), next_id: 1, last_s: None, image_size: None }
    }

    /// How it works.
    pub fn options(&self) -> &TrackerOptions {
        &self.options
    }

    /// The tracks in this frame by their identities, those that coast included. The order of the detections does not
    /// matter.
    ///
    /// # Errors
    /// When the frame is not later than the last one, or holds what is no number. The tracks are then as before.
    pub fn update(&mut self, frame: &Frame) -> Result<Vec<Track>, TrackError> {
        self.check(frame)?;
        let mut is_new_scene = self.image_size != Some(frame.image_size);
        if is_new_scene {
            self.entries.clear();
        }
        let dt_s = self.last_s.map_or(0.0, |last_s| frame.time_s - last_s);
        (self.last_s, self.image_size) = (Some(frame.time_s), Some(frame.image_size));
        for entry in &mut self.entries {
            entry.predict(dt_s, frame, &self.options);
        }

        let noise = &self.options.noise;
        let mut seen: Vec<Seen> = frame
            .detections
            .iter()
            .filter(|detection| detection.score >= self.options.low_score)
            .map(|detection| Seen {
                detection,
                measured: Measured::new(detection, frame.camera, frame.image_size, noise),
            })
            .collect();
        seen.sort_by(|a, b| order(a.detection, b.detection));
        let mut partner = self.matches(&seen);
        if let Some(nod_px) = self.nod_px(&seen, &partner) {
            for entry in &mut self.entries {
                let Box2d { x1, y1, x2, y2 } = entry.expected;
                entry.expected = Box2d::new(x1, y1 + nod_px, x2, y2 + nod_px);
            }
            partner = self.matches(&seen);
        }
        if frame.looks_cut && !self.goes_on(&partner) {
            self.entries.clear();
            partner = vec![None; seen.len()];
            is_new_scene = true;
        }
        self.take(frame, &seen, &partner);
        self.name(is_new_scene);
        for entry in &mut self.entries {
            entry.may_stand_still(frame);
        }
        self.end(frame);
        Ok(self.told(frame))
    }

    fn check(&self, frame: &Frame) -> Result<(), TrackError> {
        let time_s = frame.time_s;
        if !time_s.is_finite() {
            return Err(TrackError::Time { time_s });
        }
        if let Some(last_s) = self.last_s.filter(|last_s| time_s <= *last_s) {
            return Err(TrackError::NotAfter { time_s, last_s });
        }
        if frame.image_size.contains(&0) {
            return Err(TrackError::Size { size: frame.image_size });
        }
        frame.detections.iter().enumerate().try_for_each(|(place, detection)| check_detection(place, detection))
    }

    /// The entry of each detection.
    fn matches(&self, seen: &[Seen]) -> Vec<Option<usize>> {
        let TrackerOptions { birth_score, birth_hits, min_overlap, gate_sigmas, max_coast_s, .. } = self.options;
        let now = self.last_s.unwrap_or_default();
        let is_lost = |entry: &Entry| entry.misses > 0 && !entry.is_shown(now, max_coast_s, self.options.max_hidden_s);
        let near = Strictness { min_overlap, margin: MARGIN, gate_sigmas };
        let close = Strictness { min_overlap: min_overlap.max(LOW_MIN_OVERLAP), margin: 0.0, gate_sigmas };
        let far = Strictness { min_overlap: min_overlap.min(LOST_MIN_OVERLAP), margin: LOST_MARGIN, gate_sigmas };
        let is_high = |one: &Seen| one.detection.score >= birth_score;
        let mut partner = vec![None; seen.len()];
        self.stage(seen, &mut partner, near, is_high, |entry| !is_lost(entry));
        self.stage(
            seen,
            &mut partner,
            close,
            |one| !is_high(one),
            |entry| entry.is_confirmed(birth_hits) && !is_lost(entry),
        );
        self.stage(seen, &mut partner, far, is_high, is_lost);
        partner
    }

    /// Matches what is free and may be matched in this stage.
    fn stage(
        &self,
        seen: &[Seen],
        partner: &mut [Option<usize>],
        strictness: Strictness,
        may_detection: impl Fn(&Seen) -> bool,
        may_entry: impl Fn(&Entry) -> bool,
    ) {
        let free = |place: &usize| !partner.contains(&Some(*place)) && may_entry(&self.entries[*place]);
        let entries: Vec<usize> = (0..self.entries.len()).filter(free).collect();
        let detections: Vec<usize> =
            (0..seen.len()).filter(|&place| partner[place].is_none() && may_detection(&seen[place])).collect();
        let cost = |entry: &Entry, one: &Seen| {
            let is_like = entry.classes.iter().any(|(class, _)| class.is_like(&one.detection.class));
            if !is_like {
                return f64::INFINITY;
            }
            cost(&entry.filter, &entry.expected, &one.measured, &one.detection.box2d, strictness, &self.options)
        };
        let costs: Vec<Vec<f64>> = entries
            .iter()
            .map(|&entry| detections.iter().map(|&place| cost(&self.entries[entry], &seen[place])).collect())
            .collect();
        for (&entry, column) in entries.iter().zip(assigned(&costs)) {
            if let Some(column) = column {
                partner[detections[column]] = Some(entry);
            }
        }
    }

    /// By so many pixels everything is lower in the image than expected, where that is more than boxes err by: the
    /// camera nodded. The median of what is matched already; none of too few.
    fn nod_px(&self, seen: &[Seen], partner: &[Option<usize>]) -> Option<f64> {
        let middle = |one: &Box2d| f64::midpoint(one.y1, one.y2);
        let mut shifts: Vec<f64> = seen
            .iter()
            .zip(partner)
            .filter_map(|(one, partner)| Some((one, &self.entries[(*partner)?])))
            .map(|(one, entry)| middle(&one.detection.box2d) - middle(&entry.expected))
            .collect();
        shifts.sort_by(f64::total_cmp);
        let median = *shifts.get(shifts.len() / 2).filter(|_| shifts.len() >= MIN_NODDED)?;
        (median.abs() > MIN_NOD_PX).then_some(median)
    }

    /// Whether enough of the tracks that were seen last are seen again.
    fn goes_on(&self, partner: &[Option<usize>]) -> bool {
        let expected = self.entries.iter().filter(|entry| entry.misses == 0).count();
        let found = partner.iter().flatten().filter(|&&place| self.entries[place].misses == 0).count();
        found as f64 >= SAME_SCENE * expected as f64
    }

    /// Detections become part of their tracks, or tracks of their own.
    fn take(&mut self, frame: &Frame, seen: &[Seen], partner: &[Option<usize>]) {
        for entry in &mut self.entries {
            entry.misses += 1;
        }
        for (one, partner) in seen.iter().zip(partner) {
            match partner {
                Some(place) => self.entries[*place].update(one, frame, &self.options),
                None if one.detection.score >= self.options.birth_score => {
                    self.entries.push(Entry::new(one, frame, &self.options));
                }
                None => {}
            }
        }
    }

    /// What is told from this frame on gets its identity: of a new scene everything.
    fn name(&mut self, is_new_scene: bool) {
        let birth_hits = if is_new_scene { 1 } else { self.options.birth_hits };
        // In the order of the detections, which is the same however they came.
        let mut born: Vec<&mut Entry> = self.entries.iter_mut().collect();
        born.sort_by(|a, b| a.first_seen(b));
        for entry in born.into_iter().filter(|entry| entry.id == 0 && entry.is_confirmed(birth_hits)) {
            entry.id = self.next_id;
            self.next_id += 1;
        }
    }

    /// Ends what is gone.
    fn end(&mut self, frame: &Frame) {
        let now = frame.time_s;
        let boxes: Vec<(Box2d, f64)> = self
            .entries
            .iter()
            .filter(|entry| entry.misses == 0)
            .map(|entry| (entry.expected, entry.filter.near_m()))
            .collect();
        for entry in self.entries.iter_mut().filter(|entry| entry.misses > 0) {
            let near_m = entry.filter.near_m();
            entry.is_hidden = boxes
                .iter()
                .any(|(other, other_m)| *other_m < near_m && covered_share_2d(&entry.expected, other) > HIDDEN_SHARE);
        }
        let TrackerOptions { birth_hits, max_lost_s, .. } = self.options;
        let [width, height] = frame.image_size.map(|side| side as f64);
        self.entries.retain(|entry| {
            let visible = entry.expected.clamped(width, height).area();
            let is_in_image = visible > MIN_IN_IMAGE * entry.expected.area();
            let may_miss = entry.is_confirmed(birth_hits) || entry.misses <= TENTATIVE_MISSES;
            entry.misses == 0 || (is_in_image && may_miss && now - entry.seen_s <= max_lost_s)
        });
    }

    fn told(&mut self, frame: &Frame) -> Vec<Track> {
        for entry in &mut self.entries {
            entry.closing = entry.closing(frame.time_s, &self.options);
        }
        let TrackerOptions { max_coast_s, max_hidden_s, .. } = self.options;
        let is_told = |entry: &&Entry| entry.id > 0 && entry.is_shown(frame.time_s, max_coast_s, max_hidden_s);
        let mut told: Vec<Track> =
            self.entries.iter().filter(is_told).map(|entry| entry.track(frame, &self.options)).collect();
        told.sort_by_key(|track| track.id);
        told
    }
}

impl Entry {
    fn new(one: &Seen, frame: &Frame, options: &TrackerOptions) -> Self {
        let filter = Filter::new(&one.measured, options);
        let Detection { class, score, box2d, .. } = one.detection;
        Self {
            id: 0,
            classes: vec![(class.clone(), *score)],
            score: *score,
            frames: 1,
            hits: 1,
            misses: 0,
            born_s: frame.time_s,
            seen_s: frame.time_s,
            is_hidden: false,
            anchor: Anchor::new(*box2d, &filter, frame.camera),
            window: ClosingWindow::default(),
            closing: None,
            expected: *box2d,
            filter,
        }
    }

    fn predict(&mut self, dt_s: f64, frame: &Frame, options: &TrackerOptions) {
        self.filter.predict(dt_s, options);
        self.frames += 1;
        self.expected = self.anchor.expected(&self.filter, frame.camera);
    }

    fn update(&mut self, one: &Seen, frame: &Frame, options: &TrackerOptions) {
        self.filter.update(&one.measured, &options.noise);
        let Detection { class, score, box2d, .. } = one.detection;
        match self.classes.iter_mut().find(|(known, _)| known == class) {
            Some((_, sum)) => *sum += score,
            None => self.classes.push((class.clone(), *score)),
        }
        self.score = *score;
        self.hits += 1;
        self.misses = 0;
        self.is_hidden = false;
        self.seen_s = frame.time_s;
        self.anchor = Anchor::new(*box2d, &self.filter, frame.camera);
        self.expected = *box2d;
    }

    /// Whether it was seen often enough to be believed; in a new scene all is told before that.
    fn is_confirmed(&self, birth_hits: u32) -> bool {
        self.hits >= birth_hits
    }

    /// What was seen for a short time only coasts for a share of it, and for less the more seldom it was seen in that
    /// time.
    fn is_shown(&self, now: f64, max_coast_s: f64, max_hidden_s: f64) -> bool {
        let (most_s, share) =
            if self.is_hidden { (max_hidden_s, HIDDEN_COAST_SHARE) } else { (max_coast_s, COAST_SHARE) };
        let seen_share = f64::from(self.hits) / (self.frames.saturating_sub(u64::from(self.misses)).max(1)) as f64;
        let known_s = (self.seen_s - self.born_s) * seen_share * seen_share;
        now - self.seen_s <= most_s.min(share * known_s)
    }

    /// Tracks in the order of their first frames, and of their boxes in it.
    fn first_seen(&self, other: &Self) -> Ordering {
        let key = |entry: &Self| [entry.born_s, -entry.score, entry.expected.x1, entry.expected.y1];
        compared(&key(self), &key(other))
    }

    fn class(&self) -> ObjectClass {
        let more = |a: &&(ObjectClass, f64), b: &&(ObjectClass, f64)| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0));
        self.classes.iter().max_by(more).map_or(ObjectClass::DontCare, |(class, _)| class.clone())
    }

    /// Counts that it may stand still, where the camera's own motion tells that from moving.
    fn may_stand_still(&mut self, frame: &Frame) {
        let Some(ego) = frame.ego.filter(|ego| ego.speed_mps > MIN_EGO_MPS) else { return };
        let walks = matches!(self.class(), ObjectClass::Pedestrian | ObjectClass::PersonSitting);
        self.filter.may_stand_still(&ego, if walks { Moving::WALKING } else { Moving::DRIVING });
    }

    /// What is known of its motion; none before it is.
    fn velocity(&self, time_s: f64, options: &TrackerOptions) -> Option<Velocity> {
        let ([vx, vz], [[xx, xz], [_, zz]]) = self.filter.ground_velocity();
        let sigmas = [xx.sqrt(), zz.sqrt()];
        let is_sure = sigmas.iter().zip(options.known_sigma_mps).all(|(sigma, known)| *sigma < known);
        let is_known = is_sure && self.hits >= KNOWN_HITS && time_s - self.born_s >= KNOWN_AFTER_S;
        is_known.then(|| Velocity {
            mps: [vx, 0.0, vz],
            sigma_mps: [sigmas[0], self.filter.vertical_sigma_mps(), sigmas[1]],
            covariance_xz: xz,
        })
    }

    /// How it comes nearer, once that is known.
    fn closing(&mut self, time_s: f64, options: &TrackerOptions) -> Option<Closing> {
        let Velocity { mps: [_, _, vz], sigma_mps: [_, _, sigma], .. } = self.velocity(time_s, options)?;
        let closing = Closing::new(-vz, sigma, self.filter.log_rate());
        Some(Closing {
            in_path: closing.ttc_s.map(|ttc_s| self.in_path(ttc_s, options.own_width_m)),
            // What coasts keeps its speed because nothing is known of it.
            acceleration: if self.misses == 0 { self.window.update(time_s, closing.mps, sigma) } else { None },
            ..closing
        })
    }

    /// Probability that it reaches into a way of this width straight ahead, after so many seconds.
    fn in_path(&self, ahead_s: f64, own_width_m: f64) -> f64 {
        let object = self.filter.box3d();
        let (sin, cos) = object.yaw.sin_cos();
        let across_m = cos.abs() * object.dimensions.length + sin.abs() * object.dimensions.width;
        let reach_m = f64::midpoint(own_width_m, across_m);
        let [aside_m, sigma_m] = self.filter.aside_after(ahead_s);
        let below = |edge_m: f64| 0.5 * (1.0 + libm::erf((edge_m - aside_m) / (f64::sqrt(2.0) * sigma_m)));
        below(reach_m) - below(-reach_m)
    }

    fn track(&self, frame: &Frame, options: &TrackerOptions) -> Track {
        let filter = &self.filter;
        let [width, height] = frame.image_size.map(|side| side as f64);
        Track {
            id: self.id,
            class: self.class(),
            score: self.score,
            age: self.frames,
            box2d: self.expected.clamped(width, height),
            box3d: filter.box3d(),
            range_sigma_m: filter.log_sigma() * filter.depth_m(),
            velocity: self.velocity(frame.time_s, options),
            closing: self.closing,
            coasting: self.misses > 0,
        }
    }
}

impl Anchor {
    fn new(box2d: Box2d, filter: &Filter, camera: &Camera) -> Self {
        Self { box2d, pixel: pixel(filter, camera), near_m: filter.near_m() }
    }

    /// Where the box is now: moved with its object, and larger as it comes nearer.
    fn expected(&self, filter: &Filter, camera: &Camera) -> Box2d {
        let [u, v] = pixel(filter, camera);
        let growth = self.near_m / filter.near_m();
        let x = |edge: f64| u + growth * (edge - self.pixel[0]);
        let y = |edge: f64| v + growth * (edge - self.pixel[1]);
        Box2d::new(x(self.box2d.x1), y(self.box2d.y1), x(self.box2d.x2), y(self.box2d.y2))
    }
}

/// The pixel of the object's location; depths of tracks are positive.
fn pixel(filter: &Filter, camera: &Camera) -> [f64; 2] {
    camera.pixel_from_point(filter.box3d().location).unwrap_or([0.0; 2])
}

fn compared(a: &[f64], b: &[f64]) -> Ordering {
    a.iter().zip(b).map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
}

/// The same order for the same detections: the highest score first.
fn order(a: &Detection, b: &Detection) -> Ordering {
    let numbers = |one: &Detection| {
        let Box2d { x1, y1, x2, y2 } = one.box2d;
        let [x, y, z] = one.box3d.location;
        [-one.score, x1, y1, x2, y2, z, x, y, one.box3d.yaw]
    };
    compared(&numbers(a), &numbers(b)).then_with(|| a.class.cmp(&b.class))
}

fn check_detection(place: usize, detection: &Detection) -> Result<(), TrackError> {
    let Detection { score, box2d, box3d, range_sigma_m, .. } = detection;
    let size = box3d.dimensions;
    let positive = [
        ("a depth of", box3d.depth_m()),
        ("a height in the image of", box2d.height()),
        ("a width in the image of", box2d.width()),
        ("a height of", size.height),
        ("a width of", size.width),
        ("a length of", size.length),
        ("an error bar of", range_sigma_m.unwrap_or(1.0)),
    ];
    let finite = [
        ("a score of", *score),
        ("an x of", box3d.location[0]),
        ("a y of", box3d.location[1]),
        ("a heading of", box3d.yaw),
        ("a left edge at", box2d.x1),
        ("a top edge at", box2d.y1),
    ];
    let wrong = positive
        .into_iter()
        .find(|(_, value)| !(value.is_finite() && *value > 0.0))
        .map(|wrong| (wrong, "positive number"))
        .or_else(|| finite.into_iter().find(|(_, value)| !value.is_finite()).map(|wrong| (wrong, "finite number")));
    wrong.map_or(Ok(()), |((what, value), expected)| Err(TrackError::Detection { place, what, value, expected }))
}
