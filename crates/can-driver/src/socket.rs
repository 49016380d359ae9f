//! Linux SocketCAN.
//!
//! Frames are stamped by the kernel when they arrive, error frames are asked for and decoded, and
//! only the wanted identifiers pass the kernel's filter. The transmit buffer is small, so that a
//! blocked bus is noticed within a cycle or two: a full one (`ENOBUFS`, `EAGAIN`) is
//! [`SendOutcome::Full`], and nothing is ever sent again. Set the interface's own queue to one
//! cycle as well: `ip link set can0 txqueuelen 4`.

use std::io;
use std::time::{Duration, SystemTime};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use socketcan::id::{CAN_EFF_FLAG, CAN_RTR_FLAG, CAN_SFF_MASK};
use socketcan::{
    CanAnyFrame, CanDataFrame, CanError, CanFdFrame, CanFdSocket, CanFilter, EmbeddedFrame, ErrorCause, Socket,
    SocketOptions, StandardId,
};

use crate::{Bus, BusFault, Error, Event, Frame, Id, SendOutcome, Stamped};

/// A kernel stamp further away than this is not believed: the wall clock was set in between.
const PLAUSIBLE_AGE: Duration = Duration::from_secs(1);
/// Faults decoded from one error frame at most.
const PENDING_FAULTS: usize = 8;

/// Which identifiers a socket receives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter<'a> {
    /// All.
    All,
    /// These.
    Only(&'a [Id]),
}

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

/// What a socket receives beside classic frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SocketEvent {
    /// A classic frame or a condition of the bus.
    Classic(Event),
    /// A CAN FD frame.
    Fd {
        /// When it arrived.
        at: Duration,
        /// The frame.
        frame: FdFrame,
    },
}

/// What a socket has passed over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SocketCounts {
    /// Frames with 29-bit identifiers and remote frames.
    pub unsupported: u64,
    /// FD frames that [`Bus::receive`] met.
    pub fd_ignored: u64,
    /// Kernel stamps that the wall clock contradicts; the time of reading was taken instead.
    pub implausible_stamps: u64,
    /// Frames that the kernel did not take for sending.
    pub full: u64,
}

/// An interface of the kernel, such as `can0` or `vcan0`.
#[derive(Debug)]
pub struct SocketCan {
    socket: CanFdSocket,
    interface: String,
    faults: [Option<BusFault>; PENDING_FAULTS],
    counts: SocketCounts,
}

impl SocketCan {
    /// Opens an interface. `send_buffer_bytes` bounds what may wait for sending (the kernel
    /// rounds up to about 4600; a classic frame takes about 800).
    ///
    /// # Errors
    /// [`Error::Io`]: no such interface, no CAN in the kernel, no permission.
    pub fn open(interface: &str, filter: Filter<'_>, send_buffer_bytes: u32) -> Result<Self, Error> {
        let fail = |action| move |source| Error::Io { interface: interface.to_owned(), action, source };
        let socket = CanFdSocket::open(interface).map_err(fail("open"))?;
        socket.set_nonblocking(true).map_err(fail("set non-blocking"))?;
        socket.set_recv_timestamp(true).map_err(fail("ask for time stamps"))?;
        socket.set_error_filter_accept_all().map_err(fail("ask for error frames"))?;
        let buffer = i32::try_from(send_buffer_bytes).unwrap_or(i32::MAX) / 2; // the kernel doubles it
        socket.set_socket_option_int(libc::SOL_SOCKET, libc::SO_SNDBUF, buffer).map_err(fail("set the send buffer"))?;
        if let Filter::Only(ids) = filter {
            let exact = CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG;
            let filters: Vec<CanFilter> = ids.iter().map(|id| CanFilter::new(id.raw().into(), exact)).collect();
            socket.set_filters(&filters).map_err(fail("set filters"))?;
        }
        Ok(Self {
            socket,
            interface: interface.to_owned(),
            faults: [None; PENDING_FAULTS],
            counts: SocketCounts::default(),
        })
    }

    /// Name of the interface.
    pub fn interface(&self) -> &str {
        &self.interface
    }

    /// What was passed over so far.
    pub fn counts(&self) -> SocketCounts {
        self.counts
    }

    /// Waits until something can be received, at most `timeout`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn wait(&self, timeout: Duration) -> Result<bool, Error> {
        let timeout = Timespec {
            tv_sec: i64::try_from(timeout.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: timeout.subsec_nanos().into(),
        };
        let mut wanted = [PollFd::new(&self.socket, PollFlags::IN)];
        match poll(&mut wanted, Some(&timeout)) {
            Ok(ready) => Ok(ready > 0),
            Err(rustix::io::Errno::INTR) => Ok(false),
            Err(e) => Err(self.failed("wait", e.into())),
        }
    }

    /// Sends an FD frame; the interface needs an MTU of 72.
    ///
    /// # Errors
    /// Those of [`Bus::send`].
    pub fn send_fd(&mut self, frame: &FdFrame) -> Result<SendOutcome, Error> {
        let id = StandardId::new(frame.id.raw()).expect("an Id has 11 bits");
        let mut out = CanFdFrame::new(id, frame.data()).expect("an FdFrame has a length of the format");
        out.set_brs(frame.bit_rate_switch);
        let result = self.socket.write_frame(&CanAnyFrame::Fd(out));
        self.sent(result)
    }

