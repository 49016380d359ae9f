//! Linux SocketCAN.
//!
//! Frames are stamped by the kernel when they arrive, error frames are asked for and decoded, and
//! only the wanted identifiers pass the kernel's filter. The transmit buffer is small, so that a
//! blocked bus is noticed within a cycle or two: a full one (`ENOBUFS`, `EAGAIN`) is
//! [`SendOutcome::Full`], and nothing is ever sent again. Set the interface's own queue to one
//! cycle as well: `ip link set can0 txqueuelen 4`. The frames of a cycle go through one system call
//! each way.

mod batch;
mod faults;
mod fd;

use std::io;
use std::time::{Duration, SystemTime};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use socketcan::id::{CAN_EFF_FLAG, CAN_RTR_FLAG, CAN_SFF_MASK};
use socketcan::{CanAnyFrame, CanFdFrame, CanFdSocket, CanFilter, EmbeddedFrame, Socket, SocketOptions, StandardId};

use self::batch::{Arrived, BATCH};
use self::faults::{PENDING_FAULTS, faults_of};
pub use self::fd::FdFrame;
use crate::{Bus, BusFault, Error, Event, Frame, Id, SendOutcome, Stamped};

/// A kernel stamp further away than this is not believed: the wall clock was set in between.
const PLAUSIBLE_AGE: Duration = Duration::from_secs(1);

/// Which identifiers a socket receives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter<'a> {
    /// All.
    All,
    /// These.
    Only(&'a [Id]),
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
    /// Frames with 29-bit identifiers, remote frames, and frames of a layout that is neither classic nor FD.
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
    clocks: Option<Clocks>,
    counts: SocketCounts,
}

/// The caller's clock and the kernel's at one moment.
#[derive(Clone, Copy, Debug)]
struct Clocks {
    now: Duration,
    wall: SystemTime,
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
            clocks: None,
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
        let id = StandardId::new(frame.id().raw()).expect("an Id has 11 bits");
        let mut out = CanFdFrame::new(id, frame.data()).expect("an FdFrame has a length of the format");
        out.set_brs(frame.bit_rate_switch());
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
            let Some([Some((frame, stamp)), ..]) = self.received(1)? else { return Ok(None) };
            if let Some(event) = self.understood(now, frame, stamp) {
                return Ok(Some(event));
            }
        }
    }

    /// At most `limit` frames; `None` when there is none at this moment.
    fn received(&self, limit: usize) -> Result<Option<[Option<Arrived>; BATCH]>, Error> {
        loop {
            match batch::receive(&self.socket, limit) {
                Ok(received) => return Ok(Some(received)),
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => return Ok(None),
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(self.failed("receive", e)),
            }
        }
    }

    /// What a frame means here; the faults of an error frame are put by.
    fn understood(
        &mut self,
        now: Duration,
        frame: Option<CanAnyFrame>,
        stamp: Option<SystemTime>,
    ) -> Option<SocketEvent> {
        let at = self.arrival(now, stamp);
        let event = match frame {
            Some(CanAnyFrame::Normal(frame)) => standard(&frame)
                .and_then(|id| Frame::new(id, frame.data()).ok())
                .map(|frame| SocketEvent::Classic(Event::Frame(Stamped { at, frame }))),
            Some(CanAnyFrame::Fd(frame)) => standard(&frame)
                .and_then(|id| FdFrame::new(id, frame.data(), frame.is_brs()).ok())
                .map(|frame| SocketEvent::Fd { at, frame }),
            Some(CanAnyFrame::Remote(_)) | None => None,
            Some(CanAnyFrame::Error(frame)) => {
                self.faults = faults_of(&frame.into_error());
                return None;
            }
        };
        self.counts.unsupported += u64::from(event.is_none());
        event
    }

    /// When a frame arrived on the caller's clock. The kernel stamps with the wall clock; the
    /// difference to the wall clock's present reading is the frame's age. The wall clock is read once for one
    /// `now`, and again for a frame that came after that.
    fn arrival(&mut self, now: Duration, stamp: Option<SystemTime>) -> Duration {
        let known = self.clocks.filter(|clocks| clocks.now == now);
        let age = stamp.and_then(|stamp| {
            let read = known.and_then(|clocks| clocks.wall.duration_since(stamp).ok());
            read.or_else(|| {
                #[expect(
                    clippy::disallowed_methods,
                    reason = "the age of a kernel stamp is known only on the kernel's clock"
                )]
                let wall = SystemTime::now();
                self.clocks = Some(Clocks { now, wall });
                wall.duration_since(stamp).ok()
            })
        });
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
    fn send(&mut self, now: Duration, frame: &Frame) -> Result<SendOutcome, Error> {
        self.transmit(now, std::slice::from_ref(frame))
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

    fn drain(&mut self, now: Duration, events: &mut Vec<Event>) -> Result<(), Error> {
        events.clear();
        while events.len() < events.capacity() {
            if let Some(fault) = self.faults.iter_mut().find_map(Option::take) {
                events.push(Event::Fault(fault));
                continue;
            }
            // A frame may name several conditions; those of the last one that find no room wait.
            let limit = ((events.capacity() - events.len()) / PENDING_FAULTS).clamp(1, BATCH);
            let Some(received) = self.received(limit)? else { break };
            let last = received[limit - 1].is_none();
            for (frame, stamp) in received.into_iter().flatten() {
                events.extend(self.faults.iter_mut().filter_map(Option::take).map(Event::Fault));
                match self.understood(now, frame, stamp) {
                    Some(SocketEvent::Classic(event)) => events.push(event),
                    Some(SocketEvent::Fd { .. }) => self.counts.fd_ignored += 1,
                    None => {}
                }
            }
            if last && self.faults.iter().all(Option::is_none) {
                break;
            }
        }
        Ok(())
    }

    fn transmit(&mut self, _now: Duration, frames: &[Frame]) -> Result<SendOutcome, Error> {
        for batch in frames.chunks(BATCH) {
            let taken = batch::send(&self.socket, batch);
            // What is refused in the middle found no room; an interface that went down there says so at the next call.
            let whole =
                taken.and_then(|n| if n == batch.len() { Ok(()) } else { Err(io::ErrorKind::WouldBlock.into()) });
            if self.sent(whole)? == SendOutcome::Full {
                return Ok(SendOutcome::Full);
            }
        }
        Ok(SendOutcome::Sent)
    }
}
