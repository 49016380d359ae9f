//! Reads the part of the DBC format that describes messages: `BO_`, `SG_` and `VAL_`.
//!
//! The build script reads the protocol's own DBC file with this module to make the codec's
//! tables, and the tools read any DBC file with it. Multiplexed signals and extended identifiers
//! are refused by name: nothing here decodes them wrongly.
//!
//! Format: the "DBC File Format Documentation" of Vector Informatik, as far as public tools
//! (cantools, can-utils) agree on it. Bit numbers count from bit 0 of byte 0 upward; a
//! little-endian signal is given by its least significant bit, a big-endian one by its most
//! significant bit.

use std::fmt;

/// A DBC file that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DbcError {
    /// Line of the file, from 1.
    pub line: usize,
    /// What is wrong with it.
    pub reason: String,
}

impl fmt::Display for DbcError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "dbc line {}: {}", self.line, self.reason)
    }
}

impl std::error::Error for DbcError {}

/// One signal of a message.
#[derive(Clone, Debug, PartialEq)]
pub struct DbcSignal {
    /// Name of the signal.
    pub name: String,
    /// First bit (see the module's head).
    pub start: u8,
    /// Length, 1 to 64 bits.
    pub length: u8,
    /// Most significant bit first (`@0`).
    pub big_endian: bool,
    /// Two's complement (`-`).
    pub signed: bool,
    /// Physical value = raw value * `factor` + `offset`.
    pub factor: f64,
    /// See `factor`.
    pub offset: f64,
    /// Lowest physical value.
    pub min: f64,
    /// Highest physical value.
    pub max: f64,
    /// Unit of the physical value.
    pub unit: String,
    /// Names of single raw values.
    pub names: Vec<(i64, String)>,
}

/// One message.
#[derive(Clone, Debug, PartialEq)]
pub struct DbcMessage {
    /// 11-bit identifier.
    pub id: u16,
    /// Name of the message.
    pub name: String,
    /// Length in bytes.
    pub len: u8,
    /// Node that sends it.
    pub sender: String,
    /// Its signals in file order.
    pub signals: Vec<DbcSignal>,
}

/// The messages of one file.
#[derive(Clone, Debug, PartialEq)]
pub struct Dbc {
    /// In file order.
    pub messages: Vec<DbcMessage>,
}

impl Dbc {
    /// Reads a DBC file.
    ///
    /// # Errors
    /// [`DbcError`] with the line for anything malformed, multiplexed, extended, longer than
    /// 8 bytes, or outside its message.
    pub fn parse(text: &str) -> Result<Self, DbcError> {
        let mut messages: Vec<DbcMessage> = Vec::new();
        for (index, line) in text.lines().enumerate() {
            let fail = |reason: &str| DbcError { line: index + 1, reason: reason.to_owned() };
            let line = line.trim();
            if let Some(rest) = line.strip_prefix("BO_ ") {
                let message = message(rest).ok_or_else(|| fail("malformed message"))?;
                let message = message.map_err(fail)?;
                if messages.iter().any(|m| m.id == message.id || m.name == message.name) {
                    return Err(fail("message appears twice"));
                }
                messages.push(message);
            } else if let Some(rest) = line.strip_prefix("SG_ ") {
                let signal = signal(rest).ok_or_else(|| fail("malformed signal"))?;
                let owner = messages.last_mut().ok_or_else(|| fail("signal before any message"))?;
                if !signal.fits(owner.len) {
                    return Err(fail("signal reaches outside its message"));
                }
                if owner.signals.iter().any(|s| s.name == signal.name) {
                    return Err(fail("signal appears twice"));
                }
                owner.signals.push(signal);
            } else if let Some(rest) = line.strip_prefix("VAL_ ") {
                let (id, name, names) = names(rest).ok_or_else(|| fail("malformed value table"))?;
                messages
                    .iter_mut()
                    .filter(|m| u32::from(m.id) == id)
                    .flat_map(|m| m.signals.iter_mut())
                    .find(|s| s.name == name)
                    .ok_or_else(|| fail("value table of an unknown signal"))?
                    .names = names;
            }
        }
        Ok(Self { messages })
    }

    /// The message with this identifier.
    pub fn message(&self, id: u16) -> Option<&DbcMessage> {
        self.messages.iter().find(|m| m.id == id)
    }
}

