//! The two widths in which the expansions are computed: `f64` in a bake and for the errors by
//! order, `f32` for the twins of the GPU's kernels. The code is one.

use std::ops::{Add, AddAssign, Mul, Sub};

/// A floating-point number.
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
    /// The nearest number of this width.
    fn from_f64(value: f64) -> Self;
    /// The same number, wide.
    fn wide(self) -> f64;
    /// The square root; correctly rounded on every machine.
    fn sqrt(self) -> Self;
    /// 1 / self.
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
