//! Where each signal lies, from the DBC file.

/// Identifier of a message; its length is 8, but for the heartbeat's 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Message {
    pub(crate) id: u16,
}

/// Place and scale of a signal, as in [`crate::DbcSignal`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Signal {
    pub(crate) start: u8,
    pub(crate) length: u8,
    pub(crate) big_endian: bool,
    pub(crate) signed: bool,
    pub(crate) factor: f64,
    pub(crate) offset: f64,
}

mod generated {
    #![allow(
        dead_code,
        clippy::unreadable_literal,
        reason = "made from the DBC file, which names more than the codec reads"
    )]
    use super::{Message, Signal};

    include!(concat!(env!("OUT_DIR"), "/tables.rs"));
}
pub(crate) use generated::*;

impl Signal {
    const fn mask(self) -> u64 {
        u64::MAX >> (64 - self.length)
    }

    /// Distance of the least significant bit from that of the payload read in the signal's order.
    const fn shift(self) -> u32 {
        if self.big_endian {
            // `start` is the most significant bit, and byte 7 lies lowest.
            (7 - self.start as u32 / 8) * 8 + self.start as u32 % 8 + 1 - self.length as u32
        } else {
            self.start as u32
        }
    }

    const fn load(self, bytes: [u8; 8]) -> u64 {
        if self.big_endian { u64::from_be_bytes(bytes) } else { u64::from_le_bytes(bytes) }
    }

    /// The raw value.
    pub(crate) const fn get(self, bytes: [u8; 8]) -> i64 {
        let raw = (self.load(bytes) >> self.shift()) & self.mask();
        if self.signed {
            let unused = 64 - self.length as u32;
            (raw << unused).cast_signed() >> unused
        } else {
            raw.cast_signed()
        }
    }

    /// Writes a raw value; bits above the signal's length are cut off.
    pub(crate) const fn put(self, bytes: &mut [u8; 8], raw: i64) {
        let rest = self.load(*bytes) & !(self.mask() << self.shift());
        let word = rest | (raw.cast_unsigned() & self.mask()) << self.shift();
        *bytes = if self.big_endian { word.to_be_bytes() } else { word.to_le_bytes() };
    }

    /// The physical value.
    pub(crate) fn physical(self, bytes: [u8; 8]) -> f64 {
        self.get(bytes) as f64 * self.factor + self.offset
    }

    /// Writes the nearest raw value, saturating at the signal's ends. NaN is written as the
    /// lowest; callers pass finite numbers.
    pub(crate) fn put_physical(self, bytes: &mut [u8; 8], value: f64) {
        let steps = ((value - self.offset) / self.factor).round();
        let (low, high) = if self.signed {
            (-(1_i64 << (self.length - 1)), (1_i64 << (self.length - 1)) - 1)
        } else {
            (0, self.mask().cast_signed())
        };
        self.put(bytes, (steps as i64).clamp(low, high));
    }
}
