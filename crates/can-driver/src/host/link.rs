//! Round trip and losses, from the echo in STATUS.

use std::time::Duration;

/// How the link has been since the session began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkReport {
    /// Sets sent.
    pub sets_sent: u64,
    /// Sets whose counter came back.
    pub sets_echoed: u64,
    /// Sets whose counter did not come back although a later one did: lost, refused, or
    /// overtaken by a newer one before the controller looked.
    pub sets_unechoed: u64,
    /// STATUS frames received.
    pub status_received: u64,
    /// STATUS frames missing, by their counter.
    pub status_lost: u64,
    /// STATUS frames without all three FB frames.
    pub feedback_incomplete: u64,
    /// Damaged frames.
    pub corrupt_frames: u64,
    /// Cycles that the host's loop skipped.
    pub cycles_missed: u64,
    /// Cycles whose frames the bus did not take.
    pub transmit_full: u64,
    /// Latest round trip: from sending a set to its echo, less the time at the controller.
    pub round_trip: Option<Duration>,
    /// Shortest round trip.
    pub round_trip_min: Option<Duration>,
    /// Longest round trip.
    pub round_trip_max: Option<Duration>,
    /// Sum of all round trips, for the mean.
    round_trip_sum: Duration,
    round_trips: u32,
}

impl LinkReport {
    /// Mean round trip.
    pub fn round_trip_mean(&self) -> Option<Duration> {
        self.round_trip_sum.checked_div(self.round_trips)
    }

    fn add_round_trip(&mut self, time: Duration) {
        self.round_trip = Some(time);
        self.round_trip_min = Some(self.round_trip_min.map_or(time, |m| m.min(time)));
        self.round_trip_max = Some(self.round_trip_max.map_or(time, |m| m.max(time)));
        if let Some(count) = self.round_trips.checked_add(1) {
            self.round_trips = count;
            self.round_trip_sum += time;
        }
    }
}

/// Times of the sets sent, by counter, and what came back.
#[derive(Clone, Debug)]
pub(super) struct Link {
    pub(super) report: LinkReport,
    sent_at: [Option<Duration>; 256],
    /// Sets sent since the echo last moved.
    pub(super) since_echo: u32,
    /// When the echo last moved.
    pub(super) echo_at: Option<Duration>,
    status_counter: Option<u8>,
    /// Round trips in a row above the limit.
    pub(super) slow_trips: u8,
}

impl Link {
    pub(super) fn new() -> Self {
        Self {
            report: LinkReport::default(),
            sent_at: [None; 256],
            since_echo: 0,
            echo_at: None,
            status_counter: None,
            slow_trips: 0,
        }
    }

    pub(super) fn sent(&mut self, counter: u8, now: Duration) {
        self.sent_at[usize::from(counter)] = Some(now);
        self.report.sets_sent += 1;
        self.since_echo += 1;
    }

    /// Takes the counter of a STATUS; false if it is a repeat or older than the last one.
    pub(super) fn status(&mut self, counter: u8) -> bool {
        if let Some(last) = self.status_counter {
            let step = counter.wrapping_sub(last);
            if step == 0 || step >= 128 {
                return false;
            }
            self.report.status_lost += u64::from(step - 1);
        }
        self.status_counter = Some(counter);
        self.report.status_received += 1;
        true
    }

    /// The controller may have started anew, with another counter.
    pub(super) fn forget_status_counter(&mut self) {
        self.status_counter = None;
    }

    /// Takes the echo of a STATUS that arrived at `at`.
    pub(super) fn echo(&mut self, echo: u8, echo_age: Duration, at: Duration, limit: Duration) {
        let Some(sent_at) = self.sent_at[usize::from(echo)].take() else { return };
        let round_trip = at.saturating_sub(sent_at).saturating_sub(echo_age);
        self.report.add_round_trip(round_trip);
        self.slow_trips = if round_trip > limit { self.slow_trips.saturating_add(1) } else { 0 };
        self.report.sets_echoed += 1;
        self.since_echo = 0;
        self.echo_at = Some(at);
        // Whatever was sent before this one and is still open will not be echoed any more.
        for open in &mut self.sent_at {
            if open.is_some_and(|other| other < sent_at) {
                *open = None;
                self.report.sets_unechoed += 1;
            }
        }
    }
}
