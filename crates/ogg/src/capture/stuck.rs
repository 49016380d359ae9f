//! A source that repeats one picture with new times.
//!
//! Some cameras freeze without an error: new frames, old pixels. Sensor noise makes two real pictures differ, so equal pixels mean a
//! frozen source. A recording of a still synthetic scene repeats pictures too; such sources are not watched.

use image::RgbImage;

/// Notices when a source gives the same picture several times in a row.
#[derive(Debug, Clone)]
pub struct StuckDetector {
    limit: u32,
    last: Option<u64>,
    equal: u32,
}

impl Default for StuckDetector {
    /// Three equal pictures: at 30 Hz a tenth of a second, and far from chance.
    fn default() -> Self {
        Self::new(3)
    }
}

impl StuckDetector {
    /// Speaks up when `limit` pictures in a row are equal (at least two).
    pub fn new(limit: u32) -> Self {
        Self { limit: limit.max(2), last: None, equal: 0 }
    }

    /// Takes the next picture; true while the source is stuck.
    ///
    /// ```
    /// let mut stuck = ogg::capture::StuckDetector::default();
    /// let (a, b) = (image::RgbImage::new(8, 8), image::RgbImage::from_pixel(8, 8, image::Rgb([1, 0, 0])));
    /// let seen: Vec<bool> = [&a, &a, &a, &a, &b].into_iter().map(|image| stuck.observe(image)).collect();
    /// assert_eq!(seen, [false, false, true, true, false]);
    /// ```
    pub fn observe(&mut self, image: &RgbImage) -> bool {
        let hash = image_hash(image);
        self.equal = if self.last == Some(hash) { self.equal.saturating_add(1) } else { 1 };
        self.last = Some(hash);
        self.equal >= self.limit
    }
}

/// A 64-bit hash of size and pixels, the same on every machine. Every byte counts; not for hostile input.
///
/// Four independent multiply-and-rotate lanes over words of eight bytes: a 1080p picture takes about a millisecond.
pub fn image_hash(image: &RgbImage) -> u64 {
    // Odd constants with well mixed bits (fractional parts of the golden ratio and of square roots).
    const MIX: [u64; 4] = [0x9e37_79b9_7f4a_7c15, 0xbb67_ae85_84ca_a73b, 0x3c6e_f372_fe94_f82b, 0xa54f_f53a_5f1d_36f1];
    let step = |state: u64, word: u64, mix: u64| (state ^ word).wrapping_mul(mix).rotate_left(29);
    let mut lanes = MIX;
    let blocks = image.as_raw().chunks_exact(32);
    let rest = blocks.remainder();
    for block in blocks {
        for ((lane, mix), word) in lanes.iter_mut().zip(MIX).zip(block.as_chunks::<8>().0) {
            *lane = step(*lane, u64::from_le_bytes(*word), mix);
        }
    }
    for &byte in rest {
        lanes[0] = step(lanes[0], u64::from(byte) + 1, MIX[0]);
    }
    let size = u64::from(image.width()) << 32 | u64::from(image.height());
    let mixed = lanes.iter().fold(size, |state, &lane| step(state, lane, MIX[1]));
    (mixed ^ mixed >> 32).wrapping_mul(MIX[0])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn changing_any_one_byte_changes_the_hash(at in 0_usize..(13 * 7 * 3), change in 1_u8..) {
            let picture = RgbImage::from_fn(13, 7, |x, y| image::Rgb([x as u8, y as u8, 9]));
            let mut other = picture.clone();
            let byte = &mut other.as_flat_samples_mut().samples[at];
            *byte = byte.wrapping_add(change);
            prop_assert_ne!(image_hash(&picture), image_hash(&other));
        }
    }

    #[test]
    fn size_counts_even_where_pixels_agree() {
        assert_ne!(image_hash(&RgbImage::new(4, 2)), image_hash(&RgbImage::new(2, 4)));
    }

    #[test]
    fn noise_never_counts_as_stuck() {
        let mut stuck = StuckDetector::default();
        for frame in 0..1000_u32 {
            let picture = RgbImage::from_fn(16, 16, |x, y| image::Rgb([(frame ^ x ^ y) as u8, (frame >> 8) as u8, 0]));
            assert!(!stuck.observe(&picture), "frame {frame}");
        }
    }
}
