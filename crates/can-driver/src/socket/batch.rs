//! Several frames with one system call.
//!
//! A cycle sends and receives four frames, and a system call costs more than what the kernel does
//! with a frame: `sendmmsg` and `recvmmsg` take them together.

use std::cell::RefCell;
use std::io::{self, IoSlice, IoSliceMut};
use std::os::fd::AsRawFd;
use std::time::{Duration, SystemTime};

use nix::cmsg_space;
use nix::sys::socket::{ControlMessageOwned, MsgFlags, MultiHeaders, recvmmsg, sendmmsg};
use nix::sys::time::TimeSpec;
use socketcan::frame::{can_frame_default, canfd_frame_default};
use socketcan::{CanAnyFrame, CanFdFrame, CanFrame};

use crate::Frame;

/// Frames that go through one call.
pub(super) const BATCH: usize = 16;
/// Bytes of the kernel's `struct can_frame`: identifier, length, three bytes of padding, data.
const CLASSIC_BYTES: usize = 16;
/// Bytes of `struct canfd_frame`: identifier, length, flags, two bytes of padding, data.
const FD_BYTES: usize = 72;

thread_local! {
    // They hold pointers, so that a socket that owned them could not move to another thread. Both calls set all of a
    // header anew but the room for control messages, which is as long as the stamp that every frame carries.
    static SENT: RefCell<MultiHeaders<()>> = RefCell::new(MultiHeaders::preallocate(BATCH, None));
    static RECEIVED: RefCell<MultiHeaders<()>> =
        RefCell::new(MultiHeaders::preallocate(BATCH, Some(cmsg_space!(TimeSpec))));
}

/// Hands at most [`BATCH`] frames over and returns how many the kernel has taken. An error is that of the
/// first frame.
pub(super) fn send(socket: &impl AsRawFd, frames: &[Frame]) -> io::Result<usize> {
    let mut wire = [[0_u8; CLASSIC_BYTES]; BATCH];
    for (bytes, frame) in wire.iter_mut().zip(frames) {
        let data = frame.data();
        bytes[..4].copy_from_slice(&u32::from(frame.id().raw()).to_ne_bytes());
        bytes[4] = data.len() as u8;
        bytes[8..8 + data.len()].copy_from_slice(data);
    }
    let count = frames.len().min(BATCH);
    SENT.with_borrow_mut(|headers| {
        let slices = wire.each_ref().map(|bytes| [IoSlice::new(bytes)]);
        let sent = sendmmsg(socket.as_raw_fd(), headers, &slices[..count], [None; BATCH], [], MsgFlags::empty())?;
        Ok(sent.count())
    })
}

/// A frame, `None` if its layout is unknown here, and the kernel's stamp.
pub(super) type Arrived = (Option<CanAnyFrame>, Option<SystemTime>);

/// Takes at most `limit` and at most [`BATCH`] frames that have arrived, the first of the places first.
pub(super) fn receive(socket: &impl AsRawFd, limit: usize) -> io::Result<[Option<Arrived>; BATCH]> {
    RECEIVED.with_borrow_mut(|headers| {
        let mut wire = [[0_u8; FD_BYTES]; BATCH];
        let mut slices = wire.each_mut().map(|bytes| [IoSliceMut::new(bytes)]);
        let slices = &mut slices[..limit.min(BATCH)];
        let messages = recvmmsg(socket.as_raw_fd(), headers, slices, MsgFlags::empty(), None)?;
        let mut arrived = [None; BATCH];
        for (place, message) in arrived.iter_mut().zip(messages) {
            let stamp = message.cmsgs().ok().and_then(|mut all| {
                all.find_map(|one| match one {
                    ControlMessageOwned::ScmTimestampns(at) => Some(SystemTime::UNIX_EPOCH + Duration::from(at)),
                    _ => None,
                })
            });
            *place = Some((message.iovs().next().and_then(parsed), stamp));
        }
        Ok(arrived)
    })
}

/// A frame as the kernel lays it out; the number of bytes tells the format.
fn parsed(bytes: &[u8]) -> Option<CanAnyFrame> {
    let id = u32::from_ne_bytes(*bytes.first_chunk()?);
    let data = bytes.get(8..)?;
    match bytes.len() {
        CLASSIC_BYTES => {
            let mut frame = can_frame_default();
            frame.can_id = id;
            frame.can_dlc = bytes[4];
            frame.data.copy_from_slice(data);
            Some(CanFrame::from(frame).into())
        }
        FD_BYTES => {
            let mut frame = canfd_frame_default();
            frame.can_id = id;
            frame.len = bytes[4];
            frame.flags = bytes[5];
            frame.data.copy_from_slice(data);
            Some(CanFdFrame::from(frame).into())
        }
        _ => None,
    }
}
