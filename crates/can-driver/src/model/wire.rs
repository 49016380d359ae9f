//! What happens on the wire, and the error counters of the nodes.

use std::collections::VecDeque;
use std::time::Duration;

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::bits::frame_bits;
use super::params::SimBusParams;
use crate::{BusFault, Event, Frame};

/// Frames that a node holds for its reader; more are lost, as in a kernel's socket.
const RECEIVE_CAPACITY: usize = 4096;
const WARNING_AT: u32 = 96;
const PASSIVE_AT: u32 = 128;
const OFF_AT: u32 = 256;
/// Error flag of two nodes, delimiter and intermission.
const ERROR_FRAME_BITS: u32 = 12 + 8 + 3;

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
pub(super) enum Health {
    Active,
    Warning,
    Passive,
    Off,
}

#[derive(Debug)]
pub(super) struct Node {
    pub(super) powered: bool,
    pub(super) queue: VecDeque<(Duration, Frame)>,
    pub(super) capacity: usize,
    pub(super) inbox: VecDeque<(Duration, Event)>,
    pub(super) transmit_errors: u32,
    pub(super) receive_errors: u32,
    pub(super) health: Health,
    pub(super) no_acknowledge: bool,
}

impl Node {
    fn on_bus(&self) -> bool {
        self.powered && self.health != Health::Off
    }

    pub(super) fn post(&mut self, at: Duration, event: Event) {
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
pub(super) struct Model {
    pub(super) params: SimBusParams,
    pub(super) rng: ChaCha8Rng,
    pub(super) now: Duration,
    /// When the bus falls idle.
    pub(super) free_at: Duration,
    /// Nothing begins before this.
    pub(super) stalled_until: Duration,
    /// The frame on the wire: sender, and whether it will arrive.
    pub(super) on_wire: Option<(usize, bool)>,
    pub(super) nodes: Vec<Node>,
    pub(super) load: BusLoad,
}

impl Model {
    fn bits(&self, bits: u32) -> Duration {
        Duration::from_nanos(u64::from(bits) * 1_000_000_000 / u64::from(self.params.bit_rate))
    }

    pub(super) fn advance_to(&mut self, to: Duration) {
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
