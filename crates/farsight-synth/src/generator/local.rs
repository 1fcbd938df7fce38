//! What a region changes in the plan of a place: lanes, lines, and what lines the road.

use super::config::Place;
use super::roadside::Roadside;
use super::street::{Lane, LaneUse, Markings};
use super::view::View;
use crate::region::Region;
use crate::rng::SceneRng;

impl Markings {
    /// These lines as they are in a region.
    pub(super) fn localized(self, place: Place, region: &Region, rng: &mut SceneRng) -> Self {
        let is_double = rng.chance(region.roads.double_middle);
        let shoulder = rng.range(0.3, 3.0);
        Self {
            middle: if self.middle > 0 && is_double { 3 } else { self.middle },
            island: self.lanes || self.edges,
            shoulder: match place {
                Place::Motorway => shoulder,
                Place::Rural => 0.3 * shoulder,
                _ => 0.0,
            },
            ..self
        }
    }
}

impl Roadside {
    /// What lines the road in a region.
    pub(super) fn localized(mut self, place: Place, region: &Region, rng: &mut SceneRng) -> Self {
        let in_town = matches!(place, Place::City | Place::Suburban);
        let (is_low, is_tall) = (rng.chance(region.sides.low_rise), rng.chance(region.sides.towers));
        if in_town && is_low {
            self.house_gap = rng.range(0.1, 1.5);
            self.setback = rng.range(5.0, 35.0);
            self.house_height = [3.6, 8.0];
            self.house_width = [14.0, 50.0];
        } else if in_town && is_tall {
            self.house_gap = rng.range(0.1, 0.8);
            self.setback = rng.range(4.0, 25.0);
            self.house_height = [25.0, 95.0];
            self.house_width = [16.0, 36.0];
        }
        self
    }
}

/// Where the camera's lane is among lanes, as an offset from their first edge.
///
/// A camera that looks back sees its own lane's traffic come towards it: it stands in a lane of the other direction,
/// and where there is none, all lanes are that.
pub(super) fn own_lane(lanes: &mut [Lane], forward: f64, view: &View, rng: &mut SceneRng) -> f64 {
    if !view.looks_back() {
        return forward;
    }
    let oncoming = |lanes: &[Lane]| -> Vec<f64> {
        let toward = lanes.iter().filter(|lane| lane.used_for == LaneUse::Drive && lane.direction < 0.0);
        toward.map(|lane| lane.center).collect()
    };
    let mut centers = oncoming(lanes);
    if centers.is_empty() {
        for lane in lanes.iter_mut() {
            lane.direction = -lane.direction;
        }
        centers = oncoming(lanes);
    }
    if centers.is_empty() { forward } else { rng.pick(&centers) }
}
