//! Where a patch of one picture is in another: Lucas and Kanade's method on pyramids, inverse compositional (Baker and
//! Matthews 2004), with the mean brightness left out.

use crate::grey::Grey;

/// Patches reach so many pixels to each side: of the road, whose shape on its way is known, and of other things.
pub(crate) const ROAD_REACH: usize = 6;
pub(crate) const REACH: usize = 4;

/// Most pixels of a patch.
const MOST: usize = (2 * ROAD_REACH + 1) * (2 * ROAD_REACH + 1);

/// Steps on each level, and the step, pixels, that is none.
const STEPS: usize = 8;
const SMALL_STEP_PX: f32 = 0.01;

/// A patch is not looked for farther from where it was expected on a level, pixels.
const MAX_MOVE_PX: f32 = 8.0;

/// A patch is found where what is left is less than this share of its contrast: there are two pictures' noise in it,
/// and one's in the contrast.
const MAX_LEFT: f32 = 1.2;

/// Back in the first picture it must be this near to where it came from, pixels.
const MAX_BACK_PX: f32 = 0.5;

/// Least standard deviation of grey levels; the pixels of a patch are not independent, by so much its information is
/// less.
const LEAST_NOISE: f32 = 1.0;
const CORRELATION: f32 = 4.0;

/// Least standard deviation of a place, pixels, and the largest, in a direction in which there is no texture.
const LEAST_SIGMA_PX: f32 = 0.06;
const MOST_SIGMA_PX: f32 = 6.0;

/// A linear map of the plane.
pub(crate) type Map = [[f32; 2]; 2];

/// Where a patch is, and how surely.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// Pixels.
    pub(crate) place: [f32; 2],
    /// Of the place: xx, xy, yy, pixels².
    pub(crate) covariance: [f32; 3],
}

/// A patch with its slopes.
struct Patch {
    reach: usize,
    values: [f32; MOST],
    slopes: [[f32; 2]; MOST],
    /// Sums of the products of slopes, which have mean zero, and their regular inverse.
    tensor: [f32; 3],
    inverse: [f32; 3],
    contrast: f32,
}

impl Patch {
    fn new(picture: &Grey, [x, y]: [f32; 2], reach: usize) -> Option<Self> {
        const WIDE: usize = 2 * ROAD_REACH + 3;
        if !picture.holds([x, y], reach as f32 + 1.0) {
            return None;
        }
        let (side, wide_side) = (2 * reach + 1, 2 * reach + 3);
        let mut wide = [[0.0; WIDE]; WIDE];
        let start = [x, y].map(|v| v - (reach + 1) as f32);
        for (row, line) in wide.iter_mut().take(wide_side).enumerate() {
            picture.sample(start[0], start[1] + row as f32, &mut line[..wide_side]);
        }
        let (mut values, mut slopes, mut means) = ([0.0; MOST], [[0.0; 2]; MOST], [0.0; 3]);
        for row in 0..side {
            for column in 0..side {
                let (index, r, c) = (row * side + column, row + 1, column + 1);
                values[index] = wide[r][c];
                slopes[index] = [0.5 * (wide[r][c + 1] - wide[r][c - 1]), 0.5 * (wide[r + 1][c] - wide[r - 1][c])];
                means[0] += slopes[index][0];
                means[1] += slopes[index][1];
                means[2] += values[index];
            }
        }
        let count = side * side;
        let means = means.map(|sum| sum / count as f32);
        let (mut tensor, mut contrast) = ([0.0; 3], 0.0);
        for (slope, value) in slopes.iter_mut().zip(&mut values).take(count) {
            *slope = [slope[0] - means[0], slope[1] - means[1]];
            *value -= means[2];
            tensor[0] += slope[0] * slope[0];
            tensor[1] += slope[0] * slope[1];
            tensor[2] += slope[1] * slope[1];
            contrast += *value * *value;
        }
        // Where there is no texture a place stays about where it was expected.
        let ridge = CORRELATION * LEAST_NOISE * LEAST_NOISE / (MOST_SIGMA_PX * MOST_SIGMA_PX);
        let inverse = inverted([tensor[0] + ridge, tensor[1], tensor[2] + ridge]);
        Some(Self { reach, values, slopes, tensor, inverse, contrast })
    }

    fn count(&self) -> usize {
        (2 * self.reach + 1) * (2 * self.reach + 1)
    }

