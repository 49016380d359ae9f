//! The ISO base media container (MP4, MOV): where each coded picture lies and when it is shown.
//!
//! Reads the sample tables of the first video track and, where the file is fragmented, the track runs. Nothing
//! is decoded here and no sample is held: a sample is an offset, a size and a presentation time. Every length
//! and index that comes from the file is checked before use, and a place that does not hold what
//! ISO/IEC 14496-12 asks for becomes a `Malformed` with its offset. Presentation times start at zero: the smallest one is
//! subtracted, as players do; an edit list that cuts frames away is not applied, so every coded picture counts.
//!
//! Memory is the `moov` and `moof` boxes plus 40 bytes per sample; one pass over the tables.

use std::io::{self, Read, Seek, SeekFrom};

use super::bytes::{Bytes, Malformed, fourcc_text};
use atoms::top_level_header;
use movie::read_movie;

mod atoms;
mod fragments;
mod movie;
mod tables;

/// Index boxes above this size are refused; an hour at 60 Hz needs about 6 MiB.
const MAX_INDEX_BYTES: u64 = 256 << 20;

/// One coded picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sample {
    /// Offset in the file, in bytes.
    pub(super) offset: u64,
    /// Size, in bytes.
    pub(super) size: u32,
    /// Presentation time in ticks of the track, from 0.
    pub(super) time: i64,
}

/// Parameter sets and the width of the length field of an AVC track (ISO/IEC 14496-15).
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct AvcConfig {
    pub(super) length_bytes: usize,
    pub(super) sequence_sets: Vec<Vec<u8>>,
    pub(super) picture_sets: Vec<Vec<u8>>,
}

/// How the pictures are coded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Codec {
    Avc(AvcConfig),
    Other([u8; 4]),
}

/// Clockwise turn that brings a decoded picture upright.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rotation {
    None,
    Quarter,
    Half,
    ThreeQuarters,
}

/// Colour description of the container (`colr` box of type `nclx`), ISO/IEC 23091-2 codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Nclx {
    pub(super) matrix: u16,
    pub(super) full_range: bool,
}

/// The first video track of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct VideoTrack {
    pub(super) codec: Codec,
    pub(super) width: u16,
    pub(super) height: u16,
    pub(super) rotation: Rotation,
    pub(super) colour: Option<Nclx>,
    pub(super) ticks_per_second: u32,
    /// Coded pictures in file (decoding) order.
    pub(super) samples: Vec<Sample>,
}

impl VideoTrack {
    /// Mean frame rate, if the track has two different times.
    pub(super) fn rate_hz(&self) -> Option<f64> {
        let last = self.samples.iter().map(|sample| sample.time).max()?;
        let intervals = self.samples.len() - 1;
        (last > 0).then(|| intervals as f64 * f64::from(self.ticks_per_second) / last as f64)
    }
}

/// Why a container could not be read.
#[derive(Debug)]
pub(super) enum ContainerError {
    Io(io::Error),
    Malformed(Malformed),
    NoVideo(String),
}

impl From<io::Error> for ContainerError {
    fn from(source: io::Error) -> Self {
        Self::Io(source)
    }
}

impl From<Malformed> for ContainerError {
    fn from(place: Malformed) -> Self {
        Self::Malformed(place)
    }
}

/// Reads the index of a file of `length` bytes.
pub(super) fn read<R: Read + Seek>(reader: &mut R, length: u64) -> Result<VideoTrack, ContainerError> {
    let mut movie: Option<(u64, Vec<u8>)> = None;
    let mut fragments: Vec<(u64, Vec<u8>)> = Vec::new();
    let mut position = 0_u64;
    let mut seen = Vec::new();
    while position < length {
        let header = top_level_header(reader, position, length)?;
        if position == 0 && !matches!(&header.kind, b"ftyp" | b"moov" | b"mdat" | b"free" | b"skip" | b"wide" | b"styp")
        {
            return Err(Malformed::new(0, "an MP4 file ('ftyp' box)", format!("'{}'", fourcc_text(header.kind))).into());
        }
        seen.push(fourcc_text(header.kind));
        if matches!(&header.kind, b"moov" | b"moof") {
            if header.body_bytes > MAX_INDEX_BYTES {
                return Err(Malformed::new(
                    position,
                    format!("an index of at most {MAX_INDEX_BYTES} bytes"),
                    format!("{} bytes", header.body_bytes),
                )
                .into());
            }
            let mut body = vec![0; header.body_bytes as usize];
            reader.seek(SeekFrom::Start(header.body_start))?;
            reader.read_exact(&mut body)?;
            if &header.kind == b"moov" {
                movie = Some((header.body_start, body));
            } else {
                fragments.push((header.body_start, body));
            }
        }
        position = header.body_start + header.body_bytes;
    }
    let Some((start, movie)) = movie else {
        let found = if seen.is_empty() { "an empty file".to_owned() } else { format!("only {}", seen.join(", ")) };
        return Err(Malformed::new(length, "a 'moov' box (the index) before the end of the file", found).into());
    };
    let mut parsed = read_movie(Bytes::new(&movie, start), length)?;
    for (start, body) in &fragments {
        fragments::append(&mut parsed, Bytes::new(body, *start), length)?;
    }
    let track = parsed.track;
    if track.samples.is_empty() {
        return Err(Malformed::new(start, "at least one video sample", "none").into());
    }
    Ok(from_zero(track))
}

fn check_sample(sample: Sample, index: usize, length: u64, table: u64) -> Result<(), Malformed> {
    let end = sample.offset.checked_add(u64::from(sample.size));
    match end {
        Some(end) if end <= length => Ok(()),
        _ if sample.offset >= length => Err(Malformed::new(
            length,
            format!("video sample {index} of {} bytes at byte {}", sample.size, sample.offset),
            format!("the end of the file (table at byte {table})"),
        )),
        _ => Err(Malformed::new(
            sample.offset,
            format!("video sample {index} of {} bytes", sample.size),
            format!("a file that ends after {} of them", length - sample.offset),
        )),
    }
}

fn from_zero(mut track: VideoTrack) -> VideoTrack {
    let first = track.samples.iter().map(|sample| sample.time).min().unwrap_or(0);
    for sample in &mut track.samples {
        sample.time = sample.time.saturating_sub(first);
    }
    track
}

#[cfg(test)]
mod tests;
