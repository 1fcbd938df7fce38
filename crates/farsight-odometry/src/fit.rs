//! The likeliest motion.

use farsight_core::linear::solved;

use crate::mixture::{Assessment, Fitted, Flow, ROAD, STAND};
use crate::motion::{AHEAD, COUNT, Motion, Pinhole, Warp};
use crate::prior::Prior;

/// Motions that are tried beside the expected one, also where nothing is known of the last frame; and of how many flows
/// of the road's region and of all each is made.
const TRIES: usize = 12;
const FIRST_TRIES: usize = 40;
const FLOWS_OF_TRY: [usize; 2] = [2, 1];

/// Steps of Gauss and Newton's method for a try, and in the end.
const STEPS_OF_TRY: usize = 3;
const STEPS: usize = 10;

/// Steps by which derivatives are taken.
const DELTAS: Motion = [1e-5, 1e-5, 1e-5, 1e-3, 1e-3, 1e-3, 1e-4, 1e-4];

/// A step this small, in standard deviations, is the last one.
const SMALL_STEP: f64 = 0.01;

/// Errors of neighbouring flows are alike, and the mixture is no truth: variances are so many times those of
/// independent flows. Chosen on rendered sequences.
const ALIKE: f64 = 4.0;

/// Less likely kinds of a flow do not count.
const LEAST_SHARE: f64 = 0.01;

type Matrix = [[f64; COUNT]; COUNT];

/// What is fitted to.
#[derive(Clone, Copy)]
pub(crate) struct Problem<'a> {
    pub(crate) flows: &'a [Flow],
    pub(crate) pinhole: &'a Pinhole,
    pub(crate) height_m: f64,
    pub(crate) prior: &'a Prior,
    /// Whether nothing is known of the last frame.
    pub(crate) is_first: bool,
}

/// The likeliest motion.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    pub(crate) motion: Motion,
    pub(crate) sigma: Motion,
    /// Standard deviation of the way ahead by these two pictures alone, metres.
    pub(crate) own_ahead_sigma: f64,
    /// How many flows are of the road and of other things that stand.
    pub(crate) on_road: f64,
    pub(crate) standing: f64,
    /// How many flows are in the road's region.
    pub(crate) low: usize,
    /// How much likelier it is than that all flows are wrong, a logarithm.
    pub(crate) gain: f64,
}

/// What a flow of the road is worth beside its likelihood, where all of its region fit: only the road tells a speed. So
/// many are enough: what lies still in the picture, as dirt and the blocks of compression do, has many.
const ROAD_WORTH: f64 = 20.0;
const ENOUGH_ON_ROAD: f64 = 10.0;

impl Fit {
    /// How much speaks for its speed, against fits to other flows.
    pub(crate) fn evidence(&self) -> f64 {
        self.gain + ROAD_WORTH * self.on_road.min(ENOUGH_ON_ROAD) * self.on_road / (self.low as f64).max(1.0)
    }
}

/// Gradient and curvature of what is to be as small as possible.
struct Demand {
    gradient: Motion,
    curvature: Matrix,
}

