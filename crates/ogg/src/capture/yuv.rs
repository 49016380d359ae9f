//! Luma and chroma to RGB.
//!
//! With `y, cb, cr` scaled to `[0, 1]` and `[-1/2, 1/2]`,
//! `r = y + 2 (1 - kr) cr`, `b = y + 2 (1 - kb) cb`, `g = y - (2 kb (1 - kb) cb + 2 kr (1 - kr) cr) / kg`,
//! `kg = 1 - kr - kb`; `kr, kb` are 0.299, 0.114 (BT.601), 0.2126, 0.0722 (BT.709) and 0.2627, 0.0593 (BT.2020).
//! Limited range scales `y` from 16..235 and chroma from 16..240. Chroma of 4:2:0 is repeated, not interpolated.
//!
//! Arithmetic is in 16-bit integers with 6 fractional bits, one colour plane of a row at a time, a form that compilers
//! turn into vector instructions; the result lies within 0.55 of the formula (0.5 of it is rounding to a whole number).

use image::RgbImage;

use super::Error;

/// Which weights and which code range a stream uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ColourSpace {
    /// Luma weights.
    pub matrix: ColourMatrix,
    /// True for 0..255, false for 16..235.
    pub full_range: bool,
}

/// Luma weights of a standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColourMatrix {
    /// ITU-R BT.601.
    Bt601,
    /// ITU-R BT.709.
    Bt709,
    /// ITU-R BT.2020, non-constant luminance.
    Bt2020,
}

impl ColourSpace {
    /// From ISO/IEC 23091-2 `matrix_coefficients` and the range flag. A stream that states no matrix (or one that
    /// is none of the three) is taken as BT.709 from 720 rows on and BT.601 below; no range means limited.
    ///
    /// ```
    /// use ogg::capture::{ColourMatrix, ColourSpace};
    /// assert_eq!(ColourSpace::from_codes(Some(6), None, 1080).matrix, ColourMatrix::Bt601);
    /// assert_eq!(ColourSpace::from_codes(None, None, 1080).matrix, ColourMatrix::Bt709);
    /// ```
    pub fn from_codes(matrix: Option<u8>, full_range: Option<bool>, height: u32) -> Self {
        let matrix = match matrix {
            Some(1) => ColourMatrix::Bt709,
            Some(4..=6) => ColourMatrix::Bt601,
            Some(9) => ColourMatrix::Bt2020,
            _ if height >= 720 => ColourMatrix::Bt709,
            _ => ColourMatrix::Bt601,
        };
        Self { matrix, full_range: full_range.unwrap_or(false) }
    }

    /// The formula's coefficients.
    fn weights(self) -> Weights {
        let (kr, kb) = match self.matrix {
            ColourMatrix::Bt601 => (0.299, 0.114),
            ColourMatrix::Bt709 => (0.2126, 0.0722),
            ColourMatrix::Bt2020 => (0.2627, 0.0593),
        };
        let kg = 1.0 - kr - kb;
        let (luma, chroma, black) = if self.full_range { (1.0, 1.0, 0) } else { (255.0 / 219.0, 255.0 / 224.0, 16) };
        let fixed = |value: f64| (value * 65536.0).round() as i32;
        Weights {
            black,
            luma_gain: ((luma - 1.0) * 65536.0_f64).round() as i16,
            red_cr: fixed(chroma * 2.0 * (1.0 - kr)),
            green_cb: fixed(chroma * -2.0 * kb * (1.0 - kb) / kg),
            green_cr: fixed(chroma * -2.0 * kr * (1.0 - kr) / kg),
            blue_cb: fixed(chroma * 2.0 * (1.0 - kb)),
        }
    }
}

/// Coefficients times 65536; that of luma less one, so that it fits 16 bits.
#[derive(Debug, Clone, Copy)]
struct Weights {
    black: i16,
    luma_gain: i16,
    red_cr: i32,
    green_cb: i32,
    green_cr: i32,
    blue_cb: i32,
}

/// Buffers for one row.
#[derive(Debug)]
struct Row {
    weights: Weights,
    luma: Vec<i16>,
    /// What chroma adds to red, green and blue of each column, rounding included.
    tints: [Vec<i16>; 3],
    planes: [Vec<u8>; 3],
}

