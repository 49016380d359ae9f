//! A bus inside the process: every endpoint hears every other one.
//!
//! Frames arrive in the order in which they were sent, at the moment they were sent, and none is
//! lost unless a receiver leaves its queue full. For bit times, arbitration and faults use
//! [`crate::SimBus`].

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::{Bus, BusFault, Error, Event, Frame, SendOutcome};

#[derive(Debug)]
struct Queue {
    events: VecDeque<Event>,
    overflowed: bool,
}

#[derive(Debug, Default)]
struct Shared {
    queues: Vec<Queue>,
}

/// Makes connected [`LocalEndpoint`]s, which may live in different threads.
///
/// ```
/// use can_driver::{Bus, Event, Frame, Id, LocalBus};
/// use std::time::Duration;
///
/// let bus = LocalBus::new(64);
/// let (mut a, mut b) = (bus.endpoint(), bus.endpoint());
/// let frame = Frame::new(Id::new(0x100).unwrap(), &[1, 2])?;
/// let now = Duration::from_millis(5);
/// let _ = a.send(now, &frame)?;
/// assert_eq!(b.receive(now)?, Some(Event::frame(now, frame)));
/// assert_eq!(a.receive(now)?, None); // nobody hears himself
/// # Ok::<(), can_driver::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct LocalBus {
    shared: Arc<Mutex<Shared>>,
    capacity: usize,
}

impl LocalBus {
    /// Every endpoint holds at most `capacity` frames that nobody has taken yet (at least 1).
    pub fn new(capacity: usize) -> Self {
        Self { shared: Arc::default(), capacity: capacity.max(1) }
    }

    /// A new endpoint.
    pub fn endpoint(&self) -> LocalEndpoint {
        let mut shared = lock(&self.shared);
        let index = shared.queues.len();
        shared.queues.push(Queue { events: VecDeque::with_capacity(self.capacity), overflowed: false });
        LocalEndpoint { shared: Arc::clone(&self.shared), index, capacity: self.capacity }
    }
}

/// One end of a [`LocalBus`].
#[derive(Debug)]
pub struct LocalEndpoint {
    shared: Arc<Mutex<Shared>>,
    index: usize,
    capacity: usize,
}

/// A panic of another user leaves whole frames behind: the queues stay usable.
fn lock(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Bus for LocalEndpoint {
    fn send(&mut self, now: Duration, frame: &Frame) -> Result<SendOutcome, Error> {
        let mut shared = lock(&self.shared);
        for (index, queue) in shared.queues.iter_mut().enumerate() {
            if index == self.index {
                continue;
            }
            if queue.events.len() < self.capacity {
                queue.events.push_back(Event::frame(now, *frame));
            } else {
                queue.overflowed = true;
            }
        }
        Ok(SendOutcome::Sent)
    }

    fn receive(&mut self, _now: Duration) -> Result<Option<Event>, Error> {
        let mut shared = lock(&self.shared);
        let queue = &mut shared.queues[self.index];
        if queue.overflowed {
            queue.overflowed = false;
            return Ok(Some(Event::Fault(BusFault::Overflow)));
        }
        Ok(queue.events.pop_front())
    }
}
