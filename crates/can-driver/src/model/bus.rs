//! The bus and its nodes, as programs hold them.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::params::{Faults, SimBusParams};
use super::wire::{BusLoad, Health, Model, Node};
use crate::{Bus, BusFault, Error, Event, Frame, SendOutcome};

/// A bus in virtual time; nodes are its ends.
///
/// ```
/// use can_driver::{Bus, Event, Frame, Id, SimBus, SimBusParams};
/// use std::time::Duration;
///
/// let bus = SimBus::new(SimBusParams::default())?;
/// let (mut a, mut b) = (bus.node(8), bus.node(8));
/// let frame = Frame::full(Id::new(0x100).unwrap(), [0x55; 8]);
/// let _ = a.send(Duration::ZERO, &frame)?;
/// assert_eq!(b.receive(Duration::from_micros(100))?, None); // still on the wire
/// assert!(matches!(b.receive(Duration::from_micros(140))?, Some(Event::Frame(_))));
/// # Ok::<(), can_driver::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct SimBus {
    model: Arc<Mutex<Model>>,
}

impl SimBus {
    /// # Errors
    /// [`Error::InvalidParameter`] for a bit rate outside 10,000 to 1,000,000 or a probability
    /// outside 0 to 1.
    pub fn new(params: SimBusParams) -> Result<Self, Error> {
        let faults = params.faults;
        for (field, value) in [
            ("loss", faults.loss),
            ("duplicate", faults.duplicate),
            ("corrupt", faults.corrupt),
            ("delay", faults.delay),
            ("wire_error", faults.wire_error),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return Err(Error::InvalidParameter { field: field.to_owned(), allowed: "0 to 1", value });
            }
        }
        if !(10_000..=1_000_000).contains(&params.bit_rate) {
            return Err(Error::InvalidParameter {
                field: "bit_rate".to_owned(),
                allowed: "10,000 to 1,000,000 bit/s",
                value: params.bit_rate.into(),
            });
        }
        let model = Model {
            params,
            rng: ChaCha8Rng::seed_from_u64(params.seed),
            now: Duration::ZERO,
            free_at: Duration::ZERO,
            stalled_until: Duration::ZERO,
            on_wire: None,
            nodes: Vec::new(),
            load: BusLoad::default(),
        };
        Ok(Self { model: Arc::new(Mutex::new(model)) })
    }

    /// A new node whose transmit queue holds `queue` frames (at least 1).
    pub fn node(&self, queue: usize) -> SimNode {
        let mut model = lock(&self.model);
        let index = model.nodes.len();
        model.nodes.push(Node {
            powered: true,
            queue: VecDeque::with_capacity(queue.max(1)),
            capacity: queue.max(1),
            inbox: VecDeque::new(),
            transmit_errors: 0,
            receive_errors: 0,
            health: Health::Active,
            no_acknowledge: false,
        });
        SimNode { model: Arc::clone(&self.model), index }
    }

    /// Moves the bus's time on.
    pub fn advance_to(&self, now: Duration) {
        lock(&self.model).advance_to(now);
    }

    /// Blocks the bus from `now` until `until`: nothing new is sent, queues fill.
    pub fn stall(&self, now: Duration, until: Duration) {
        let mut model = lock(&self.model);
        model.advance_to(now);
        model.stalled_until = until;
    }

    /// Changes what goes wrong from now on.
    pub fn set_faults(&self, faults: Faults) {
        lock(&self.model).params.faults = faults;
    }

    /// What the bus has carried so far.
    pub fn load(&self) -> BusLoad {
        lock(&self.model).load
    }
}

/// A panic of another user leaves a whole bus behind.
fn lock(model: &Mutex<Model>) -> MutexGuard<'_, Model> {
    model.lock().unwrap_or_else(PoisonError::into_inner)
}

/// One end of a [`SimBus`].
#[derive(Debug)]
pub struct SimNode {
    model: Arc<Mutex<Model>>,
    index: usize,
}

impl SimNode {
    /// Switches the node on or off. Off, it neither hears nor acknowledges; what waits in its
    /// transmit queue stays there and leaves when power returns.
    pub fn set_power(&self, now: Duration, on: bool) {
        let mut model = lock(&self.model);
        model.advance_to(now);
        let node = &mut model.nodes[self.index];
        node.powered = on;
        if !on {
            node.inbox.clear();
        }
    }

    /// Leaves bus-off, as an operator does with `ip link set can0 down; ip link set can0 up`.
    pub fn restart(&self, now: Duration) {
        let mut model = lock(&self.model);
        model.advance_to(now);
        let node = &mut model.nodes[self.index];
        node.transmit_errors = 0;
        node.receive_errors = 0;
        node.health = Health::Active;
        node.queue.clear();
        node.post(now, Event::Fault(BusFault::Restarted));
    }
}

impl Bus for SimNode {
    fn send(&mut self, now: Duration, frame: &Frame) -> Result<SendOutcome, Error> {
        let mut model = lock(&self.model);
        model.advance_to(now);
        let at = model.now;
        let node = &mut model.nodes[self.index];
        if node.queue.len() >= node.capacity || node.health == Health::Off {
            return Ok(SendOutcome::Full);
        }
        node.queue.push_back((at, *frame));
        Ok(SendOutcome::Sent)
    }

    fn receive(&mut self, now: Duration) -> Result<Option<Event>, Error> {
        let mut model = lock(&self.model);
        model.advance_to(now);
        let inbox = &mut model.nodes[self.index].inbox;
        if inbox.front().is_some_and(|(at, _)| *at <= now) {
            return Ok(inbox.pop_front().map(|(_, event)| event));
        }
        Ok(None)
    }
}
