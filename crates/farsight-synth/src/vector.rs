//! Arithmetic of vectors and a few functions, exact to the bit on every machine: only `+ - * /`, square roots and
//! whole numbers.
//!
//! The standard library's `exp` and `powf` are the system's, and differ from machine to machine.

use crate::scene::{Color, Vec3};

/// Scalar product.
#[inline]
pub(crate) fn dot(a: Vec3, b: Vec3) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
#[inline]
pub(crate) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a + b`.
#[inline]
pub(crate) fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[inline]
pub(crate) fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `a * factor`.
#[inline]
pub(crate) fn scale(a: Vec3, factor: f32) -> Vec3 {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

/// `a + b * factor`.
#[inline]
pub(crate) fn add_scaled(a: Vec3, b: Vec3, factor: f32) -> Vec3 {
    [a[0] + b[0] * factor, a[1] + b[1] * factor, a[2] + b[2] * factor]
}

/// `a` where `share` is 0, `b` where it is 1.
#[inline]
pub(crate) fn mix(a: Color, b: Color, share: f32) -> Color {
    [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share]
}

/// The unit vector along `a`; one of length 0 stays as it is.
#[inline]
pub(crate) fn normalized(a: Vec3) -> Vec3 {
    let square = dot(a, a);
    if square > 0.0 { scale(a, 1.0 / square.sqrt()) } else { a }
}

/// Its norm.
#[inline]
pub(crate) fn length(a: Vec3) -> f32 {
    dot(a, a).sqrt()
}

/// The unit vector along `a`; straight up where `a` has no direction.
pub(crate) fn unit(a: Vec3) -> Vec3 {
    let norm = length(a);
    if norm > 1e-9 { scale(a, 1.0 / norm) } else { [0.0, -1.0, 0.0] }
}

/// A count below two thousand million as a number: one instruction, where a 64-bit count takes a branch and several.
#[inline]
pub(crate) fn float(count: usize) -> f32 {
    count as i32 as f32
}

/// The largest whole number not above `x`, for numbers between minus and plus four million.
///
/// The standard library's is a function call on processors without SSE 4.1, and its casts check for numbers that do
/// not fit.
#[inline]
pub(crate) fn floor(x: f32) -> i32 {
    // 1.5 * 2^23: the sum has no bits left for a fraction, and its lowest bits are the nearest whole number.
    const LARGE: f32 = 12_582_912.0;
    let sum = x + LARGE;
    let nearest = sum.to_bits().wrapping_sub(LARGE.to_bits()) as i32;
    nearest - i32::from(sum - LARGE > x)
}

/// 2 to the power `x`, to 1e-6 of itself; 0 below -126.
#[inline]
pub(crate) fn exp2(x: f32) -> f32 {
    if x < -126.0 {
        return 0.0;
    }
    let x = x.min(127.0);
    let whole = floor(x);
    let t = (x - whole as f32) * std::f32::consts::LN_2;
    // Taylor's series of e^t up to ln 2.
    let series =
        1.0 + t * (1.0 + t * (0.5 + t * (1.0 / 6.0 + t * (1.0 / 24.0 + t * (1.0 / 120.0 + t * (1.0 / 720.0))))));
    series * f32::from_bits(((whole + 127) as u32) << 23)
}

/// e to the power `x`.
#[inline]
pub(crate) fn exp(x: f32) -> f32 {
    exp2(x * std::f32::consts::LOG2_E)
}

/// Logarithm to base 2 of a positive normal number, to 2e-5.
#[inline]
pub(crate) fn log2(x: f32) -> f32 {
    let bits = x.to_bits();
    let exponent = (bits >> 23) as i32 - 127;
    let mantissa = f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000);
    // log2(m) = 2/ln 2 * artanh((m - 1) / (m + 1)); the argument is at most 1/3.
    let t = (mantissa - 1.0) / (mantissa + 1.0);
    let square = t * t;
    let series = t * (1.0 + square * (1.0 / 3.0 + square * (1.0 / 5.0 + square * (1.0 / 7.0 + square * (1.0 / 9.0)))));
    exponent as f32 + series * (2.0 * std::f32::consts::LOG2_E)
}

/// `base` to the power `exponent`; 0 for a base that is not positive.
#[inline]
pub(crate) fn pow(base: f32, exponent: f32) -> f32 {
    if base < f32::MIN_POSITIVE { 0.0 } else { exp2(log2(base) * exponent) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_agree_with_the_standard_library() {
        for i in 1..4000 {
            let x = i as f32 * 0.01;
            assert!((log2(x) - x.log2()).abs() < 2e-5, "log2({x})");
            let y = x - 20.0;
            assert!((exp(y) / y.exp() - 1.0).abs() < 1e-5, "exp({y})");
            assert!((pow(x, 2.2) / x.powf(2.2) - 1.0).abs() < 1e-4, "pow({x})");
        }
        for (found, expected) in [(exp2(0.0), 1.0), (exp2(-200.0), 0.0), (pow(0.0, 2.0), 0.0)] {
            assert!((found - expected).abs() < 1e-7, "{found} is not {expected}");
        }
    }

    #[test]
    fn floors_are_those_of_the_standard_library() {
        for x in [0.0, -0.0, 0.5, -0.5, 1.5, 2.5, -1.5, 7.0, -7.0, 1e-9, -1e-9, 0.999_999_9, 3_999_999.8, -3_999_999.8]
        {
            assert_eq!(floor(x), x.floor() as i32, "floor of {x}");
        }
    }
}
