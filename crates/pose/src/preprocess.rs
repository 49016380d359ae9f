//! From picture to input tensor: crop, resize with area averaging, pad, normalise, in two passes over the bytes.
//!
//! # Where a pixel is
//!
//! This is the one place where it is written. A coordinate of 0 is the *centre* of the first pixel, as in OpenCV, COCO
//! annotations and camera matrices; the picture covers `-0.5 .. width - 0.5`. Resizing keeps *edges*: the left edge of
//! the crop is the left edge of the tensor. With `s` picture pixels per tensor pixel and the crop starting at edge `l`
//! (`l = 0` is the left edge of the picture),
//!
//! ```text
//! u = l + (x + 1/2) s - 1/2          picture from tensor
//! x = (u + 1/2 - l) / s - 1/2        tensor from picture
//! ```
//!
//! and the same with a map of stride `n` in the place of the tensor and the tensor in the place of the picture:
//! `x = (i + 1/2) n - 1/2`.
//!
//! # How it is resized
//!
//! Shrinking averages over exactly the area that a tensor pixel covers; enlarging is bilinear. Weights are multiples of
//! 1/256 that sum to 1, so a constant picture stays constant. Pixels outside the picture have the value `pad`. A picture
//! row is read once, and only the columns inside the crop. Rounding of weights moves a value by less than one grey level
//! for a shrink of up to 8.

use crate::{
    ImageView,
    card::{ColourOrder, ElementType, InputSpec, Layout},
};

/// Where a tensor lies in a picture: an axis-aligned crop with one scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CropMap {
    /// Left edge of the crop, px from the left edge of the picture.
    pub left_px: f32,
    /// Top edge of the crop, px from the top edge of the picture.
    pub top_px: f32,
    /// Picture pixels per tensor pixel.
    pub scale: f32,
}

impl CropMap {
    /// The whole picture in the middle of a tensor, as large as it fits.
    ///
    /// ```
    /// let map = pose::CropMap::letterbox(1280, 720, 256, 256);
    /// assert_eq!(map.scale, 5.0);
    /// assert_eq!(map.to_picture(127.5, 127.5), (639.5, 359.5)); // the middle is the middle
    /// ```
    pub fn letterbox(width: usize, height: usize, tensor_width: usize, tensor_height: usize) -> Self {
        let (w, h) = (width as f32, height as f32);
        let (tw, th) = (tensor_width as f32, tensor_height as f32);
        let scale = (w / tw).max(h / th);
        Self { left_px: (w - tw * scale) / 2.0, top_px: (h - th * scale) / 2.0, scale }
    }

    /// A tensor whose middle is at `(u_px, v_px)` and whose shorter side covers `side_px`.
    pub fn around(u_px: f32, v_px: f32, side_px: f32, tensor_width: usize, tensor_height: usize) -> Self {
        let (tw, th) = (tensor_width as f32, tensor_height as f32);
        let scale = side_px / tw.min(th);
        Self { left_px: u_px + 0.5 - tw * scale / 2.0, top_px: v_px + 0.5 - th * scale / 2.0, scale }
    }

    /// Picture coordinates of a point of the tensor, px.
    pub fn to_picture(&self, x: f32, y: f32) -> (f32, f32) {
        ((x + 0.5) * self.scale + self.left_px - 0.5, (y + 0.5) * self.scale + self.top_px - 0.5)
    }

    /// Tensor coordinates of a point of the picture, px.
    pub fn to_tensor(&self, u_px: f32, v_px: f32) -> (f32, f32) {
        ((u_px + 0.5 - self.left_px) / self.scale - 0.5, (v_px + 0.5 - self.top_px) / self.scale - 0.5)
    }
}

/// The numbers of an input tensor.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum TensorData {
    /// 32-bit floats.
    F32(Vec<f32>),
    /// 32-bit integers.
    I32(Vec<i32>),
    /// Bytes.
    U8(Vec<u8>),
}

/// Fills input tensors for one network; keeps its buffers, so that filling allocates nothing once it is warm.
#[derive(Debug, Clone)]
pub struct Preprocessor {
    width: usize,
    height: usize,
    layout: Layout,
    pad: u8,
    /// Blue comes first in the tensor.
    reversed: bool,
    gain: [f32; 3],
    offset: [f32; 3],
    data: TensorData,
    columns: Taps,
    rows: Taps,
    row_sum: Vec<u16>,
}

impl Preprocessor {
    /// For the tensor that a card describes.
    pub fn new(input: &InputSpec) -> Self {
        let mut new = Self {
            width: 0,
            height: 0,
            layout: input.layout,
            pad: input.pad,
            reversed: input.colour == ColourOrder::Bgr,
            gain: input.scale.map(|s| s / SUM_ONE),
            offset: [0, 1, 2].map(|c| -input.mean[c] * input.scale[c]),
            data: match input.dtype {
                ElementType::Float32 => TensorData::F32(Vec::new()),
                ElementType::Int32 => TensorData::I32(Vec::new()),
                ElementType::Uint8 => TensorData::U8(Vec::new()),
            },
            columns: Taps::default(),
            rows: Taps::default(),
            row_sum: Vec::new(),
        };
        new.resize(input.width, input.height);
        new
    }

