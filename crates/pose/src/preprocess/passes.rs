//! The two passes over the bytes, compiled for the machine's instruction set.
//!
//! Sums are integers below 2^24, so 32-bit floats hold them exactly.

use pulp::{Simd, WithSimd};

use super::{
    TensorData,
    taps::{Cover, Even, Taps},
};
use crate::{ImageView, card::Layout};

/// A pixel of value 1 after both passes.
pub(super) const SUM_ONE: f32 = 65_536.0;

/// From sums over pixels to the numbers that the network eats, in the picture's order of colours.
#[derive(Clone, Copy)]
pub(super) struct Normalise {
    /// The tensor has the picture's last colour first.
    reversed: bool,
    gain: [f32; 4],
    offset: [f32; 4],
}

impl Normalise {
    /// `gain` and `offset` are in the tensor's order.
    pub(super) fn new(reversed: bool, gain: [f32; 3], offset: [f32; 3]) -> Self {
        let lanes = |[a, b, c]: [f32; 3]| if reversed { [c, b, a, 0.0] } else { [a, b, c, 0.0] };
        Self { reversed, gain: lanes(gain), offset: lanes(offset) }
    }

    #[inline(always)]
    fn apply(&self, sum: [f32; 4]) -> [f32; 4] {
        let mut out = [0.0; 4];
        for lane in 0..4 {
            out[lane] = sum[lane] * self.gain[lane] + self.offset[lane];
        }
        out
    }
}

/// A number of the tensor.
trait Element: Copy {
    fn of(x: f32) -> Self;
}

impl Element for f32 {
    #[inline(always)]
    fn of(x: f32) -> Self {
        x
    }
}

impl Element for i32 {
    #[inline(always)]
    fn of(x: f32) -> Self {
        half_up(x) as Self
    }
}

impl Element for u8 {
    #[inline(always)]
    fn of(x: f32) -> Self {
        half_up(x) as Self
    }
}

/// What is left of this without its fraction is `x.round()`, which has no instruction: the addend is the largest number
/// below a half, so that only halves reach the next integer, and from 2^23 on nothing changes.
#[inline(always)]
pub(super) fn half_up(x: f32) -> f32 {
    x + 0.499_999_97_f32.copysign(x)
}

/// Everything that fills one tensor.
pub(super) struct Fill<'a> {
    pub(super) image: ImageView<'a>,
    pub(super) columns: &'a Taps,
    pub(super) rows: &'a Taps,
    pub(super) layout: Layout,
    pub(super) pad: u8,
    pub(super) norm: Normalise,
    /// Rows that lie outside the picture are in the tensor already.
    pub(super) is_padded: bool,
    pub(super) scratch: &'a mut Scratch,
    pub(super) data: &'a mut TensorData,
}

/// Buffers of one row.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    /// A picture row summed over the rows that a tensor row covers.
    sums: Vec<f32>,
    /// A tensor row: the three colours, and a lane that is not used.
    line: Vec<[f32; 4]>,
}

impl WithSimd for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) {
        let mut data = std::mem::replace(self.data, TensorData::U8(Vec::new()));
        match &mut data {
            TensorData::F32(v) => self.fill::<S, _>(v),
            TensorData::I32(v) => self.fill::<S, _>(v),
            TensorData::U8(v) => self.fill::<S, _>(v),
        }
        *self.data = data;
    }
}

impl Fill<'_> {
    #[inline(always)]
    fn fill<S: Simd, T: Element>(&mut self, data: &mut [T]) {
        let (even, columns) = (self.columns.even(), self.columns.len());
        let mut out = Tensor::new(data, self.layout);
        let used = even.range.len() * 3;
        // Weights of 0 reach over the end, and the horizontal pass reads four numbers at a time.
        self.scratch.sums.resize(used + even.width * 3 + 1, 0.0);
        self.scratch.line.resize(columns, [0.0; 4]);
        for y in 0..self.rows.len() {
            let cover = self.rows.of(y);
            if used > 0 && !cover.weights.is_empty() {
                down(self.image, cover, even.range.start * 3, self.pad, &mut self.scratch.sums[..used]);
                self.across::<S>(even);
            } else if self.is_padded {
                continue;
            } else {
                self.scratch.line.fill(self.norm.apply([f32::from(self.pad) * SUM_ONE; 4]));
            }
            out.write(y, &self.scratch.line, self.norm.reversed);
        }
    }

    /// Horizontal pass and normalisation of one row.
    #[inline(always)]
    fn across<S: Simd>(&mut self, even: &Even) {
        let scratch = &mut *self.scratch;
        match even.width {
            1 => self.across_by::<S, 1>(even),
            2 => self.across_by::<S, 2>(even),
            3 => self.across_by::<S, 3>(even),
            4 => self.across_by::<S, 4>(even),
            5 => self.across_by::<S, 5>(even),
            6 => self.across_by::<S, 6>(even),
            7 => self.across_by::<S, 7>(even),
            8 => self.across_by::<S, 8>(even),
            width => {
                let (pad, norm, sums) = (f32::from(self.pad), self.norm, &scratch.sums[..]);
                let columns = even.first.iter().zip(even.weight.chunks_exact(width)).zip(&even.outside);
                for (out, ((first, weights), outside)) in scratch.line.iter_mut().zip(columns) {
                    *out = norm.apply(pixel::<S>(&sums[*first..][..=width * 3], weights, pad * outside));
                }
            }
        }
    }

    /// With the loop over `K` weights unrolled.
    #[inline(always)]
    fn across_by<S: Simd, const K: usize>(&mut self, even: &Even) {
        let scratch = &mut *self.scratch;
        let (pad, norm, sums) = (f32::from(self.pad), self.norm, &scratch.sums[..]);
        let columns = even.first.iter().zip(even.weight.as_chunks::<K>().0).zip(&even.outside);
        for (out, ((first, weights), outside)) in scratch.line.iter_mut().zip(columns) {
            *out = norm.apply(pixel::<S>(&sums[*first..][..=K * 3], weights, pad * outside));
        }
    }
}

