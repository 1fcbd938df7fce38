//! Body types of passenger cars.

/// Body types of passenger cars.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Style {
    Hatchback,
    Saloon,
    Estate,
    Suv,
    Minivan,
    PanelVan,
    Bus,
    FullSizeSuv,
    KeiCar,
    Pickup,
}
