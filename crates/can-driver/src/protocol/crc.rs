//! The frames' checksum.
//!
//! CRC-16 with the polynomial x^16 + x^13 + x^12 + x^11 + x^10 + x^8 + x^6 + x^5 + x^2 + 1 (0x3D65, the one of DNP3 and
//! IEC 60870-5 class FT3), initial value 0xFFFF, most significant bit first, nothing inverted at
//! the end. With the 64 bits of a frame any two valid payloads of one data id differ in at least
//! 6 bits, so that every pattern of 1 to 5 flipped bits is refused; a test tries all 8,303,632.

const POLYNOMIAL: u16 = 0x3D65;

const TABLE: [u16; 256] = {
    let mut table = [0_u16; 256];
    let mut i = 0;
    while i < 256 {
        let mut rest = (i as u16) << 8;
        let mut bit = 0;
        while bit < 8 {
            rest = if rest & 0x8000 == 0 { rest << 1 } else { (rest << 1) ^ POLYNOMIAL };
            bit += 1;
        }
        table[i] = rest;
        i += 1;
    }
    table
};

/// Checksum over a data id (sent by nobody, known to both sides) and the bytes.
///
/// ```
/// // The usual check input "123456789", its first two characters being the data id.
/// assert_eq!(can_driver::crc16(0x3132, b"3456789"), 0xBBB6);
/// ```
pub const fn crc16(data_id: u16, bytes: &[u8]) -> u16 {
    let [high, low] = data_id.to_be_bytes();
    let mut crc = step(step(0xFFFF, high), low);
    let mut i = 0;
    while i < bytes.len() {
        crc = step(crc, bytes[i]);
        i += 1;
    }
    crc
}

const fn step(crc: u16, byte: u8) -> u16 {
    (crc << 8) ^ TABLE[((crc >> 8) as u8 ^ byte) as usize]
}

/// CRC-32 (ISO 3309, as in zlib) of the stored limits, for the seal.
pub(crate) fn crc32(bytes: impl IntoIterator<Item = u8>) -> u32 {
    !bytes.into_iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Long division of polynomials over GF(2), bit by bit, as in a textbook.
    fn by_division(message: &[u8]) -> u16 {
        let mut bits: Vec<bool> = message.iter().flat_map(|b| (0..8).rev().map(move |i| b >> i & 1 == 1)).collect();
        bits.iter_mut().take(16).for_each(|b| *b = !*b); // initial value 0xFFFF
        bits.extend([false; 16]);
        let divisor: Vec<bool> = (0..17).rev().map(|i| 0x1_3D65_u32 >> i & 1 == 1).collect();
        for at in 0..message.len() * 8 {
            if bits[at] {
                bits[at..].iter_mut().zip(&divisor).for_each(|(b, d)| *b ^= d);
            }
        }
        bits[message.len() * 8..].iter().fold(0, |n, b| n << 1 | u16::from(*b))
    }

    #[test]
    fn equals_long_division() {
        for message in [&b"123456789"[..], &[0, 0], &[0xFF; 8], &[1, 2, 3, 4, 5, 6, 7, 8]] {
            let data_id = u16::from_be_bytes([message[0], message[1]]);
            assert_eq!(crc16(data_id, &message[2..]), by_division(message));
        }
    }

    #[test]
    fn crc32_has_the_published_check_value() {
        assert_eq!(crc32(*b"123456789"), 0xCBF4_3926);
    }
}
