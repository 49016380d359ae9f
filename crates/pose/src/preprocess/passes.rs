//! The two passes over the bytes, compiled for the machine's instruction set.
//!
//! Sums are integers below 2^24, so 32-bit floats hold them exactly.

use pulp::{Simd, WithSimd};

use super::{
    TensorData,
    taps::{Cover, Even, ONE, Taps},
};
use crate::{ImageView, card::Layout};

/// A pixel of value 1 after both passes.
pub(super) const SUM_ONE: f32 = 65_536.0;

/// From sums over pixels to the numbers that the network eats.
pub(super) struct Normalise {
    pub(super) reversed: bool,
    pub(super) gain: [f32; 3],
    pub(super) offset: [f32; 3],
}

impl Normalise {
    #[inline(always)]
    fn apply(&self, [a, b, c, _]: [f32; 4]) -> [f32; 3] {
        let [a, b, c] = if self.reversed { [c, b, a] } else { [a, b, c] };
        [a * self.gain[0] + self.offset[0], b * self.gain[1] + self.offset[1], c * self.gain[2] + self.offset[2]]
    }
}

/// Everything that fills one tensor.
pub(super) struct Fill<'a> {
    pub(super) image: ImageView<'a>,
    pub(super) columns: &'a Taps,
    pub(super) rows: &'a Taps,
    pub(super) layout: Layout,
    pub(super) pad: u8,
    pub(super) norm: Normalise,
    /// A picture row summed over the rows that a tensor row covers.
    pub(super) words: &'a mut Vec<u16>,
    /// The same as floats.
    pub(super) sums: &'a mut Vec<f32>,
    /// A tensor row: red, green, blue, and a lane that is not used.
    pub(super) line: &'a mut Vec<[f32; 4]>,
    pub(super) data: &'a mut TensorData,
}

impl WithSimd for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { image, columns, rows, layout, pad, norm, words, sums, line, data } = self;
        let even = columns.even();
        let used = even.range.len() * 3;
        words.resize(used, 0);
        // Weights of 0 reach over the end, and the horizontal pass reads four numbers at a time.
        sums.resize(used + even.width * 3 + 1, 0.0);
        line.resize(columns.len(), [0.0; 4]);
        let size = (columns.len(), rows.len());
        for y in 0..rows.len() {
            let cover = rows.of(y);
            if used == 0 || cover.weights.is_empty() {
                line.fill([f32::from(pad) * SUM_ONE; 4]);
            } else {
                down(image, cover, even.range.start, pad, words, sums);
                match even.width {
                    1 => across::<1>(even, pad, sums, line),
                    2 => across::<2>(even, pad, sums, line),
                    3 => across::<3>(even, pad, sums, line),
                    4 => across::<4>(even, pad, sums, line),
                    5 => across::<5>(even, pad, sums, line),
                    6 => across::<6>(even, pad, sums, line),
                    _ => across_many(even, pad, sums, line),
                }
            }
            match data {
                TensorData::F32(v) => write(out_row(v, layout, size, y), line, &norm, |x| x),
                TensorData::I32(v) => write(out_row(v, layout, size, y), line, &norm, |x| x.round() as i32),
                TensorData::U8(v) => write(out_row(v, layout, size, y), line, &norm, |x| x.round() as u8),
            }
        }
    }
}

/// Vertical pass: the weighted sum of the picture rows that a tensor row covers, times [`ONE`].
#[inline(always)]
fn down(image: ImageView<'_>, cover: Cover<'_>, first: usize, pad: u8, words: &mut [u16], sums: &mut [f32]) {
    words.fill(u16::from(pad).wrapping_mul(cover.outside));
    let row = |k: usize| &image.row(cover.start + k)[first * 3..];
    // Four rows at a time, so that the sums are loaded and stored less often than pixels.
    let mut fours = cover.weights.chunks_exact(4);
    let mut k = 0;
    for weights in fours.by_ref() {
        add([0, 1, 2, 3].map(|i| (row(k + i), weights[i])), words);
        k += 4;
    }
    match *fours.remainder() {
        [a, b, c] => add([(row(k), a), (row(k + 1), b), (row(k + 2), c)], words),
        [a, b] => add([(row(k), a), (row(k + 1), b)], words),
        [a] => add([(row(k), a)], words),
        _ => {}
    }
    for (sum, word) in sums.iter_mut().zip(words) {
        *sum = f32::from(*word);
    }
}

