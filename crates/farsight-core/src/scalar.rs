//! Numbers that the geometry computes with: plain `f64`, or dual numbers that carry derivatives along.
//!
//! Forward-mode differentiation over eight variables is all the loss needs; a general library brings a matrix library
//! with it.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number, or one with derivatives.
pub trait Scalar:
    Copy
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
{
    /// The value without its derivatives.
    fn value(self) -> f64;
    /// e to this power.
    #[must_use]
    fn exp(self) -> Self;
    /// Square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// Sine and cosine of an angle in radians.
    fn sin_cos(self) -> (Self, Self);
    /// The angle of the point (`other`, `self`), radians.
    #[must_use]
    fn atan2(self, other: Self) -> Self;
}

impl Scalar for f64 {
    fn value(self) -> f64 {
        self
    }

    fn exp(self) -> Self {
        self.exp()
    }

    fn sqrt(self) -> Self {
        self.sqrt()
    }

    fn sin_cos(self) -> (Self, Self) {
        self.sin_cos()
    }

    fn atan2(self, other: Self) -> Self {
        self.atan2(other)
    }
}

/// A value and its derivatives with respect to `N` variables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<const N: usize> {
    /// The value.
    pub value: f64,
    /// Its derivative with respect to each variable.
    pub gradient: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// A number that depends on no variable.
    pub const fn constant(value: f64) -> Self {
        Self { value, gradient: [0.0; N] }
    }

    /// The variables themselves, at these values.
    pub fn variables(values: [f64; N]) -> [Self; N] {
        std::array::from_fn(|i| Self {
            value: values[i],
            gradient: std::array::from_fn(|j| f64::from(u8::from(i == j))),
        })
    }

    /// `value` with this gradient times `slope`: the chain rule.
    fn chain(self, value: f64, slope: f64) -> Self {
        Self { value, gradient: self.gradient.map(|g| g * slope) }
    }

    /// `value` with the gradient `slope * self + other_slope * other`.
    fn combine(self, other: Self, value: f64, slope: f64, other_slope: f64) -> Self {
        Self { value, gradient: std::array::from_fn(|i| self.gradient[i] * slope + other.gradient[i] * other_slope) }
    }
}

impl<const N: usize> Scalar for Dual<N> {
    fn value(self) -> f64 {
        self.value
    }

    fn exp(self) -> Self {
        let exp = self.value.exp();
        self.chain(exp, exp)
    }

    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, 0.5 / root)
    }

    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }

    fn atan2(self, other: Self) -> Self {
        let (y, x) = (self.value, other.value);
        let squared_norm = x * x + y * y;
        self.combine(other, y.atan2(x), x / squared_norm, -y / squared_norm)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;

    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        self.combine(other, self.value + other.value, 1.0, 1.0)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self.combine(other, self.value - other.value, 1.0, -1.0)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        self.combine(other, self.value * other.value, other.value, self.value)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let quotient = self.value / other.value;
        self.combine(other, quotient, 1.0 / other.value, -quotient / other.value)
    }
}

impl<const N: usize> Add<f64> for Dual<N> {
    type Output = Self;

    fn add(self, other: f64) -> Self {
        self.chain(self.value + other, 1.0)
    }
}

impl<const N: usize> Sub<f64> for Dual<N> {
    type Output = Self;

    fn sub(self, other: f64) -> Self {
        self.chain(self.value - other, 1.0)
    }
}

impl<const N: usize> Mul<f64> for Dual<N> {
    type Output = Self;

    fn mul(self, other: f64) -> Self {
        self.chain(self.value * other, other)
    }
}

#[cfg(test)]
mod tests {
    use super::{Dual, Scalar};

    /// A function that uses every operation of the trait.
    fn every_operation<S: Scalar>(x: S, y: S) -> S {
        let (sin, cos) = (x * y).sin_cos();
        let quotient = (sin + x.exp()) / ((cos - y) * y + 3.0);
        (quotient * quotient + 0.5).sqrt().atan2(-x * 0.25 - 0.1) - quotient
    }

    #[test]
    fn derivatives_equal_central_differences() {
        const STEP: f64 = 1e-6;
        for [x, y] in [[0.3, 0.7], [-1.2, 0.4], [2.0, -0.5]] {
            let [dx, dy] = Dual::variables([x, y]);
            let dual = every_operation(dx, dy);
            assert!((dual.value - every_operation(x, y)).abs() < 1e-14);
            let slope_x = (every_operation(x + STEP, y) - every_operation(x - STEP, y)) / (2.0 * STEP);
            let slope_y = (every_operation(x, y + STEP) - every_operation(x, y - STEP)) / (2.0 * STEP);
            assert!((dual.gradient[0] - slope_x).abs() < 1e-8, "{} {slope_x}", dual.gradient[0]);
            assert!((dual.gradient[1] - slope_y).abs() < 1e-8, "{} {slope_y}", dual.gradient[1]);
        }
    }
}
