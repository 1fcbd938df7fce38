//! What lines the streets of a place.

use super::config::Place;
use crate::rng::SceneRng;

/// What lines one side of a street.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Roadside {
    /// Mean gap between houses over their width; no houses where negative.
    pub(crate) house_gap: f64,
    /// Metres behind the pavement.
    pub(crate) setback: f64,
    pub(crate) house_height: [f64; 2],
    pub(crate) house_width: [f64; 2],
    /// Distance between trees at the kerb; none where 0.
    pub(crate) tree_pitch: f64,
    /// Trees and bushes behind the pavement, a hundred metres.
    pub(crate) plants: f64,
    /// A wall of leaves behind everything: a wood, distance from the road; none where 0.
    pub(crate) wood: f64,
    /// Garden walls, hedges and fences.
    pub(crate) fenced: f64,
    pub(crate) guard_rail: bool,
    /// Posts, signs and lamps, a hundred metres.
    pub(crate) posts: f64,
}

impl Roadside {
    /// Draws what lines one side of a street of a place.
    pub(crate) fn sample(place: Place, rng: &mut SceneRng) -> Self {
        let none = Roadside {
            house_gap: -1.0,
            setback: 0.0,
            house_height: [5.0, 9.0],
            house_width: [8.0, 16.0],
            tree_pitch: 0.0,
            plants: 0.0,
            wood: 0.0,
            fenced: 0.0,
            guard_rail: false,
            posts: 3.0,
        };
        let street_trees = |share: f64, rng: &mut SceneRng| if rng.chance(share) { rng.range(7.0, 22.0) } else { 0.0 };
        match place {
            Place::City => Roadside {
                house_gap: if rng.chance(0.7) { 0.02 } else { 0.5 },
                setback: if rng.chance(0.6) { 0.0 } else { rng.range(1.0, 8.0) },
                house_height: [8.0, 22.0],
                house_width: [9.0, 24.0],
                tree_pitch: street_trees(0.6, rng),
                plants: rng.range(0.0, 14.0),
                posts: rng.range(4.0, 12.0),
                ..none
            },
            Place::Residential => Roadside {
                house_gap: rng.range(0.1, 0.9),
                setback: rng.range(1.5, 7.0),
                tree_pitch: street_trees(0.3, rng),
                plants: rng.range(8.0, 40.0),
                fenced: rng.range(0.3, 1.0),
                posts: rng.range(2.0, 6.0),
                ..none
            },
            Place::Suburban => Roadside {
                house_gap: if rng.chance(0.6) { rng.range(0.5, 3.0) } else { -1.0 },
                setback: rng.range(4.0, 16.0),
                house_height: [5.0, 15.0],
                house_width: [9.0, 26.0],
                tree_pitch: street_trees(0.6, rng),
                plants: rng.range(10.0, 50.0),
                wood: if rng.chance(0.4) { rng.range(8.0, 40.0) } else { 0.0 },
                fenced: rng.range(0.0, 0.6),
                posts: rng.range(2.0, 7.0),
                ..none
            },
            Place::Rural => Roadside {
                house_gap: if rng.chance(0.1) { rng.range(4.0, 9.0) } else { -1.0 },
                setback: rng.range(6.0, 20.0),
                tree_pitch: street_trees(0.3, rng),
                plants: rng.range(0.0, 50.0),
                wood: if rng.chance(0.7) { rng.range(2.0, 30.0) } else { 0.0 },
                guard_rail: rng.chance(0.15),
                posts: rng.range(1.0, 4.0),
                ..none
            },
            Place::Motorway => Roadside {
                plants: rng.range(0.0, 20.0),
                wood: if rng.chance(0.5) { rng.range(6.0, 30.0) } else { 0.0 },
                guard_rail: rng.chance(0.8),
                posts: rng.range(1.0, 3.0),
                ..none
            },
            Place::CarPark => Roadside {
                house_gap: if rng.chance(0.6) { rng.range(0.1, 1.0) } else { -1.0 },
                setback: rng.range(2.0, 12.0),
                house_height: [5.0, 16.0],
                house_width: [14.0, 40.0],
                tree_pitch: street_trees(0.4, rng),
                plants: rng.range(2.0, 20.0),
                wood: if rng.chance(0.3) { rng.range(10.0, 30.0) } else { 0.0 },
                ..none
            },
        }
    }
}
