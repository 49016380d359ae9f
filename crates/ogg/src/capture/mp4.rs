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

mod fragments;
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

/// A box: its type, the offset of its header in the file, and its contents.
#[derive(Debug, Clone, Copy)]
struct Atom<'a> {
    kind: [u8; 4],
    position: u64,
    body: Bytes<'a>,
}

/// Splits the contents of a container box into its children.
fn children(mut body: Bytes<'_>) -> Result<Vec<Atom<'_>>, Malformed> {
    let mut out = Vec::new();
    // Writers pad some containers with fewer bytes than a header takes.
    while body.len() >= 8 {
        let position = body.position();
        let size = body.u32("box size")?;
        let kind = body.fourcc("box type")?;
        let length = match size {
            0 => body.len() as u64,
            1 => body
                .u64("large box size")?
                .checked_sub(16)
                .ok_or_else(|| Malformed::new(position, "a large box size of at least 16", "a smaller one"))?,
            2..=7 => return Err(Malformed::new(position, "a box size of 0, 1 or at least 8", size.to_string())),
            _ => u64::from(size) - 8,
        };
        let room = body.len();
        let inner = usize::try_from(length).ok().filter(|&length| length <= room).ok_or_else(|| {
            Malformed::new(
                position,
                format!("box '{}' within its parent ({room} bytes left)", fourcc_text(kind)),
                format!("a length of {length} bytes"),
            )
        })?;
        let start = body.position();
        out.push(Atom { kind, position, body: Bytes::new(body.take(inner, "box contents")?, start) });
    }
    Ok(out)
}

fn find<'a>(atoms: &[Atom<'a>], kind: [u8; 4]) -> Option<Atom<'a>> {
    atoms.iter().find(|atom| atom.kind == kind).copied()
}

