//! Arithmetic on four places at once: what `crate::vector` is for one.
//!
//! Only operations that every processor rounds alike; `min` and `max` are never given anything that is not a number.

use wide::{bytemuck::cast, f32x4, i32x4};

use crate::scene::Color;

/// One number for each of four places.
pub(crate) type Lanes = f32x4;

/// A vector or colour for each of four places.
pub(crate) type Vec3s = [Lanes; 3];

/// The same number everywhere.
#[inline]
pub(crate) fn all(value: f32) -> Lanes {
    Lanes::splat(value)
}

/// The same vector everywhere.
#[inline]
pub(crate) fn all3(value: [f32; 3]) -> Vec3s {
    [all(value[0]), all(value[1]), all(value[2])]
}

#[inline]
pub(crate) fn dot(a: Vec3s, b: Vec3s) -> Lanes {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
pub(crate) fn add(a: Vec3s, b: Vec3s) -> Vec3s {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline]
pub(crate) fn sub(a: Vec3s, b: Vec3s) -> Vec3s {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
pub(crate) fn scale(a: Vec3s, factor: Lanes) -> Vec3s {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

#[inline]
pub(crate) fn add_scaled(a: Vec3s, b: Vec3s, factor: Lanes) -> Vec3s {
    [a[0] + b[0] * factor, a[1] + b[1] * factor, a[2] + b[2] * factor]
}

#[inline]
pub(crate) fn multiply(a: Vec3s, b: Vec3s) -> Vec3s {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}

/// `a` where `share` is 0, `b` where it is 1.
#[inline]
pub(crate) fn mix(a: Vec3s, b: Vec3s, share: Lanes) -> Vec3s {
    add_scaled(a, sub(b, a), share)
}

/// Between two colours that are the same everywhere.
#[inline]
pub(crate) fn mix_colors(a: Color, b: Color, share: Lanes) -> Vec3s {
    let channel = |i: usize| all(a[i]) + all(b[i] - a[i]) * share;
    [channel(0), channel(1), channel(2)]
}

/// The unit vector along `a`, which must not be very short.
#[inline]
pub(crate) fn normalized(a: Vec3s) -> Vec3s {
    scale(a, all(1.0) / dot(a, a).fast_max(all(1e-30)).sqrt())
}

/// `x` between two limits.
#[inline]
pub(crate) fn clamp(x: Lanes, least: f32, most: f32) -> Lanes {
    x.fast_max(all(least)).fast_min(all(most))
}

/// `a` where the mask is set, `b` elsewhere.
#[inline]
pub(crate) fn choose(mask: Lanes, a: Lanes, b: Lanes) -> Lanes {
    mask.bitselect(a, b)
}

/// 0 up to `from`, 1 from `to` on, smooth between.
#[inline]
pub(crate) fn smooth_step(from: Lanes, to: Lanes, x: Lanes) -> Lanes {
    let t = clamp((x - from) / (to - from), 0.0, 1.0);
    t * t * (all(3.0) - all(2.0) * t)
}

/// The largest whole numbers not above `x`, for numbers between minus and plus four million.
#[inline]
pub(crate) fn floor(x: Lanes) -> Lanes {
    // 1.5 * 2^23: the sum has no bits left for a fraction.
    let large = all(12_582_912.0);
    let nearest = (x + large) - large;
    nearest - (nearest.simd_gt(x) & all(1.0))
}

/// Whole numbers as integers.
#[inline]
pub(crate) fn integers(whole: Lanes) -> i32x4 {
    whole.fast_trunc_int()
}

/// 2 to the power `x`, to 1e-6 of itself, for x up to 127; next to 0 below -126.
#[inline]
pub(crate) fn exp2(x: Lanes) -> Lanes {
    let x = x.fast_max(all(-126.0));
    let whole = floor(x);
    let t = (x - whole) * all(std::f32::consts::LN_2);
    // Taylor's series of e^t up to ln 2.
    let mut series = all(1.0 / 720.0);
    for coefficient in [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
        series = series * t + all(coefficient);
    }
    let power: Lanes = cast((integers(whole) + i32x4::splat(127)) << 23);
    series * power
}

/// e to the power `x`.
#[inline]
pub(crate) fn exp(x: Lanes) -> Lanes {
    exp2(x * all(std::f32::consts::LOG2_E))
}

/// Logarithm to base 2 of positive normal numbers, to 2e-5.
#[inline]
fn log2(x: Lanes) -> Lanes {
    let bits: i32x4 = cast(x);
    let exponent = (bits >> 23) - i32x4::splat(127);
    let mantissa: Lanes = cast((bits & i32x4::splat(0x007f_ffff)) | i32x4::splat(0x3f80_0000));
    // log2(m) = 2/ln 2 * artanh((m - 1) / (m + 1)); the argument is at most 1/3.
    let t = (mantissa - all(1.0)) / (mantissa + all(1.0));
    let square = t * t;
    let mut series = all(1.0 / 9.0);
    for coefficient in [1.0 / 7.0, 1.0 / 5.0, 1.0 / 3.0, 1.0] {
        series = series * square + all(coefficient);
    }
    Lanes::from_i32x4(exponent) + t * series * all(2.0 * std::f32::consts::LOG2_E)
}

/// `base` to the power `exponent`; 0, or next to it, for a base that is not positive.
#[inline]
pub(crate) fn pow(base: Lanes, exponent: Lanes) -> Lanes {
    exp2(log2(base.fast_max(all(1e-30))) * exponent)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_agree_with_the_standard_library() {
        for i in 1..1000 {
            let x = [i as f32 * 0.01, i as f32 * 0.5, i as f32 * 3.0, 1.0 / i as f32];
            let close = |ours: Lanes, theirs: [f32; 4], within: f32| {
                ours.to_array().iter().zip(theirs).all(|(a, b)| (a - b).abs() <= within * b.abs().max(1.0))
            };
            assert!(close(log2(x.into()), x.map(f32::log2), 2e-5), "log2 of {x:?}");
            assert!(close(exp(-Lanes::from(x)), x.map(|x| (-x).exp()), 1e-5), "exp of {x:?}");
            assert!(close(pow(x.into(), all(2.2)), x.map(|x| x.powf(2.2)), 1e-4), "power of {x:?}");
            assert!(close(floor(x.into()), x.map(f32::floor), 0.0), "floor of {x:?}");
            assert!(close(floor(-Lanes::from(x)), x.map(|x| (-x).floor()), 0.0), "floor of -{x:?}");
        }
        assert!(pow(all(0.0), all(2.0)).to_array()[0] < 1e-30);
    }
}
