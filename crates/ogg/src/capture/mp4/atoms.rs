//! Boxes: headers, contents, and boxes in boxes.

use std::io::{Read, Seek, SeekFrom};

use super::ContainerError;
use crate::capture::bytes::{Bytes, Malformed, fourcc_text};

/// A box: its type, the offset of its header in the file, and its contents.
#[derive(Debug, Clone, Copy)]
pub(super) struct Atom<'a> {
    pub(super) kind: [u8; 4],
    pub(super) position: u64,
    pub(super) body: Bytes<'a>,
}

/// Splits the contents of a container box into its children.
pub(super) fn children(mut body: Bytes<'_>) -> Result<Vec<Atom<'_>>, Malformed> {
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

pub(super) fn find<'a>(atoms: &[Atom<'a>], kind: [u8; 4]) -> Option<Atom<'a>> {
    atoms.iter().find(|atom| atom.kind == kind).copied()
}

pub(super) fn require<'a>(atoms: &[Atom<'a>], kind: [u8; 4], parent: Atom<'_>) -> Result<Atom<'a>, Malformed> {
    find(atoms, kind).ok_or_else(|| {
        Malformed::new(
            parent.position,
            format!("a '{}' box in '{}'", fourcc_text(kind), fourcc_text(parent.kind)),
            "none",
        )
    })
}

pub(super) struct TopLevelHeader {
    pub(super) kind: [u8; 4],
    pub(super) body_start: u64,
    pub(super) body_bytes: u64,
}

pub(super) fn top_level_header<R: Read + Seek>(
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
