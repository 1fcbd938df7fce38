//! How often scenes play where.

use serde::{Deserialize, Serialize};

use super::Region;
use crate::rng::SceneRng;

/// Relative frequencies of the regions. What a world file does not name has none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct RegionWeights {
    /// The German city of KITTI's labels, with its statistics of sizes: what is drawn without regions.
    #[serde(default)]
    pub kitti: f64,
    /// Europe, the islands that drive on the left included.
    #[serde(default)]
    pub europe: f64,
    /// The United States and Canada.
    #[serde(default)]
    pub north_america: f64,
    /// China.
    #[serde(default)]
    pub china: f64,
    /// Japan.
    #[serde(default)]
    pub japan: f64,
    /// India.
    #[serde(default)]
    pub india: f64,
}

impl Default for RegionWeights {
    fn default() -> Self {
        Self { kitti: 1.0, europe: 0.0, north_america: 0.0, china: 0.0, japan: 0.0, india: 0.0 }
    }
}

impl RegionWeights {
    pub(crate) fn table(&self) -> [(Option<&'static str>, f64); 6] {
        [
            (None, self.kitti),
            (Some("europe"), self.europe),
            (Some("north-america"), self.north_america),
            (Some("china"), self.china),
            (Some("japan"), self.japan),
            (Some("india"), self.india),
        ]
    }

    /// Whether all scenes are of KITTI's city: then nothing is drawn for them.
    pub(crate) fn is_kitti_only(&self) -> bool {
        self.table().iter().all(|(name, weight)| name.is_none() || *weight <= 0.0)
    }

    /// Draws a region; none for KITTI's city.
    pub(crate) fn sample(&self, rng: &mut SceneRng) -> Option<&'static Region> {
        self.sample_name(rng).and_then(|name| Region::named(name).ok())
    }

    /// Draws the name of a region; none for KITTI's city.
    pub(crate) fn sample_name(&self, rng: &mut SceneRng) -> Option<&'static str> {
        if self.is_kitti_only() { None } else { rng.weighted(&self.table()) }
    }

    /// Why a region that is asked for cannot be drawn, if so.
    pub(crate) fn problem(&self) -> Option<String> {
        self.table().into_iter().filter(|(_, weight)| *weight > 0.0).find_map(|(name, _)| Region::named(name?).err())
    }
}
