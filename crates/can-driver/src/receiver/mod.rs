//! Which sets of setpoints may act: sequence and age.
//!
//! A set is four frames under one counter. [`Assembler`] brings them together, [`Receiver`]
//! judges the whole.
//!
//! **Sequence.** The counter has to move forward by 1 to 5 (1 to 4 lost sets are bridged); 0 is a
//! repeat and changes nothing; anything else is out of sequence and dropped. At the start, after
//! a pause longer than the latch time, and after a set out of sequence that is followed by its
//! own successors, three sets in a row are needed, of which the third acts.
//!
//! **Age.** The difference between the controller's clock at arrival and the host time inside the
//! set is the clocks' offset plus the transport time. Its minimum over the last 10 s stands for
//! offset plus shortest transport; what a set exceeds it by is the set's age. A set older than
//! `stale_after` is dropped, so that frames that waited in a queue never act. The window of 10 s
//! keeps the error by crystal drift (100 ppm) at 1 ms. A transport time that is long from the
//! first set on cannot be seen here; the host sees it as round trip. The host time wraps after
//! 6.55 s: when nothing fresh has come for 3 s, ages are no longer certain, and everything is
//! refused until the host begins a new session.

use std::time::Duration;

use crate::Angle;

/// Sets in a row that (re)establish the sequence.
pub(crate) const SYNC_SETS: u8 = 3;
/// Highest forward step of the counter: 1 to 4 lost sets are bridged.
pub(crate) const MAX_STEP: u8 = 5;
const HOST_TICK_NS: i64 = 100_000;
const HOST_WRAP_NS: i64 = HOST_TICK_NS << 16;
/// Time without a fresh set after which ages are no longer certain: below half of the wrap.
const EXPIRES_AFTER: Duration = Duration::from_secs(3);
const BUCKETS: usize = 10;
const BUCKET_NS: i64 = 1_000_000_000;

/// Minimum of the clock difference over the last ten seconds, in buckets of one second.
#[derive(Clone, Debug)]
struct OffsetWindow {
    minima_ns: [i64; BUCKETS],
    newest_bucket: i64,
}

impl OffsetWindow {
    const EMPTY: i64 = i64::MAX;

    fn new() -> Self {
        Self { minima_ns: [Self::EMPTY; BUCKETS], newest_bucket: 0 }
    }

    fn advance(&mut self, now_ns: i64) {
        let bucket = now_ns / BUCKET_NS;
        let fresh = (bucket - self.newest_bucket).clamp(0, BUCKETS as i64);
        for i in 0..fresh {
            self.minima_ns[(bucket - i).rem_euclid(BUCKETS as i64) as usize] = Self::EMPTY;
        }
        self.newest_bucket = self.newest_bucket.max(bucket);
    }

    fn minimum_ns(&self) -> Option<i64> {
        self.minima_ns.iter().copied().min().filter(|m| *m != Self::EMPTY)
    }

    fn insert(&mut self, offset_ns: i64) {
        let slot = &mut self.minima_ns[self.newest_bucket.rem_euclid(BUCKETS as i64) as usize];
        *slot = (*slot).min(offset_ns);
    }
}

/// What a set may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Judgement {
    /// It acts.
    Accept {
        /// The sequence was (re)established with this set.
        resynchronised: bool,
        /// Sets missing between the two.
        lost: u8,
        /// Time since it was sent, beyond the shortest transport time.
        age: Duration,
    },
    /// It is good, but the sequence is not yet established.
    Synchronising,
    /// The counter has not moved.
    Repeat,
    /// The counter moved by something else than 1 to 5.
    WrongSequence,
    /// Too old.
    Stale,
}

#[derive(Clone, Copy, Debug)]
struct Accepted {
    counter: u8,
    at: Duration,
}

/// Judges complete sets.
#[derive(Clone, Debug)]
pub(crate) struct Receiver {
    stale_after_ns: i64,
    resync_after: Duration,
    offsets: OffsetWindow,
    last: Option<Accepted>,
    /// Last set that was good but out of sequence, and how many such stand in a row.
    candidate: Option<(u8, u8)>,
    fresh_at: Option<Duration>,
}