    /// Where it is in `picture`, near `place` and turned and stretched by `map`; and what is left, grey levels squared.
    fn align(&self, picture: &Grey, start: [f32; 2], map: &Map) -> Option<([f32; 2], f32)> {
        let reach = self.reach as f32 * map.iter().map(|row| row[0].abs() + row[1].abs()).fold(0.0, f32::max);
        let mut place = start;
        let mut left = 0.0;
        for step in 0..=STEPS {
            if !picture.holds(place, reach) {
                return None;
            }
            let side = 2 * self.reach + 1;
            let (mut sums, mut sum, mut squares) = ([0.0; 2], 0.0, 0.0);
            for row in 0..side {
                let (dx, dy) = (-(self.reach as f32), row as f32 - self.reach as f32);
                let (mut x, mut y) =
                    (place[0] + map[0][0] * dx + map[0][1] * dy, place[1] + map[1][0] * dx + map[1][1] * dy);
                let (values, slopes) = (&self.values[row * side..][..side], &self.slopes[row * side..][..side]);
                for (expected, slope) in values.iter().zip(slopes) {
                    let off = picture.at(x, y) - expected;
                    sum += off;
                    squares += off * off;
                    sums[0] += slope[0] * off;
                    sums[1] += slope[1] * off;
                    (x, y) = (x + map[0][0], y + map[1][0]);
                }
            }
            let count = (side * side) as f32;
            left = squares / count - (sum / count) * (sum / count);
            let [xx, xy, yy] = self.inverse;
            let [a, b] = [xx * sums[0] + xy * sums[1], xy * sums[0] + yy * sums[1]];
            if a.hypot(b) < SMALL_STEP_PX || step == STEPS {
                break;
            }
            place[0] -= map[0][0] * a + map[0][1] * b;
            place[1] -= map[1][0] * a + map[1][1] * b;
            let moved_px = (place[0] - start[0]).hypot(place[1] - start[1]);
            if moved_px.is_nan() || moved_px > MAX_MOVE_PX {
                return None;
            }
        }
        Some((place, left))
    }

    /// The covariance of where it is found, in the coordinates of the other picture.
    fn covariance(&self, left: f32, map: &Map) -> [f32; 3] {
        let noise = CORRELATION * left.max(LEAST_NOISE * LEAST_NOISE);
        let ridge = noise / (MOST_SIGMA_PX * MOST_SIGMA_PX);
        let [xx, xy, yy] = inverted([self.tensor[0] + ridge, self.tensor[1], self.tensor[2] + ridge]);
        let own = [[xx * noise, xy * noise], [xy * noise, yy * noise]];
        let entry = |i: usize, j: usize| -> f32 {
            (0..2).map(|a| (0..2).map(|b| map[i][a] * own[a][b] * map[j][b]).sum::<f32>()).sum()
        };
        let least = LEAST_SIGMA_PX * LEAST_SIGMA_PX;
        [entry(0, 0) + least, entry(0, 1), entry(1, 1) + least]
    }
}