impl Problem<'_> {
    /// From the expected motion, from `start`, and from some that a few flows suggest.
    pub(crate) fn fit(&self, start: Option<&Motion>) -> Option<Fit> {
        let mut best = (f64::NEG_INFINITY, self.prior.mean);
        let mut chance = Chance(0x2545_F491_4F6C_DD1D);
        let low: Vec<usize> = (0..self.flows.len()).filter(|&place| self.flows[place].is_low).collect();
        let count = if self.is_first { FIRST_TRIES } else { TRIES };
        let tries = (0..count).filter_map(|_| self.suggested(&low, &mut chance));
        for motion in start.copied().into_iter().chain([self.prior.mean]).chain(tries) {
            let (score, _) = self.assessed(&motion);
            if score > best.0 {
                best = (score, motion);
            }
        }
        let (mut score, mut motion) = best;
        let mut assessments = self.assessed(&motion).1;
        for _ in 0..STEPS {
            let demand = self.demand(&motion, &assessments);
            let step = solved(demand.curvature, demand.gradient)?;
            // Half of it where all of it leads astray.
            let better = [1.0, 0.5, 0.2].into_iter().find_map(|share| {
                let next: Motion = std::array::from_fn(|k| motion[k] + share * step[k]);
                let (next_score, assessments) = self.assessed(&next);
                (next_score > score).then_some((next, next_score, assessments))
            });
            let Some((next, next_score, next_assessments)) = better else { break };
            let is_small = (0..COUNT).all(|k| (next[k] - motion[k]).abs() < SMALL_STEP * self.prior.sigma[k]);
            let gained = next_score - score;
            (motion, score, assessments) = (next, next_score, next_assessments);
            if is_small && gained < SMALL_STEP {
                break;
            }
        }
        self.finished(motion, &assessments)
    }

    fn finished(&self, motion: Motion, assessments: &[Assessment]) -> Option<Fit> {
        let Demand { mut curvature, .. } = self.demand(&motion, assessments);
        let share = |kind: usize| assessments.iter().map(|one| one.shares[kind]).sum::<f64>();
        let (on_road, standing) = (share(ROAD), share(STAND));
        let likelier: f64 = assessments.iter().map(|one| one.log_likelihood - Assessment::wrong()).sum();
        let gain = self.prior.log_likelihood(&motion) + likelier;
        let squares: f64 = assessments
            .iter()
            .flat_map(|one| one.fitted.iter().zip(one.shares))
            .filter_map(|(fitted, share)| Some(share * fitted.as_ref()?.squared))
            .sum();
        let misfit = (squares / (2.0 * (on_road + standing)).max(1.0)).max(1.0);
        // What the flows say counts less, what was known before does not.
        for (k, row) in curvature.iter_mut().enumerate() {
            row[k] -= self.prior.precision(k);
            for value in row.iter_mut() {
                *value /= ALIKE * misfit;
            }
            row[k] += self.prior.precision(k);
        }
        let variance = |matrix: Matrix, k: usize| {
            let unit: Motion = std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
            solved(matrix, unit).map(|column| column[k]).filter(|variance| variance.is_finite() && *variance > 0.0)
        };
        let mut sigma = [0.0; COUNT];
        for (k, sigma) in sigma.iter_mut().enumerate() {
            *sigma = variance(curvature, k)?.sqrt();
        }
        let mut own = curvature;
        own[AHEAD][AHEAD] -= self.prior.precision(AHEAD) * (1.0 - 1e-6);
        let own_ahead_sigma = variance(own, AHEAD)?.sqrt();
        let low = self.flows.iter().filter(|flow| flow.is_low).count();
        let is_finite = motion.iter().all(|v| v.is_finite());
        is_finite.then_some(Fit { motion, sigma, own_ahead_sigma, on_road, standing, low, gain })
    }

    fn warp(&self, motion: &Motion) -> Warp {
        Warp::new(motion, self.pinhole, self.height_m)
    }

    fn warps(&self, motion: &Motion) -> [Warp; COUNT] {
        std::array::from_fn(|k| {
            let mut moved = *motion;
            moved[k] += DELTAS[k];
            self.warp(&moved)
        })
    }

    /// How likely a motion is (a logarithm), and of what each flow then is.
    fn assessed(&self, motion: &Motion) -> (f64, Vec<Assessment>) {
        let warp = self.warp(motion);
        let all: Vec<Assessment> = self.flows.iter().map(|flow| Assessment::new(flow, &warp, self.height_m)).collect();
        (self.prior.log_likelihood(motion) + all.iter().map(|one| one.log_likelihood).sum::<f64>(), all)
    }

    fn demand_of_prior(&self, motion: &Motion) -> Demand {
        let mut curvature = [[0.0; COUNT]; COUNT];
        for (k, row) in curvature.iter_mut().enumerate() {
            row[k] = self.prior.precision(k);
        }
        Demand {
            gradient: std::array::from_fn(|k| self.prior.precision(k) * (self.prior.mean[k] - motion[k])),
            curvature,
        }
    }

    fn demand(&self, motion: &Motion, assessments: &[Assessment]) -> Demand {
        let mut demand = self.demand_of_prior(motion);
        let warps = self.warps(motion);
        for (flow, one) in self.flows.iter().zip(assessments) {
            for kind in [ROAD, STAND] {
                if let Some(fitted) = one.fitted[kind].filter(|_| one.shares[kind] > LEAST_SHARE) {
                    demand.add(flow, kind, &fitted, one.shares[kind], &warps);
                }
            }
        }
        demand
    }

    /// The motion that a few flows suggest, those of the road's region (`low`) as road.
    fn suggested(&self, low: &[usize], chance: &mut Chance) -> Option<Motion> {
        let mut motion: Motion = std::array::from_fn(|k| self.prior.mean[k] + self.prior.sigma[k] * chance.normal());
        let mut chosen = Vec::new();
        for of_all in [false, true] {
            for _ in 0..FLOWS_OF_TRY[usize::from(of_all)] {
                let place = chance.below(if of_all { self.flows.len() } else { low.len() });
                let place = if of_all { Some(&place) } else { low.get(place) };
                chosen.extend(place.map(|&place| (place, chance.below(4) > 0)));
            }
        }
        for _ in 0..STEPS_OF_TRY {
            let (warp, warps) = (self.warp(&motion), self.warps(&motion));
            let mut demand = self.demand_of_prior(&motion);
            for &(place, may_be_road) in &chosen {
                let flow = &self.flows[place];
                let is_road = may_be_road && flow.is_low;
                let kind = if is_road { ROAD } else { STAND };
                let fitted = Assessment::new(flow, &warp, self.height_m).fitted[kind]?;
                demand.add(flow, kind, &fitted, 1.0, &warps);
            }
            let step = solved(demand.curvature, demand.gradient)?;
            motion = std::array::from_fn(|k| motion[k] + step[k]);
        }
        motion.iter().all(|v| v.is_finite()).then_some(motion)
    }
}

