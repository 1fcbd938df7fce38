//! How good tracks are: HOTA, CLEAR and identity metrics, equal to `TrackEval`'s.
//!
//! HOTA: Luiten et al., IJCV 2021. CLEAR: Bernardin and Stiefelhagen, 2008. Identity: Ristani et al., 2016. What counts
//! as a match is the caller's choice: [`TrackedFrame::similarities`] may be overlaps of boxes or nearness in metres.

use std::collections::BTreeMap;

use farsight_track::assigned;

/// One frame: who is there, who is told of, and how alike they are.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TrackedFrame {
    /// Identities that are there, each once.
    pub truth: Vec<u64>,
    /// Identities that are told, each once.
    pub told: Vec<u64>,
    /// Similarity from 0 to 1 of each that is there (rows) with each that is told (columns).
    pub similarities: Vec<Vec<f64>>,
}

/// The metrics of one sequence; shares, not per cent.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct TrackingMetrics {
    /// Higher order tracking accuracy, and its parts: detection, association, localisation; means over [`ALPHAS`].
    pub hota: f64,
    /// Detection accuracy.
    pub det_a: f64,
    /// Association accuracy.
    pub ass_a: f64,
    /// Localisation accuracy.
    pub loc_a: f64,
    /// CLEAR's accuracy; may be negative.
    pub mota: f64,
    /// CLEAR's precision: mean similarity of matches.
    pub motp: f64,
    /// Identity switches.
    pub switches: u64,
    /// Times that a track of the truth was lost and found again.
    pub fragments: u64,
    /// Objects that are matched in more than 80% of their frames.
    pub mostly_tracked: u64,
    /// Objects that are matched in 20 to 80% of their frames.
    pub partially_tracked: u64,
    /// Objects that are matched in fewer.
    pub mostly_lost: u64,
    /// F1 of identities.
    pub idf1: f64,
    /// Identity recall and precision.
    pub id_recall: f64,
    /// Identity precision.
    pub id_precision: f64,
}

/// Thresholds of similarity that HOTA is the mean over.
pub const ALPHAS: usize = 19;

/// Least similarity of a match for CLEAR and identity metrics.
pub const MATCH_SIMILARITY: f64 = 0.5;

/// Shares of an object's frames in which it is matched: more than the first is mostly tracked, from the second on
/// partially.
const MOSTLY_TRACKED: f64 = 0.8;
const PARTIALLY_TRACKED: f64 = 0.2;

/// What keeps its match does so before anything else, as in `TrackEval`.
const KEEP: f64 = 1000.0;

/// Metrics of a sequence.
pub fn tracking_metrics(frames: &[TrackedFrame]) -> TrackingMetrics {
    let counts = Counts::of(frames);
    let (hota, det_a, ass_a, loc_a) = hota(frames, &counts);
    let Clear { matched, missed, wrong, similarity, switches, fragments, matched_of } = clear(frames);
    let share = |(id, place): (&u64, &usize)| matched_of.get(id).unwrap_or(&0.0) / counts.truth[*place];
    let shares: Vec<f64> = counts.truth_place.iter().map(share).collect();
    let count = |is: fn(f64) -> bool| shares.iter().filter(|share| is(**share)).count() as u64;
    let mostly_tracked = count(|share| share > MOSTLY_TRACKED);
    let partially_tracked = count(|share| share >= PARTIALLY_TRACKED) - mostly_tracked;
    let id_matched = id_matched(frames, &counts);
    let [truth, told] = [counts.truth.iter().sum::<f64>(), counts.told.iter().sum::<f64>()];
    TrackingMetrics {
        hota,
        det_a,
        ass_a,
        loc_a,
        mota: (matched - wrong - switches as f64) / (matched + missed).max(1.0),
        motp: similarity / matched.max(1.0),
        switches,
        fragments,
        mostly_tracked,
        partially_tracked,
        mostly_lost: shares.len() as u64 - mostly_tracked - partially_tracked,
        idf1: id_matched / f64::midpoint(truth, told).max(1.0),
        id_recall: id_matched / truth.max(1.0),
        id_precision: id_matched / told.max(1.0),
    }
}