    /// Changes the size of the tensor, for networks that take any.
    pub fn resize(&mut self, width: usize, height: usize) {
        self.width = width;
        self.height = height;
        let n = width * height * 3;
        match &mut self.data {
            TensorData::F32(v) => v.resize(n, 0.0),
            TensorData::I32(v) => v.resize(n, 0),
            TensorData::U8(v) => v.resize(n, 0),
        }
    }

    /// Width of the tensor.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height of the tensor.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Shape of the tensor, with its batch of one.
    pub fn shape(&self) -> [usize; 4] {
        match self.layout {
            Layout::Nchw => [1, 3, self.height, self.width],
            Layout::Nhwc => [1, self.height, self.width, 3],
        }
    }

    /// What the last [`Preprocessor::fill`] wrote.
    pub fn data(&self) -> &TensorData {
        &self.data
    }

    /// Fills the tensor with a crop of the picture.
    pub fn fill(&mut self, image: ImageView<'_>, map: CropMap) -> &TensorData {
        self.columns.compute(map.left_px, map.scale, self.width, image.width());
        self.rows.compute(map.top_px, map.scale, self.height, image.height());
        let (first, end) = self.columns.range();
        // One element more than is summed, because the horizontal pass reads four at a time.
        self.row_sum.resize((end - first) * 3 + 1, 0);
        let Self { width, height, layout, pad, reversed, gain, offset, columns, rows, row_sum, data, .. } = self;
        let norm = Normalise { reversed: *reversed, gain: *gain, offset: *offset };
        for y in 0..*height {
            let is_padding = end == first || rows.of(y).1.is_empty();
            if !is_padding {
                let used = row_sum.len() - 1;
                sum_rows(image, rows, y, first, *pad, &mut row_sum[..used]);
            }
            let line = Line { columns, first, sums: row_sum, pad: *pad, is_padding, norm: &norm };
            match data {
                TensorData::F32(v) => line.write(out_row(v, *layout, *width, *height, y), |x| x),
                TensorData::I32(v) => line.write(out_row(v, *layout, *width, *height, y), |x| x.round() as i32),
                TensorData::U8(v) => line.write(out_row(v, *layout, *width, *height, y), |x| x.round() as u8),
            }
        }
        &self.data
    }
}

/// Weights are multiples of `1 / ONE`. 256 keeps a row sum of 8-bit pixels inside 16 bits: `255 * 256 < 65536`.
const ONE: u16 = 256;
/// A pixel of value 1 after both passes.
const SUM_ONE: f32 = 65_536.0;

/// For every tensor column (or row): which picture columns count how much.
#[derive(Debug, Clone, Default)]
struct Taps {
    start: Vec<usize>,
    /// Exclusive ends of each run in `weight`.
    end: Vec<usize>,
    weight: Vec<u16>,
    /// Weight of what lies outside the picture.
    outside: Vec<u16>,
}

impl Taps {
    fn compute(&mut self, edge_px: f32, scale: f32, count: usize, limit: usize) {
        self.start.clear();
        self.end.clear();
        self.weight.clear();
        self.outside.clear();
        let (edge, scale) = (f64::from(edge_px), f64::from(scale));
        for i in 0..count {
            let (from, to) = if scale >= 1.0 {
                (edge + i as f64 * scale, edge + (i + 1) as f64 * scale)
            } else {
                // A box of one pixel around the centre is bilinear interpolation.
                let centre = edge + (i as f64 + 0.5) * scale;
                (centre - 0.5, centre + 0.5)
            };
            self.push_box(from, to, limit);
        }
    }

    /// Pixels `[k, k + 1)` weigh what of the box they cover; the rounded cumulative cover makes the sum exact.
    fn push_box(&mut self, from: f64, to: f64, limit: usize) {
        let cumulative = |x: f64| (((x - from) / (to - from)).clamp(0.0, 1.0) * f64::from(ONE)).round() as u16;
        let first = from.floor().clamp(0.0, limit as f64) as usize;
        let last = to.ceil().clamp(0.0, limit as f64) as usize;
        let mut inside = 0;
        for k in first..last.max(first) {
            let weight = cumulative((k + 1) as f64) - cumulative(k as f64);
            self.weight.push(weight);
            inside += weight;
        }
        self.start.push(first);
        self.end.push(self.weight.len());
        self.outside.push(ONE - inside);
    }

    fn of(&self, i: usize) -> (usize, &[u16], u16) {
        let begin = if i == 0 { 0 } else { self.end[i - 1] };
        (self.start[i], &self.weight[begin..self.end[i]], self.outside[i])
    }

