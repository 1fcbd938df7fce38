//! The ground's height.

use crate::rng::SceneRng;

/// Beyond this distance the ground goes on straight, metres.
const STRAIGHT_BEYOND_M: f64 = 70.0;

/// A gently sloping ground: `y = at_camera + across x + along z + bend z^2 + twist x z`, straight beyond some distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ground {
    pub(crate) at_camera: f64,
    pub(crate) across: f64,
    pub(crate) along: f64,
    pub(crate) bend: f64,
    pub(crate) twist: f64,
}

impl Ground {
    /// Slopes of about 1 percent and bends of some decimetres over 50 m: the bottoms of the drawn cars spread about as
    /// those of KITTI's labels do (`label_statistics`: 1.1 to 2.3 m below the camera for nine in ten).
    pub(crate) fn sample(at_camera: f64, rng: &mut SceneRng) -> Self {
        if rng.chance(0.2) {
            return Self { at_camera, across: 0.0, along: 0.0, bend: 0.0, twist: 0.0 };
        }
        let mut slope = |deviation: f64| rng.normal(0.0, deviation).clamp(-2.5 * deviation, 2.5 * deviation);
        Self { at_camera, across: slope(0.009), along: slope(0.008), bend: slope(0.8e-4), twist: 0.0 }
    }

    /// Height of the ground, y of the scene, metres.
    pub(crate) fn y(&self, [x, z]: [f64; 2]) -> f64 {
        let near = z.clamp(-20.0, STRAIGHT_BEYOND_M);
        let near_x = x.clamp(-STRAIGHT_BEYOND_M, STRAIGHT_BEYOND_M);
        let bent = self.bend * (near * near + 2.0 * near * (z - near));
        self.at_camera + self.across * near_x + self.along * z + bent + self.twist * near_x * near
    }
}
