//! What scenes are drawn from.

use serde::{Deserialize, Serialize};

use crate::region::RegionWeights;
use crate::sensor::Device;

/// Most pixels of a rendered image: each takes some two hundred bytes while it is drawn.
pub const MAX_IMAGE_PX: usize = 16_000_000;

/// How scenes are drawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SceneConfig {
    /// The cameras, each with the share of scenes that it takes.
    pub cameras: Vec<CameraRanges>,
    /// In which part of the world.
    pub regions: RegionWeights,
    /// Where the scenes play.
    pub places: PlaceWeights,
    /// When, and in which weather.
    pub weather: WeatherWeights,
    /// How strong weather and darkness are, from 1 to 5; drawn at random where none is said. With it, light is drawn
    /// apart from everything else: scenes that differ in weather and severity only have the same objects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub severity: Option<u8>,
    /// Range of the factor on the number of vehicles and people.
    pub density: [f64; 2],
    /// Factor on the number of people on foot and on bicycles, beside `density`.
    pub people_factor: f64,
    /// Factor on the share of trucks, buses and trams among the vehicles.
    pub heavy_factor: f64,
    /// No vehicle or person is farther away, metres.
    pub farthest_m: f64,
    /// Share of scenes whose colours and light are like nothing on earth.
    pub unusual_share: f64,
    /// Share of scenes with random shapes lying and hanging about.
    pub distractor_share: f64,
    /// Things that stand about on pavements (bicycles, boards, café tables): about so many for each ten metres of
    /// either side, as far as there is room. Above 0, some houses have shops, too.
    pub clutter: f64,
    /// Share of scenes where people drive on the left.
    pub left_hand_share: f64,
    /// Share of scenes whose surfaces carry patterns that they do not have in life: blotches, stripes, tiles.
    pub textured_share: f64,
    /// Share of the scenes by day and at dusk whose sky was photographed.
    #[serde(skip_serializing_if = "is_zero")]
    pub photographed_sky_share: f64,
    /// Of sequences: from the exposure of a picture's first row to that of its last one, seconds (rolling shutter); 0
    /// exposes all rows at once. A single picture knows no motion.
    #[serde(skip_serializing_if = "is_zero")]
    pub readout_s: f64,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands a reference")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// Relative frequencies of the places.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlaceWeights {
    /// Houses wall to wall, several lanes, parked cars, people.
    pub city: f64,
    /// Narrow streets with gardens and cars parked on both sides.
    pub residential: f64,
    /// Wider roads with verges, trees and houses set back.
    pub suburban: f64,
    /// Fields and woods.
    pub rural: f64,
    /// Two to four lanes a direction, guard rails.
    pub motorway: f64,
    /// Rows of bays.
    pub car_park: f64,
}

/// Relative frequencies of light and weather.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WeatherWeights {
    /// Sun.
    pub clear: f64,
    /// Sun between clouds.
    pub cloudy: f64,
    /// Soft light without shadows.
    pub overcast: f64,
    /// The sun at the horizon.
    pub dusk: f64,
    /// Lamps and headlights.
    pub night: f64,
    /// Wet road, grey sky.
    pub rain: f64,
    /// Fog and haze.
    pub fog: f64,
}

/// The range of cameras that pictures are taken with. A pair is the smallest and the largest value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraRanges {
    /// Relative frequency among the cameras.
    pub share: f64,
    /// Widths and heights of the image, pixels; one is drawn.
    pub image_sizes: Vec<[usize; 2]>,
    /// Focal length as a multiple of the image's width (half the width over the tangent of half the field of view).
    pub focal_widths: [f64; 2],
    /// Principal point as shares of width and height.
    pub center: [f64; 2],
    /// Reach of the principal point about that, shares of width and height.
    pub center_reach: f64,
    /// Height above the ground, metres.
    pub height_m: [f64; 2],
    /// Pitch, degrees, positive downwards.
    pub pitch_deg: [f64; 2],
    /// Reach of the roll to either side, degrees.
    pub roll_deg: f64,
    /// Reach of the shift of the camera to either side of where a driver would be, metres.
    pub lateral_m: f64,
    /// Reach of the projection's fourth column over the focal length, metres (KITTI's left colour camera has 0.06).
    pub offset_m: f64,
    /// Direction in which it looks, degrees to the right of the way that its lane goes: 0 ahead, 90 to the right, 180
    /// back.
    pub heading_deg: [f64; 2],
    /// Share of the scenes in which the bonnet of its own car is where it would be.
    pub bonnet: f64,
    /// What takes the picture.
    pub device: Device,
}

impl Default for CameraRanges {
    fn default() -> Self {
        Self::kitti()
    }
}

