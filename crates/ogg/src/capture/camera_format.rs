//! Which format to ask of a camera, and how its bytes become pixels: everything about cameras that needs no camera.

use image::{ImageFormat, RgbImage};

use super::Error;

/// How a camera packs its pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelLayout {
    /// `YUYV`: packed 4:2:2, two bytes per pixel.
    Yuyv,
    /// `MJPG`: one JPEG per picture.
    Mjpeg,
}

/// A format that a camera offers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraMode {
    /// Packing.
    pub layout: PixelLayout,
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Highest frame rate in this format and size.
    pub rate_hz: f64,
}

/// What is asked of a camera. What is left open is chosen; what is given must be met.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CameraRequest {
    /// Pixels per row and rows.
    pub size: Option<(u32, u32)>,
    /// Lowest acceptable frame rate.
    pub rate_hz: Option<f64>,
}

/// Size up to which a larger picture is preferred when none is asked for: a worker at a bench fills it well enough for every
/// pose network, and USB 2 carries it at 30 Hz as MJPG.
const PREFERRED_PIXELS: u64 = 1280 * 720;
/// Rate that is preferred when none is asked for.
const PREFERRED_RATE_HZ: f64 = 30.0;
/// Drivers state 29.97 Hz for 30.
const RATE_SLACK_HZ: f64 = 0.1;

/// Chooses the format: the size asked for, or else the largest one up to 1280 x 720; the rate asked for, or else at least 30 Hz where there is
/// one; and of what remains the uncompressed packing, for it costs no decoding and no artefacts.
///
/// `None` if nothing meets the request.
///
/// ```
/// use ogg::capture::{choose_mode, CameraMode, CameraRequest, PixelLayout};
/// let slow = CameraMode { layout: PixelLayout::Yuyv, width: 1280, height: 720, rate_hz: 10.0 };
/// let fast = CameraMode { layout: PixelLayout::Mjpeg, rate_hz: 30.0, ..slow };
/// assert_eq!(choose_mode(&[slow, fast], &CameraRequest::default()), Some(fast));
/// ```
pub fn choose_mode(modes: &[CameraMode], request: &CameraRequest) -> Option<CameraMode> {
    let pixels = |mode: &CameraMode| u64::from(mode.width) * u64::from(mode.height);
    let fits: Vec<CameraMode> = modes
        .iter()
        .filter(|mode| mode.rate_hz.is_finite() && mode.rate_hz > 0.0 && pixels(mode) > 0)
        .filter(|mode| request.size.is_none_or(|size| size == (mode.width, mode.height)))
        .filter(|mode| request.rate_hz.is_none_or(|rate_hz| mode.rate_hz + RATE_SLACK_HZ >= rate_hz))
        .copied()
        .collect();
    let wanted_hz = request.rate_hz.unwrap_or(PREFERRED_RATE_HZ);
    fits.into_iter().max_by(|a, b| {
        let rank = |mode: &CameraMode| {
            let fast = mode.rate_hz + RATE_SLACK_HZ >= wanted_hz;
            let small = pixels(mode) <= PREFERRED_PIXELS;
            let size = if small { pixels(mode).cast_signed() } else { -pixels(mode).cast_signed() };
            (fast, small, size, mode.layout == PixelLayout::Yuyv)
        };
        rank(a).cmp(&rank(b)).then(a.rate_hz.total_cmp(&b.rate_hz))
    })
}

/// Decodes one picture of a Motion JPEG stream. Cameras may leave out the Huffman tables; the standard ones then apply.
///
/// # Errors
///
/// [`Error::CameraJpeg`] if the bytes are no JPEG or not of the negotiated size.
pub fn rgb_from_mjpeg(bytes: &[u8], width: u32, height: u32) -> Result<RgbImage, Error> {
    let failed = |message: String| Error::CameraJpeg { width, height, message };
    let completed = with_huffman_tables(bytes);
    let image = image::load_from_memory_with_format(completed.as_deref().unwrap_or(bytes), ImageFormat::Jpeg)
        .map_err(|error| failed(error.to_string()))?
        .into_rgb8();
    if image.dimensions() == (width, height) {
        Ok(image)
    } else {
        Err(failed(format!("{} x {}", image.width(), image.height())))
    }
}

