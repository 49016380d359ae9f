//! The bus and its nodes.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::bits::{Stuffing, frame_bits};
use crate::{Bus, BusFault, Error, Event, Frame, SendOutcome};

/// Frames that a node holds for its reader; more are lost, as in a kernel's socket.
const RECEIVE_CAPACITY: usize = 4096;
const WARNING_AT: u32 = 96;
const PASSIVE_AT: u32 = 128;
const OFF_AT: u32 = 256;
/// Error flag of two nodes, delimiter and intermission.
const ERROR_FRAME_BITS: u32 = 12 + 8 + 3;

/// How often things go wrong, as probabilities from 0 to 1, drawn per frame and receiver (errors
/// on the wire: per frame).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// The receiver misses the frame.
    pub loss: f64,
    /// The receiver gets the frame twice.
    pub duplicate: f64,
    /// The receiver gets other bytes, unnoticed by the bus.
    pub corrupt: f64,
    /// The receiver gets the frame late,
    pub delay: f64,
    /// by up to this time.
    pub delay_max: Duration,
    /// The frame is destroyed on the wire and sent again.
    pub wire_error: f64,
}

/// Settings of a [`SimBus`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimBusParams {
    /// Bits per second, 10,000 to 1,000,000.
    pub bit_rate: u32,
    /// Which stuff bits to count.
    pub stuffing: Stuffing,
    /// What goes wrong.
    pub faults: Faults,
    /// Seed of the faults: the same seed and calls give the same bus.
    pub seed: u64,
}

impl Default for SimBusParams {
    /// A faultless bus at 1 Mbit/s.
    fn default() -> Self {
        Self { bit_rate: 1_000_000, stuffing: Stuffing::Exact, faults: Faults::default(), seed: 0 }
    }
}

/// What the bus has carried.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BusLoad {
    /// Frames delivered.
    pub frames: u64,
    /// Frames destroyed on the wire.
    pub errors: u64,
    /// Time the bus was busy, intermissions included.
    pub busy: Duration,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Health {
    Active,
    Warning,
    Passive,
    Off,
}

#[derive(Debug)]
struct Node {
    powered: bool,
    queue: VecDeque<(Duration, Frame)>,
    capacity: usize,
    inbox: VecDeque<(Duration, Event)>,
    transmit_errors: u32,
    receive_errors: u32,
    health: Health,
    no_acknowledge: bool,
}

impl Node {
    fn on_bus(&self) -> bool {
        self.powered && self.health != Health::Off
    }

    fn post(&mut self, at: Duration, event: Event) {
        if self.inbox.len() < RECEIVE_CAPACITY {
            // Late frames arrive between newer ones.
            let place = self.inbox.partition_point(|(other, _)| *other <= at);
            self.inbox.insert(place, (at, event));
        }
    }

    /// Tells the node when an error counter passes a level.
    fn judge(&mut self, at: Duration) {
        let health = if self.transmit_errors >= OFF_AT {
            Health::Off
        } else {
            match self.transmit_errors.max(self.receive_errors) {
                PASSIVE_AT.. => Health::Passive,
                WARNING_AT.. => Health::Warning,
                _ => Health::Active,
            }
        };
        if health > self.health {
            let fault = match health {
                Health::Active | Health::Warning => BusFault::Warning,
                Health::Passive => BusFault::Passive,
                Health::Off => BusFault::Off,
            };
            self.post(at, Event::Fault(fault));
        }
        if health == Health::Off {
            self.queue.clear();
        }
        self.health = health;
    }
}

#[derive(Debug)]
struct Model {
    params: SimBusParams,
    rng: ChaCha8Rng,
    now: Duration,
    /// When the bus falls idle.
    free_at: Duration,
    /// Nothing begins before this.
    stalled_until: Duration,
    /// The frame on the wire: sender, and whether it will arrive.
    on_wire: Option<(usize, bool)>,
    nodes: Vec<Node>,
    load: BusLoad,
}

impl Model {
    fn bits(&self, bits: u32) -> Duration {
        Duration::from_nanos(u64::from(bits) * 1_000_000_000 / u64::from(self.params.bit_rate))
    }

