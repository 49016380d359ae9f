//! How long a frame occupies the bus.

use crate::Frame;

/// Which stuff bits to count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stuffing {
    /// Those that the frame's bits need.
    #[default]
    Exact,
    /// As many as any frame of this length can need.
    Worst,
    /// None.
    None,
}

/// Bits that are never stuffed: CRC delimiter, acknowledge slot and delimiter, end of frame,
/// intermission.
const TAIL_BITS: u32 = 1 + 2 + 7 + 3;
/// Start of frame to the length code, and the CRC.
const HEAD_BITS: u32 = 1 + 11 + 1 + 1 + 1 + 4 + 15;
const CRC15_POLYNOMIAL: u16 = 0x4599;

/// Bits of a frame with an 11-bit identifier, from start of frame to the end of the intermission.
///
/// ```
/// use can_driver::{Frame, Id, Stuffing, frame_bits};
/// let frame = Frame::full(Id::new(0x123).unwrap(), [0x55; 8]);
/// assert_eq!(frame_bits(&frame, Stuffing::None), 111);
/// assert_eq!(frame_bits(&frame, Stuffing::Worst), 135);
/// ```
pub fn frame_bits(frame: &Frame, stuffing: Stuffing) -> u32 {
    let plain = HEAD_BITS + 8 * frame.data().len() as u32;
    let stuffed = match stuffing {
        Stuffing::None => 0,
        // A run of five, then every stuff bit begins the next run.
        Stuffing::Worst => (plain - 1) / 4,
        Stuffing::Exact => stuff_bits(frame),
    };
    plain + stuffed + TAIL_BITS
}

fn stuff_bits(frame: &Frame) -> u32 {
    let mut counter = Counter { crc: 0, last: true, run: 0, stuffed: 0 };
    counter.push(0, 1); // start of frame
    counter.push(u32::from(frame.id().raw()), 11);
    counter.push(0, 3); // data frame, 11-bit identifier, reserved
    counter.push(frame.data().len() as u32, 4);
    for byte in frame.data() {
        counter.push(u32::from(*byte), 8);
    }
    let crc = counter.crc;
    counter.push(u32::from(crc), 15);
    counter.stuffed
}

struct Counter {
    crc: u16,
    last: bool,
    run: u32,
    stuffed: u32,
}

impl Counter {
    fn push(&mut self, value: u32, bits: u32) {
        for i in (0..bits).rev() {
            let bit = value >> i & 1 == 1;
            let feedback = bit != (self.crc & 0x4000 != 0);
            self.crc = (self.crc << 1 & 0x7FFF) ^ if feedback { CRC15_POLYNOMIAL } else { 0 };
            self.run = if bit == self.last { self.run + 1 } else { 1 };
            self.last = bit;
            if self.run == 5 {
                self.stuffed += 1;
                self.last = !bit;
                self.run = 1;
            }
        }
    }
}
