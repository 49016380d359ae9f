//! Log lines as candump (can-utils) writes them: `(1436509052.249713) can0 123#DEADBEEF`.

use std::fmt::Write as _;
use std::time::Duration;

use crate::{Error, Frame, Id};

/// One line of a log.
///
/// ```
/// use can_driver::CandumpLine;
/// let line = CandumpLine::parse("(1436509052.249713) can0 123#DEADBEEF", 1)?.unwrap();
/// assert_eq!((line.frame.id().raw(), line.frame.data()), (0x123, &[0xDE, 0xAD, 0xBE, 0xEF][..]));
/// assert_eq!(line.to_string(), "(1436509052.249713) can0 123#DEADBEEF");
/// # Ok::<(), can_driver::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CandumpLine {
    /// Time in the log, to the microsecond.
    pub time: Duration,
    /// Interface.
    pub interface: String,
    /// The frame.
    pub frame: Frame,
}

impl CandumpLine {
    /// Reads one line. `Ok(None)` for empty lines and for what this crate does not send: 29-bit
    /// identifiers, remote, error and FD frames.
    ///
    /// # Errors
    /// [`Error::Candump`] with `number`.
    pub fn parse(text: &str, number: usize) -> Result<Option<Self>, Error> {
        let fail = |reason| Error::Candump { line: number, reason, text: text.chars().take(80).collect() };
        let mut words = text.split_ascii_whitespace();
        let Some(time) = words.next() else { return Ok(None) };
        let time = time.strip_prefix('(').and_then(|t| t.strip_suffix(')')).ok_or_else(|| fail("no time stamp"))?;
        let (seconds, fraction) = time.split_once('.').ok_or_else(|| fail("time stamp without a fraction"))?;
        let digits = |t: &str| !t.is_empty() && t.bytes().all(|b| b.is_ascii_digit());
        if !digits(seconds) || !digits(fraction) || fraction.len() != 6 {
            return Err(fail("time stamp is not seconds and microseconds"));
        }
        let seconds: u64 = seconds.parse().map_err(|_| fail("time stamp too big"))?;
        let micros: u32 = fraction.parse().map_err(|_| fail("time stamp is not a number"))?;
        let interface = words.next().ok_or_else(|| fail("no interface"))?.to_owned();
        let (id, data) = words.next().and_then(|w| w.split_once('#')).ok_or_else(|| fail("no frame"))?;
        if id.len() == 8 || data.starts_with('#') || data.starts_with('R') {
            return Ok(None);
        }
        let id = u16::from_str_radix(id, 16).ok().filter(|_| id.len() == 3).and_then(Id::new);
        let id = id.ok_or_else(|| fail("identifier is not three hexadecimal digits up to 7FF"))?;
        if !data.is_ascii() || data.len() % 2 != 0 || data.len() > 16 {
            return Err(fail("payload is not 0 to 8 bytes"));
        }
        let mut bytes = [0; 8];
        let mut len = 0;
        for (place, pair) in bytes.iter_mut().zip(data.as_bytes().chunks_exact(2)) {
            let digit = |b: u8| (b as char).to_digit(16).ok_or_else(|| fail("payload is not hexadecimal"));
            *place = (digit(pair[0])? << 4 | digit(pair[1])?) as u8;
            len += 1;
        }
        let time = Duration::new(seconds, micros * 1000);
        Ok(Some(Self { time, interface, frame: Frame::new(id, &bytes[..len])? }))
    }
}

impl std::fmt::Display for CandumpLine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "({}.{:06}) {} {}", self.time.as_secs(), self.time.subsec_micros(), self.interface, self.frame)
    }
}

/// Appends the line of a frame, for writers that reuse their buffer.
pub fn write_candump(out: &mut String, time: Duration, interface: &str, frame: &Frame) {
    // Writing to a String cannot fail.
    let _ = writeln!(out, "({}.{:06}) {interface} {frame}", time.as_secs(), time.subsec_micros());
}
