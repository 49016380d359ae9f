//! The part of an H.264 sequence parameter set that decides how its pictures turn into RGB.
//!
//! Reads ITU-T H.264 (08/2021) 7.3.2.1.1 and annex E up to `matrix_coefficients`: chroma format, bit depth, frame or field
//! coding, colour range and matrix. Everything else is the decoder's business.

/// Facts of a sequence parameter set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SequenceFacts {
    /// 0 grey, 1 4:2:0, 2 4:2:2, 3 4:4:4.
    pub(super) chroma_format: u32,
    pub(super) bit_depth_luma: u32,
    pub(super) bit_depth_chroma: u32,
    /// False for interlaced coding.
    pub(super) frames_only: bool,
    /// `video_full_range_flag`, where the stream states it.
    pub(super) full_range: Option<bool>,
    /// `matrix_coefficients` (ISO/IEC 23091-2), where the stream states it.
    pub(super) matrix: Option<u8>,
}

/// Reads a sequence parameter set NAL unit (with its header byte); `None` if it is cut short or not one.
pub(super) fn parse(nal: &[u8]) -> Option<SequenceFacts> {
    let (&header, payload) = nal.split_first()?;
    if header & 0x1f != 7 {
        return None;
    }
    let payload = without_emulation_prevention(payload);
    let mut bits = Bits { bytes: &payload, next: 0 };
    let profile = bits.take(8)?;
    bits.take(16)?;
    bits.unsigned()?;
    let mut facts = SequenceFacts {
        chroma_format: 1,
        bit_depth_luma: 8,
        bit_depth_chroma: 8,
        frames_only: true,
        full_range: None,
        matrix: None,
    };
    if matches!(profile, 100 | 110 | 122 | 244 | 44 | 83 | 86 | 118 | 128 | 138 | 139 | 134 | 135) {
        facts.chroma_format = bits.unsigned()?;
        if facts.chroma_format == 3 {
            bits.take(1)?;
        }
        facts.bit_depth_luma = bits.unsigned()?.checked_add(8)?;
        facts.bit_depth_chroma = bits.unsigned()?.checked_add(8)?;
        bits.take(1)?;
        if bits.flag()? {
            let lists = if facts.chroma_format == 3 { 12 } else { 8 };
            for list in 0..lists {
                if bits.flag()? {
                    skip_scaling_list(&mut bits, if list < 6 { 16 } else { 64 })?;
                }
            }
        }
    }
    bits.unsigned()?;
    match bits.unsigned()? {
        0 => {
            bits.unsigned()?;
        }
        1 => {
            bits.take(1)?;
            bits.signed()?;
            bits.signed()?;
            let cycle = bits.unsigned()?;
            if cycle > 255 {
                return None;
            }
            for _ in 0..cycle {
                bits.signed()?;
            }
        }
        _ => {}
    }
    bits.unsigned()?;
    bits.take(1)?;
    bits.unsigned()?;
    bits.unsigned()?;
    facts.frames_only = bits.flag()?;
    if !facts.frames_only {
        bits.take(1)?;
    }
    bits.take(1)?;
    if bits.flag()? {
        for _ in 0..4 {
            bits.unsigned()?;
        }
    }
    if bits.flag()? {
        read_video_usability(&mut bits, &mut facts)?;
    }
    Some(facts)
}

fn read_video_usability(bits: &mut Bits<'_>, facts: &mut SequenceFacts) -> Option<()> {
    const EXTENDED_ASPECT: u32 = 255;
    if bits.flag()? && bits.take(8)? == EXTENDED_ASPECT {
        bits.take(32)?;
    }
    if bits.flag()? {
        bits.take(1)?;
    }
    if bits.flag()? {
        bits.take(3)?;
        facts.full_range = Some(bits.flag()?);
        if bits.flag()? {
            bits.take(16)?;
            facts.matrix = u8::try_from(bits.take(8)?).ok();
        }
    }
    Some(())
}

fn skip_scaling_list(bits: &mut Bits<'_>, size: usize) -> Option<()> {
    let (mut last, mut next) = (8_i32, 8_i32);
    for _ in 0..size {
        if next != 0 {
            next = (last.wrapping_add(bits.signed()?)).rem_euclid(256);
        }
        if next != 0 {
            last = next;
        }
    }
    Some(())
}

