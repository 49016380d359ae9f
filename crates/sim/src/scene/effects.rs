//! Faults of a real picture: blur, sensor noise, exposure and colour cast.

use image::RgbImage;

use super::material::lattice_noise;
use super::mesh::V3;
use crate::smooth::hash_unit;

/// Strengths of the faults; the default leaves the picture as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Effects {
    pub(crate) seed: u64,
    /// Standard deviation of the noise in 8-bit steps.
    pub(crate) noise: f32,
    /// Passes of a 3 x 3 binomial blur.
    pub(crate) blur_passes: u8,
    /// Gain of each channel.
    pub(crate) gain: [f32; 3],
    /// Strength of large soft blotches, as of uneven light, in 8-bit steps.
    pub(crate) blotch: f32,
}

impl Default for Effects {
    fn default() -> Self {
        Self { seed: 0, noise: 0.0, blur_passes: 0, gain: [1.0; 3], blotch: 0.0 }
    }
}

impl Effects {
    /// Applies blur, gain, blotches and noise, in this order. `frame` makes the noise differ between pictures.
    pub(crate) fn apply(&self, picture: &mut RgbImage, frame: u64) {
        if *self == (Self { seed: self.seed, ..Self::default() }) {
            return;
        }
        for _ in 0..self.blur_passes {
            blur(picture);
        }
        let width = picture.width();
        let stream = self.seed.wrapping_add(frame);
        for (i, pixel) in (0_i64..).zip(picture.pixels_mut()) {
            let (x, y) = (i as u32 % width, i as u32 / width);
            let shade = if self.blotch > 0.0 {
                let p = V3::new(x as f32 / 60.0, y as f32 / 60.0, (self.seed % 97) as f32);
                self.blotch * (2.0 * lattice_noise(p) - 1.0)
            } else {
                0.0
            };
            for (c, value) in pixel.0.iter_mut().enumerate() {
                // The sum of three uniform numbers in [-1, 1) has variance 1 and no long tails.
                let grain: f64 = (0..3).map(|k| hash_unit(stream, 3 * c as u64 + k, i)).sum();
                let seen = f32::from(*value) * self.gain[c] + shade + self.noise * grain as f32;
                *value = (seen + 0.5).clamp(0.0, 255.0) as u8;
            }
        }
    }
}

/// One pass of the kernel 1 2 1 in both directions.
fn blur(picture: &mut RgbImage) {
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let mut pass = |step: usize, count: usize, lines: usize, line_step: usize| {
        let data: &mut [u8] = picture;
        for line in 0..lines {
            for channel in 0..3 {
                let start = line * line_step + channel;
                let mut before = u16::from(data[start]);
                for k in 0..count {
                    let here = u16::from(data[start + k * step]);
                    let after = u16::from(data[start + (k + 1).min(count - 1) * step]);
                    data[start + k * step] = ((before + 2 * here + after + 2) / 4) as u8;
                    before = here;
                }
            }
        }
    };
    pass(3, width, height, 3 * width);
    pass(3 * width, height, width, 3);
}