/// Sums stay below 2^16 because the weights sum to 256; wrapping arithmetic only spares the check.
#[inline(always)]
fn add<const N: usize>(rows: [(&[u8], u16); N], words: &mut [u16]) {
    let n = words.len();
    let rows = rows.map(|(row, weight)| (&row[..n], weight));
    for i in 0..n {
        let mut sum = words[i];
        for (row, weight) in &rows {
            sum = sum.wrapping_add(u16::from(row[i]).wrapping_mul(*weight));
        }
        words[i] = sum;
    }
}

/// Horizontal pass, with the loop over `K` weights unrolled.
#[inline(always)]
fn across<const K: usize>(even: &Even, pad: u8, sums: &[f32], line: &mut [[f32; 4]]) {
    let columns = even.start.iter().zip(even.weight.as_chunks::<K>().0).zip(&even.outside);
    for (out, ((start, weights), outside)) in line.iter_mut().zip(columns) {
        *out = pixel(&sums[start * 3..][..=K * 3], weights, f32::from(pad) * outside);
    }
}

/// The same for any number of weights.
#[inline(always)]
fn across_many(even: &Even, pad: u8, sums: &[f32], line: &mut [[f32; 4]]) {
    let columns = even.start.iter().zip(even.weight.chunks_exact(even.width)).zip(&even.outside);
    for (out, ((start, weights), outside)) in line.iter_mut().zip(columns) {
        *out = pixel(&sums[start * 3..][..=even.width * 3], weights, f32::from(pad) * outside);
    }
}

/// Red, green, blue and whatever is next: four lanes, of which the last is dropped.
#[inline(always)]
fn pixel(sums: &[f32], weights: &[f32], outside: f32) -> [f32; 4] {
    let mut sum = [outside * f32::from(ONE); 4];
    for (i, weight) in weights.iter().enumerate() {
        for lane in 0..4 {
            sum[lane] += sums[i * 3 + lane] * weight;
        }
    }
    sum
}

/// One row of the tensor, in either memory order.
enum OutRow<'a, T> {
    Interleaved(&'a mut [T]),
    Planes([&'a mut [T]; 3]),
}

#[inline(always)]
fn out_row<T>(data: &mut [T], layout: Layout, (width, height): (usize, usize), y: usize) -> OutRow<'_, T> {
    match layout {
        Layout::Nhwc => OutRow::Interleaved(&mut data[y * width * 3..(y + 1) * width * 3]),
        Layout::Nchw => {
            let (a, rest) = data.split_at_mut(width * height);
            let (b, c) = rest.split_at_mut(width * height);
            OutRow::Planes([a, b, c].map(|plane| &mut plane[y * width..(y + 1) * width]))
        }
    }
}

/// Normalisation into the tensor.
#[inline(always)]
fn write<T>(out: OutRow<'_, T>, line: &[[f32; 4]], norm: &Normalise, convert: impl Fn(f32) -> T) {
    match out {
        OutRow::Interleaved(row) => {
            for (pixel, sum) in row.chunks_exact_mut(3).zip(line) {
                let [a, b, c] = norm.apply(*sum);
                pixel[0] = convert(a);
                pixel[1] = convert(b);
                pixel[2] = convert(c);
            }
        }
        OutRow::Planes([a, b, c]) => {
            for (((a, b), c), sum) in a.iter_mut().zip(b).zip(c).zip(line) {
                let pixel = norm.apply(*sum);
                *a = convert(pixel[0]);
                *b = convert(pixel[1]);
                *c = convert(pixel[2]);
            }
        }
    }
}