impl CameraRanges {
    /// KITTI's left colour camera (Geiger et al. 2013), 1.65 m above the road.
    pub fn kitti() -> Self {
        Self {
            share: 0.6,
            image_sizes: vec![[1242, 375]],
            focal_widths: [0.578, 0.584],
            center: [0.4908, 0.461],
            center_reach: 0.004,
            height_m: [1.58, 1.72],
            pitch_deg: [0.0, 0.0],
            roll_deg: 0.0,
            lateral_m: 0.3,
            offset_m: 0.06,
            heading_deg: [0.0, 0.0],
            bonnet: 0.0,
            device: Device::Any,
        }
    }

    /// Cameras like KITTI's in other cars.
    pub fn varied() -> Self {
        Self {
            share: 0.4,
            focal_widths: [0.48, 0.75],
            center: [0.5, 0.48],
            center_reach: 0.05,
            height_m: [1.2, 2.2],
            pitch_deg: [-1.5, 1.5],
            roll_deg: 1.0,
            lateral_m: 0.6,
            ..Self::kitti()
        }
    }

    /// Any camera in a car: 40 to 110 degrees, any resolution.
    pub fn generic() -> Self {
        Self {
            share: 0.3,
            image_sizes: vec![[1280, 720], [1920, 1080], [1024, 768], [1600, 900], [640, 480], [1280, 384]],
            focal_widths: [0.35, 1.374],
            center: [0.5, 0.5],
            center_reach: 0.02,
            height_m: [1.1, 2.5],
            pitch_deg: [-2.0, 8.0],
            roll_deg: 2.0,
            lateral_m: 0.8,
            offset_m: 0.0,
            ..Self::kitti()
        }
    }

    /// A camera on a mast beside the road, looking down.
    pub fn roadside() -> Self {
        Self { share: 0.1, height_m: [3.0, 6.0], pitch_deg: [5.0, 20.0], lateral_m: 5.0, ..Self::generic() }
    }

    fn problem(&self, index: usize) -> Option<String> {
        let at = |message: String| format!("cameras[{index}].{message}");
        let range = |name: &str, [low, high]: [f64; 2], least: f64, most: f64| {
            (!(least <= low && low <= high && high <= most)).then(|| {
                format!("{name} is [{low}, {high}]; expected two numbers from {least} to {most} in rising order")
            })
        };
        let number = |name: &str, value: f64, most: f64| {
            (!(0.0..=most).contains(&value)).then(|| format!("{name} is {value}; expected a number from 0 to {most}"))
        };
        let size = |[width, height]: &[usize; 2]| {
            let fits = |side: &usize| (16..=16_384).contains(side);
            if !fits(width) || !fits(height) {
                return Some(format!("image_sizes has [{width}, {height}]; expected sides from 16 to 16384 pixels"));
            }
            (width * height > MAX_IMAGE_PX)
                .then(|| format!("image_sizes has [{width}, {height}]; expected at most {MAX_IMAGE_PX} pixels in all"))
        };
        if self.image_sizes.is_empty() {
            return Some(at("image_sizes is empty; expected at least one width and height".to_owned()));
        }
        number("share", self.share, 1e9)
            .or_else(|| self.image_sizes.iter().find_map(size))
            .or_else(|| range("focal_widths", self.focal_widths, 0.1, 20.0))
            .or_else(|| number("center[0]", self.center[0], 1.0))
            .or_else(|| number("center[1]", self.center[1], 1.0))
            .or_else(|| number("center_reach", self.center_reach, 0.5))
            .or_else(|| range("height_m", self.height_m, 0.5, 20.0))
            .or_else(|| range("pitch_deg", self.pitch_deg, -30.0, 60.0))
            .or_else(|| number("roll_deg", self.roll_deg, 30.0))
            .or_else(|| number("lateral_m", self.lateral_m, 20.0))
            .or_else(|| number("offset_m", self.offset_m, 1.0))
            .or_else(|| range("heading_deg", self.heading_deg, -360.0, 360.0))
            .or_else(|| number("bonnet", self.bonnet, 1.0))
            .map(at)
    }
}

impl Default for SceneConfig {
    fn default() -> Self {
        Self {
            cameras: vec![CameraRanges::kitti(), CameraRanges::varied()],
            regions: RegionWeights::default(),
            places: PlaceWeights::default(),
            weather: WeatherWeights::default(),
            severity: None,
            density: [0.2, 1.1],
            people_factor: 1.0,
            heavy_factor: 1.0,
            farthest_m: 80.0,
            unusual_share: 0.08,
            distractor_share: 0.08,
            clutter: 0.0,
            left_hand_share: 0.08,
            textured_share: 0.0,
            photographed_sky_share: 0.0,
            readout_s: 0.0,
        }
    }
}