/// Fractional bits of the 16-bit arithmetic: luma below 2^15 / 64 = 512 leaves room for every sum, which saturates besides.
const FRACTION: u32 = 6;

impl Row {
    fn new(columns: usize, weights: Weights) -> Self {
        // One column more where their number is odd, so that every chroma pair has two.
        let wide = || vec![0; columns.next_multiple_of(2)];
        Self {
            weights,
            luma: wide(),
            tints: [wide(), wide(), wide()],
            planes: std::array::from_fn(|_| vec![0; columns]),
        }
    }

    /// Takes the chroma of a row: one pair for two columns.
    fn set_chroma(&mut self, cb: impl Iterator<Item = u8> + Clone, cr: impl Iterator<Item = u8> + Clone) {
        const SHIFT: u32 = 16 - FRACTION;
        // Half a unit of this shift, and half of the whole number that comes of the next.
        const ROUND: i32 = (1 << (SHIFT - 1)) + (1 << 15);
        let w = self.weights;
        let [red, green, blue] = &mut self.tints;
        let centred = |value: u8| i32::from(value).wrapping_sub(128);
        for (pair, cr) in red.as_chunks_mut::<2>().0.iter_mut().zip(cr.clone()) {
            *pair = [(w.red_cr.wrapping_mul(centred(cr)).wrapping_add(ROUND) >> SHIFT) as i16; 2];
        }
        for ((pair, cb), cr) in green.as_chunks_mut::<2>().0.iter_mut().zip(cb.clone()).zip(cr) {
            let sum = w.green_cb.wrapping_mul(centred(cb)).wrapping_add(w.green_cr.wrapping_mul(centred(cr)));
            *pair = [(sum.wrapping_add(ROUND) >> SHIFT) as i16; 2];
        }
        for (pair, cb) in blue.as_chunks_mut::<2>().0.iter_mut().zip(cb) {
            *pair = [(w.blue_cb.wrapping_mul(centred(cb)).wrapping_add(ROUND) >> SHIFT) as i16; 2];
        }
    }

    /// Turns the luma of a row into pixels.
    fn convert(&mut self, luma: impl Iterator<Item = u8>, out: &mut [u8]) {
        let w = self.weights;
        for (luma, y) in self.luma.iter_mut().zip(luma) {
            let scaled = i16::from(y).wrapping_sub(w.black) << FRACTION;
            let more = i32::from(scaled).wrapping_mul(i32::from(w.luma_gain)) >> 16;
            *luma = scaled.wrapping_add(more as i16);
        }
        for (plane, tint) in self.planes.iter_mut().zip(&self.tints) {
            for ((value, &luma), &tint) in plane.iter_mut().zip(&self.luma).zip(tint) {
                *value = (luma.saturating_add(tint) >> FRACTION).clamp(0, 255) as u8;
            }
        }
        let [red, green, blue] = &self.planes;
        let pixels = out.as_chunks_mut::<3>().0.iter_mut().zip(red).zip(green).zip(blue);
        for (((pixel, &red), &green), &blue) in pixels {
            *pixel = [red, green, blue];
        }
    }
}

/// Three planes of 4:2:0 with their row strides, in bytes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Planes<'a> {
    pub(super) y: &'a [u8],
    pub(super) u: &'a [u8],
    pub(super) v: &'a [u8],
    pub(super) y_stride: u32,
    pub(super) uv_stride: u32,
    pub(super) width: u32,
    pub(super) height: u32,
}

/// Converts planar 4:2:0.
pub(super) fn rgb_from_yuv420(planes: Planes<'_>, colour: ColourSpace) -> Result<RgbImage, Error> {
    let Planes { y, u, v, y_stride, uv_stride, width, height } = planes;
    let (columns, rows) = (width as usize, height as usize);
    let (half_columns, half_rows) = (columns.div_ceil(2), rows.div_ceil(2));
    let (y_stride, uv_stride) = (y_stride as usize, uv_stride as usize);
    // The last row of a plane may lack its padding.
    let needed = |stride: usize, rows: usize, columns: usize| (rows.max(1) - 1) * stride + columns;
    let (need_y, need_uv) = (needed(y_stride, rows, columns), needed(uv_stride, half_rows, half_columns));
    if y.len() < need_y || u.len().min(v.len()) < need_uv || y_stride < columns || uv_stride < half_columns {
        let (expected, got) = (need_y + 2 * need_uv, y.len() + u.len() + v.len());
        return Err(Error::ShortBuffer { format: "I420", width, height, expected, got });
    }
    let mut pixels = vec![0; columns * rows * 3];
    if !pixels.is_empty() {
        let mut buffers = Row::new(columns, colour.weights());
        for (row, out) in pixels.chunks_exact_mut(columns * 3).enumerate() {
            if row % 2 == 0 {
                let start = row / 2 * uv_stride;
                let chroma = start..start + half_columns;
                buffers.set_chroma(u[chroma.clone()].iter().copied(), v[chroma].iter().copied());
            }
            buffers.convert(y[row * y_stride..row * y_stride + columns].iter().copied(), out);
        }
    }
    Ok(image_of(width, height, pixels))
}

