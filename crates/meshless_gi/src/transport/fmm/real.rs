//! The two precisions of the expansions. A bake and the tests of errors by order use `f64`, the
//! twins of the GPU kernels use `f32`. The code is the same.

use std::ops::{Add, AddAssign, Mul, Sub};

/// Floating-point type.
pub trait Real:
    Copy
    + Default
    + Send
    + Sync
    + PartialOrd
    + Add<Output = Self>
    + AddAssign
    + Sub<Output = Self>
    + Mul<Output = Self>
    + 'static
{
    /// Rounds to the nearest number of this type.
    fn from_f64(value: f64) -> Self;
    /// Converts to `f64`.
    fn wide(self) -> f64;
    /// Returns the square root, correctly rounded on every machine.
    fn sqrt(self) -> Self;
    /// Returns 1 / self.
    fn reciprocal(self) -> Self;
}

impl Real for f64 {
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn reciprocal(self) -> Self {
        1.0 / self
    }
}

impl Real for f32 {
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn reciprocal(self) -> Self {
        1.0 / self
    }
}