/// Vertical pass: the weighted sum of the picture rows that a tensor row covers, times [`ONE`](super::taps::ONE). `first` is the
/// first byte.
#[inline(always)]
fn down(image: ImageView<'_>, cover: Cover<'_>, first: usize, pad: u8, sums: &mut [f32]) {
    let outside = u16::from(pad).wrapping_mul(cover.outside);
    let done = down_by::<1>(image, cover, first, outside, sums)
        || down_by::<2>(image, cover, first, outside, sums)
        || down_by::<3>(image, cover, first, outside, sums)
        || down_by::<4>(image, cover, first, outside, sums)
        || down_by::<5>(image, cover, first, outside, sums)
        || down_by::<6>(image, cover, first, outside, sums)
        || down_by::<7>(image, cover, first, outside, sums)
        || down_by::<8>(image, cover, first, outside, sums);
    if !done {
        sums.fill(f32::from(outside));
        for (k, weight) in cover.weights.iter().enumerate() {
            for (sum, value) in sums.iter_mut().zip(&image.row(cover.start + k)[first..]) {
                *sum += f32::from(*value) * f32::from(*weight);
            }
        }
    }
}

/// The same where exactly `N` rows are covered; else false, and nothing is done.
#[inline(always)]
fn down_by<const N: usize>(
    image: ImageView<'_>,
    cover: Cover<'_>,
    first: usize,
    outside: u16,
    sums: &mut [f32],
) -> bool {
    let Ok(weights) = <[u16; N]>::try_from(cover.weights) else { return false };
    let n = sums.len();
    let mut rows = [&[][..]; N];
    for (k, row) in rows.iter_mut().enumerate() {
        *row = &image.row(cover.start + k)[first..][..n];
    }
    for (i, out) in sums.iter_mut().enumerate() {
        let mut sum = outside;
        for (row, weight) in rows.iter().zip(&weights) {
            // Below 2^16 because the weights sum to 256; wrapping arithmetic only spares the check.
            sum = sum.wrapping_add(u16::from(row[i]).wrapping_mul(*weight));
        }
        *out = f32::from(sum);
    }
    true
}

/// Red, green, blue and whatever is next: four lanes, of which the last is dropped.
#[inline(always)]
fn pixel<S: Simd>(sums: &[f32], weights: &[f32], outside: f32) -> [f32; 4] {
    let mut sum = [outside; 4];
    for (i, weight) in weights.iter().enumerate() {
        for lane in 0..4 {
            let value = sums[i * 3 + lane];
            // Integers below 2^24 either way; one instruction where the machine has it.
            sum[lane] = if S::IS_SCALAR { sum[lane] + value * weight } else { value.mul_add(*weight, sum[lane]) };
        }
    }
    sum
}

/// Rows of a tensor, in either memory order.
enum Tensor<'a, T> {
    Interleaved(&'a mut [T]),
    Planes([&'a mut [T]; 3]),
}

impl<T: Element> Tensor<'_, T> {
    fn new(data: &mut [T], layout: Layout) -> Tensor<'_, T> {
        match layout {
            Layout::Nhwc => Tensor::Interleaved(data),
            Layout::Nchw => {
                let plane = data.len() / 3;
                let (a, rest) = data.split_at_mut(plane);
                let (b, c) = rest.split_at_mut(plane);
                Tensor::Planes([a, b, c])
            }
        }
    }

    #[inline(always)]
    fn write(&mut self, y: usize, line: &[[f32; 4]], reversed: bool) {
        let n = line.len();
        match self {
            Self::Interleaved(rows) => {
                let row = &mut rows[y * n * 3..(y + 1) * n * 3];
                if reversed {
                    interleave(row, line, |[a, b, c, d]| [c, b, a, d]);
                } else {
                    interleave(row, line, |pixel| pixel);
                }
            }
            Self::Planes([a, b, c]) => {
                let row = y * n..(y + 1) * n;
                let (a, b, c) = (&mut a[row.clone()], &mut b[row.clone()], &mut c[row]);
                if reversed { part([c, b, a], line) } else { part([a, b, c], line) }
            }
        }
    }
}

/// Four numbers are stored at a time; the next pixel writes over the fourth.
#[inline(always)]
fn interleave<T: Element>(mut row: &mut [T], line: &[[f32; 4]], order: impl Fn([f32; 4]) -> [f32; 4]) {
    let Some((last, line)) = line.split_last() else { return };
    for pixel in line {
        let pixel = order(*pixel);
        let Some(out) = row.first_chunk_mut::<4>() else { return };
        for lane in 0..4 {
            out[lane] = T::of(pixel[lane]);
        }
        row = &mut row[3..];
    }
    for (out, value) in row.iter_mut().zip(order(*last)) {
        *out = T::of(value);
    }
}

#[inline(always)]
fn part<T: Element>([a, b, c]: [&mut [T]; 3], line: &[[f32; 4]]) {
    for (((a, b), c), pixel) in a.iter_mut().zip(b).zip(c).zip(line) {
        *a = T::of(pixel[0]);
        *b = T::of(pixel[1]);
        *c = T::of(pixel[2]);
    }
}
