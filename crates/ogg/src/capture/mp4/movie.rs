//! The movie box (`moov`): the first video track, its size, rotation, codec and tables.

use super::atoms::{Atom, children, find, require};
use super::{AvcConfig, Codec, ContainerError, Nclx, Rotation, VideoTrack, fragments, tables};
use crate::capture::bytes::{Bytes, Malformed, fourcc_text};

/// The track plus what fragments need to extend it.
pub(super) struct Parsed {
    pub(super) track: VideoTrack,
    pub(super) track_id: u32,
    pub(super) defaults: fragments::Defaults,
    /// Decoding time after the last sample, in ticks.
    pub(super) decode_end: i64,
}

pub(super) fn read_movie(body: Bytes<'_>, length: u64) -> Result<Parsed, ContainerError> {
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
