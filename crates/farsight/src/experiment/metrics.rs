//! What the arms of an experiment are judged by: figures of cars, Moderate, unless the name says otherwise.

use std::fmt::{self, Display};
use std::str::FromStr;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

/// A figure of a cell. The order is that of tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Metric {
    /// AP 3D at an overlap of 0.7, percent.
    Ap3d,
    Ap3dEasy,
    Ap3dHard,
    /// AP in bird's-eye view at 0.7.
    Bev,
    BevEasy,
    BevHard,
    /// AP 3D at 0.5.
    #[serde(rename = "ap3d_05")]
    Ap3d05,
    /// AP in bird's-eye view at 0.5.
    #[serde(rename = "bev_05")]
    Bev05,
    /// AP 3D at 0.5 of cars from 40 to 50 m.
    #[serde(rename = "ap3d_05_far")]
    Ap3d05Far,
    /// Of cars from 25 to 40 pixels high.
    #[serde(rename = "ap3d_05_small")]
    Ap3d05Small,
    /// Of largely hidden cars (Hard).
    #[serde(rename = "ap3d_05_occluded")]
    Ap3d05Occluded,
    /// AP of boxes in the image at 0.7.
    Ap2d,
    /// Mean absolute error of z, metres.
    Mae,
    /// Root of the mean squared error of z, metres.
    Rmse,
    /// Mean absolute error of z of cars from 40 to 50 m, metres.
    MaeFar,
    /// Of cars from 25 to 40 pixels high.
    MaeSmall,
    /// Of largely hidden cars (Hard).
    MaeOccluded,
    /// Share of the cars that are found, 0 to 1.
    Found,
    /// Share of the cars from 40 to 50 m that are found.
    FoundFar,
    /// Share of the cars from 25 to 40 pixels high that are found.
    FoundSmall,
    /// Share of the largely hidden cars that are found (Hard).
    FoundOccluded,
    /// Share of the cars that are found at the lowest score with at most 0.3 false alarms an image.
    #[serde(rename = "found_03")]
    Found03,
    /// The same of pedestrians.
    #[serde(rename = "pedestrians_03")]
    Pedestrians03,
    /// The same of cyclists.
    #[serde(rename = "cyclists_03")]
    Cyclists03,
}

impl Metric {
    /// All of them.
    pub(crate) const ALL: [Self; 24] = [
        Self::Ap3d,
        Self::Ap3dEasy,
        Self::Ap3dHard,
        Self::Bev,
        Self::BevEasy,
        Self::BevHard,
        Self::Ap3d05,
        Self::Bev05,
        Self::Ap3d05Far,
        Self::Ap3d05Small,
        Self::Ap3d05Occluded,
        Self::Ap2d,
        Self::Mae,
        Self::Rmse,
        Self::MaeFar,
        Self::MaeSmall,
        Self::MaeOccluded,
        Self::Found,
        Self::FoundFar,
        Self::FoundSmall,
        Self::FoundOccluded,
        Self::Found03,
        Self::Pedestrians03,
        Self::Cyclists03,
    ];

    /// Whether less is better.
    pub(crate) fn is_error(self) -> bool {
        matches!(self, Self::Mae | Self::Rmse | Self::MaeFar | Self::MaeSmall | Self::MaeOccluded)
    }

    /// Whether it is average precision.
    pub(crate) fn is_ap(self) -> bool {
        !self.is_error() && !self.is_share()
    }

    fn is_share(self) -> bool {
        use Metric::{Cyclists03, Found, Found03, FoundFar, FoundOccluded, FoundSmall, Pedestrians03};
        matches!(self, Found | FoundFar | FoundSmall | FoundOccluded | Found03 | Pedestrians03 | Cyclists03)
    }

    /// What tables call it.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Ap3d => "AP 3D",
            Self::Ap3dEasy => "AP 3D, Easy",
            Self::Ap3dHard => "AP 3D, Hard",
            Self::Bev => "AP bird's-eye",
            Self::BevEasy => "AP bird's-eye, Easy",
            Self::BevHard => "AP bird's-eye, Hard",
            Self::Ap3d05 => "AP 3D at 0.5",
            Self::Bev05 => "AP bird's-eye at 0.5",
            Self::Ap3d05Far => "AP 3D at 0.5, 40 to 50 m",
            Self::Ap3d05Small => "AP 3D at 0.5, 25 to 40 px high",
            Self::Ap3d05Occluded => "AP 3D at 0.5, largely hidden",
            Self::Ap2d => "AP 2D",
            Self::Mae => "MAE",
            Self::Rmse => "RMSE",
            Self::MaeFar => "MAE, 40 to 50 m",
            Self::MaeSmall => "MAE, 25 to 40 px high",
            Self::MaeOccluded => "MAE, largely hidden",
            Self::Found => "found",
            Self::FoundFar => "found, 40 to 50 m",
            Self::FoundSmall => "found, 25 to 40 px high",
            Self::FoundOccluded => "found, largely hidden",
            Self::Found03 => "found at 0.3 false alarms",
            Self::Pedestrians03 => "pedestrians at 0.3",
            Self::Cyclists03 => "cyclists at 0.3",
        }
    }

    /// A value of it in a table.
    pub(crate) fn shown(self, value: f64) -> String {
        if self.is_error() {
            format!("{value:.3} m")
        } else if self.is_ap() {
            format!("{value:.2}")
        } else {
            format!("{:.1}%", 100.0 * value)
        }
    }

    /// A difference of it in a table, without a unit.
    pub(crate) fn shown_difference(self, value: f64) -> String {
        if self.is_error() {
            format!("{value:+.3}")
        } else if self.is_ap() {
            format!("{value:+.2}")
        } else {
            format!("{:+.1}", 100.0 * value)
        }
    }
}

impl Display for Metric {
    /// Its name in files.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

impl FromStr for Metric {
    type Err = anyhow::Error;

    fn from_str(name: &str) -> Result<Self> {
        let known = Self::ALL.into_iter().find(|metric| metric.to_string() == name);
        known.with_context(|| {
            let names: Vec<String> = Self::ALL.iter().map(ToString::to_string).collect();
            format!("no metric \"{name}\"; expected one of {}", names.join(", "))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back() {
        for metric in Metric::ALL {
            assert_eq!(metric.to_string().parse::<Metric>().unwrap(), metric);
        }
        assert_eq!(Metric::Ap3d05.to_string(), "ap3d_05");
        assert!("ap".parse::<Metric>().is_err());
    }
}
