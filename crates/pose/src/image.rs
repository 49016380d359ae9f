//! Pictures as they come in: borrowed rows of 8-bit RGB.

use crate::{Error, Result};

/// A borrowed 8-bit RGB picture, rows from top to bottom, three bytes per pixel.
///
/// Rows may be padded: `stride_bytes` is the distance from one row to the next.
///
/// ```
/// let pixels = [0_u8; 4 * 2 * 3];
/// let image = pose::ImageView::new(4, 2, &pixels).unwrap();
/// assert_eq!((image.width(), image.height()), (4, 2));
/// ```
#[derive(Debug, Clone, Copy)]
pub struct ImageView<'a> {
    width: usize,
    height: usize,
    stride_bytes: usize,
    data: &'a [u8],
}

impl<'a> ImageView<'a> {
    /// A picture without row padding.
    ///
    /// # Errors
    /// [`Error::Image`] when a side is zero or `data` is not exactly `3 * width * height` long.
    pub fn new(width: usize, height: usize, data: &'a [u8]) -> Result<Self> {
        let expected = width.saturating_mul(height).saturating_mul(3);
        if expected == 0 || data.len() != expected {
            return Err(Error::Image { width, height, expected, got: data.len() });
        }
        Ok(Self { width, height, stride_bytes: width * 3, data })
    }

    /// A picture whose rows start `stride_bytes` apart.
    ///
    /// # Errors
    /// [`Error::Image`] when a side is zero, the stride is shorter than a row, or `data` is too short.
    pub fn with_stride(width: usize, height: usize, stride_bytes: usize, data: &'a [u8]) -> Result<Self> {
        let expected = stride_bytes.saturating_mul(height.saturating_sub(1)).saturating_add(width.saturating_mul(3));
        if width == 0 || height == 0 || stride_bytes < width.saturating_mul(3) || data.len() < expected {
            return Err(Error::Image { width, height, expected, got: data.len() });
        }
        Ok(Self { width, height, stride_bytes, data })
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// One row, `3 * width` bytes.
    ///
    /// # Panics
    /// When `y` is not below the height.
    pub fn row(&self, y: usize) -> &'a [u8] {
        let start = y * self.stride_bytes;
        &self.data[start..start + self.width * 3]
    }
}
