//! CAN FD frames.

use socketcan::CanFdFrame;

use crate::{Error, Id};

/// A CAN FD data frame with an 11-bit identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FdFrame {
    id: Id,
    len: u8,
    bytes: [u8; 64],
    bit_rate_switch: bool,
}

impl FdFrame {
    /// Takes 0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes: the lengths that the format has.
    ///
    /// # Errors
    /// [`Error::FrameTooLong`] above 64 bytes, [`Error::InvalidParameter`] for the lengths between.
    pub fn new(id: Id, data: &[u8], bit_rate_switch: bool) -> Result<Self, Error> {
        let mut bytes = [0; 64];
        bytes
            .get_mut(..data.len())
            .ok_or(Error::FrameTooLong { bytes: data.len(), limit_bytes: 64 })?
            .copy_from_slice(data);
        if !CanFdFrame::is_valid_data_len(data.len()) {
            return Err(Error::InvalidParameter {
                field: "fd payload".to_owned(),
                allowed: "0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes",
                value: data.len() as f64,
            });
        }
        Ok(Self { id, len: data.len() as u8, bytes, bit_rate_switch })
    }

    /// The identifier.
    pub const fn id(&self) -> Id {
        self.id
    }

    /// The payload.
    pub fn data(&self) -> &[u8] {
        &self.bytes[..usize::from(self.len)]
    }

    /// Whether the payload travels at the higher bit rate.
    pub const fn bit_rate_switch(&self) -> bool {
        self.bit_rate_switch
    }
}
