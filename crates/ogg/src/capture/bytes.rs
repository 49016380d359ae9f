//! A bounds-checked big-endian reader that knows where in the file it stands.

/// A place in a file that does not hold what the format asks for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Malformed {
    pub(super) position: u64,
    pub(super) expected: String,
    pub(super) found: String,
}

impl Malformed {
    pub(super) fn new(position: u64, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self { position, expected: expected.into(), found: found.into() }
    }
}

/// Reads numbers from a slice that starts at a known offset of the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bytes<'a> {
    rest: &'a [u8],
    position: u64,
}

impl<'a> Bytes<'a> {
    pub(super) fn new(rest: &'a [u8], position: u64) -> Self {
        Self { rest, position }
    }

    pub(super) fn position(&self) -> u64 {
        self.position
    }

    pub(super) fn len(&self) -> usize {
        self.rest.len()
    }

    pub(super) fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], Malformed> {
        let Some((head, tail)) = self.rest.split_at_checked(count) else {
            return Err(Malformed::new(
                self.position,
                format!("{what} ({count} bytes)"),
                format!("{} bytes to the end of the box", self.rest.len()),
            ));
        };
        self.rest = tail;
        self.position += count as u64;
        Ok(head)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], Malformed> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N, what)?);
        Ok(out)
    }

    pub(super) fn u8(&mut self, what: &str) -> Result<u8, Malformed> {
        Ok(self.array::<1>(what)?[0])
    }

    pub(super) fn u16(&mut self, what: &str) -> Result<u16, Malformed> {
        Ok(u16::from_be_bytes(self.array(what)?))
    }

    pub(super) fn u32(&mut self, what: &str) -> Result<u32, Malformed> {
        Ok(u32::from_be_bytes(self.array(what)?))
    }

    pub(super) fn i32(&mut self, what: &str) -> Result<i32, Malformed> {
        Ok(i32::from_be_bytes(self.array(what)?))
    }

    pub(super) fn u64(&mut self, what: &str) -> Result<u64, Malformed> {
        Ok(u64::from_be_bytes(self.array(what)?))
    }

    pub(super) fn fourcc(&mut self, what: &str) -> Result<[u8; 4], Malformed> {
        self.array(what)
    }

    /// Reads an entry count and checks that so many entries of `entry_bytes` fit into what is left.
    pub(super) fn count(&mut self, entry_bytes: usize, what: &str) -> Result<usize, Malformed> {
        let position = self.position;
        let count = self.u32(what)? as usize;
        let room = self.rest.len() / entry_bytes.max(1);
        if count > room {
            return Err(Malformed::new(
                position,
                format!("{what}: at most {room} entries of {entry_bytes} bytes"),
                format!("a count of {count}"),
            ));
        }
        Ok(count)
    }
}

/// A four-character code for a message: printable characters as they are, others as dots.
pub(super) fn fourcc_text(code: [u8; 4]) -> String {
    code.iter().map(|&b| if b.is_ascii_graphic() || b == b' ' { char::from(b) } else { '.' }).collect()
}