/// The picture with the standard Huffman tables before its scan, or `None` if it has tables (or is no JPEG).
fn with_huffman_tables(bytes: &[u8]) -> Option<Vec<u8>> {
    const START_OF_SCAN: u8 = 0xda;
    const HUFFMAN_TABLES: u8 = 0xc4;
    let mut at = 2;
    loop {
        let marker = bytes.get(at..at + 4)?;
        if marker[0] != 0xff || marker[1] == HUFFMAN_TABLES {
            return None;
        }
        if marker[1] == START_OF_SCAN {
            let mut out = Vec::with_capacity(bytes.len() + 512);
            out.extend_from_slice(&bytes[..at]);
            for (class_and_id, lengths, values) in STANDARD_TABLES {
                let size = (2 + 1 + 16 + values.len()) as u16;
                out.extend_from_slice(&[0xff, HUFFMAN_TABLES]);
                out.extend_from_slice(&size.to_be_bytes());
                out.push(class_and_id);
                out.extend_from_slice(&lengths);
                out.extend_from_slice(values);
            }
            out.extend_from_slice(&bytes[at..]);
            return Some(out);
        }
        at += 2 + usize::from(u16::from_be_bytes([marker[2], marker[3]]));
    }
}

/// Table class and number, count of codes per length 1 to 16, values: ITU-T T.81 annex K.3.
const STANDARD_TABLES: [(u8, [u8; 16], &[u8]); 4] = [
    (0x00, [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0], &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]),
    (0x01, [0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0], &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]),
    (
        0x10,
        [0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7d],
        b"\x01\x02\x03\x00\x04\x11\x05\x12\x21\x31\x41\x06\x13\x51\x61\x07\x22\x71\x14\x32\x81\x91\xa1\x08\x23\x42\xb1\xc1\
          \x15\x52\xd1\xf0\x24\x33\x62\x72\x82\x09\x0a\x16\x17\x18\x19\x1a\x25\x26\x27\x28\x29\x2a\x34\x35\x36\x37\x38\x39\
          \x3a\x43\x44\x45\x46\x47\x48\x49\x4a\x53\x54\x55\x56\x57\x58\x59\x5a\x63\x64\x65\x66\x67\x68\x69\x6a\x73\x74\x75\
          \x76\x77\x78\x79\x7a\x83\x84\x85\x86\x87\x88\x89\x8a\x92\x93\x94\x95\x96\x97\x98\x99\x9a\xa2\xa3\xa4\xa5\xa6\xa7\
          \xa8\xa9\xaa\xb2\xb3\xb4\xb5\xb6\xb7\xb8\xb9\xba\xc2\xc3\xc4\xc5\xc6\xc7\xc8\xc9\xca\xd2\xd3\xd4\xd5\xd6\xd7\xd8\
          \xd9\xda\xe1\xe2\xe3\xe4\xe5\xe6\xe7\xe8\xe9\xea\xf1\xf2\xf3\xf4\xf5\xf6\xf7\xf8\xf9\xfa",
    ),
    (
        0x11,
        [0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77],
        b"\x00\x01\x02\x03\x11\x04\x05\x21\x31\x06\x12\x41\x51\x07\x61\x71\x13\x22\x32\x81\x08\x14\x42\x91\xa1\xb1\xc1\x09\
          \x23\x33\x52\xf0\x15\x62\x72\xd1\x0a\x16\x24\x34\xe1\x25\xf1\x17\x18\x19\x1a\x26\x27\x28\x29\x2a\x35\x36\x37\x38\
          \x39\x3a\x43\x44\x45\x46\x47\x48\x49\x4a\x53\x54\x55\x56\x57\x58\x59\x5a\x63\x64\x65\x66\x67\x68\x69\x6a\x73\x74\
          \x75\x76\x77\x78\x79\x7a\x82\x83\x84\x85\x86\x87\x88\x89\x8a\x92\x93\x94\x95\x96\x97\x98\x99\x9a\xa2\xa3\xa4\xa5\
          \xa6\xa7\xa8\xa9\xaa\xb2\xb3\xb4\xb5\xb6\xb7\xb8\xb9\xba\xc2\xc3\xc4\xc5\xc6\xc7\xc8\xc9\xca\xd2\xd3\xd4\xd5\xd6\
          \xd7\xd8\xd9\xda\xe2\xe3\xe4\xe5\xe6\xe7\xe8\xe9\xea\xf2\xf3\xf4\xf5\xf6\xf7\xf8\xf9\xfa",
    ),
];

