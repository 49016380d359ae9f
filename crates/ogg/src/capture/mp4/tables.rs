//! The sample tables of `stbl`: sizes, chunks, decoding and composition times.

use super::atoms::{Atom, find, require};
use super::{Malformed, Sample, check_sample};

/// Expands the run-length coded tables into one [`Sample`] per picture, and gives the decoding time after the
/// last one. A fragmented file has empty tables here.
pub(super) fn expand(table: Atom<'_>, parts: &[Atom<'_>], length: u64) -> Result<(Vec<Sample>, i64), Malformed> {
    let sizes = Sizes::read(find(parts, *b"stsz"), find(parts, *b"stz2"), table)?;
    let mut samples: Vec<Sample> = Vec::new();
    if sizes.count == 0 {
        return Ok((samples, 0));
    }
    let (chunks, chunk_position) = chunk_offsets(parts, table)?;
    let runs = chunk_runs(require(parts, *b"stsc", table)?)?;
    let mut run = 0;
    'chunks: for (number, &chunk) in (1_u64..).zip(&chunks) {
        while runs.get(run + 1).is_some_and(|next| u64::from(next.first_chunk) <= number) {
            run += 1;
        }
        let mut offset = chunk;
        for _ in 0..runs.get(run).map_or(0, |run| run.samples) {
            let index = samples.len();
            if index == sizes.count {
                break 'chunks;
            }
            let sample = Sample { offset, size: sizes.get(index), time: 0 };
            check_sample(sample, index, length, chunk_position)?;
            offset += u64::from(sample.size);
            samples.push(sample);
        }
    }
    if samples.len() != sizes.count {
        return Err(Malformed::new(
            chunk_position,
            format!("chunks for {} samples", sizes.count),
            format!("chunks for {}", samples.len()),
        ));
    }
    let decode_end = apply_times(&mut samples, require(parts, *b"stts", table)?, find(parts, *b"ctts"))?;
    Ok((samples, decode_end))
}

struct Sizes {
    count: usize,
    fixed: u32,
    each: Vec<u32>,
}

impl Sizes {
    fn read(stsz: Option<Atom<'_>>, stz2: Option<Atom<'_>>, table: Atom<'_>) -> Result<Self, Malformed> {
        if let Some(atom) = stsz {
            let mut body = atom.body;
            body.take(4, "sample size version")?;
            let fixed = body.u32("sample size")?;
            if fixed != 0 {
                let count = body.u32("sample count")? as usize;
                return Ok(Self { count, fixed, each: Vec::new() });
            }
            let count = body.count(4, "sample sizes")?;
            let each = (0..count).map(|_| body.u32("sample size")).collect::<Result<_, _>>()?;
            return Ok(Self { count, fixed, each });
        }
        let Some(atom) = stz2 else {
            return Err(Malformed::new(table.position, "an 'stsz' or 'stz2' box in 'stbl'", "neither"));
        };
        let mut body = atom.body;
        body.take(4, "sample size version")?;
        let position = body.position();
        let bits = body.u32("sample size width")? & 0xff;
        let each: Vec<u32> = match bits {
            8 => {
                let count = body.count(1, "sample sizes")?;
                (0..count).map(|_| body.u8("sample size").map(u32::from)).collect::<Result<_, _>>()?
            }
            16 => {
                let count = body.count(2, "sample sizes")?;
                (0..count).map(|_| body.u16("sample size").map(u32::from)).collect::<Result<_, _>>()?
            }
            _ => return Err(Malformed::new(position, "a sample size width of 8 or 16 bits", bits.to_string())),
        };
        Ok(Self { count: each.len(), fixed: 0, each })
    }

    fn get(&self, index: usize) -> u32 {
        self.each.get(index).copied().unwrap_or(self.fixed)
    }
}

fn chunk_offsets(parts: &[Atom<'_>], table: Atom<'_>) -> Result<(Vec<u64>, u64), Malformed> {
    if let Some(atom) = find(parts, *b"stco") {
        let mut body = atom.body;
        body.take(4, "chunk offset version")?;
        let count = body.count(4, "chunk offsets")?;
        let offsets = (0..count).map(|_| body.u32("chunk offset").map(u64::from)).collect::<Result<_, _>>()?;
        return Ok((offsets, atom.position));
    }
    if let Some(atom) = find(parts, *b"co64") {
        let mut body = atom.body;
        body.take(4, "chunk offset version")?;
        let count = body.count(8, "chunk offsets")?;
        let offsets = (0..count).map(|_| body.u64("chunk offset")).collect::<Result<_, _>>()?;
        return Ok((offsets, atom.position));
    }
    Err(Malformed::new(table.position, "an 'stco' or 'co64' box in 'stbl'", "neither"))
}

struct ChunkRun {
    first_chunk: u32,
    samples: u32,
}

fn chunk_runs(atom: Atom<'_>) -> Result<Vec<ChunkRun>, Malformed> {
    let mut body = atom.body;
    body.take(4, "sample-to-chunk version")?;
    let count = body.count(12, "sample-to-chunk runs")?;
    let mut runs: Vec<ChunkRun> = Vec::with_capacity(count);
    for _ in 0..count {
        let position = body.position();
        let run = ChunkRun { first_chunk: body.u32("first chunk")?, samples: body.u32("samples per chunk")? };
        let description = body.u32("sample description index")?;
        let smallest = runs.last().map_or(1, |run| run.first_chunk.saturating_add(1));
        let starts_well = if runs.is_empty() { run.first_chunk == 1 } else { run.first_chunk >= smallest };
        if !starts_well {
            return Err(Malformed::new(
                position,
                format!("a first chunk of {}{smallest}", if runs.is_empty() { "" } else { "at least " }),
                run.first_chunk.to_string(),
            ));
        }
        if description != 1 {
            return Err(Malformed::new(position, "sample description 1", description.to_string()));
        }
        runs.push(run);
    }
    Ok(runs)
}

fn apply_times(samples: &mut [Sample], stts: Atom<'_>, ctts: Option<Atom<'_>>) -> Result<i64, Malformed> {
    let mut body = stts.body;
    body.take(4, "decoding time version")?;
    let runs = body.count(8, "decoding time runs")?;
    let mut next = samples.iter_mut();
    let mut left = next.len();
    let mut time = 0_i64;
    for _ in 0..runs {
        let count = body.u32("run length")? as usize;
        let delta = i64::from(body.u32("sample duration")?);
        for sample in next.by_ref().take(count) {
            sample.time = time;
            time = time.saturating_add(delta);
            left -= 1;
        }
    }
    if left > 0 {
        return Err(Malformed::new(
            stts.position,
            format!("decoding times for {} samples", samples.len()),
            format!("times for {}", samples.len() - left),
        ));
    }
    let Some(ctts) = ctts else { return Ok(time) };
    let mut body = ctts.body;
    body.take(4, "composition offset version")?;
    let runs = body.count(8, "composition offset runs")?;
    let mut next = samples.iter_mut();
    let mut left = next.len();
    for _ in 0..runs {
        let count = body.u32("run length")? as usize;
        // Version 0 calls the field unsigned, yet writers store negative offsets there too.
        let offset = i64::from(body.i32("composition offset")?);
        for sample in next.by_ref().take(count) {
            sample.time = sample.time.saturating_add(offset);
            left -= 1;
        }
    }
    if left > 0 {
        return Err(Malformed::new(
            ctts.position,
            format!("composition offsets for {} samples", samples.len()),
            format!("offsets for {}", samples.len() - left),
        ));
    }
    Ok(time)
}