/// Looks for the patch around `from` of the first pyramid in the second one: near `expected`, turned and stretched by
/// `map`, beginning on the pyramids' level `coarsest`, with patches that reach so far. None where it is not found, or
/// is not found back.
pub(crate) fn find(
    [first, second]: [&[Grey]; 2],
    from: [f32; 2],
    expected: [f32; 2],
    map: &Map,
    [coarsest, reach]: [usize; 2],
) -> Option<Found> {
    let (place, left, patch) = on_levels([first, second], from, expected, map, [coarsest, reach])?;
    // Back from there: to where it would be if it had gone as expected.
    let back = inverse_map(map)?;
    let moved = [place[0] - expected[0], place[1] - expected[1]];
    let start = [0, 1].map(|i| from[i] + back[i][0] * moved[0] + back[i][1] * moved[1]);
    let (returned, ..) = on_levels([second, first], place, start, &back, [coarsest.min(1), reach])?;
    let [x, y] = [returned[0] - from[0], returned[1] - from[1]];
    let [xx, xy, yy] = patch.tensor;
    let strongest = 0.5 * (xx + yy) + (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
    let off = ((xx * x * x + 2.0 * xy * x * y + yy * y * y) / strongest).sqrt();
    (off < MAX_BACK_PX).then(|| Found { place, covariance: patch.covariance(left, map) })
}

/// The place on the finest level, what is left there, and the patch.
fn on_levels(
    [first, second]: [&[Grey]; 2],
    from: [f32; 2],
    expected: [f32; 2],
    map: &Map,
    [coarsest, reach]: [usize; 2],
) -> Option<([f32; 2], f32, Patch)> {
    let mut place = expected;
    for level in (0..=coarsest).rev() {
        let scale = (1_usize << level) as f32;
        let down = |at: [f32; 2]| at.map(|v| (v + 0.5) / scale - 0.5);
        let Some(patch) = Patch::new(&first[level], down(from), reach) else {
            if level == 0 {
                return None;
            }
            continue;
        };
        match patch.align(&second[level], down(place), map) {
            Some((found, left)) => {
                place = found.map(|v| (v + 0.5) * scale - 0.5);
                if level == 0 {
                    return (left * (patch.count() as f32) < MAX_LEFT * patch.contrast).then_some((place, left, patch));
                }
            }
            None if level == 0 => return None,
            None => {}
        }
    }
    None
}

fn inverted([xx, xy, yy]: [f32; 3]) -> [f32; 3] {
    let determinant = xx * yy - xy * xy;
    [yy / determinant, -xy / determinant, xx / determinant]
}

fn inverse_map([[a, b], [c, d]]: &Map) -> Option<Map> {
    let determinant = a * d - b * c;
    (determinant > 0.1).then(|| [[d / determinant, -b / determinant], [-c / determinant, a / determinant]])
}

#[cfg(test)]
mod tests {
    use super::{REACH, find};
    use crate::grey::{Grey, LEVELS, pyramid};

    /// Waves that no shift repeats.
    fn picture(shift: [f32; 2]) -> Vec<Grey> {
        let size = [200, 120];
        let value = |x: f32, y: f32| {
            let wave = |a: f32, b: f32, c: f32| (a * x + b * y + c).sin();
            128.0 + 30.0 * wave(0.31, 0.11, 0.0) + 25.0 * wave(-0.12, 0.27, 1.0) + 30.0 * wave(0.05, 0.06, 2.0)
        };
        let pixels = (0..size[0] * size[1])
            .map(|k| value((k % size[0]) as f32 - shift[0], (k / size[0]) as f32 - shift[1]))
            .collect();
        pyramid(Grey { size, pixels })
    }

    #[test]
    fn a_shift_is_found_to_a_thirtieth_of_a_pixel_and_an_edge_tells_only_what_lies_across() {
        let first = picture([0.0; 2]);
        for shift in [[0.3, -0.7], [4.2, 2.6], [-9.4, 6.1]] {
            let second = picture(shift);
            let found =
                find([&first, &second], [90.0, 60.0], [90.0, 60.0], &[[1.0, 0.0], [0.0, 1.0]], [LEVELS - 1, REACH]);
            let found = found.expect("found").place;
            let off = [found[0] - 90.0 - shift[0], found[1] - 60.0 - shift[1]];
            assert!(off[0].hypot(off[1]) < 0.03, "{shift:?}: {off:?}");
        }
        let edge = |shift: f32| {
            let pixels = (0..200 * 120).map(|k| 128.0 + 80.0 * (((k % 200) as f32 - 90.0 - shift) / 4.0).tanh());
            pyramid(Grey { size: [200, 120], pixels: pixels.collect() })
        };
        let found = find([&edge(0.0), &edge(1.5)], [90.0, 60.0], [90.0, 60.0], &[[1.0, 0.0], [0.0, 1.0]], [1, REACH]);
        let found = found.expect("found");
        assert!((found.place[0] - 91.5).abs() < 0.02, "{found:?}");
        assert!(found.covariance[0] < 0.02 && found.covariance[2] > 4.0, "{found:?}");
    }

    #[test]
    fn what_is_not_there_is_not_found() {
        let flat = pyramid(Grey { size: [200, 120], pixels: vec![128.0; 200 * 120] });
        let map = [[1.0, 0.0], [0.0, 1.0]];
        assert!(find([&picture([0.0; 2]), &flat], [90.0, 60.0], [90.0, 60.0], &map, [2, REACH]).is_none());
        assert!(find([&picture([0.0; 2]), &picture([0.0; 2])], [2.0, 60.0], [2.0, 60.0], &map, [2, REACH]).is_none());
    }
}