/// Removes the 0x03 bytes that keep start codes out of the payload (7.4.1).
fn without_emulation_prevention(payload: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(payload.len());
    let mut zeros = 0;
    for &byte in payload {
        if zeros >= 2 && byte == 3 {
            zeros = 0;
            continue;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        out.push(byte);
    }
    out
}

struct Bits<'a> {
    bytes: &'a [u8],
    next: usize,
}

impl Bits<'_> {
    fn flag(&mut self) -> Option<bool> {
        let byte = self.bytes.get(self.next / 8)?;
        let bit = byte >> (7 - self.next % 8) & 1;
        self.next += 1;
        Some(bit == 1)
    }

    fn take(&mut self, count: u32) -> Option<u32> {
        (0..count).try_fold(0_u32, |value, _| Some(value << 1 | u32::from(self.flag()?)))
    }

    /// Exp-Golomb code (9.1).
    fn unsigned(&mut self) -> Option<u32> {
        let mut zeros = 0;
        while !self.flag()? {
            zeros += 1;
            if zeros > 31 {
                return None;
            }
        }
        Some((1_u32 << zeros) - 1 + self.take(zeros)?)
    }

    fn signed(&mut self) -> Option<i32> {
        let code = self.unsigned()?;
        let magnitude = i32::try_from(code.div_ceil(2)).ok()?;
        Some(if code % 2 == 1 { magnitude } else { -magnitude })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Writes a sequence parameter set bit by bit, following the tables of the recommendation.
    struct Writer(Vec<bool>);

    impl Writer {
        fn bits(&mut self, value: u32, count: u32) -> &mut Self {
            self.0.extend((0..count).rev().map(|bit| value >> bit & 1 == 1));
            self
        }

        fn golomb(&mut self, value: u32) -> &mut Self {
            let code = value + 1;
            let length = 32 - code.leading_zeros();
            self.bits(0, length - 1).bits(code, length)
        }

        fn nal(&self) -> Vec<u8> {
            let mut out = vec![0x67];
            let mut zeros = 0;
            for chunk in self.0.chunks(8) {
                let byte = chunk.iter().enumerate().fold(0_u8, |byte, (i, &bit)| byte | u8::from(bit) << (7 - i));
                if zeros >= 2 && byte <= 3 {
                    out.push(3);
                    zeros = 0;
                }
                zeros = if byte == 0 { zeros + 1 } else { 0 };
                out.push(byte);
            }
            out
        }
    }

    fn high_profile(chroma: u32, depth: u32, frames_only: bool, colour: Option<(bool, u32)>) -> Vec<u8> {
        let mut w = Writer(Vec::new());
        w.bits(100, 8).bits(0, 16).golomb(0);
        w.golomb(chroma).golomb(depth - 8).golomb(depth - 8).bits(0, 1).bits(0, 1);
        w.golomb(0).golomb(0).golomb(2).golomb(4).bits(0, 1).golomb(19).golomb(14);
        w.bits(u32::from(frames_only), 1);
        if !frames_only {
            w.bits(0, 1);
        }
        w.bits(1, 1).bits(0, 1);
        if let Some((full, matrix)) = colour {
            w.bits(1, 1).bits(0, 1).bits(0, 1).bits(1, 1).bits(5, 3).bits(u32::from(full), 1);
            w.bits(1, 1).bits(1, 8).bits(1, 8).bits(matrix, 8);
        } else {
            w.bits(0, 1);
        }
        w.bits(1, 1);
        w.nal()
    }

    #[test]
    fn colour_range_and_matrix_are_read_from_the_usability_information() {
        let facts = parse(&high_profile(1, 8, true, Some((false, 6)))).unwrap();
        assert_eq!((facts.full_range, facts.matrix), (Some(false), Some(6)));
        let facts = parse(&high_profile(1, 8, true, Some((true, 1)))).unwrap();
        assert_eq!((facts.full_range, facts.matrix), (Some(true), Some(1)));
    }

    #[test]
    fn a_stream_that_states_no_colour_says_so() {
        let facts = parse(&high_profile(1, 8, true, None)).unwrap();
        assert_eq!((facts.full_range, facts.matrix), (None, None));
    }

    #[test]
    fn chroma_format_depth_and_field_coding_are_read() {
        let facts = parse(&high_profile(2, 10, false, None)).unwrap();
        assert_eq!((facts.chroma_format, facts.bit_depth_luma, facts.frames_only), (2, 10, false));
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic(mut bytes in proptest::collection::vec(any::<u8>(), 0..80)) {
            let _ = parse(&bytes);
            bytes.insert(0, 0x67);
            let _ = parse(&bytes);
        }
    }
}