    /// The picture columns that any tensor column needs.
    fn range(&self) -> (usize, usize) {
        let mut range = (usize::MAX, 0);
        for i in 0..self.start.len() {
            let (start, weights, _) = self.of(i);
            if !weights.is_empty() {
                range = (range.0.min(start), range.1.max(start + weights.len()));
            }
        }
        if range.0 == usize::MAX { (0, 0) } else { range }
    }
}

/// Vertical pass: the weighted sum of the picture rows of tensor row `y`, times [`ONE`].
fn sum_rows(image: ImageView<'_>, rows: &Taps, y: usize, first: usize, pad: u8, sums: &mut [u16]) {
    let (start, weights, outside) = rows.of(y);
    let base = u16::from(pad).wrapping_mul(outside);
    for (k, &weight) in weights.iter().enumerate() {
        let row = &image.row(start + k)[first * 3..][..sums.len()];
        // The sum stays below 2^16 because the weights sum to 256; wrapping arithmetic only spares the check.
        if k == 0 {
            for (sum, &pixel) in sums.iter_mut().zip(row) {
                *sum = base.wrapping_add(u16::from(pixel).wrapping_mul(weight));
            }
        } else {
            for (sum, &pixel) in sums.iter_mut().zip(row) {
                *sum = sum.wrapping_add(u16::from(pixel).wrapping_mul(weight));
            }
        }
    }
}

/// One row of the tensor, in either memory order.
enum OutRow<'a, T> {
    Interleaved(&'a mut [T]),
    Planes([&'a mut [T]; 3]),
}

fn out_row<T>(data: &mut [T], layout: Layout, width: usize, height: usize, y: usize) -> OutRow<'_, T> {
    match layout {
        Layout::Nhwc => OutRow::Interleaved(&mut data[y * width * 3..(y + 1) * width * 3]),
        Layout::Nchw => {
            let (a, rest) = data.split_at_mut(width * height);
            let (b, c) = rest.split_at_mut(width * height);
            OutRow::Planes([a, b, c].map(|plane| &mut plane[y * width..(y + 1) * width]))
        }
    }
}

/// From sums over pixels to the numbers that the network eats.
struct Normalise {
    reversed: bool,
    gain: [f32; 3],
    offset: [f32; 3],
}

impl Normalise {
    fn apply(&self, sum: [u32; 4]) -> [f32; 3] {
        let [a, b, c, _] = sum;
        let [a, b, c] = if self.reversed { [c, b, a] } else { [a, b, c] };
        [
            a as f32 * self.gain[0] + self.offset[0],
            b as f32 * self.gain[1] + self.offset[1],
            c as f32 * self.gain[2] + self.offset[2],
        ]
    }
}

struct Line<'a> {
    columns: &'a Taps,
    first: usize,
    sums: &'a [u16],
    pad: u8,
    is_padding: bool,
    norm: &'a Normalise,
}

impl Line<'_> {
    /// Horizontal pass and normalisation.
    fn write<T>(&self, out: OutRow<'_, T>, convert: impl Fn(f32) -> T) {
        match out {
            OutRow::Interleaved(row) => {
                let mut pixels = row.chunks_exact_mut(3);
                self.each(|value| {
                    if let Some([a, b, c]) = pixels.next() {
                        [*a, *b, *c] = value.map(&convert);
                    }
                });
            }
            OutRow::Planes([a, b, c]) => {
                let mut pixels = a.iter_mut().zip(b).zip(c);
                self.each(|value| {
                    if let Some(((a, b), c)) = pixels.next() {
                        [*a, *b, *c] = value.map(&convert);
                    }
                });
            }
        }
    }

    /// Every pixel of the row, in order.
    fn each(&self, mut visit: impl FnMut([f32; 3])) {
        let one = u32::from(ONE);
        if self.is_padding {
            let value = self.norm.apply([u32::from(self.pad) * one * one; 4]);
            (0..self.columns.start.len()).for_each(|_| visit(value));
            return;
        }
        let mut begin = 0;
        for ((&start, &end), &outside) in self.columns.start.iter().zip(&self.columns.end).zip(&self.columns.outside) {
            let weights = &self.columns.weight[begin..end];
            begin = end;
            let mut sum = [u32::from(self.pad) * u32::from(outside) * one; 4];
            if !weights.is_empty() {
                let mut rest = &self.sums[(start - self.first) * 3..];
                for &weight in weights {
                    // Red, green, blue and whatever is next: four lanes, of which the last is dropped.
                    let Some((pixel, _)) = rest.split_first_chunk::<4>() else { break };
                    for lane in 0..4 {
                        sum[lane] = sum[lane].wrapping_add(u32::from(pixel[lane]).wrapping_mul(u32::from(weight)));
                    }
                    rest = &rest[3..];
                }
            }
            visit(self.norm.apply(sum));
        }
    }
}

#[cfg(test)]
mod tests;