    /// The next frame of either format, or condition.
    ///
    /// # Errors
    /// Those of [`Bus::receive`].
    pub fn receive_any(&mut self, now: Duration) -> Result<Option<SocketEvent>, Error> {
        loop {
            if let Some(fault) = self.faults.iter_mut().find_map(Option::take) {
                return Ok(Some(SocketEvent::Classic(Event::Fault(fault))));
            }
            let (frame, stamps) = match self.socket.read_frame_with_timestamps() {
                Ok(read) => read,
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => return Ok(None),
                Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
                Err(e) => return Err(self.failed("receive", e)),
            };
            let at = self.arrival(now, stamps.socket);
            match frame {
                CanAnyFrame::Normal(frame) => match standard(&frame) {
                    Some(id) => {
                        let frame = Frame::new(id, frame.data())?;
                        return Ok(Some(SocketEvent::Classic(Event::Frame(Stamped { at, frame }))));
                    }
                    None => self.counts.unsupported += 1,
                },
                CanAnyFrame::Fd(frame) => match standard(&frame) {
                    Some(id) => {
                        let frame = FdFrame::new(id, frame.data(), frame.is_brs())?;
                        return Ok(Some(SocketEvent::Fd { at, frame }));
                    }
                    None => self.counts.unsupported += 1,
                },
                CanAnyFrame::Remote(_) => self.counts.unsupported += 1,
                CanAnyFrame::Error(frame) => self.faults = faults_of(&frame.into_error()),
            }
        }
    }

    /// When a frame arrived on the caller's clock. The kernel stamps with the wall clock; the
    /// difference to the wall clock's present reading is the frame's age.
    fn arrival(&mut self, now: Duration, stamp: Option<SystemTime>) -> Duration {
        #[expect(clippy::disallowed_methods, reason = "the age of a kernel stamp is known only on the kernel's clock")]
        let age = stamp.and_then(|stamp| SystemTime::now().duration_since(stamp).ok());
        if let Some(age) = age.filter(|age| *age <= PLAUSIBLE_AGE) {
            now.saturating_sub(age)
        } else {
            self.counts.implausible_stamps += 1;
            now
        }
    }

    fn sent(&mut self, result: io::Result<()>) -> Result<SendOutcome, Error> {
        match result {
            Ok(()) => Ok(SendOutcome::Sent),
            Err(e) if e.kind() == io::ErrorKind::WouldBlock || e.raw_os_error() == Some(libc::ENOBUFS) => {
                self.counts.full += 1;
                Ok(SendOutcome::Full)
            }
            Err(e) => Err(self.failed("send", e)),
        }
    }

    fn failed(&self, action: &'static str, source: io::Error) -> Error {
        let interface = self.interface.clone();
        match source.raw_os_error() {
            Some(libc::ENETDOWN | libc::ENODEV | libc::ENXIO) => Error::Down { interface },
            _ => Error::Io { interface, action, source },
        }
    }
}

fn standard<F: EmbeddedFrame>(frame: &F) -> Option<Id> {
    match frame.id() {
        socketcan::Id::Standard(id) => Id::new(id.as_raw()),
        socketcan::Id::Extended(_) => None,
    }
}

impl Bus for SocketCan {
    fn send(&mut self, _now: Duration, frame: &Frame) -> Result<SendOutcome, Error> {
        let id = StandardId::new(frame.id().raw()).expect("an Id has 11 bits");
        let out = CanDataFrame::new(id, frame.data()).expect("a Frame has at most 8 bytes");
        let result = self.socket.write_frame(&CanAnyFrame::Normal(out));
        self.sent(result)
    }

    fn receive(&mut self, now: Duration) -> Result<Option<Event>, Error> {
        loop {
            match self.receive_any(now)? {
                Some(SocketEvent::Classic(event)) => return Ok(Some(event)),
                Some(SocketEvent::Fd { .. }) => self.counts.fd_ignored += 1,
                None => return Ok(None),
            }
        }
    }
}

/// The conditions that one error frame names.
fn faults_of(error: &CanError) -> [Option<BusFault>; PENDING_FAULTS] {
    let mut out = [None; PENDING_FAULTS];
    let mut free = out.iter_mut();
    for cause in error {
        let fault = match cause {
            ErrorCause::TransmitTimeout => BusFault::TransmitTimeout,
            ErrorCause::LostArbitration(_) => BusFault::ArbitrationLost,
            ErrorCause::Controller(problems) => {
                use socketcan::errors::ControllerProblems as P;
                if problems.intersects(P::RX_PASSIVE | P::TX_PASSIVE) {
                    BusFault::Passive
                } else if problems.intersects(P::RX_OVERFLOW | P::TX_OVERFLOW) {
                    BusFault::Overflow
                } else if problems.intersects(P::RX_WARNING | P::TX_WARNING) {
                    BusFault::Warning
                } else {
                    continue; // back to error-active
                }
            }
            ErrorCause::Transceiver { .. } => BusFault::Transceiver,
            ErrorCause::NoAck => BusFault::NoAcknowledge,
            ErrorCause::BusOff => BusFault::Off,
            ErrorCause::Restarted => BusFault::Restarted,
            ErrorCause::Counters { .. } => continue,
            _ => BusFault::Protocol,
        };
        if let Some(place) = free.next() {
            *place = Some(fault);
        }
    }
    out
}
