//! Eight numbers side by side, in as many registers as they take.
//!
//! The number of lanes is the same for every instruction set, so sums over lanes have one order and results the same
//! bytes everywhere.

use std::ops::{Add, Deref, DerefMut, Div, Mul, Sub};

use pulp::Simd;

/// Numbers side by side; the widest register in use (AVX-512) holds as many.
pub(crate) const LANES: usize = 8;

/// Calls a method with the number of registers that hold eight numbers as its last constant. A given register width fixes it, so only one
/// arm is compiled.
macro_rules! in_registers {
    ($this:ident.$method:ident<$simd:ident $(, $constant:tt)*>($($argument:expr),*)) => {
        match $crate::wide::LANES / $simd::F64_LANES {
            1 => $this.$method::<$simd, $($constant,)* 1>($($argument),*),
            2 => $this.$method::<$simd, $($constant,)* 2>($($argument),*),
            4 => $this.$method::<$simd, $($constant,)* 4>($($argument),*),
            _ => $this.$method::<$simd, $($constant,)* { $crate::wide::LANES }>($($argument),*),
        }
    };
}
pub(crate) use in_registers;

/// Doubles that begin on a cache line, so that no register load straddles two.
#[derive(Debug)]
pub(crate) struct Aligned {
    storage: Vec<f64>,
    offset: usize,
    len: usize,
}

impl Aligned {
    pub(crate) fn zeros(len: usize) -> Self {
        let storage = vec![0.0; len + LANES];
        // The allocator aligns to eight bytes at least, so at most seven doubles are skipped.
        let offset = storage.as_ptr().align_offset(64).min(LANES);
        Self { storage, offset, len }
    }
}

impl Aligned {
    /// The numbers by eights.
    #[inline(always)]
    pub(crate) fn lanes_mut(&mut self) -> &mut [[f64; LANES]] {
        self.as_chunks_mut().0
    }
}

impl Deref for Aligned {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        &self.storage[self.offset..self.offset + self.len]
    }
}

impl DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.storage[self.offset..self.offset + self.len]
    }
}

/// [`LANES`] numbers in `P` registers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wide<S: Simd, const P: usize> {
    simd: S,
    registers: [S::f64s; P],
}

#[expect(clippy::needless_range_loop, reason = "one index for several arrays, constant bounds")]
impl<S: Simd, const P: usize> Wide<S, P> {
    #[inline(always)]
    pub(crate) fn splat(simd: S, value: f64) -> Self {
        Self { simd, registers: [simd.splat_f64s(value); P] }
    }

    #[inline(always)]
    pub(crate) fn load(simd: S, values: &[f64; LANES]) -> Self {
        let mut registers = [simd.splat_f64s(0.0); P];
        registers.copy_from_slice(S::as_simd_f64s(values).0);
        Self { simd, registers }
    }

    #[inline(always)]
    pub(crate) fn store(self, values: &mut [f64; LANES]) {
        S::as_mut_simd_f64s(values).0.copy_from_slice(&self.registers);
    }

    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(S, S::f64s, S::f64s) -> S::f64s) -> Self {
        let mut registers = self.registers;
        for p in 0..P {
            registers[p] = f(self.simd, self.registers[p], other.registers[p]);
        }
        Self { simd: self.simd, registers }
    }

    /// `self * factor + term`, rounded once.
    #[inline(always)]
    pub(crate) fn mul_add(self, factor: Self, term: Self) -> Self {
        let mut registers = self.registers;
        for p in 0..P {
            registers[p] = self.simd.mul_add_f64s(self.registers[p], factor.registers[p], term.registers[p]);
        }
        Self { simd: self.simd, registers }
    }

    /// The larger of each two; `other` where either is NaN.
    #[inline(always)]
    pub(crate) fn larger(self, other: Self) -> Self {
        self.with(
            other,
            #[inline(always)]
            |simd, a, b| simd.select_f64s(simd.greater_than_f64s(a, b), a, b),
        )
    }

    /// The smaller of each two; `other` where either is NaN.
    #[inline(always)]
    pub(crate) fn smaller(self, other: Self) -> Self {
        self.with(
            other,
            #[inline(always)]
            |simd, a, b| simd.select_f64s(simd.less_than_f64s(a, b), a, b),
        )
    }

    /// `value` and its `tag` where `value` is larger, `self` and `own` elsewhere.
    #[inline(always)]
    pub(crate) fn or_larger(self, value: Self, own: Self, tag: Self) -> (Self, Self) {
        let (mut most, mut tags) = (self, own);
        for p in 0..P {
            let larger = self.simd.greater_than_f64s(value.registers[p], self.registers[p]);
            most.registers[p] = self.simd.select_f64s(larger, value.registers[p], self.registers[p]);
            tags.registers[p] = self.simd.select_f64s(larger, tag.registers[p], own.registers[p]);
        }
        (most, tags)
    }

    /// The square root of each.
    #[inline(always)]
    pub(crate) fn square_root(self) -> Self {
        let mut registers = self.registers;
        for p in 0..P {
            registers[p] = self.simd.sqrt_f64s(self.registers[p]);
        }
        Self { simd: self.simd, registers }
    }

    /// Whether every number is within `[low, high)`; NaN is not.
    #[inline(always)]
    pub(crate) fn all_in(self, low: f64, high: f64) -> bool {
        let Self { simd, registers } = self;
        let mut all = true;
        for v in registers {
            let above = simd.less_than_or_equal_f64s(simd.splat_f64s(low), v);
            let within = simd.and_m64s(above, simd.less_than_f64s(v, simd.splat_f64s(high)));
            all &= simd.first_true_m64s(simd.not_m64s(within)) >= S::F64_LANES;
        }
        all
    }

    /// Whether every magnitude is at most `bound`; NaN is not.
    #[inline(always)]
    pub(crate) fn all_within(self, bound: f64) -> bool {
        let Self { simd, registers } = self;
        let mut all = true;
        for v in registers {
            let within = simd.less_than_or_equal_f64s(simd.abs_f64s(v), simd.splat_f64s(bound));
            all &= simd.first_true_m64s(simd.not_m64s(within)) >= S::F64_LANES;
        }
        all
    }
}

macro_rules! operator {
    ($name:ident, $method:ident, $instruction:ident) => {
        impl<S: Simd, const P: usize> $name for Wide<S, P> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.with(
                    other,
                    #[inline(always)]
                    |simd, a, b| simd.$instruction(a, b),
                )
            }
        }
    };
}

operator!(Add, add, add_f64s);
operator!(Sub, sub, sub_f64s);
operator!(Mul, mul, mul_f64s);
operator!(Div, div, div_f64s);
