//! Shapes of vehicles that the tables of regions name.

use farsight_core::Dimensions;
use serde::Deserialize;

use super::car;
use super::context::BuildContext;
use super::style::Style;
use super::{fitted, lorry, three_wheeler, truck, two_wheeler};
use crate::scene::Mesh;

/// What a vehicle looks like, whatever its size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Shape {
    Hatchback,
    Sedan,
    Wagon,
    Suv,
    /// Long, tall and straight, on large wheels.
    FullSizeSuv,
    Minivan,
    /// A box with a wheel at each corner.
    KeiCar,
    Pickup,
    PanelVan,
    Minibus,
    /// A cab over the wheels and a bed with low sides.
    MiniTruck,
    BoxTruck,
    /// A lorry with an open load, or none.
    Flatbed,
    Articulated,
    /// Articulated, with the engine in front of the cab.
    BonnetedArticulated,
    Bus,
    SchoolBus,
    Tram,
    Trailer,
    ThreeWheeler,
    Motorcycle,
    Scooter,
}

impl Shape {
    /// The mesh of this shape in object coordinates, of exactly this size.
    pub(crate) fn build(self, size: Dimensions, context: &mut BuildContext) -> Mesh {
        let hwl = [size.height, size.width, size.length].map(|v| v as f32);
        let mesh = match self {
            Self::Hatchback => car::private(Style::Hatchback, hwl, context),
            Self::Sedan => car::private(Style::Saloon, hwl, context),
            Self::Wagon => car::private(Style::Estate, hwl, context),
            Self::Suv => car::private(Style::Suv, hwl, context),
            Self::FullSizeSuv => car::private(Style::FullSizeSuv, hwl, context),
            Self::Minivan => car::private(Style::Minivan, hwl, context),
            Self::KeiCar => car::private(Style::KeiCar, hwl, context),
            Self::Pickup => car::private(Style::Pickup, hwl, context),
            Self::PanelVan => car::at_work(Style::PanelVan, hwl, context),
            Self::Minibus => car::at_work(Style::Bus, hwl, context),
            Self::MiniTruck => lorry::mini_truck(hwl, context),
            Self::BoxTruck => truck::rigid_truck(hwl, true, context),
            Self::Flatbed => lorry::flatbed(hwl, context),
            Self::Articulated => lorry::articulated(hwl, context),
            Self::BonnetedArticulated => lorry::bonneted_articulated(hwl, context),
            Self::Bus => truck::bus(hwl, context),
            Self::SchoolBus => lorry::school_bus(hwl, context),
            Self::Tram => truck::tram(hwl, context),
            Self::Trailer => truck::trailer(hwl, context),
            Self::ThreeWheeler => three_wheeler::three_wheeler(hwl, context),
            Self::Motorcycle => two_wheeler::motorcycle(context),
            Self::Scooter => two_wheeler::scooter(context),
        };
        fitted(mesh, hwl)
    }
}
