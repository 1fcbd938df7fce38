//! Side views and plans of the styles of cars and vans, before each car's own variation.

use super::body::{Glazing, Profile};
use super::style::Style;

const HATCHBACK: Profile = Profile {
    nose: 0.50,
    cowl: 0.655,
    screen: [0.245, 0.43],
    rear: [0.86, 0.96],
    deck: 0.68,
    tail: 0.60,
    roof: [0.955, 0.945],
    sill: 0.13,
    axles: [0.185, 0.815],
    wheel_m: 0.305,
    roof_width: 0.74,
    shoulder_width: 0.925,
    nose_width: 0.70,
    tail_width: 0.84,
    pillar: 0.57,
    window_end: 0.84,
    glazing: Glazing::Full,
    black_sill: false,
    upright_lamps: true,
};

const SALOON: Profile = Profile {
    screen: [0.27, 0.43],
    rear: [0.71, 0.85],
    deck: 0.70,
    tail: 0.64,
    axles: [0.18, 0.79],
    pillar: 0.54,
    window_end: 0.755,
    upright_lamps: false,
    ..HATCHBACK
};

const ESTATE: Profile = Profile {
    screen: [0.26, 0.41],
    rear: [0.915, 0.972],
    roof: [0.955, 0.95],
    axles: [0.18, 0.79],
    pillar: 0.53,
    window_end: 0.90,
    ..HATCHBACK
};

const SUV: Profile = Profile {
    nose: 0.55,
    cowl: 0.65,
    screen: [0.25, 0.40],
    rear: [0.915, 0.972],
    sill: 0.17,
    wheel_m: 0.35,
    roof_width: 0.78,
    pillar: 0.54,
    window_end: 0.89,
    black_sill: true,
    ..HATCHBACK
};

const FULL_SIZE_SUV: Profile = Profile {
    nose: 0.57,
    cowl: 0.64,
    screen: [0.25, 0.36],
    rear: [0.945, 0.978],
    deck: 0.66,
    roof: [0.965, 0.965],
    sill: 0.18,
    axles: [0.175, 0.80],
    wheel_m: 0.39,
    roof_width: 0.84,
    shoulder_width: 0.945,
    nose_width: 0.84,
    tail_width: 0.92,
    pillar: 0.50,
    window_end: 0.92,
    black_sill: true,
    ..HATCHBACK
};

const KEI_CAR: Profile = Profile {
    nose: 0.47,
    cowl: 0.56,
    screen: [0.15, 0.29],
    rear: [0.955, 0.982],
    deck: 0.58,
    roof: [0.97, 0.97],
    sill: 0.11,
    axles: [0.15, 0.86],
    wheel_m: 0.275,
    roof_width: 0.85,
    shoulder_width: 0.95,
    nose_width: 0.82,
    tail_width: 0.94,
    pillar: 0.52,
    window_end: 0.92,
    ..HATCHBACK
};

/// The roof ends behind the rear seats; the top of the bed is where a saloon's boot is.
const PICKUP: Profile = Profile {
    nose: 0.57,
    cowl: 0.645,
    screen: [0.25, 0.355],
    rear: [0.60, 0.635],
    deck: 0.64,
    tail: 0.64,
    roof: [0.965, 0.965],
    sill: 0.19,
    axles: [0.17, 0.77],
    wheel_m: 0.395,
    roof_width: 0.82,
    shoulder_width: 0.945,
    nose_width: 0.84,
    tail_width: 0.95,
    pillar: 0.475,
    window_end: 0.60,
    black_sill: true,
    ..HATCHBACK
};

const MINIVAN: Profile = Profile {
    nose: 0.45,
    cowl: 0.585,
    screen: [0.16, 0.37],
    rear: [0.925, 0.975],
    deck: 0.60,
    wheel_m: 0.315,
    roof_width: 0.80,
    pillar: 0.50,
    window_end: 0.90,
    ..HATCHBACK
};

const PANEL_VAN: Profile = Profile {
    nose: 0.41,
    cowl: 0.52,
    screen: [0.115, 0.27],
    rear: [0.968, 0.985],
    deck: 0.58,
    tail: 0.50,
    roof: [0.965, 0.975],
    sill: 0.11,
    axles: [0.17, 0.79],
    wheel_m: 0.335,
    roof_width: 0.86,
    shoulder_width: 0.955,
    nose_width: 0.78,
    tail_width: 0.93,
    pillar: 0.39,
    window_end: 0.92,
    glazing: Glazing::Rear,
    ..HATCHBACK
};

/// The profile of a style.
pub(super) fn base_profile(style: Style) -> Profile {
    match style {
        Style::Hatchback => HATCHBACK,
        Style::Saloon => SALOON,
        Style::Estate => ESTATE,
        Style::Suv => SUV,
        Style::FullSizeSuv => FULL_SIZE_SUV,
        Style::KeiCar => KEI_CAR,
        Style::Pickup => PICKUP,
        Style::Minivan => MINIVAN,
        Style::PanelVan => PANEL_VAN,
        Style::Bus => Profile { glazing: Glazing::Full, ..PANEL_VAN },
    }
}
