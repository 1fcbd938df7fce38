//! Of what a flow is: of the road, of something else that stands still, or wrong.

use crate::motion::Warp;

/// Where a patch is seen and where it is found again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Flow {
    /// Direction in the first frame, with z = 1.
    pub(crate) ray: [f64; 3],
    /// Place in the second picture, pixels.
    pub(crate) to: [f64; 2],
    /// Of the place: xx, xy, yy, pixels².
    pub(crate) covariance: [f64; 3],
    /// Whether it begins in the road's region, by the motion that was expected: a motion that is being tried is not to
    /// choose what it is judged by.
    pub(crate) is_low: bool,
}

/// The road is looked at so far ahead and to each side, metres.
const ROAD_AHEAD_M: f64 = 20.0;
const ROAD_ASIDE_M: f64 = 7.0;

/// How well a flow in the road's region fits roads: shares of road, of other things that stand, and of what is wrong.
/// The same for other flows.
const SHARES_LOW: [f64; 3] = [0.6, 0.25, 0.15];
const SHARES_HIGH: [f64; 3] = [0.0, 0.75, 0.25];

/// How far roads leave their plane, metres, and metres a metre ahead.
const UNEVEN_M: f64 = 0.03;
const BENT: f64 = 0.003;

/// Inverse depths of what stands, less that of the road in the same direction: mean and standard deviation, 1/m.
pub(crate) const STANDING: [f64; 2] = [0.03, 0.07];

/// Roads end at this inverse depth, 1/m.
const LEAST_RHO: f64 = 0.01;

/// Wrong flows end anywhere within so many pixels squared.
const WRONG_PX2: f64 = 50.0 * 50.0;

/// Indices of the two kinds that tell something.
pub(crate) const ROAD: usize = 0;
pub(crate) const STAND: usize = 1;

/// A flow under the assumption of one kind.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fitted {
    /// Inverse depth that is most likely.
    pub(crate) rho: f64,
    /// Seen less expected there, pixels.
    pub(crate) off: [f64; 2],
    /// Inverse of the covariance of that: xx, xy, yy.
    pub(crate) precision: [f64; 3],
    /// The square of the deviation from what was likeliest before, in standard deviations.
    pub(crate) squared: f64,
    log_density: f64,
}

impl Fitted {
    /// Of a point with this inverse depth (and its standard deviation).
    fn new(flow: &Flow, warp: &Warp, [rho, sigma]: [f64; 2]) -> Option<Self> {
        let (pixel, by_rho) = warp.pixel(&flow.ray, rho)?;
        let [a, b] = by_rho.map(|v| v * sigma);
        let [xx, xy, yy] = [flow.covariance[0] + a * a, flow.covariance[1] + a * b, flow.covariance[2] + b * b];
        let determinant = xx * yy - xy * xy;
        let precision = [yy / determinant, -xy / determinant, xx / determinant];
        let off = [flow.to[0] - pixel[0], flow.to[1] - pixel[1]];
        let squared = squared(&off, &precision);
        let log_density = -0.5 * (squared + determinant.ln()) - std::f64::consts::TAU.ln();
        (determinant > 0.0).then_some(Self { rho, off, precision, squared, log_density })
    }

    /// At the inverse depth that this flow itself asks for, which is not below 0; from then on it pulls at nothing but
    /// what no depth explains.
    fn at_own_depth(mut self, flow: &Flow, warp: &Warp, sigma: f64) -> Option<Self> {
        let (_, [a, b]) = warp.pixel(&flow.ray, self.rho)?;
        let ([x, y], [xx, xy, yy]) = (self.off, self.precision);
        let change = sigma * sigma * (a * (xx * x + xy * y) + b * (xy * x + yy * y));
        self.rho = (self.rho + change).max(0.0);
        let (pixel, _) = warp.pixel(&flow.ray, self.rho)?;
        self.off = [flow.to[0] - pixel[0], flow.to[1] - pixel[1]];
        Some(self)
    }
}

fn squared([x, y]: &[f64; 2], [xx, xy, yy]: &[f64; 3]) -> f64 {
    xx * x * x + 2.0 * xy * x * y + yy * y * y
}

/// Whether a ray ends on the part of the road that is looked at, by its inverse depth there.
pub(crate) fn is_low(ray: &[f64; 3], rho: f64) -> bool {
    rho > 1.0 / ROAD_AHEAD_M && ray[0].abs() < ROAD_ASIDE_M * rho
}

/// A flow as road (`fitted[ROAD]`) and as something else that stands (`fitted[STAND]`), each with its probability.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Assessment {
    pub(crate) fitted: [Option<Fitted>; 2],
    pub(crate) shares: [f64; 2],
    pub(crate) log_likelihood: f64,
}

impl Assessment {
    /// The log likelihood of a flow that is wrong.
    pub(crate) fn wrong() -> f64 {
        -WRONG_PX2.ln()
    }

    /// By this motion, `height_m` above the road.
    pub(crate) fn new(flow: &Flow, warp: &Warp, height_m: f64) -> Self {
        let rho = warp.road(&flow.ray);
        let usual = if flow.is_low { SHARES_LOW } else { SHARES_HIGH };
        let on_road = || {
            let share = (UNEVEN_M / height_m).hypot(BENT / (rho * height_m));
            Fitted::new(flow, warp, [rho, share * rho])
        };
        let fitted = [
            (flow.is_low && rho > LEAST_RHO).then(on_road).flatten(),
            Fitted::new(flow, warp, [STANDING[0] + rho.max(0.0), STANDING[1]])
                .and_then(|fitted| fitted.at_own_depth(flow, warp, STANDING[1])),
        ];
        let densities = [ROAD, STAND].map(|k| fitted[k].map_or(0.0, |fitted| usual[k] * fitted.log_density.exp()));
        let all = densities[0] + densities[1] + usual[2] / WRONG_PX2;
        Self { fitted, shares: densities.map(|density| density / all), log_likelihood: all.ln() }
    }
}
