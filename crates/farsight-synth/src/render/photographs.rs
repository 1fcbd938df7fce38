//! Skies that were photographed: radiance maps by Poly Haven, which `scripts/make_skies.py` cut to the half above the
//! horizon.

use std::sync::LazyLock;

use image::RgbImage;

use super::lanes::{Lanes, Vec3s, all, clamp};
use crate::scene::{SkyMap, SkyPhotograph};

/// Radiance where a byte is 255; that of a byte grows with its square. The median of a map is 1.
const BRIGHTEST: f32 = 4.0;

static MAPS: LazyLock<[RgbImage; SkyMap::ALL.len()]> = LazyLock::new(|| SkyMap::ALL.map(decoded));

fn decoded(map: SkyMap) -> RgbImage {
    let bytes: &[u8] = match map {
        SkyMap::City => include_bytes!("../../skies/city.png"),
        SkyMap::Dawn => include_bytes!("../../skies/dawn.png"),
        SkyMap::Forest => include_bytes!("../../skies/forest.png"),
        SkyMap::Park => include_bytes!("../../skies/park.png"),
        SkyMap::Sky => include_bytes!("../../skies/sky.png"),
        SkyMap::Sunrise => include_bytes!("../../skies/sunrise.png"),
        SkyMap::Sunset => include_bytes!("../../skies/sunset.png"),
        SkyMap::Venice => include_bytes!("../../skies/venice.png"),
    };
    // A test decodes them all.
    image::load_from_memory(bytes).map(|map| map.to_rgb8()).unwrap_or_default()
}

impl SkyPhotograph {
    /// Light from unit directions `d`; from below the horizon it is that of the horizon.
    pub(super) fn color(&self, d: Vec3s) -> Vec3s {
        let map = &MAPS[self.map as usize];
        let [across, ahead] = self.towards_sun;
        let up = (-d[1]).fast_max(Lanes::ZERO);
        let x = d[0] * all(ahead) - d[2] * all(across);
        let z = d[0] * all(across) + d[2] * all(ahead);
        let inverse = all(1.0) / (x.abs() + up + z.abs()).fast_max(all(1e-6));
        let last = map.width().saturating_sub(1) as f32;
        // Never as far as the last pixel, so that there is one beside it.
        let pixel = |at: Lanes| clamp((at * inverse + all(1.0)) * all(0.5 * last), 0.0, last - 0.001).to_array();
        let (columns, rows) = (pixel(x + z), pixel(x - z));
        let mut seen = [[0.0; 4]; 3];
        for lane in 0..4 {
            let color = bilinear(map, columns[lane], rows[lane]);
            for channel in 0..3 {
                seen[channel][lane] = self.gain * color[channel];
            }
        }
        seen.map(Lanes::from)
    }
}

/// Radiance between the four pixels about this place.
fn bilinear(map: &RgbImage, column: f32, row: f32) -> [f32; 3] {
    let (left, top) = (column as u32, row as u32);
    let (u, v) = (column - left as f32, row - top as f32);
    let radiance = |right: u32, down: u32| {
        map.get_pixel(left + right, top + down).0.map(|byte| {
            let root = f32::from(byte) / 255.0;
            BRIGHTEST * root * root
        })
    };
    let [nw, ne, sw, se] = [radiance(0, 0), radiance(1, 0), radiance(0, 1), radiance(1, 1)];
    [0, 1, 2].map(|i| {
        let (upper, lower) = (nw[i] + (ne[i] - nw[i]) * u, sw[i] + (se[i] - sw[i]) * u);
        upper + (lower - upper) * v
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::lanes::all3;

    fn seen(map: SkyMap, towards_sun: [f32; 2], direction: [f32; 3]) -> f32 {
        let color = SkyPhotograph { map, towards_sun, gain: 2.0 }.color(all3(direction));
        color.map(|channel| channel.to_array()[0]).iter().sum::<f32>() / 3.0
    }

    /// 12 degrees above the horizon.
    fn around([across, ahead]: [f32; 2]) -> [f32; 3] {
        [0.978 * across, -0.208, 0.978 * ahead]
    }

    #[test]
    fn every_map_is_there_and_its_sun_is_where_the_scene_has_it() {
        for map in SkyMap::ALL {
            assert_eq!(MAPS[map as usize].dimensions(), (256, 256), "{map:?}");
        }
        for map in [SkyMap::Dawn, SkyMap::Sky, SkyMap::Sunrise, SkyMap::Sunset] {
            for towards_sun in [[0.0, 1.0], [1.0, 0.0], [-0.6, 0.8]] {
                let [across, ahead] = towards_sun;
                let bright = seen(map, towards_sun, around(towards_sun));
                for away in [[-across, -ahead], [ahead, -across], [-ahead, across]] {
                    let dark = seen(map, towards_sun, around(away));
                    assert!(bright > 1.4 * dark, "{map:?} {towards_sun:?} {away:?}: {bright} and {dark}");
                }
            }
        }
    }

    #[test]
    fn below_the_horizon_it_is_as_at_the_horizon() {
        let [at, below] = [[0.6, 0.0, 0.8], [0.36, 0.8, 0.48]].map(|d| seen(SkyMap::Venice, [0.0, 1.0], d));
        assert!((at - below).abs() < 1e-4 && at > 0.0, "{at} and {below}");
    }
}
