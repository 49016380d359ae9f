//! Control and the simulated plant, each on absolute deadlines.

use std::collections::BTreeMap;
use std::sync::PoisonError;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use can_driver::{Bus, HostState};
use crossbeam_channel::Sender;
use follow::Phase;

use super::{Measured, Shared};
use crate::cell::Cell;
use crate::error::Error;
use crate::journal::Journal;
use crate::link::{Link, Wish};
use crate::plant::Plant;
use crate::record::Level;
use crate::summary::Latencies;

/// Cycle of the simulated controller.
const PLANT_CYCLE: Duration = Duration::from_millis(1);
/// Poses of the links are recorded this often.
const FRAMES_EVERY: Duration = Duration::from_millis(20);
/// A simulated cell that has stopped starts again after this time.
const SIMULATED_RESET_AFTER: Duration = Duration::from_secs(1);

/// Absolute deadlines: a missed cycle is skipped, never caught up.
#[derive(Debug)]
struct Deadlines {
    epoch: Instant,
    period: Duration,
    next: u128,
    missed: u64,
}

impl Deadlines {
    fn new(epoch: Instant, period: Duration) -> Self {
        Self { epoch, period, next: epoch.elapsed().as_nanos() / period.as_nanos() + 1, missed: 0 }
    }

    /// Sleeps until the next deadline; returns how late it woke up.
    fn wait(&mut self) -> Duration {
        let due = Duration::from_nanos((self.next * self.period.as_nanos()) as u64);
        let now = self.epoch.elapsed();
        if due > now {
            std::thread::sleep(due - now);
        }
        let woken = self.epoch.elapsed();
        let reached = woken.as_nanos() / self.period.as_nanos();
        self.missed += (reached.saturating_sub(self.next)) as u64;
        self.next = reached.max(self.next) + 1;
        woken.saturating_sub(due)
    }
}

/// What the control thread did.
#[derive(Debug, Default)]
pub struct ControlReport {
    /// Times of a tick, and how late they woke up.
    pub latencies: Latencies,
    /// Stops by cause.
    pub stops: BTreeMap<String, u64>,
    /// Cycles that were skipped.
    pub missed: u64,
}

/// Runs the simulated arm until told to stop.
///
/// # Errors
/// [`Error::Bus`] when its end of the bus is gone.
pub fn plant<B: Bus>(mut plant: Plant<B>, shared: &Shared, epoch: Instant) -> Result<(), Error> {
    let mut deadlines = Deadlines::new(epoch, PLANT_CYCLE);
    while !shared.stop.load(Relaxed) {
        deadlines.wait();
        plant.advance_to(epoch.elapsed())?;
    }
    Ok(())
}

/// The control loop: one tick each period, until told to stop.
///
/// # Errors
/// [`Error::Bus`] when the bus is down or gone.
pub fn control<B: Bus>(
    mut link: Link<B>,
    cell: &Cell,
    shared: &Shared,
    journal: &Journal,
    measured: &Sender<Measured>,
    epoch: Instant,
) -> Result<ControlReport, Error> {
    let mut report = ControlReport::default();
    let mut deadlines = Deadlines::new(epoch, cell.period());
    let resets_itself = cell.control().reengage_automatically;
    let (mut last_phase, mut last_session) = (None, None);
    let mut next_frames = Duration::ZERO;
    let mut stopped_since: Option<Duration> = None;
    while !shared.stop.load(Relaxed) {
        let late = deadlines.wait();
        let now = epoch.elapsed();
        let started = Instant::now();
        let follow = shared.follow.load(Relaxed);
        let by_operator = shared.reset.swap(false, Relaxed);
        let waited = stopped_since.is_some_and(|since| now.saturating_sub(since) > SIMULATED_RESET_AFTER);
        let reset = by_operator || (resets_itself && follow && waited);
        if reset {
            stopped_since = None;
        }
        let plan = shared.plan.load();
        let tick = link.tick(now, plan.as_deref(), Wish { follow, standby: !follow, reset })?;
        let frames = now >= next_frames;
        if frames {
            next_frames = now + FRAMES_EVERY;
        }
        journal.tick(now, &tick, frames);
        if let Some((at, joints)) = &tick.measured {
            // A full channel means that nobody compares; the loop does not wait for that.
            let _ = measured.try_send((*at, joints.clone(), tick.phase == Phase::Following));
        }
        if last_phase != Some(tick.phase) {
            last_phase = Some(tick.phase);
            *shared.phase.lock().unwrap_or_else(PoisonError::into_inner) = last_phase;
            journal.log(now, Level::Info, &format!("control: {:?}", tick.phase));
            if let (Phase::Braking(cause), true) = (tick.phase, follow) {
                *report.stops.entry(format!("{cause:?}")).or_insert(0) += 1;
            }
        }
        if last_session != Some(tick.session) {
            last_session = Some(tick.session);
            journal.log(now, Level::Info, &format!("bus session: {:?}", tick.session));
            if tick.session == HostState::Stopped {
                let cause = tick.cause.map_or_else(|| "unknown".to_owned(), |cause| cause.to_string());
                shared.say(format!("stop        {cause}"));
                journal.log(now, Level::Error, &format!("stop: {cause}"));
                *report.stops.entry(cause).or_insert(0) += 1;
                stopped_since = Some(now);
            }
        }
        let parked = !follow && link.is_at_rest() && tick.session != HostState::Active;
        shared.parked.store(parked, Relaxed);
        report.latencies.add("control", started.elapsed());
        report.latencies.add("jitter", late);
    }
    report.missed = deadlines.missed;
    Ok(report)
}