impl Receiver {
    pub(crate) fn new(stale_after: Duration, resync_after: Duration) -> Self {
        Self {
            stale_after_ns: nanoseconds(stale_after),
            resync_after,
            offsets: OffsetWindow::new(),
            last: None,
            candidate: None,
            fresh_at: None,
        }
    }

    /// Forgets sequence and clocks, for a new session of the host.
    pub(crate) fn restart(&mut self) {
        self.offsets = OffsetWindow::new();
        self.last = None;
        self.candidate = None;
        self.fresh_at = None;
    }

    pub(crate) fn judge(&mut self, at: Duration, counter: u8, host_time: u16) -> Judgement {
        if self.fresh_at.is_some_and(|fresh| at.saturating_sub(fresh) > EXPIRES_AFTER) {
            return Judgement::Stale;
        }
        let Some(age) = self.age(at, host_time) else { return Judgement::Stale };
        self.fresh_at = Some(at);
        if self.last.is_some_and(|last| at.saturating_sub(last.at) > self.resync_after) {
            self.last = None;
            self.candidate = None;
        }
        if let Some(last) = self.last {
            let step = counter.wrapping_sub(last.counter);
            if step == 0 {
                return Judgement::Repeat;
            }
            if step <= MAX_STEP {
                self.accept(at, counter);
                return Judgement::Accept { resynchronised: false, lost: step - 1, age };
            }
        }
        let run = match self.candidate {
            Some((before, _)) if before == counter => return Judgement::Repeat,
            Some((before, run)) if counter == before.wrapping_add(1) => run + 1,
            _ => 1,
        };
        if run >= SYNC_SETS {
            self.accept(at, counter);
            return Judgement::Accept { resynchronised: true, lost: 0, age };
        }
        self.candidate = Some((counter, run));
        if self.last.is_some() { Judgement::WrongSequence } else { Judgement::Synchronising }
    }

    fn accept(&mut self, at: Duration, counter: u8) {
        self.last = Some(Accepted { counter, at });
        self.candidate = None;
    }

    /// Age of a set, or `None` if it is stale. A set that is far fresher than the window allows
    /// (another clock) starts the window anew.
    fn age(&mut self, at: Duration, host_time: u16) -> Option<Duration> {
        let now_ns = nanoseconds(at);
        self.offsets.advance(now_ns);
        let raw_ns = now_ns - i64::from(host_time) * HOST_TICK_NS;
        let Some(minimum_ns) = self.offsets.minimum_ns() else {
            self.offsets.insert(raw_ns);
            return Some(Duration::ZERO);
        };
        // The host time wraps: the difference nearest to zero is meant.
        let age_ns = (raw_ns - minimum_ns + HOST_WRAP_NS / 2).rem_euclid(HOST_WRAP_NS) - HOST_WRAP_NS / 2;
        if age_ns > self.stale_after_ns {
            return None;
        }
        if age_ns < -self.stale_after_ns {
            self.restart();
            self.offsets.advance(now_ns);
        }
        self.offsets.insert(minimum_ns + age_ns);
        Some(Duration::from_nanos(age_ns.max(0).unsigned_abs()))
    }
}

fn nanoseconds(time: Duration) -> i64 {
    i64::try_from(time.as_nanos()).unwrap_or(i64::MAX)
}

/// Brings the frames of one counter together. One place per slot, the newest wins, as in the
/// mailboxes of a DSP28335.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Assembler {
    slots: [Option<(u8, [Angle; 2])>; 3],
}

impl Assembler {
    pub(crate) fn put(&mut self, slot: u8, counter: u8, angles: [Angle; 2]) {
        if let Some(place) = self.slots.get_mut(usize::from(slot)) {
            *place = Some((counter, angles));
        }
    }

    /// The six angles, if all three frames carry this counter.
    pub(crate) fn complete(&self, counter: u8) -> Option<[Angle; 6]> {
        let mut angles = [Angle::NO_VALUE; 6];
        for (place, pair) in self.slots.iter().zip(angles.chunks_exact_mut(2)) {
            let (found, two) = (*place)?;
            if found != counter {
                return None;
            }
            pair.copy_from_slice(&two);
        }
        Some(angles)
    }
}

#[cfg(test)]
mod tests;