/// Frames of each identity, and places of the identities in those.
struct Counts {
    truth_place: BTreeMap<u64, usize>,
    told_place: BTreeMap<u64, usize>,
    truth: Vec<f64>,
    told: Vec<f64>,
}

impl Counts {
    fn of(frames: &[TrackedFrame]) -> Self {
        let counted = |identities: &dyn Fn(&TrackedFrame) -> Vec<u64>| {
            let mut counts = BTreeMap::new();
            frames.iter().flat_map(identities).for_each(|identity| *counts.entry(identity).or_insert(0.0) += 1.0);
            let places = counts.keys().enumerate().map(|(place, identity)| (*identity, place)).collect();
            (places, counts.into_values().collect())
        };
        let (truth_place, truth) = counted(&|frame| frame.truth.clone());
        let (told_place, told) = counted(&|frame| frame.told.clone());
        Self { truth_place, told_place, truth, told }
    }

    /// A number for each pair of identities.
    fn pairs(&self) -> Vec<Vec<f64>> {
        vec![vec![0.0; self.told.len()]; self.truth.len()]
    }

    /// Places of the identities of a frame.
    fn places(&self, frame: &TrackedFrame) -> (Vec<usize>, Vec<usize>) {
        let places =
            |identities: &[u64], places: &BTreeMap<u64, usize>| identities.iter().map(|id| places[id]).collect();
        (places(&frame.truth, &self.truth_place), places(&frame.told, &self.told_place))
    }
}

/// The pairs (row, column) of the assignment with the highest sum of scores, which are at least 0.
fn best(scores: &[Vec<f64>]) -> Vec<(usize, usize)> {
    let costs: Vec<Vec<f64>> = scores.iter().map(|row| row.iter().map(|score| 1.0 - score).collect()).collect();
    assigned(&costs).into_iter().enumerate().filter_map(|(row, column)| Some((row, column?))).collect()
}

fn hota(frames: &[TrackedFrame], counts: &Counts) -> (f64, f64, f64, f64) {
    // How often a pair could be one, softly: how well its identities go together over all frames.
    let mut together = counts.pairs();
    for frame in frames {
        let (truth, told) = counts.places(frame);
        let rows: Vec<f64> = frame.similarities.iter().map(|row| row.iter().sum()).collect();
        let column = |place: usize| frame.similarities.iter().map(|row| row[place]).sum::<f64>();
        let columns: Vec<f64> = (0..told.len()).map(column).collect();
        for (i, &row) in truth.iter().enumerate() {
            for (j, &column) in told.iter().enumerate() {
                let similarity = frame.similarities[i][j];
                let all = rows[i] + columns[j] - similarity;
                together[row][column] += if all > f64::EPSILON { similarity / all } else { 0.0 };
            }
        }
    }
    let alignment = |i: usize, j: usize| together[i][j] / (counts.truth[i] + counts.told[j] - together[i][j]);
    let mut levels: Vec<Level> = (1..=ALPHAS).map(|step| Level::new(0.05 * step as f64, counts)).collect();
    for frame in frames {
        let (truth, told) = counts.places(frame);
        let score = |i: usize, j: usize| alignment(truth[i], told[j]) * frame.similarities[i][j];
        let scores: Vec<Vec<f64>> = (0..truth.len()).map(|i| (0..told.len()).map(|j| score(i, j)).collect()).collect();
        for (i, j) in best(&scores) {
            let similarity = frame.similarities[i][j];
            for level in levels.iter_mut().filter(|level| similarity >= level.alpha - f64::EPSILON) {
                level.matched += 1.0;
                level.located += similarity;
                level.matches[truth[i]][told[j]] += 1.0;
            }
        }
    }
    let values: Vec<[f64; 4]> = levels.iter().map(|level| level.values(counts)).collect();
    let [hota, detection, association, location] =
        [0, 1, 2, 3].map(|place| values.iter().map(|value| value[place]).sum::<f64>() / ALPHAS as f64);
    (hota, detection, association, location)
}