fn require<'a>(atoms: &[Atom<'a>], kind: [u8; 4], parent: Atom<'_>) -> Result<Atom<'a>, Malformed> {
    find(atoms, kind).ok_or_else(|| {
        Malformed::new(
            parent.position,
            format!("a '{}' box in '{}'", fourcc_text(kind), fourcc_text(parent.kind)),
            "none",
        )
    })
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

struct TopLevelHeader {
    kind: [u8; 4],
    body_start: u64,
    body_bytes: u64,
}

fn top_level_header<R: Read + Seek>(
    reader: &mut R,
    position: u64,
    length: u64,
) -> Result<TopLevelHeader, ContainerError> {
    let mut raw = [0_u8; 16];
    let room = (length - position).min(16) as usize;
    reader.seek(SeekFrom::Start(position))?;
    reader.read_exact(&mut raw[..room])?;
    let mut bytes = Bytes::new(&raw[..room], position);
    let size = bytes.u32("box size")?;
    let kind = bytes.fourcc("box type")?;
    let (header_bytes, total) = match size {
        0 => (8, length - position),
        1 => (16, bytes.u64("large box size")?),
        _ => (8, u64::from(size)),
    };
    let Some(body_bytes) = total.checked_sub(header_bytes) else {
        return Err(Malformed::new(
            position,
            format!("box '{}' of at least {header_bytes} bytes", fourcc_text(kind)),
            format!("{total} bytes"),
        )
        .into());
    };
    if total > length - position {
        return Err(Malformed::new(
            position,
            format!("box '{}' of {total} bytes", fourcc_text(kind)),
            format!("a file that ends after {} of them", length - position),
        )
        .into());
    }
    Ok(TopLevelHeader { kind, body_start: position + header_bytes, body_bytes })
}

/// The track plus what fragments need to extend it.
struct Parsed {
    track: VideoTrack,
    track_id: u32,
    defaults: fragments::Defaults,
    /// Decoding time after the last sample, in ticks.
    decode_end: i64,
}

fn read_movie(body: Bytes<'_>, length: u64) -> Result<Parsed, ContainerError> {
    let position = body.position();
    let atoms = children(body)?;
    let mut other = Vec::new();
    for trak in atoms.iter().filter(|atom| &atom.kind == b"trak") {
        let parts = children(trak.body)?;
        let media = require(&parts, *b"mdia", *trak)?;
        let media_parts = children(media.body)?;
        let handler = handler_type(require(&media_parts, *b"hdlr", media)?)?;
        if &handler != b"vide" {
            other.push(format!("'{}' track", fourcc_text(handler)));
            continue;
        }
        let (track_id, rotation) = track_header(require(&parts, *b"tkhd", *trak)?)?;
        let ticks_per_second = time_scale(require(&media_parts, *b"mdhd", media)?)?;
        let info = require(&media_parts, *b"minf", media)?;
        let info_parts = children(info.body)?;
        let table = require(&info_parts, *b"stbl", info)?;
        let table_parts = children(table.body)?;
        let entry = sample_description(require(&table_parts, *b"stsd", table)?)?;
        let (samples, decode_end) = tables::expand(table, &table_parts, length)?;
        let defaults = fragments::Defaults::find(&atoms, track_id)?;
        return Ok(Parsed {
            track: VideoTrack {
                codec: entry.codec,
                width: entry.width,
                height: entry.height,
                rotation,
                colour: entry.colour,
                ticks_per_second,
                samples,
            },
            track_id,
            defaults,
            decode_end,
        });
    }
    if atoms.is_empty() {
        return Err(Malformed::new(position, "tracks in 'moov'", "an empty box").into());
    }
    Err(ContainerError::NoVideo(if other.is_empty() { "no track at all".to_owned() } else { other.join(" and ") }))
}

fn handler_type(atom: Atom<'_>) -> Result<[u8; 4], Malformed> {
    let mut body = atom.body;
    body.take(8, "handler header")?;
    body.fourcc("handler type")
}

fn time_scale(atom: Atom<'_>) -> Result<u32, Malformed> {
    let mut body = atom.body;
    let version = body.u32("media header version")? >> 24;
    body.take(if version == 1 { 16 } else { 8 }, "creation times")?;
    let position = body.position();
    let ticks = body.u32("time scale")?;
    if ticks == 0 {
        return Err(Malformed::new(position, "a time scale of at least 1 tick per second", "0"));
    }
    Ok(ticks)
}

fn track_header(atom: Atom<'_>) -> Result<(u32, Rotation), Malformed> {
    const ONE: i32 = 0x1_0000;
    let mut body = atom.body;
    let version = body.u32("track header version")? >> 24;
    body.take(if version == 1 { 16 } else { 8 }, "creation times")?;
    let id = body.u32("track id")?;
    body.take(if version == 1 { 12 } else { 8 }, "duration")?;
    body.take(16, "layer and volume")?;
    let position = body.position();
    let mut matrix = [0_i32; 6];
    for value in &mut matrix {
        *value = body.i32("display matrix")?;
    }
    // Row-vector convention: x' = a x + c y, y' = b x + d y, stored as a, b, u, c, d, v.
    let [a, b, _, c, d, _] = matrix;
    let rotation = match (a, b, c, d) {
        (ONE, 0, 0, ONE) => Rotation::None,
        (0, ONE, c, 0) if c == -ONE => Rotation::Quarter,
        (a, 0, 0, d) if a == -ONE && d == -ONE => Rotation::Half,
        (0, b, ONE, 0) if b == -ONE => Rotation::ThreeQuarters,
        _ => {
            return Err(Malformed::new(
                position,
                "a display matrix that turns by 0, 90, 180 or 270 degrees",
                format!("[{a} {b}; {c} {d}] / 65536"),
            ));
        }
    };
    Ok((id, rotation))
}

struct Description {
    codec: Codec,
    width: u16,
    height: u16,
    colour: Option<Nclx>,
}

fn sample_description(atom: Atom<'_>) -> Result<Description, Malformed> {
    let mut body = atom.body;
    body.take(4, "sample description version")?;
    let position = body.position();
    let count = body.u32("sample description count")?;
    if count != 1 {
        return Err(Malformed::new(position, "one sample description", count.to_string()));
    }
    let entries = children(body)?;
    let Some(entry) = entries.first() else {
        return Err(Malformed::new(position, "a sample entry", "none"));
    };
    let mut visual = entry.body;
    visual.take(24, "sample entry header")?;
    let width = visual.u16("picture width")?;
    let height = visual.u16("picture height")?;
    visual.take(50, "sample entry fields")?;
    let parts = children(visual)?;
    let mut colour = None;
    if let Some(atom) = find(&parts, *b"colr") {
        let mut body = atom.body;
        if &body.fourcc("colour type")? == b"nclx" {
            body.take(4, "colour primaries and transfer")?;
            let matrix = body.u16("colour matrix")?;
            colour = Some(Nclx { matrix, full_range: body.u8("colour range")? & 0x80 != 0 });
        }
    }
    let codec = if matches!(&entry.kind, b"avc1" | b"avc3") {
        Codec::Avc(avc_config(require(&parts, *b"avcC", *entry)?)?)
    } else {
        Codec::Other(entry.kind)
    };
    Ok(Description { codec, width, height, colour })
}

fn avc_config(atom: Atom<'_>) -> Result<AvcConfig, Malformed> {
    let mut body = atom.body;
    body.take(4, "AVC profile and level")?;
    let position = body.position();
    let length_bytes = usize::from(body.u8("NAL length size")? & 3) + 1;
    if length_bytes == 3 {
        return Err(Malformed::new(position, "a NAL length size of 1, 2 or 4 bytes", "3"));
    }
    let read_sets = |body: &mut Bytes<'_>, count: u8| -> Result<Vec<Vec<u8>>, Malformed> {
        (0..count)
            .map(|_| {
                let size = body.u16("parameter set size")?;
                Ok(body.take(usize::from(size), "parameter set")?.to_vec())
            })
            .collect()
    };
    let count = body.u8("sequence set count")? & 0x1f;
    let sequence_sets = read_sets(&mut body, count)?;
    let count = body.u8("picture set count")?;
    let picture_sets = read_sets(&mut body, count)?;
    Ok(AvcConfig { length_bytes, sequence_sets, picture_sets })
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
