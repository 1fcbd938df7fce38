//! Two ways to associate detections that trackers are compared with, written down in short.

use farsight::{Box2d, Detection, ObjectClass};
use farsight_core::overlap::{iou_2d, iou_3d};
use farsight_eval::tracks::PredictedTrack;
use farsight_track::assigned;

/// A Kalman filter of one coordinate and its rate: mean, and variances of the value, both, and the rate.
#[derive(Clone, Copy)]
struct Coordinate {
    value: f64,
    rate: f64,
    covariance: [f64; 3],
}

impl Coordinate {
    fn new(value: f64, sigma: f64, rate_sigma: f64) -> Self {
        Self { value, rate: 0.0, covariance: [sigma * sigma, 0.0, rate_sigma * rate_sigma] }
    }

    fn predict(&mut self, dt_s: f64, value_noise: f64, rate_noise: f64) {
        self.value += dt_s * self.rate;
        let [a, b, c] = self.covariance;
        self.covariance = [a + 2.0 * dt_s * b + dt_s * dt_s * c + value_noise, b + dt_s * c, c + rate_noise];
    }

    fn update(&mut self, seen: f64, sigma: f64) {
        let [a, b, c] = self.covariance;
        let all = a + sigma * sigma;
        let (gain, rate_gain, off) = (a / all, b / all, seen - self.value);
        self.value += gain * off;
        self.rate += rate_gain * off;
        self.covariance = [a - gain * a, b - gain * b, c - rate_gain * b];
    }
}

/// Somebody who is followed.
struct Entry {
    id: u64,
    state: [Coordinate; 3],
    image: [Coordinate; 4],
    last: Detection,
    hits: u32,
    misses: u32,
}

fn corners(area: &Box2d) -> [f64; 4] {
    [area.x1, area.y1, area.x2, area.y2]
}

impl Entry {
    fn new(id: u64, seen: &Detection) -> Self {
        let height = seen.box2d.height();
        Self {
            id,
            state: seen.box3d.location.map(|value| Coordinate::new(value, 1.0, 10.0)),
            image: corners(&seen.box2d).map(|value| Coordinate::new(value, height / 10.0, height)),
            last: seen.clone(),
            hits: 1,
            misses: 0,
        }
    }

    fn predict(&mut self, dt_s: f64) {
        let height = self.last.box2d.height();
        self.state.iter_mut().for_each(|one| one.predict(dt_s, 0.01, 0.1));
        self.image.iter_mut().for_each(|one| one.predict(dt_s, (height / 20.0).powi(2), (height / 16.0).powi(2)));
        self.misses += 1;
    }

    fn update(&mut self, seen: &Detection) {
        for (one, value) in self.state.iter_mut().zip(seen.box3d.location) {
            one.update(value, 1.0);
        }
        for (one, value) in self.image.iter_mut().zip(corners(&seen.box2d)) {
            one.update(value, seen.box2d.height() / 20.0);
        }
        (self.last, self.hits, self.misses) = (seen.clone(), self.hits + 1, 0);
    }

    fn expected(&self) -> Detection {
        let [x1, y1, x2, y2] = self.image.map(|one| one.value);
        let mut expected = self.last.clone();
        expected.box3d.location = self.state.map(|one| one.value);
        expected.box2d = Box2d::new(x1, y1, x2, y2);
        expected
    }

    fn told(&self, is_filtered: bool) -> PredictedTrack {
        let mut box3d = self.last.box3d;
        if is_filtered {
            box3d.location = self.state.map(|one| one.value);
        }
        PredictedTrack {
            id: self.id,
            class: self.last.class.clone(),
            box2d: self.last.box2d,
            box3d,
            range_sigma_m: None,
            closing_mps: None,
            ttc_s: None,
            ttc_interval_s: None,
            speed_mps: None,
        }
    }
}

/// Which of the two.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    /// AB3DMOT (Weng et al., IROS 2020): constant velocity in space, overlap of boxes in space, two frames of patience,
    /// three detections before a track is told (but in the first frames).
    Ab3dMot,
    /// `ByteTrack` (Zhang et al., ECCV 2022): constant velocity in the image, overlap there, low scores second, a
    /// second of patience.
    ByteTrack,
}

/// Follows the frames of one sequence.
pub(crate) struct Baseline {
    kind: Kind,
    entries: Vec<Entry>,
    next: u64,
    frame: u32,
}

impl Baseline {
    pub(crate) fn new(kind: Kind) -> Self {
        Self { kind, entries: Vec::new(), next: 1, frame: 0 }
    }

    pub(crate) fn update(
        &mut self,
        dt_s: f64,
        detections: &[Detection],
        class: &ObjectClass,
        birth: f64,
    ) -> Vec<PredictedTrack> {
        self.frame += 1;
        self.entries.iter_mut().for_each(|entry| entry.predict(dt_s));
        let mut of_class: Vec<&Detection> = detections.iter().filter(|one| one.class == *class).collect();
        of_class.sort_by(|a, b| b.score.total_cmp(&a.score));
        let (high, low): (Vec<&Detection>, Vec<&Detection>) = of_class.into_iter().partition(|one| one.score >= birth);
        let least = if self.kind == Kind::Ab3dMot { 0.01 } else { 0.2 };
        let free = self.stage(&high, least, |_| true);
        if self.kind == Kind::ByteTrack {
            // What was seen in the last frame only.
            self.stage(&low, 0.5, |entry| entry.misses == 1);
        }
        for place in free {
            self.entries.push(Entry::new(self.next, high[place]));
            self.next += 1;
        }
        let patience = if self.kind == Kind::Ab3dMot { 2 } else { (1.0 / dt_s.max(1e-3)).round() as u32 };
        self.entries.retain(|entry| entry.misses <= patience);
        let (hits, frame) = (if self.kind == Kind::Ab3dMot { 3 } else { 2 }, self.frame);
        let is_told = |entry: &&Entry| entry.misses == 0 && (entry.hits >= hits || frame <= hits);
        self.entries.iter().filter(is_told).map(|entry| entry.told(self.kind == Kind::Ab3dMot)).collect()
    }

    /// Matches what may be matched; the places of detections that are left.
    fn stage(&mut self, seen: &[&Detection], least: f64, may: impl Fn(&Entry) -> bool) -> Vec<usize> {
        let rows: Vec<usize> =
            (0..self.entries.len()).filter(|&row| self.entries[row].misses > 0 && may(&self.entries[row])).collect();
        let cost = |entry: &Entry, one: &Detection| {
            let expected = entry.expected();
            let overlap = match self.kind {
                Kind::Ab3dMot => iou_3d(&expected.box3d, &one.box3d),
                Kind::ByteTrack => iou_2d(&expected.box2d, &one.box2d),
            };
            if overlap >= least { 1.0 - overlap } else { f64::INFINITY }
        };
        let costs: Vec<Vec<f64>> =
            rows.iter().map(|&row| seen.iter().map(|one| cost(&self.entries[row], one)).collect()).collect();
        let mut taken = vec![false; seen.len()];
        for (&row, column) in rows.iter().zip(assigned(&costs)) {
            if let Some(column) = column {
                taken[column] = true;
                self.entries[row].update(seen[column]);
            }
        }
        (0..seen.len()).filter(|&place| !taken[place]).collect()
    }
}
