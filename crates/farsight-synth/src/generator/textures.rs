//! Patterns on surfaces that have none: what is seen in and behind a car's windows, reflections on its paint, and what
//! nobody thought of.
//!
//! Rendered surfaces are plainer than photographed ones. A network that has only seen plain ones takes a face in a
//! window for a car of its own; one that has seen anything on them has to go by the shape (domain randomisation).

use crate::palette::{any_color, grey, times};
use crate::rng::SceneRng;
use crate::scene::{Color, Material, Pattern};

/// Share of the plain materials of a scene that get a pattern.
const REPLACED: [f64; 2] = [0.15, 0.8];

/// Strongest mirror that paint and glass get.
const STRONGEST_MIRROR: f64 = 0.35;

/// Gives some of the materials a pattern drawn by chance. Those that glow, and those with holes or a pattern of their
/// own, stay; transparent glass does not, and can then no longer be seen through.
pub(crate) fn spread(materials: &mut [Material], rng: &mut SceneRng) {
    let share = rng.range(REPLACED[0], REPLACED[1]);
    for material in materials {
        let mut rng = rng.fork();
        let is_plain = matches!(material.pattern, Pattern::Plain | Pattern::Noise { .. } | Pattern::Transparent { .. });
        let glows = material.emission.iter().any(|&light| light > 0.0);
        if !is_plain || glows || !rng.chance(share) {
            continue;
        }
        material.pattern = pattern(material.color, &mut rng);
        if material.reflectivity > 0.0 {
            material.reflectivity = rng.log_range(0.02, STRONGEST_MIRROR) as f32;
        }
    }
}

fn pattern(color: Color, rng: &mut SceneRng) -> Pattern {
    let other = other_color(color, rng);
    let seed = rng.seed();
    match rng.weighted(&[(0, 7.0), (1, 1.0), (2, 1.0), (3, 1.0)]) {
        0 => Pattern::Noise { other, scale: rng.log_range(0.1, 1.5) as f32, amount: rng.range32(0.2, 1.0), seed },
        1 => Pattern::Stripes { other, period: rng.log_range(0.05, 1.0) as f32, share: rng.range32(0.1, 0.9) },
        2 => {
            let size = [rng.log_range(0.1, 1.0) as f32, rng.log_range(0.1, 0.6) as f32];
            Pattern::Bricks { other, size, joint: 0.1 * size[1], variation: rng.range32(0.2, 0.9), seed }
        }
        _ => {
            let pitch = [rng.log_range(0.3, 2.0) as f32, rng.log_range(0.3, 2.0) as f32];
            let fill = [rng.range32(0.3, 0.95), rng.range32(0.3, 0.95)];
            Pattern::Windows { other, pitch, fill, lit: 0.0, seed }
        }
    }
}

/// Lighter or darker, grey, or anything at all.
fn other_color(color: Color, rng: &mut SceneRng) -> Color {
    match rng.weighted(&[(0, 4.0), (1, 4.0), (2, 2.0)]) {
        0 => times(color, rng.log_range(0.1, 10.0) as f32).map(|c| c.clamp(0.004, 0.85)),
        1 => grey(rng.log_range(0.01, 0.7) as f32),
        _ => any_color(rng),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::palette::matte;

    #[test]
    fn plain_surfaces_get_patterns_and_lamps_and_fences_keep_theirs() {
        let fence = Material { pattern: Pattern::Worn { scale: 0.1, wear: 0.5, seed: 1 }, ..matte(grey(0.3)) };
        let lamp = Material { emission: [3.0; 3], ..matte(grey(0.3)) };
        let glass = Material { reflectivity: 0.1, ..matte(grey(0.02)) };
        let mut materials = [vec![fence, lamp], vec![glass; 300]].concat();
        spread(&mut materials, &mut SceneRng::new(1, 2, 3));
        assert_eq!(materials[..2], [fence, lamp]);
        let changed: Vec<_> = materials[2..].iter().filter(|material| **material != glass).collect();
        assert!((30..270).contains(&changed.len()), "{} of 300 panes got a pattern", changed.len());
        assert!(changed.iter().all(|m| m.pattern != Pattern::Plain && (0.02..=0.36).contains(&m.reflectivity)));
    }
}
