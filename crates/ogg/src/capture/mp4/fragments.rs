//! Movie fragments (`moof`): track runs that extend the sample list.

use super::atoms::{Atom, children, find, require};
use super::movie::Parsed;
use super::{Bytes, Malformed, Sample, check_sample};

const BASE_OFFSET: u32 = 0x1;
const DESCRIPTION: u32 = 0x2;
const DEFAULT_DURATION: u32 = 0x8;
const DEFAULT_SIZE: u32 = 0x10;
const RUN_OFFSET: u32 = 0x1;
const RUN_FIRST_FLAGS: u32 = 0x4;
const RUN_DURATION: u32 = 0x100;
const RUN_SIZE: u32 = 0x200;
const RUN_FLAGS: u32 = 0x400;
const RUN_COMPOSITION: u32 = 0x800;

/// Duration and size of a sample whose run does not say.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Defaults {
    duration: u32,
    size: u32,
}

impl Defaults {
    /// Looks for the track's `trex` box.
    pub(super) fn find(movie: &[Atom<'_>], track_id: u32) -> Result<Self, Malformed> {
        let Some(extends) = find(movie, *b"mvex") else { return Ok(Self::default()) };
        for atom in children(extends.body)?.iter().filter(|atom| &atom.kind == b"trex") {
            let mut body = atom.body;
            body.take(4, "track defaults version")?;
            if body.u32("track id")? == track_id {
                body.u32("default sample description")?;
                return Ok(Self {
                    duration: body.u32("default sample duration")?,
                    size: body.u32("default sample size")?,
                });
            }
        }
        Ok(Self::default())
    }
}

/// Adds the samples of one `moof` box to the track.
pub(super) fn append(parsed: &mut Parsed, body: Bytes<'_>, length: u64) -> Result<(), Malformed> {
    // Offsets count from the first byte of the box's header, which is eight bytes before its contents.
    let moof_start = body.position().saturating_sub(8);
    for traf in children(body)?.iter().filter(|atom| &atom.kind == b"traf") {
        let parts = children(traf.body)?;
        let header = require(&parts, *b"tfhd", *traf)?;
        let mut fields = header.body;
        let flags = fields.u32("fragment header flags")? & 0x00ff_ffff;
        if fields.u32("track id")? != parsed.track_id {
            continue;
        }
        let base = if flags & BASE_OFFSET != 0 { fields.u64("base data offset")? } else { moof_start };
        if flags & DESCRIPTION != 0 {
            fields.u32("sample description index")?;
        }
        let mut defaults = parsed.defaults;
        if flags & DEFAULT_DURATION != 0 {
            defaults.duration = fields.u32("default sample duration")?;
        }
        if flags & DEFAULT_SIZE != 0 {
            defaults.size = fields.u32("default sample size")?;
        }
        if let Some(atom) = find(&parts, *b"tfdt") {
            let mut fields = atom.body;
            let version = fields.u32("decode time version")? >> 24;
            let position = fields.position();
            let time =
                if version == 1 { fields.u64("base decode time")? } else { u64::from(fields.u32("base decode time")?) };
            parsed.decode_end = i64::try_from(time)
                .map_err(|_| Malformed::new(position, "a decode time below 2^63", time.to_string()))?;
        }
        let mut next_offset = base;
        for run in parts.iter().filter(|atom| &atom.kind == b"trun") {
            next_offset = append_run(parsed, *run, defaults, base, next_offset, length)?;
        }
    }
    Ok(())
}

fn append_run(
    parsed: &mut Parsed,
    run: Atom<'_>,
    defaults: Defaults,
    base: u64,
    next_offset: u64,
    length: u64,
) -> Result<u64, Malformed> {
    let mut body = run.body;
    let flags = body.u32("run flags")? & 0x00ff_ffff;
    let position = body.position();
    let count = body.u32("run length")?;
    let mut offset = next_offset;
    if flags & RUN_OFFSET != 0 {
        let relative = i64::from(body.i32("run data offset")?);
        offset = base
            .checked_add_signed(relative)
            .ok_or_else(|| Malformed::new(position, "a run data offset inside the file", relative.to_string()))?;
    }
    if flags & RUN_FIRST_FLAGS != 0 {
        body.u32("first sample flags")?;
    }
    let fields = [RUN_DURATION, RUN_SIZE, RUN_FLAGS, RUN_COMPOSITION];
    let entry_bytes = 4 * fields.iter().filter(|&&field| flags & field != 0).count();
    if entry_bytes == 0 && defaults.size == 0 {
        return Err(Malformed::new(position, "a sample size in the run or its defaults", "none"));
    }
    if (count as usize).checked_mul(entry_bytes).is_none_or(|bytes| bytes > body.len()) {
        return Err(Malformed::new(
            position,
            format!("a run of at most {} entries", body.len() / entry_bytes.max(1)),
            count.to_string(),
        ));
    }
    for _ in 0..count {
        let duration = if flags & RUN_DURATION != 0 { body.u32("sample duration")? } else { defaults.duration };
        let size = if flags & RUN_SIZE != 0 { body.u32("sample size")? } else { defaults.size };
        if flags & RUN_FLAGS != 0 {
            body.u32("sample flags")?;
        }
        let composition = if flags & RUN_COMPOSITION != 0 { body.i32("composition offset")? } else { 0 };
        let sample = Sample { offset, size, time: parsed.decode_end.saturating_add(i64::from(composition)) };
        check_sample(sample, parsed.track.samples.len(), length, run.position)?;
        parsed.track.samples.push(sample);
        offset += u64::from(size);
        parsed.decode_end = parsed.decode_end.saturating_add(i64::from(duration));
    }
    Ok(offset)
}