impl DbcSignal {
    /// Place in the payload of the signal's bit `i`, counted from the least significant.
    fn place(&self, i: u8) -> Option<u8> {
        if self.big_endian {
            // From the most significant bit: down inside a byte, then on to bit 7 of the next.
            let from_top = self.length - 1 - i;
            let walked = (7 - self.start % 8) + from_top;
            (self.start / 8 * 8 + walked / 8 * 8).checked_add(7 - walked % 8)
        } else {
            self.start.checked_add(i)
        }
    }

    fn fits(&self, len: u8) -> bool {
        (1..=64).contains(&self.length)
            && self.start < 64
            && (0..self.length).all(|i| self.place(i).is_some_and(|bit| bit < len * 8))
    }

    /// The raw value in `payload`; bits beyond its end read as zero.
    pub fn raw(&self, payload: &[u8]) -> i64 {
        let mut value = 0_u64;
        for i in 0..self.length {
            let bit = self.place(i).map_or(0, |place| {
                let byte = payload.get(usize::from(place / 8)).copied().unwrap_or(0);
                u64::from(byte >> (place % 8) & 1)
            });
            value |= bit << i;
        }
        if self.signed && self.length < 64 && value >> (self.length - 1) & 1 == 1 {
            value |= u64::MAX << self.length;
        }
        value.cast_signed()
    }

    /// The physical value in `payload`.
    pub fn physical(&self, payload: &[u8]) -> f64 {
        self.raw(payload) as f64 * self.factor + self.offset
    }
}

/// `256 SET_12: 8 HOST`; the inner error is a refusal by name.
fn message(rest: &str) -> Option<Result<DbcMessage, &'static str>> {
    let mut words = rest.split_whitespace();
    let id: u32 = words.next()?.parse().ok()?;
    let name = words.next()?.strip_suffix(':')?.to_owned();
    let len: u8 = words.next()?.parse().ok()?;
    let sender = words.next()?.to_owned();
    if id > 0x7FF {
        return Some(Err("extended identifier"));
    }
    if len > 8 {
        return Some(Err("message longer than 8 bytes"));
    }
    Some(Ok(DbcMessage { id: id as u16, name, len, sender, signals: Vec::new() }))
}

/// `Joint1 : 0|20@1- (1.2e-05,0) [-6.3|6.3] "rad" CONTROLLER`
fn signal(rest: &str) -> Option<DbcSignal> {
    let (name, rest) = rest.split_once(':')?;
    let name = name.trim();
    if name.is_empty() || name.contains(char::is_whitespace) {
        return None; // a multiplexer indicator stands between name and colon
    }
    let (start, rest) = rest.trim_start().split_once('|')?;
    let (length, rest) = rest.split_once('@')?;
    let mut kind = rest.chars();
    let big_endian = match kind.next()? {
        '0' => true,
        '1' => false,
        _ => return None,
    };
    let signed = match kind.next()? {
        '-' => true,
        '+' => false,
        _ => return None,
    };
    let (factor, rest) = kind.as_str().trim_start().strip_prefix('(')?.split_once(',')?;
    let (offset, rest) = rest.split_once(')')?;
    let (min, rest) = rest.trim_start().strip_prefix('[')?.split_once('|')?;
    let (max, rest) = rest.split_once(']')?;
    let (unit, _) = rest.trim_start().strip_prefix('"')?.split_once('"')?;
    let number = |text: &str| text.trim().parse().ok().filter(|x: &f64| x.is_finite());
    Some(DbcSignal {
        name: name.to_owned(),
        start: start.trim().parse().ok()?,
        length: length.trim().parse().ok()?,
        big_endian,
        signed,
        factor: number(factor)?,
        offset: number(offset)?,
        min: number(min)?,
        max: number(max)?,
        unit: unit.to_owned(),
        names: Vec::new(),
    })
}

type Names = Vec<(i64, String)>;

/// `387 State 0 "Unconfigured" 1 "Ready" ;`
fn names(rest: &str) -> Option<(u32, String, Names)> {
    let (id, rest) = rest.split_once(' ')?;
    let (name, rest) = rest.trim_start().split_once(' ')?;
    let mut out = Vec::new();
    let mut rest = rest.trim().strip_suffix(';')?.trim();
    while !rest.is_empty() {
        let (value, tail) = rest.split_once('"')?;
        let (text, tail) = tail.split_once('"')?;
        out.push((value.trim().parse().ok()?, text.to_owned()));
        rest = tail.trim_start();
    }
    Some((id.parse().ok()?, name.to_owned(), out))
}