impl Demand {
    /// Adds what a flow asks for as one kind.
    fn add(&mut self, flow: &Flow, kind: usize, fitted: &Fitted, share: f64, warps: &[Warp; COUNT]) {
        let expected = [flow.to[0] - fitted.off[0], flow.to[1] - fitted.off[1]];
        let mut slopes = [[0.0; 2]; COUNT];
        for (k, warp) in warps.iter().enumerate() {
            // How far what stands is away is not known, so it tells no speed.
            if kind == STAND && k == AHEAD {
                continue;
            }
            let rho = if kind == ROAD { warp.road(&flow.ray) } else { fitted.rho };
            let Some((pixel, _)) = warp.pixel(&flow.ray, rho) else { return };
            slopes[k] = [0, 1].map(|axis| (pixel[axis] - expected[axis]) / DELTAS[k]);
        }
        let [xx, xy, yy] = fitted.precision.map(|v| v * share);
        let [x, y] = fitted.off;
        let pull = [xx * x + xy * y, xy * x + yy * y];
        for (k, [a, b]) in slopes.into_iter().enumerate() {
            self.gradient[k] += a * pull[0] + b * pull[1];
            let weighted = [xx * a + xy * b, xy * a + yy * b];
            for (entry, slope) in self.curvature[k].iter_mut().zip(&slopes) {
                *entry += weighted[0] * slope[0] + weighted[1] * slope[1];
            }
        }
    }
}

/// Draws that are the same for the same pictures (xorshift).
struct Chance(u64);

impl Chance {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() >> 33) as usize % count.max(1)
    }

    /// Nearly normal: the sum of four uniform draws, standard deviation 1.
    fn normal(&mut self) -> f64 {
        let sum: f64 = (0..4).map(|_| (self.next() >> 11) as f64 / (1_u64 << 53) as f64).sum();
        (sum - 2.0) * 3.0_f64.sqrt()
    }
}