#[cfg(test)]
mod tests {
    use image::Rgb;
    use image::codecs::jpeg::JpegEncoder;
    use proptest::prelude::*;

    use super::*;

    const fn mode(layout: PixelLayout, width: u32, height: u32, rate_hz: f64) -> CameraMode {
        CameraMode { layout, width, height, rate_hz }
    }

    /// What a common USB camera offers.
    const MODES: [CameraMode; 7] = [
        mode(PixelLayout::Yuyv, 640, 480, 30.0),
        mode(PixelLayout::Yuyv, 1280, 720, 10.0),
        mode(PixelLayout::Yuyv, 1920, 1080, 5.0),
        mode(PixelLayout::Mjpeg, 640, 480, 30.0),
        mode(PixelLayout::Mjpeg, 1280, 720, 60.0),
        mode(PixelLayout::Mjpeg, 1280, 720, 29.97),
        mode(PixelLayout::Mjpeg, 1920, 1080, 30.0),
    ];

    #[test]
    fn without_a_request_the_largest_picture_up_to_720_rows_at_full_rate_is_taken() {
        assert_eq!(choose_mode(&MODES, &CameraRequest::default()), Some(MODES[4]));
    }

    #[test]
    fn the_uncompressed_packing_wins_where_it_is_fast_enough() {
        let request = CameraRequest { size: Some((640, 480)), rate_hz: Some(30.0) };
        assert_eq!(choose_mode(&MODES, &request), Some(MODES[0]));
    }

    #[test]
    fn a_size_that_is_asked_for_is_met_exactly_or_refused() {
        let request = CameraRequest { size: Some((1920, 1080)), rate_hz: None };
        assert_eq!(choose_mode(&MODES, &request), Some(MODES[6]));
        let request = CameraRequest { size: Some((800, 600)), rate_hz: None };
        assert_eq!(choose_mode(&MODES, &request), None);
    }

    #[test]
    fn a_rate_that_no_mode_reaches_is_refused() {
        assert_eq!(choose_mode(&MODES, &CameraRequest { size: None, rate_hz: Some(90.0) }), None);
        let only_ntsc = [MODES[5]];
        assert!(choose_mode(&only_ntsc, &CameraRequest { size: None, rate_hz: Some(30.0) }).is_some());
    }

    fn jpeg() -> Vec<u8> {
        let picture = RgbImage::from_fn(48, 32, |x, y| Rgb([(x * 5) as u8, (y * 7) as u8, ((x ^ y) * 3) as u8]));
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, 90).encode_image(&picture).unwrap();
        bytes
    }

    /// Removes every table segment, as cameras do.
    fn without_tables(jpeg: &[u8]) -> Vec<u8> {
        let mut out = jpeg[..2].to_vec();
        let mut at = 2;
        while jpeg[at + 1] != 0xda {
            let end = at + 2 + usize::from(u16::from_be_bytes([jpeg[at + 2], jpeg[at + 3]]));
            if jpeg[at + 1] != 0xc4 {
                out.extend_from_slice(&jpeg[at..end]);
            }
            at = end;
        }
        out.extend_from_slice(&jpeg[at..]);
        out
    }

    #[test]
    fn a_picture_without_huffman_tables_decodes_like_the_one_with_them() {
        let (whole, stripped) = (jpeg(), without_tables(&jpeg()));
        assert!(stripped.len() + 400 < whole.len());
        assert_eq!(rgb_from_mjpeg(&stripped, 48, 32).unwrap(), rgb_from_mjpeg(&whole, 48, 32).unwrap());
    }

    #[test]
    fn a_picture_of_another_size_is_refused() {
        let message = rgb_from_mjpeg(&jpeg(), 64, 48).unwrap_err().to_string();
        assert_eq!(message, "MJPG picture: expected a JPEG of 64 x 48, got 48 x 32");
    }

    proptest! {
        #[test]
        fn damaged_pictures_never_panic(at in 0_usize..700, value in any::<u8>(), cut in 0_usize..900) {
            let mut bytes = without_tables(&jpeg());
            if let Some(byte) = bytes.get_mut(at) {
                *byte = value;
            }
            bytes.truncate(cut.max(1));
            let _ = rgb_from_mjpeg(&bytes, 48, 32);
        }
    }
}