impl Default for PlaceWeights {
    fn default() -> Self {
        Self { city: 0.25, residential: 0.28, suburban: 0.2, rural: 0.12, motorway: 0.08, car_park: 0.07 }
    }
}

impl Default for WeatherWeights {
    fn default() -> Self {
        Self { clear: 0.45, cloudy: 0.2, overcast: 0.15, dusk: 0.07, night: 0.04, rain: 0.05, fog: 0.04 }
    }
}

impl SceneConfig {
    /// Scenes for any camera: KITTI's, others in cars, and on masts.
    pub fn generic() -> Self {
        let cameras =
            [CameraRanges::kitti(), CameraRanges::varied(), CameraRanges::generic(), CameraRanges::roadside()];
        Self { cameras: cameras.to_vec(), ..Self::default() }
    }

    /// Why this configuration cannot be used, if it cannot.
    pub fn problem(&self) -> Option<String> {
        let share = |name: &str, value: f64| {
            (!(0.0..=1.0).contains(&value)).then(|| format!("{name} is {value}; expected a number from 0 to 1"))
        };
        let factor = |name: &str, value: f64| {
            (!(0.0..=20.0).contains(&value)).then(|| format!("{name} is {value}; expected a number from 0 to 20"))
        };
        let [low, high] = self.density;
        let density = (!(0.0 <= low && low <= high && high <= 10.0))
            .then(|| format!("density is [{low}, {high}]; expected two numbers from 0 to 10 in rising order"));
        let farthest = self.farthest_m;
        let places = &self.places;
        let weather = &self.weather;
        self.cameras
            .iter()
            .enumerate()
            .find_map(|(index, camera)| camera.problem(index))
            .or_else(|| weights("cameras", &self.cameras.iter().map(|c| c.share).collect::<Vec<_>>()))
            .or_else(|| weights("places", &places.table().map(|(_, weight)| weight)))
            .or_else(|| weights("weather", &weather.table().map(|(_, weight)| weight)))
            .or_else(|| weights("regions", &self.regions.table().map(|(_, weight)| weight)))
            .or_else(|| self.regions.problem())
            .or_else(|| {
                self.severity
                    .filter(|severity| !(1..=5).contains(severity))
                    .map(|severity| format!("severity is {severity}; expected a whole number from 1 to 5"))
            })
            .or(density)
            .or_else(|| factor("people_factor", self.people_factor))
            .or_else(|| factor("heavy_factor", self.heavy_factor))
            .or_else(|| factor("clutter", self.clutter))
            .or_else(|| {
                (!(10.0..=300.0).contains(&farthest))
                    .then(|| format!("farthest_m is {farthest}; expected metres from 10 to 300"))
            })
            .or_else(|| share("unusual_share", self.unusual_share))
            .or_else(|| share("distractor_share", self.distractor_share))
            .or_else(|| share("left_hand_share", self.left_hand_share))
            .or_else(|| share("textured_share", self.textured_share))
            .or_else(|| share("photographed_sky_share", self.photographed_sky_share))
            .or_else(|| {
                let readout_s = self.readout_s;
                (!(0.0..=0.1).contains(&readout_s))
                    .then(|| format!("readout_s is {readout_s}; expected seconds from 0 to 0.1"))
            })
    }
}

fn weights(name: &str, values: &[f64]) -> Option<String> {
    let bad = values.iter().find(|v| !(v.is_finite() && **v >= 0.0));
    let sum: f64 = values.iter().sum();
    match bad {
        Some(value) => Some(format!("{name} has the weight {value}; expected a number that is not negative")),
        None if sum <= 0.0 => Some(format!("{name} has no weight above 0; nothing could be drawn")),
        None => None,
    }
}

/// Where a scene plays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    City,
    Residential,
    Suburban,
    Rural,
    Motorway,
    CarPark,
}

impl PlaceWeights {
    pub(crate) fn table(&self) -> [(Place, f64); 6] {
        [
            (Place::City, self.city),
            (Place::Residential, self.residential),
            (Place::Suburban, self.suburban),
            (Place::Rural, self.rural),
            (Place::Motorway, self.motorway),
            (Place::CarPark, self.car_park),
        ]
    }
}

/// Light and weather of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Weather {
    Clear,
    Cloudy,
    Overcast,
    Dusk,
    Night,
    Rain,
    Fog,
}

impl WeatherWeights {
    pub(crate) fn table(&self) -> [(Weather, f64); 7] {
        [
            (Weather::Clear, self.clear),
            (Weather::Cloudy, self.cloudy),
            (Weather::Overcast, self.overcast),
            (Weather::Dusk, self.dusk),
            (Weather::Night, self.night),
            (Weather::Rain, self.rain),
            (Weather::Fog, self.fog),
        ]
    }
}