fn image_of(width: u32, height: u32, pixels: Vec<u8>) -> RgbImage {
    let Some(image) = RgbImage::from_raw(width, height, pixels) else {
        unreachable!("the pixels were made for the size")
    };
    image
}

/// Converts packed 4:2:2 (`Y0 Cb Y1 Cr`), the YUYV of cameras.
///
/// # Errors
///
/// [`Error::ShortBuffer`] if `bytes` holds fewer than `stride_bytes * height` bytes, or `stride_bytes` is less than a row.
pub fn rgb_from_yuyv(
    bytes: &[u8],
    width: u32,
    height: u32,
    stride_bytes: u32,
    colour: ColourSpace,
) -> Result<RgbImage, Error> {
    let (columns, rows, stride) = (width as usize, height as usize, stride_bytes as usize);
    let row_bytes = columns.div_ceil(2) * 4;
    let needed = stride.max(row_bytes) * rows;
    if bytes.len() < needed || stride < row_bytes {
        return Err(Error::ShortBuffer { format: "YUYV", width, height, expected: needed, got: bytes.len() });
    }
    let mut pixels = vec![0; columns * rows * 3];
    if !pixels.is_empty() {
        let mut buffers = Row::new(columns, colour.weights());
        for (out, row) in pixels.chunks_exact_mut(columns * 3).zip(bytes.chunks_exact(stride)) {
            let pairs = row.as_chunks::<4>().0;
            buffers.set_chroma(pairs.iter().map(|pair| pair[1]), pairs.iter().map(|pair| pair[3]));
            buffers.convert(row.as_chunks::<2>().0.iter().map(|pair| pair[0]), out);
        }
    }
    Ok(image_of(width, height, pixels))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Rounding to a whole number; one unit of the sixth fractional bit lost in luma and a half in chroma; rounded weights.
    const TOLERANCE: f64 = 0.5 + 1.5 / 64.0 + 0.02;

    /// The header's formula in floating point.
    fn reference(y: u8, cb: u8, cr: u8, colour: ColourSpace) -> [f64; 3] {
        let (kr, kb) = match colour.matrix {
            ColourMatrix::Bt601 => (0.299, 0.114),
            ColourMatrix::Bt709 => (0.2126, 0.0722),
            ColourMatrix::Bt2020 => (0.2627, 0.0593),
        };
        let (y, cb, cr) = (f64::from(y), f64::from(cb) - 128.0, f64::from(cr) - 128.0);
        let (y, cb, cr) = if colour.full_range {
            (y / 255.0, cb / 255.0, cr / 255.0)
        } else {
            ((y - 16.0) / 219.0, cb / 224.0, cr / 224.0)
        };
        let kg = 1.0 - kr - kb;
        let red = y + 2.0 * (1.0 - kr) * cr;
        let blue = y + 2.0 * (1.0 - kb) * cb;
        let green = y - (2.0 * kb * (1.0 - kb) * cb + 2.0 * kr * (1.0 - kr) * cr) / kg;
        [red, green, blue].map(|value| (value * 255.0).clamp(0.0, 255.0))
    }

    const LIMITED_709: ColourSpace = ColourSpace { matrix: ColourMatrix::Bt709, full_range: false };
    const LIMITED_601: ColourSpace = ColourSpace { matrix: ColourMatrix::Bt601, full_range: false };

    #[test]
    fn published_bars_give_published_colours() {
        // 100 % colour bars, 8-bit limited range: ITU-R BT.601-7 and BT.709-6, rounded.
        let bars: [([u8; 3], ColourSpace, [u8; 3]); 6] = [
            ([235, 128, 128], LIMITED_709, [255, 255, 255]),
            ([16, 128, 128], LIMITED_709, [0, 0, 0]),
            ([63, 102, 240], LIMITED_709, [255, 0, 0]),
            ([173, 42, 26], LIMITED_709, [0, 255, 0]),
            ([81, 90, 240], LIMITED_601, [255, 0, 0]),
            ([145, 54, 34], LIMITED_601, [0, 255, 0]),
        ];
        for ([y, cb, cr], colour, wanted) in bars {
            let planes = Planes {
                y: &[y; 64 * 16],
                u: &[cb; 32 * 8],
                v: &[cr; 32 * 8],
                y_stride: 64,
                uv_stride: 32,
                width: 64,
                height: 16,
            };
            let out = rgb_from_yuv420(planes, colour).unwrap();
            for pixel in out.pixels() {
                for (got, wanted) in pixel.0.iter().zip(wanted) {
                    // The published codes are themselves rounded, which is worth up to 1.2 code values of RGB.
                    assert!(got.abs_diff(wanted) <= 2, "{got} for {wanted}");
                }
            }
        }
    }

    #[test]
    fn a_short_yuyv_buffer_is_refused_with_both_sizes() {
        let error = rgb_from_yuyv(&[0; 15], 4, 2, 8, LIMITED_601).unwrap_err();
        assert_eq!(error.to_string(), "YUYV picture of 4 x 2: expected 16 bytes, got 15");
    }

    fn any_colour() -> impl Strategy<Value = ColourSpace> {
        let matrix = prop_oneof![Just(ColourMatrix::Bt601), Just(ColourMatrix::Bt709), Just(ColourMatrix::Bt2020)];
        (matrix, any::<bool>()).prop_map(|(matrix, full_range)| ColourSpace { matrix, full_range })
    }

    proptest! {
        #[test]
        fn every_pixel_of_planar_data_follows_the_formula(
            colour in any_colour(),
            width in 1_u32..70,
            height in 1_u32..9,
            pad in 0_u32..5,
            seed in any::<u64>(),
        ) {
            let mut state = seed | 1;
            let mut byte = || { state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1); (state >> 56) as u8 };
            let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
            let (y_stride, uv_stride) = (width + pad, half_width + pad);
            let y: Vec<u8> = (0..y_stride * height).map(|_| byte()).collect();
            let u: Vec<u8> = (0..uv_stride * half_height).map(|_| byte()).collect();
            let v: Vec<u8> = (0..uv_stride * half_height).map(|_| byte()).collect();
            let out = rgb_from_yuv420(Planes { y: &y, u: &u, v: &v, y_stride, uv_stride, width, height }, colour).unwrap();
            for (x, row, pixel) in out.enumerate_pixels() {
                let luma = y[(row * y_stride + x) as usize];
                let chroma = (row / 2 * uv_stride + x / 2) as usize;
                let wanted = reference(luma, u[chroma], v[chroma], colour);
                for (got, wanted) in pixel.0.iter().zip(wanted) {
                    prop_assert!((f64::from(*got) - wanted).abs() <= TOLERANCE, "({x}, {row}): {got} for {wanted}");
                }
            }
        }

        #[test]
        fn every_pixel_of_packed_data_follows_the_formula(
            colour in any_colour(),
            pairs in 1_u32..40,
            height in 1_u32..6,
            seed in any::<u64>(),
        ) {
            let mut state = seed | 1;
            let mut byte = || { state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1); (state >> 56) as u8 };
            let (width, stride) = (pairs * 2, pairs * 4);
            let bytes: Vec<u8> = (0..stride * height).map(|_| byte()).collect();
            let out = rgb_from_yuyv(&bytes, width, height, stride, colour).unwrap();
            for (x, row, pixel) in out.enumerate_pixels() {
                let pair = (row * stride + x / 2 * 4) as usize;
                let luma = bytes[pair + 2 * (x as usize % 2)];
                let wanted = reference(luma, bytes[pair + 1], bytes[pair + 3], colour);
                for (got, wanted) in pixel.0.iter().zip(wanted) {
                    prop_assert!((f64::from(*got) - wanted).abs() <= TOLERANCE, "({x}, {row}): {got} for {wanted}");
                }
            }
        }
    }
}
