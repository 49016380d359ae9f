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

use pulp::Arch;

use crate::{
    ImageView,
    card::{ColourOrder, ElementType, InputSpec, Layout},
};

mod passes;
mod taps;

use passes::{Fill, Normalise, SUM_ONE, Scratch};
use taps::Taps;

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
    scratch: Scratch,
    /// Rows outside the picture are what the last fill made them.
    is_padded: bool,
    arch: Arch,
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
            scratch: Scratch::default(),
            is_padded: false,
            arch: Arch::new(),
        };
        new.resize(input.width, input.height);
        new
    }

    /// Changes the size of the tensor, for networks that take any.
    pub fn resize(&mut self, width: usize, height: usize) {
        self.width = width;
        self.height = height;
        self.is_padded = false;
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
        let columns_changed = self.columns.compute(map.left_px, map.scale, self.width, image.width());
        let rows_changed = self.rows.compute(map.top_px, map.scale, self.height, image.height());
        self.arch.dispatch(Fill {
            image,
            columns: &self.columns,
            rows: &self.rows,
            layout: self.layout,
            pad: self.pad,
            norm: Normalise::new(self.reversed, self.gain, self.offset),
            is_padded: self.is_padded && !columns_changed && !rows_changed,
            scratch: &mut self.scratch,
            data: &mut self.data,
        });
        self.is_padded = true;
        &self.data
    }

    /// Exchanges left and right in the tensor. Twice changes nothing.
    pub(crate) fn mirror(&mut self) {
        let (width, layout) = (self.width, self.layout);
        match &mut self.data {
            TensorData::F32(v) => mirror(v, width, layout),
            TensorData::I32(v) => mirror(v, width, layout),
            TensorData::U8(v) => mirror(v, width, layout),
        }
    }
}

fn mirror<T>(values: &mut [T], width: usize, layout: Layout) {
    match layout {
        Layout::Nchw => values.chunks_exact_mut(width).for_each(<[T]>::reverse),
        Layout::Nhwc => {
            values.chunks_exact_mut(width * 3).for_each(|row| row.as_chunks_mut::<3>().0.reverse());
        }
    }
}

#[cfg(test)]
mod tests;
