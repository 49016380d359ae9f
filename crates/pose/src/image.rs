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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_of_another_length_is_refused_with_both_lengths() {
        let data = [0; 4 * 2 * 3 + 1];
        for (width, height, given) in [(4, 2, 23), (4, 2, 25), (0, 2, 0), (4, 0, 0), (usize::MAX, 2, 24)] {
            let error = ImageView::new(width, height, &data[..given]).unwrap_err();
            assert!(matches!(error, Error::Image { got, .. } if got == given), "{error}");
        }
        assert!(ImageView::new(4, 2, &data[..24]).is_ok());
    }

    #[test]
    fn rows_lie_a_stride_apart_and_the_last_needs_no_padding() {
        let data: Vec<u8> = (0..13 + 6).collect();
        let image = ImageView::with_stride(2, 2, 13, &data).unwrap();
        assert_eq!((image.row(0), image.row(1)), (&data[..6], &data[13..19]));
        assert!(ImageView::with_stride(2, 2, 13, &data[..18]).is_err());
        assert!(ImageView::with_stride(2, 2, 5, &data).is_err());
        for (width, height) in [(0, 2), (2, 0), (usize::MAX, 2)] {
            assert!(ImageView::with_stride(width, height, 13, &data).is_err());
        }
    }
}
