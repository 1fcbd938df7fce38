//! Streaks of falling rain.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::scene::Color;
use crate::vector::{add, mix, scale};

/// Streaks in a picture of 466,000 pixels when it rains as hard as it can.
const MAX_STREAKS: f32 = 900.0;

/// Draws streaks; `strength` 0 draws none.
pub(super) fn fall(light: &mut [Color], size: [usize; 2], strength: f32, seed: u64) {
    if strength <= 0.0 {
        return;
    }
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut between = |least: f32, most: f32| least + (most - least) * rng.random::<f32>();
    let [width, height] = size.map(|s| s as f32);
    // Drops show the light of their surroundings: brighter than the mean of the picture.
    let bright = scale(mean(light), 1.6);
    let slant = between(-0.25, 0.25);
    let count = MAX_STREAKS * strength * width * height / 466_000.0;
    for _ in 0..count as usize {
        let near = between(0.0, 1.0);
        let streak = Streak {
            from: [between(0.0, width), between(-0.1, 1.0) * height],
            length: 6.0 + 34.0 * near * near,
            slant: slant + between(-0.04, 0.04),
            share: between(0.05, 0.22),
            width: 0.5 + near,
        };
        streak.draw(light, size, bright);
    }
}

fn mean(light: &[Color]) -> Color {
    let every = 101;
    let sum = light.iter().step_by(every).fold([0.0; 3], |sum, &c| add(sum, c.map(|v| v.min(1.5))));
    scale(sum, 1.0 / light.len().div_ceil(every).max(1) as f32)
}

struct Streak {
    from: [f32; 2],
    length: f32,
    /// Pixels across for each pixel down.
    slant: f32,
    share: f32,
    width: f32,
}

impl Streak {
    fn draw(&self, light: &mut [Color], [width, height]: [usize; 2], color: Color) {
        let [x, y] = self.from;
        for row in y.max(0.0) as usize..((y + self.length).max(0.0) as usize).min(height) {
            let middle = x + (row as f32 - y) * self.slant;
            let first = (middle - self.width).ceil().max(0.0);
            let last = (middle + self.width).floor().min(width as f32 - 1.0);
            let mut column = first;
            while column <= last {
                let inside = 1.0 - (column - middle).abs() / (self.width + 0.5);
                let pixel = &mut light[row * width + column as usize];
                *pixel = mix(*pixel, color, self.share * inside.max(0.0));
                column += 1.0;
            }
        }
    }
}
