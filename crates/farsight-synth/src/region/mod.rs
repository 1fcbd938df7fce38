//! Parts of the world: which vehicles drive there, how large they are, on which roads.
//!
//! A region is a table in `tables/`, not code. Where its numbers come from: docs/synth.md.

mod kind;
mod weights;

pub use weights::RegionWeights;

pub(crate) use kind::{Traffic, VehicleKind};

use std::sync::LazyLock;

use farsight_core::{Dimensions, ObjectClass};
use serde::Deserialize;

use crate::objects::{Look, Paint, PlateFormat};
use crate::rng::SceneRng;

/// Everything that is drawn differently in a region.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Region {
    /// Share of the scenes in which people drive on the left.
    pub(crate) left_hand_share: f64,
    /// Widths of lanes, metres: in towns, and on motorways.
    pub(crate) lane_m: [f64; 2],
    pub(crate) motorway_lane_m: [f64; 2],
    pub(crate) roads: Roads,
    pub(crate) sides: Sides,
    /// Shares of white, grey and black, and coloured cars.
    pub(crate) paint: Paint,
    pub(crate) plates: Vec<PlateFormat>,
    pub(crate) vehicles: Vec<VehicleKind>,
}

/// How often a road has what; shares of scenes.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Roads {
    /// The line between the directions is yellow.
    pub(crate) yellow_middle: f64,
    /// It is double and solid, where there is one.
    pub(crate) double_middle: f64,
    /// Light concrete instead of asphalt.
    pub(crate) concrete: f64,
    /// A town's street has two to four lanes a direction.
    pub(crate) arterial: f64,
    /// Cones, barrels and barriers.
    pub(crate) works: f64,
}

/// How often the sides of a road have what; shares of scenes.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Sides {
    /// Poles with wires.
    pub(crate) wires: f64,
    pub(crate) palms: f64,
    pub(crate) billboards: f64,
    /// Low shops behind their car parks, in towns.
    pub(crate) low_rise: f64,
    /// Towers of flats, in towns.
    pub(crate) towers: f64,
    /// Dry grass and bare earth.
    pub(crate) dry: f64,
    /// Bridges of signs over motorways.
    pub(crate) gantries: f64,
}

/// Somebody in traffic, without a place yet.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Participant {
    pub(crate) class: ObjectClass,
    pub(crate) size: Dimensions,
    /// The row of the region's table; none for what KITTI's statistics describe.
    pub(crate) kind: Option<&'static VehicleKind>,
}

macro_rules! tables {
    ($($name:literal),*) => {
        [$(($name, include_str!(concat!("tables/", $name, ".toml")))),*]
    };
}

/// The names of the regions, and their tables.
const TABLES: [(&str, &str); 5] = tables!("europe", "north-america", "china", "japan", "india");

static REGIONS: LazyLock<Vec<(&'static str, Result<Region, String>)>> =
    LazyLock::new(|| TABLES.map(|(name, text)| (name, parsed(text))).into());

fn parsed(text: &str) -> Result<Region, String> {
    let region: Region = toml::from_str(text).map_err(|error| error.to_string())?;
    match region.problem() {
        Some(problem) => Err(problem),
        None => Ok(region),
    }
}

impl Region {
    /// The region of a name.
    ///
    /// # Errors
    /// When there is none, or its table is wrong.
    pub(crate) fn named(name: &str) -> Result<&'static Self, String> {
        let found = REGIONS.iter().find(|(known, _)| *known == name);
        let (_, region) = found.ok_or_else(|| format!("{name} is no region"))?;
        region.as_ref().map_err(|problem| format!("the table of {name}: {problem}"))
    }

    /// What is wrong with the table, if anything.
    fn problem(&self) -> Option<String> {
        let wrong = self.vehicles.iter().find_map(VehicleKind::problem);
        let plates = self.plates.iter().find(|plate| plate.lines == 0 || plate.figures == 0 || plate.share < 0.0);
        let empty = self.vehicles.iter().all(|kind| kind.share <= 0.0) || self.plates.iter().all(|p| p.share <= 0.0);
        wrong
            .or_else(|| plates.map(|plate| format!("a plate of {} lines of {} figures", plate.lines, plate.figures)))
            .or_else(|| empty.then(|| "no vehicle or no plate has a share above 0".to_owned()))
    }

    /// Draws the plates of a vehicle.
    pub(crate) fn plate(&self, rng: &mut SceneRng) -> PlateFormat {
        let table: Vec<(PlateFormat, f64)> = self.plates.iter().map(|plate| (*plate, plate.share)).collect();
        rng.weighted(&table)
    }

    /// Draws what a vehicle of a kind looks like.
    pub(crate) fn look(&self, kind: Option<&'static VehicleKind>, rng: &mut SceneRng) -> Look {
        let plate = self.plate(rng);
        let has_front_plate = rng.chance(plate.in_front);
        Look { plate, has_front_plate, paint: self.paint, colors: kind.map_or(&[], |kind| &kind.colors) }
    }

    /// Draws a vehicle; `factor` weights the rows of the table beside their share.
    pub(crate) fn vehicle(
        &'static self,
        factor: impl Fn(&VehicleKind) -> f64,
        rng: &mut SceneRng,
    ) -> Option<Participant> {
        let rows = self.vehicles.iter().map(|kind| (kind, kind.share * factor(kind)));
        let table: Vec<(&'static VehicleKind, f64)> = rows.filter(|(_, weight)| *weight > 0.0).collect();
        let kind = if table.is_empty() { return None } else { rng.weighted(&table) };
        Some(Participant { class: kind.class(), size: kind.sample(rng), kind: Some(kind) })
    }

    /// Draws the row of the table that something of this class and size may be: likely where its size is usual.
    pub(crate) fn kind_of(
        &'static self,
        class: &ObjectClass,
        size: Dimensions,
        rng: &mut SceneRng,
    ) -> Option<&'static VehicleKind> {
        let rows = self.vehicles.iter().filter(|kind| kind.class() == *class);
        let table: Vec<_> = rows.map(|kind| (kind, kind.share * kind.likelihood(size))).collect();
        (!table.is_empty()).then(|| rng.weighted(&table))
    }
}

#[cfg(test)]
mod tests;