    fn advance_to(&mut self, to: Duration) {
        while self.now < to {
            if let Some((sender, arrives)) = self.on_wire {
                if self.free_at > to {
                    break;
                }
                self.now = self.free_at;
                self.on_wire = None;
                self.finish(sender, arrives);
                continue;
            }
            let Some((at, sender)) = self.next_sender(to) else { break };
            self.now = self.now.max(at);
            self.start(sender);
        }
        self.now = self.now.max(to);
    }

    /// Who sends next, and when, if that is not after `to`.
    fn next_sender(&self, to: Duration) -> Option<(Duration, usize)> {
        let ready = |(since, _): &(Duration, Frame)| (*since).max(self.free_at).max(self.stalled_until);
        let heads = || {
            let on_bus = self.nodes.iter().enumerate().filter(|(_, n)| n.on_bus());
            on_bus.filter_map(|(i, n)| n.queue.front().map(|head| (i, head)))
        };
        let first = heads().map(|(_, head)| ready(head)).min()?;
        if first > to {
            return None;
        }
        let (sender, _) = heads().filter(|(_, head)| ready(head) <= first).min_by_key(|(i, (_, f))| (f.id(), *i))?;
        Some((first, sender))
    }

    fn start(&mut self, sender: usize) {
        let Some((_, frame)) = self.nodes[sender].queue.front().copied() else { return };
        let heard = self.nodes.iter().enumerate().any(|(i, n)| i != sender && n.on_bus());
        let whole = frame_bits(&frame, self.params.stuffing);
        let destroyed = self.rng.random_bool(self.params.faults.wire_error.clamp(0.0, 1.0));
        let bits = if destroyed {
            self.rng.random_range(1..=whole) + ERROR_FRAME_BITS
        } else if heard {
            whole
        } else {
            whole - 10 + ERROR_FRAME_BITS // ends at the acknowledge slot
        };
        self.free_at = self.now + self.bits(bits);
        self.load.busy += self.bits(bits);
        self.on_wire = Some((sender, heard && !destroyed));
        if !heard && !destroyed {
            self.nodes[sender].no_acknowledge = true;
        }
    }

    fn finish(&mut self, sender: usize, arrives: bool) {
        let now = self.now;
        if !arrives {
            self.load.errors += 1;
            let node = &mut self.nodes[sender];
            let unheard = std::mem::take(&mut node.no_acknowledge);
            if unheard && node.transmit_errors < PASSIVE_AT {
                node.post(now, Event::Fault(BusFault::NoAcknowledge));
            }
            // An error-passive sender does not count a missing acknowledge.
            if !(unheard && node.transmit_errors >= PASSIVE_AT) {
                node.transmit_errors += 8;
            }
            node.judge(now);
            for (i, node) in self.nodes.iter_mut().enumerate() {
                if i != sender && node.on_bus() && !unheard {
                    node.receive_errors = (node.receive_errors + 1).min(PASSIVE_AT);
                    node.judge(now);
                }
            }
            return;
        }
        // The queue may have gone with the power.
        let Some((_, frame)) = self.nodes[sender].queue.pop_front() else { return };
        self.load.frames += 1;
        self.nodes[sender].transmit_errors = self.nodes[sender].transmit_errors.saturating_sub(1);
        self.nodes[sender].judge(now);
        let faults = self.params.faults;
        for receiver in 0..self.nodes.len() {
            if receiver == sender || !self.nodes[receiver].on_bus() {
                continue;
            }
            let mut draw = |p: f64| p > 0.0 && self.rng.random_bool(p.min(1.0));
            let (lost, twice, corrupt, late) =
                (draw(faults.loss), draw(faults.duplicate), draw(faults.corrupt), draw(faults.delay));
            let frame = if corrupt { garble(&frame, &mut self.rng) } else { frame };
            let share: f64 = if late { self.rng.random() } else { 0.0 };
            let at = now + faults.delay_max.mul_f64(share);
            let node = &mut self.nodes[receiver];
            node.receive_errors = node.receive_errors.saturating_sub(1);
            node.judge(now);
            for _ in 0..usize::from(!lost) * (1 + usize::from(twice)) {
                node.post(at, Event::frame(at, frame));
            }
        }
    }
}

/// Random other bytes.
fn garble(frame: &Frame, rng: &mut ChaCha8Rng) -> Frame {
    let bits = 8 * frame.data().len() as u8;
    let mut out = *frame;
    while bits > 0 && out == *frame {
        for bit in 0..bits {
            if rng.random() {
                out = out.with_flipped_bit(bit);
            }
        }
    }
    out
}

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
