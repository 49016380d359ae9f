//! Classic CAN data frames with 11-bit identifiers, and the small lists that carry them.

use std::fmt;
use std::ops::Deref;
use std::time::Duration;

use crate::Error;

/// An 11-bit identifier. A lower number wins the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Id(u16);

impl Id {
    /// The highest identifier, 0x7FF.
    pub const MAX: Self = Self(0x7FF);

    /// `None` above 0x7FF.
    ///
    /// ```
    /// use can_driver::Id;
    /// assert_eq!(Id::new(0x7FF).map(Id::raw), Some(2047));
    /// assert_eq!(Id::new(0x800), None);
    /// ```
    pub const fn new(raw: u16) -> Option<Self> {
        if raw <= Self::MAX.0 { Some(Self(raw)) } else { None }
    }

    /// For the protocol's own tables, whose identifiers are checked when they are built.
    pub(crate) const fn known(raw: u16) -> Self {
        assert!(raw <= Self::MAX.0, "identifier above 0x7FF");
        Self(raw)
    }

    /// The number, at most 0x7FF.
    pub const fn raw(self) -> u16 {
        self.0
    }
}

impl fmt::Display for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:03X}", self.0)
    }
}

/// A classic data frame: an 11-bit identifier and 0 to 8 bytes.
///
/// ```
/// use can_driver::{Frame, Id};
/// let frame = Frame::new(Id::new(0x123).unwrap(), &[0xDE, 0xAD])?;
/// assert_eq!(frame.to_string(), "123#DEAD");
/// # Ok::<(), can_driver::Error>(())
/// ```
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct Frame {
    id: Id,
    len: u8,
    bytes: [u8; 8],
}

impl Frame {
    /// Takes at most 8 bytes.
    ///
    /// # Errors
    /// [`Error::FrameTooLong`].
    pub fn new(id: Id, data: &[u8]) -> Result<Self, Error> {
        let mut bytes = [0; 8];
        bytes
            .get_mut(..data.len())
            .ok_or(Error::FrameTooLong { bytes: data.len(), limit_bytes: 8 })?
            .copy_from_slice(data);
        Ok(Self { id, len: data.len() as u8, bytes })
    }

    /// A frame with all 8 bytes.
    pub const fn full(id: Id, bytes: [u8; 8]) -> Self {
        Self { id, len: 8, bytes }
    }

    /// The identifier.
    pub const fn id(&self) -> Id {
        self.id
    }

    /// The payload.
    pub fn data(&self) -> &[u8] {
        &self.bytes[..usize::from(self.len)]
    }

    /// The payload if it has all 8 bytes.
    pub(crate) fn all_bytes(&self) -> Option<[u8; 8]> {
        (self.len == 8).then_some(self.bytes)
    }

    /// The same frame with one payload bit inverted; bit 0 is the least significant bit of byte 0.
    /// A bit outside the payload changes nothing.
    #[must_use]
    pub fn with_flipped_bit(mut self, bit: u8) -> Self {
        if bit < self.len * 8 {
            self.bytes[usize::from(bit / 8)] ^= 1 << (bit % 8);
        }
        self
    }
}

impl fmt::Display for Frame {
    /// As candump writes it: `123#DEAD`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}#", self.id)?;
        self.data().iter().try_for_each(|b| write!(f, "{b:02X}"))
    }
}

impl fmt::Debug for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// A frame with the moment at which it was on the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamped {
    /// Time since the start of the receiver's clock.
    pub at: Duration,
    /// The frame.
    pub frame: Frame,
}

/// A list with a fixed capacity that lives on the stack: no tick of a session allocates.
#[derive(Clone, Copy)]
pub struct FixedList<T, const N: usize> {
    items: [T; N],
    len: usize,
}

impl<T: Copy + Default, const N: usize> FixedList<T, N> {
    /// An empty list.
    pub fn new() -> Self {
        Self { items: [T::default(); N], len: 0 }
    }

    /// A list of `len` default values, at most `N`.
    pub fn with_len(len: usize) -> Self {
        Self { items: [T::default(); N], len: len.min(N) }
    }

    /// Appends `item`.
    ///
    /// # Panics
    /// If the list is full: every user of the list knows its bound.
    pub fn push(&mut self, item: T) {
        assert!(self.len < N, "fixed list of {N} is full");
        self.items[self.len] = item;
        self.len += 1;
    }

    /// Removes everything.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// The items, for change in place.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.items[..self.len]
    }
}

impl<T: Copy + Default, const N: usize> Default for FixedList<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T, const N: usize> Deref for FixedList<T, N> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.items[..self.len]
    }
}

impl<'a, T, const N: usize> IntoIterator for &'a FixedList<T, N> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<T: PartialEq, const N: usize> PartialEq for FixedList<T, N> {
    fn eq(&self, other: &Self) -> bool {
        self[..] == other[..]
    }
}

impl<T: fmt::Debug, const N: usize> fmt::Debug for FixedList<T, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self[..].fmt(f)
    }
}

/// The frames that one tick of a session sends: at most 4 of the host, at most 11 of the controller.
pub type FrameList = FixedList<Frame, 12>;
/// One value per joint.
pub type PerJoint<T> = FixedList<T, { crate::MAX_JOINTS }>;
