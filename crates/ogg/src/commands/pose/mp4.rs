//! H.264 in MP4, one picture after the other.
//!
//! OpenH264 codes constrained baseline without reordered pictures, so decoding order is presentation order. Samples go to
//! the file as they come; the index (ISO/IEC 14496-12, with `avcC` of ISO/IEC 14496-15) follows at the end, and only then
//! the file gets its name, so a run that is cut short leaves `NAME.part` and no broken video. Odd sizes lose their last row
//! or column, because chroma has half the resolution. Memory: 12 bytes per picture.

use std::fs::File;
use std::io::{BufWriter, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use image::RgbImage;
use openh264::OpenH264API;
use openh264::encoder::{
    BitRate, Encoder, EncoderConfig, FrameRate, FrameType, IntraFramePeriod, QpRange, RateControlMode, UsageType,
    VuiConfig,
};
use openh264::formats::{RgbSliceU8, YUVBuffer};

use super::unwritable;
use crate::error::Error;

/// Ticks per second of the track; the usual clock of video, which 24, 25, 30 and 60 Hz divide.
const TICKS: u32 = 90_000;
/// A key picture at least this often, so that players can jump.
const KEY_INTERVAL: u32 = 60;
/// NAL unit types of ITU-T H.264, table 7-1.
const SEQUENCE_SET: u8 = 7;
const PICTURE_SET: u8 = 8;
/// Where the length of `mdat` is written: after `ftyp` of 24 bytes and the box header of 8.
const MDAT_LENGTH_AT: u64 = 24 + 8;

/// Writes one video file.
pub(super) struct Mp4Writer {
    path: PathBuf,
    part: PathBuf,
    file: BufWriter<File>,
    position: u64,
    rate_hz: f64,
    /// Made for the size of the first picture.
    coder: Option<Coder>,
    samples: Vec<Sample>,
}

struct Coder {
    encoder: Encoder,
    width: u32,
    height: u32,
    yuv: YUVBuffer,
    sequence_set: Vec<u8>,
    picture_set: Vec<u8>,
}

#[derive(Clone, Copy)]
struct Sample {
    size: u32,
    ticks: u64,
    is_key: bool,
}

impl Mp4Writer {
    /// Opens `PATH.part`.
    pub(super) fn create(path: &Path, rate_hz: f64) -> Result<Self, Error> {
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        let part = PathBuf::from(part);
        let mut file = BufWriter::new(File::create(&part).map_err(unwritable(&part))?);
        let mut head = Vec::new();
        atom(&mut head, *b"ftyp", |b| {
            b.extend(b"isom");
            b.extend(512_u32.to_be_bytes());
            b.extend(b"isomavc1");
        });
        // A size of 1 means that the length follows in 64 bits.
        head.extend(1_u32.to_be_bytes());
        head.extend(b"mdat");
        head.extend(16_u64.to_be_bytes());
        file.write_all(&head).map_err(unwritable(&part))?;
        let position = head.len() as u64;
        Ok(Self { path: path.to_owned(), part, file, position, rate_hz, coder: None, samples: Vec::new() })
    }

    /// Adds a picture that is shown from `time` on.
    pub(super) fn push(&mut self, image: &RgbImage, time: Duration) -> Result<(), Error> {
        let (width, height) = (image.width() & !1, image.height() & !1);
        if width < 16 || height < 16 {
            return Err(self.refused(format!("pictures of {width}x{height} px, expected at least 16x16 px for H.264")));
        }
        let mut coder = match self.coder.take() {
            Some(coder) => coder,
            None => Coder::new(width, height, self.rate_hz).map_err(|e| self.refused(format!("H.264 encoder: {e}")))?,
        };
        if (coder.width, coder.height) != (width, height) {
            let (w, h) = (coder.width, coder.height);
            return Err(self.refused(format!("a picture of {width}x{height} px, expected {w}x{h} px as before")));
        }
        let (bytes, is_key) = coder.code(image).map_err(|e| self.refused(format!("H.264 encoder: {e}")))?;
        self.coder = Some(coder);
        self.file.write_all(&bytes).map_err(unwritable(&self.part))?;
        self.position += bytes.len() as u64;
        let ticks = (time.as_secs_f64() * f64::from(TICKS)).round() as u64;
        let ticks = self.samples.last().map_or(ticks, |s| ticks.max(s.ticks + 1));
        self.samples.push(Sample { size: bytes.len() as u32, ticks, is_key });
        Ok(())
    }

    /// Writes the index and gives the file its name.
    pub(super) fn finish(mut self) -> Result<(), Error> {
        let Some(coder) = self.coder.take() else {
            return Err(self.refused("no picture, expected at least one".to_owned()));
        };
        let failed = unwritable(&self.part);
        let index = index(&coder, &self.samples, self.rate_hz);
        let mdat = self.position - 24;
        let write = |file: &mut BufWriter<File>| {
            file.write_all(&index)?;
            file.seek(SeekFrom::Start(MDAT_LENGTH_AT))?;
            file.write_all(&mdat.to_be_bytes())?;
            file.flush()
        };
        write(&mut self.file).map_err(failed)?;
        std::fs::rename(&self.part, &self.path).map_err(unwritable(&self.path))
    }

    fn refused(&self, message: String) -> Error {
        Error::Content { path: self.path.clone(), message }
    }
}

impl Coder {
    fn new(width: u32, height: u32, rate_hz: f64) -> Result<Self, openh264::Error> {
        let config = EncoderConfig::new()
            .usage_type(UsageType::CameraVideoRealTime)
            .rate_control_mode(RateControlMode::Off)
            .max_frame_rate(FrameRate::from_hz(rate_hz as f32))
            // Lines one pixel wide stay legible at three bits per pixel of a 30 Hz video.
            .bitrate(BitRate::from_bps((f64::from(width * height) * rate_hz * 0.1) as u32))
            .qp(QpRange::new(14, 32))
            .skip_frames(false)
            .intra_frame_period(IntraFramePeriod::from_num_frames(KEY_INTERVAL))
            .vui(VuiConfig::bt601());
        let encoder = Encoder::with_api_config(OpenH264API::from_source(), config)?;
        let yuv = YUVBuffer::new(width as usize, height as usize);
        Ok(Self { encoder, width, height, yuv, sequence_set: Vec::new(), picture_set: Vec::new() })
    }

    /// The picture as NAL units with their lengths before them, and whether it is a key picture. Parameter sets are kept
    /// for the index.
    fn code(&mut self, image: &RgbImage) -> Result<(Vec<u8>, bool), openh264::Error> {
        let (width, height) = (self.width as usize, self.height as usize);
        let cropped;
        let pixels = if (image.width(), image.height()) == (self.width, self.height) {
            image.as_raw()
        } else {
            cropped = image::imageops::crop_imm(image, 0, 0, self.width, self.height).to_image();
            cropped.as_raw()
        };
        self.yuv.read_rgb8(RgbSliceU8::new(pixels, (width, height)));
        let stream = self.encoder.encode(&self.yuv)?;
        let is_key = matches!(stream.frame_type(), FrameType::IDR);
        let mut bytes = Vec::new();
        for layer in (0..stream.num_layers()).filter_map(|l| stream.layer(l)) {
            for unit in (0..layer.nal_count()).filter_map(|n| layer.nal_unit(n)) {
                let unit = without_start_code(unit);
                match unit.first().map(|byte| byte & 31) {
                    None => {}
                    Some(SEQUENCE_SET) => self.sequence_set = unit.to_vec(),
                    Some(PICTURE_SET) => self.picture_set = unit.to_vec(),
                    Some(_) => {
                        bytes.extend((unit.len() as u32).to_be_bytes());
                        bytes.extend(unit);
                    }
                }
            }
        }
        Ok((bytes, is_key))
    }
}

fn without_start_code(unit: &[u8]) -> &[u8] {
    let zeros = unit.iter().take_while(|b| **b == 0).count();
    if zeros >= 2 && unit.get(zeros) == Some(&1) { &unit[zeros + 1..] } else { unit }
}

/// A box: length, name, content.
fn atom(out: &mut Vec<u8>, name: [u8; 4], fill: impl FnOnce(&mut Vec<u8>)) {
    let start = out.len();
    out.extend([0; 4]);
    out.extend(name);
    fill(out);
    let length = (out.len() - start) as u32;
    out[start..start + 4].copy_from_slice(&length.to_be_bytes());
}

/// A box with a version and flags.
fn full(out: &mut Vec<u8>, name: [u8; 4], version_flags: u32, fill: impl FnOnce(&mut Vec<u8>)) {
    atom(out, name, |b| {
        b.extend(version_flags.to_be_bytes());
        fill(b);
    });
}

fn words(out: &mut Vec<u8>, words: &[u32]) {
    words.iter().for_each(|w| out.extend(w.to_be_bytes()));
}

/// Unity matrix in 16.16 and 2.30 fixed point.
const MATRIX: [u32; 9] = [0x1_0000, 0, 0, 0, 0x1_0000, 0, 0, 0, 0x4000_0000];

fn index(coder: &Coder, samples: &[Sample], rate_hz: f64) -> Vec<u8> {
    let first = samples.first().map_or(0, |s| s.ticks);
    let last_step = (f64::from(TICKS) / rate_hz.max(1e-3)).round() as u64;
    let end = samples.last().map_or(0, |s| s.ticks) + last_step;
    let duration = (end - first).min(u64::from(u32::MAX)) as u32;
    let mut out = Vec::new();
    atom(&mut out, *b"moov", |moov| {
        full(moov, *b"mvhd", 0, |b| {
            words(b, &[0, 0, TICKS, duration, 0x1_0000, 0x0100_0000, 0, 0]);
            words(b, &MATRIX);
            words(b, &[0, 0, 0, 0, 0, 0, 2]);
        });
        atom(moov, *b"trak", |trak| {
            // Flags: enabled, in the movie.
            full(trak, *b"tkhd", 3, |b| {
                words(b, &[0, 0, 1, 0, duration, 0, 0, 0, 0]);
                words(b, &MATRIX);
                words(b, &[coder.width << 16, coder.height << 16]);
            });
            atom(trak, *b"mdia", |mdia| {
                // Language "und" in five bits per letter.
                full(mdia, *b"mdhd", 0, |b| words(b, &[0, 0, TICKS, duration, 0x55c4_0000]));
                full(mdia, *b"hdlr", 0, |b| {
                    b.extend(b"\0\0\0\0vide\0\0\0\0\0\0\0\0\0\0\0\0video\0");
                });
                atom(mdia, *b"minf", |minf| {
                    full(minf, *b"vmhd", 1, |b| words(b, &[0, 0]));
                    atom(minf, *b"dinf", |dinf| {
                        full(dinf, *b"dref", 0, |b| {
                            words(b, &[1]);
                            full(b, *b"url ", 1, |_| {});
                        });
                    });
                    atom(minf, *b"stbl", |stbl| tables(stbl, coder, samples, last_step));
                });
            });
        });
    });
    out
}

fn tables(stbl: &mut Vec<u8>, coder: &Coder, samples: &[Sample], last_step: u64) {
    full(stbl, *b"stsd", 0, |b| {
        words(b, &[1]);
        atom(b, *b"avc1", |b| {
            words(b, &[0, 1, 0, 0, 0, 0]);
            b.extend((coder.width as u16).to_be_bytes());
            b.extend((coder.height as u16).to_be_bytes());
            // 72 dpi, one picture per sample, no name, 24 bits, no colour table.
            words(b, &[0x48_0000, 0x48_0000, 0]);
            b.extend(1_u16.to_be_bytes());
            b.extend([0; 32]);
            b.extend([0, 24, 0xff, 0xff]);
            atom(b, *b"avcC", |b| {
                let (sequence, picture) = (&coder.sequence_set, &coder.picture_set);
                b.push(1);
                b.extend(sequence.get(1..4).unwrap_or(&[66, 0xc0, 31]));
                // Lengths of four bytes; one parameter set of each kind.
                b.extend([0xff, 0xe1]);
                b.extend((sequence.len() as u16).to_be_bytes());
                b.extend(sequence);
                b.push(1);
                b.extend((picture.len() as u16).to_be_bytes());
                b.extend(picture);
            });
        });
    });
    let steps = samples.windows(2).map(|w| w[1].ticks - w[0].ticks).chain([last_step]);
    let mut runs: Vec<(u32, u32)> = Vec::new();
    for step in steps.take(samples.len()).map(|s| s.min(u64::from(u32::MAX)) as u32) {
        match runs.last_mut() {
            Some((count, of)) if *of == step => *count += 1,
            _ => runs.push((1, step)),
        }
    }
    full(stbl, *b"stts", 0, |b| {
        words(b, &[runs.len() as u32]);
        runs.iter().for_each(|(count, step)| words(b, &[*count, *step]));
    });
    let keys: Vec<u32> = (1..).zip(samples).filter(|(_, s)| s.is_key).map(|(i, _)| i).collect();
    full(stbl, *b"stss", 0, |b| {
        words(b, &[keys.len() as u32]);
        words(b, &keys);
    });
    // One chunk that holds every sample.
    full(stbl, *b"stsc", 0, |b| words(b, &[1, 1, samples.len() as u32, 1]));
    full(stbl, *b"stsz", 0, |b| {
        words(b, &[0, samples.len() as u32]);
        samples.iter().for_each(|s| words(b, &[s.size]));
    });
    full(stbl, *b"stco", 0, |b| words(b, &[1, 24 + 16]));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{self, OpenOptions};

    fn picture(index: u64) -> RgbImage {
        RgbImage::from_fn(97, 65, |x, _| {
            if x < 48 { image::Rgb([200, 30, 30]) } else { image::Rgb([20, 20 * index as u8, 200]) }
        })
    }

    #[test]
    fn what_is_written_reads_back_with_its_sizes_times_and_colours() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.mp4");
        let times = [0, 40, 80, 200, 240].map(Duration::from_millis);
        let mut writer = Mp4Writer::create(&path, 25.0).unwrap();
        for (i, time) in (0..).zip(times) {
            writer.push(&picture(i), time).unwrap();
        }
        assert!(!path.exists());
        writer.finish().unwrap();
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);

        let mut source = capture::open(&path, &OpenOptions::default()).unwrap();
        let mut count = 0;
        while let Some(frame) = source.next_frame().unwrap() {
            assert_eq!(frame.image.dimensions(), (96, 64));
            assert_eq!(frame.captured, times[count]);
            for (x, wanted) in [(20, [200, 30, 30]), (76, [20, 20 * count as u8, 200])] {
                let got = frame.image.get_pixel(x, 32).0;
                let worst = got.iter().zip(wanted).map(|(a, b)| a.abs_diff(b)).max();
                assert!(worst <= Some(10), "frame {count}: {got:?} for {wanted:?}");
            }
            count += 1;
        }
        assert_eq!(count, times.len());
    }

    /// Judge: another reader of the container.
    #[test]
    fn another_reader_finds_the_same_track() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.mp4");
        let mut writer = Mp4Writer::create(&path, 30.0).unwrap();
        for i in 0..70 {
            writer.push(&picture(i % 10), Duration::from_secs(i) / 30).unwrap();
        }
        writer.finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let file = re_mp4::Mp4::read_bytes(&bytes).unwrap();
        let track = file.tracks().values().next().unwrap();
        assert_eq!((track.samples.len(), track.width, track.height), (70, 96, 64));
        assert_eq!((track.timescale, track.duration), (90_000, 70 * 3000));
        let keys: Vec<usize> = (0..70).filter(|i| track.samples[*i].is_sync).collect();
        assert_eq!(keys, [0, 60]);
        let last = track.samples.last().unwrap();
        assert!(last.offset + last.size <= bytes.len() as u64);
    }

    #[test]
    fn pictures_of_another_size_and_no_picture_at_all_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.mp4");
        let mut writer = Mp4Writer::create(&path, 25.0).unwrap();
        writer.push(&picture(0), Duration::ZERO).unwrap();
        let error = writer.push(&RgbImage::new(64, 64), Duration::from_millis(40)).unwrap_err();
        assert!(error.to_string().contains("64x64 px, expected 96x64 px"), "{error}");
        assert!(Mp4Writer::create(&path, 25.0).unwrap().finish().is_err());
        assert!(!path.exists());
    }
}