/// What HOTA counts at one threshold.
struct Level {
    alpha: f64,
    matched: f64,
    /// Sum of the similarities of matches.
    located: f64,
    /// Matches of each pair of identities.
    matches: Vec<Vec<f64>>,
}

impl Level {
    fn new(alpha: f64, counts: &Counts) -> Self {
        Self { alpha, matched: 0.0, located: 0.0, matches: counts.pairs() }
    }

    /// HOTA and its parts: detection, association, localisation.
    fn values(&self, counts: &Counts) -> [f64; 4] {
        let [truth, told] = [counts.truth.iter().sum::<f64>(), counts.told.iter().sum::<f64>()];
        let mut associated = 0.0;
        for (row, truth) in self.matches.iter().zip(&counts.truth) {
            for (count, told) in row.iter().zip(&counts.told) {
                associated += count * count / (truth + told - count).max(1.0);
            }
        }
        let association = associated / self.matched.max(1.0);
        let detection = self.matched / (truth + told - self.matched).max(1.0);
        let location = self.located.max(1e-10) / self.matched.max(1e-10);
        [(detection * association).sqrt(), detection, association, location]
    }
}

#[derive(Debug, Default)]
struct Clear {
    matched: f64,
    missed: f64,
    wrong: f64,
    similarity: f64,
    switches: u64,
    fragments: u64,
    /// Frames in which each object is matched.
    matched_of: BTreeMap<u64, f64>,
}

fn clear(frames: &[TrackedFrame]) -> Clear {
    let mut clear = Clear::default();
    // Whom each identity was matched with: last time, and in the last frame with both truth and tracks.
    let (mut ever, mut before) = (BTreeMap::new(), BTreeMap::new());
    let mut begun: BTreeMap<u64, u64> = BTreeMap::new();
    for TrackedFrame { truth, told, similarities } in frames {
        if truth.is_empty() || told.is_empty() {
            clear.missed += truth.len() as f64;
            clear.wrong += told.len() as f64;
            continue;
        }
        let score = |i: usize, j: usize| {
            let similarity = similarities[i][j];
            let keeps = before.get(&truth[i]) == Some(&told[j]);
            if similarity < MATCH_SIMILARITY - f64::EPSILON { 0.0 } else { similarity + if keeps { KEEP } else { 0.0 } }
        };
        let scores: Vec<Vec<f64>> = (0..truth.len()).map(|i| (0..told.len()).map(|j| score(i, j)).collect()).collect();
        let mut now = BTreeMap::new();
        for (i, j) in best(&scores).into_iter().filter(|&(i, j)| scores[i][j] > f64::EPSILON) {
            let last = ever.insert(truth[i], told[j]);
            clear.switches += u64::from(last.is_some_and(|last| last != told[j]));
            if !before.contains_key(&truth[i]) {
                *begun.entry(truth[i]).or_insert(0) += 1;
            }
            clear.similarity += similarities[i][j];
            now.insert(truth[i], told[j]);
            *clear.matched_of.entry(truth[i]).or_insert(0.0) += 1.0;
        }
        let matched = now.len() as f64;
        clear.matched += matched;
        clear.missed += truth.len() as f64 - matched;
        clear.wrong += told.len() as f64 - matched;
        before = now;
    }
    clear.fragments = begun.values().map(|times| times - 1).sum();
    clear
}

/// Frames in which the best one-to-one assignment of identities over the whole sequence holds.
fn id_matched(frames: &[TrackedFrame], counts: &Counts) -> f64 {
    let mut possible = counts.pairs();
    for frame in frames {
        let (truth, told) = counts.places(frame);
        for (i, &row) in truth.iter().enumerate() {
            for (j, &column) in told.iter().enumerate() {
                possible[row][column] += f64::from(u8::from(frame.similarities[i][j] >= MATCH_SIMILARITY));
            }
        }
    }
    best(&possible).into_iter().map(|(i, j)| possible[i][j]).sum()
}
