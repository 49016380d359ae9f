//! Pictures made smaller and packed.

use image::RgbImage;
use jpeg_encoder::{ColorType, EncodingError, SamplingFactor};

/// Averages blocks of `n x n` pixels; rows and columns that fill no block are cut off.
pub(super) fn reduced(image: &RgbImage, n: u32) -> RgbImage {
    let (width, height) = (image.width() / n, image.height() / n);
    let (n, row_bytes) = (n as usize, image.width() as usize * 3);
    let raw = image.as_raw();
    let mut sums = vec![0_u32; width as usize * 3];
    let mut out = Vec::with_capacity(sums.len() * height as usize);
    let area = (n * n) as u32;
    for block_row in 0..height as usize {
        sums.fill(0);
        for row in raw[block_row * n * row_bytes..].chunks_exact(row_bytes).take(n) {
            for (sum, block) in sums.as_chunks_mut::<3>().0.iter_mut().zip(row.chunks_exact(3 * n)) {
                for pixel in block.as_chunks::<3>().0 {
                    for (sum, &value) in sum.iter_mut().zip(pixel) {
                        *sum += u32::from(value);
                    }
                }
            }
        }
        out.extend(sums.iter().map(|sum| ((sum + area / 2) / area) as u8));
    }
    let Some(image) = RgbImage::from_raw(width, height, out) else { unreachable!("three sums for every block") };
    image
}

/// JPEG with its colours at half the resolution (4:2:0), as cameras send them.
pub(super) fn jpeg(image: &RgbImage, quality: u8) -> Result<Vec<u8>, EncodingError> {
    let mut data = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut data, quality);
    encoder.set_sampling_factor(SamplingFactor::R_4_2_0);
    let [width, height] = [image.width(), image.height()].map(|side| u16::try_from(side).unwrap_or(u16::MAX));
    encoder.encode(image, width, height, ColorType::Rgb)?;
    Ok(data)
}
