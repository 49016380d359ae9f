//! The live threads: control and plant on absolute deadlines, vision as fast as pictures come; and what they share.

use std::collections::{BTreeMap, VecDeque};
use std::fmt::Write as _;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use arc_swap::ArcSwapOption;
use can_driver::{Bus, HostState};
use crossbeam_channel::{Receiver, Sender};
use follow::{ArmSample, JointPlan, Phase};

use crate::brain::{Action, Follower};
use crate::capture::{End, FrameSet, Latest, Wait};
use crate::cell::Cell;
use crate::compare::Comparator;
use crate::error::Error;
use crate::journal::Journal;
use crate::link::{Link, Wish};
use crate::plant::Plant;
use crate::record::{Level, Metric};
use crate::summary::{Latencies, Tracking};
use crate::vision::Vision;

/// Cycle of the simulated controller.
const PLANT_CYCLE: Duration = Duration::from_millis(1);
/// Poses of the links are recorded this often.
const FRAMES_EVERY: Duration = Duration::from_millis(20);
/// Metrics are recorded this often.
const METRICS_EVERY: Duration = Duration::from_millis(500);
/// A simulated cell that has stopped starts again after this time.
const SIMULATED_RESET_AFTER: Duration = Duration::from_secs(1);
/// Share of recent samples below which the model no longer fits what the worker does.
const RETEACH_BELOW: f64 = 0.2;

/// Measured joints on their way from control to vision: time, joints, whether the arm was following.
pub type Measured = (Duration, Vec<f64>, bool);

/// The signals that were received.
#[derive(Debug, Default)]
pub struct Stopping(AtomicU8);

impl Stopping {
    /// Counts a signal.
    pub fn signal(&self) {
        // Saturating: two are as good as many.
        let _ = self.0.fetch_update(Relaxed, Relaxed, |n| n.checked_add(1));
    }

    /// Whether a stop was asked for.
    pub fn asked(&self) -> bool {
        self.0.load(Relaxed) > 0
    }

    /// Whether it was asked for again, so that nothing is waited for.
    pub fn twice(&self) -> bool {
        self.0.load(Relaxed) > 1
    }
}

/// What the vision side is doing, for the terminal.
#[derive(Debug, Clone, Default)]
struct Status {
    lines: VecDeque<String>,
    stage: &'static str,
    detail: String,
    frames: u64,
    complete: u64,
    age: Duration,
    joint_error_rad: f64,
    tool_error_mm: f64,
}

/// What the threads share. Nothing here is waited for by the control loop.
#[derive(Debug)]
pub struct Shared {
    /// The newest plan.
    pub plan: ArcSwapOption<JointPlan>,
    /// Whether the arm shall follow.
    pub follow: AtomicBool,
    /// Set by the control thread when the arm rests with its brakes on.
    pub parked: AtomicBool,
    /// Ends all threads.
    pub stop: AtomicBool,
    /// Set by an operator who allows a new start; taken by the control thread.
    pub reset: Arc<AtomicBool>,
    phase: Mutex<Option<Phase>>,
    status: Mutex<Status>,
}

impl Shared {
    /// Nothing known, following as soon as there is a plan.
    pub fn new(knows_action: bool) -> Self {
        let stage = if knows_action { "following" } else { "teaching" };
        Self {
            plan: ArcSwapOption::empty(),
            follow: AtomicBool::new(true),
            parked: AtomicBool::new(false),
            stop: AtomicBool::new(false),
            reset: Arc::default(),
            phase: Mutex::new(None),
            status: Mutex::new(Status { stage, ..Status::default() }),
        }
    }

    fn status(&self, change: impl FnOnce(&mut Status)) {
        change(&mut self.status.lock().unwrap_or_else(PoisonError::into_inner));
    }

    fn say(&self, line: String) {
        self.status(|status| status.lines.push_back(line));
    }

    /// Messages for the terminal since the last call.
    pub fn take_lines(&self) -> VecDeque<String> {
        let mut taken = VecDeque::new();
        self.status(|status| std::mem::swap(&mut taken, &mut status.lines));
        taken
    }

    /// One line for a person.
    pub fn line(&self, now: Duration) -> String {
        let status = self.status.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let phase = *self.phase.lock().unwrap_or_else(PoisonError::into_inner);
        let rate = status.frames as f64 / now.as_secs_f64().max(1e-3);
        let seen = if status.frames > 0 { 100.0 * status.complete as f64 / status.frames as f64 } else { 0.0 };
        let mut line = format!(
            "{:>6.1} s   {:<9} {rate:4.1} frames/s, arm seen in {seen:3.0} %, age {:3.0} ms",
            now.as_secs_f64(),
            status.stage,
            status.age.as_secs_f64() * 1e3
        );
        if !status.detail.is_empty() {
            let _ = write!(line, ", {}", status.detail);
        }
        match phase {
            None | Some(Phase::Waiting) => line.push_str("; robot: enabling"),
            Some(Phase::Ready) => line.push_str("; robot: ready"),
            Some(Phase::Aligning) => line.push_str("; robot: aligning slowly"),
            Some(Phase::Following) => {
                let _ = write!(
                    line,
                    "; robot: following, {:.3} rad and {:.0} mm off",
                    status.joint_error_rad, status.tool_error_mm
                );
            }
            Some(Phase::Braking(cause)) => {
                let _ = write!(line, "; robot: coming to rest ({cause:?})");
            }
            Some(Phase::Resting(cause)) => {
                let _ = write!(line, "; robot: at rest ({cause:?})");
            }
            Some(Phase::Stopped(cause)) => {
                let _ = write!(line, "; robot: STOPPED ({cause:?})");
            }
        }
        line
    }
}

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

/// What the vision thread did.
#[derive(Debug)]
pub struct VisionReport {
    /// Frame sets that were looked at.
    pub frames: u64,
    /// Of these, with the whole arm.
    pub complete: u64,
    /// Times per stage.
    pub latencies: Latencies,
    /// How the robot followed.
    pub tracking: Option<Tracking>,
    /// What was learned last.
    pub action: Option<Action>,
}

/// What the vision thread carries from picture to picture.
struct Seeing<'a> {
    cell: &'a Cell,
    shared: &'a Shared,
    journal: &'a Journal,
    report: VisionReport,
    follower: Option<Follower>,
    comparator: Comparator,
    /// The last `teach.duration_s` of samples, and whether the model explained them.
    recent: VecDeque<(ArmSample, bool)>,
    lesson: Duration,
    lesson_from: Option<Duration>,
}

/// Looks at pictures until they end or the program stops.
///
/// # Errors
/// [`Error::Capture`] when the source fails, [`Error::Pose`] when the network does.
#[expect(clippy::too_many_arguments, reason = "the thread's whole world, named once")]
pub fn vision(
    mut vision: Vision,
    latest: &Latest<FrameSet>,
    known: Option<Action>,
    cell: &Cell,
    shared: &Shared,
    journal: &Journal,
    measured: &Receiver<Measured>,
    epoch: Instant,
) -> Result<VisionReport, Error> {
    let mut seeing = Seeing {
        cell,
        shared,
        journal,
        report: VisionReport { frames: 0, complete: 0, latencies: Latencies::default(), tracking: None, action: None },
        follower: None,
        comparator: Comparator::new(&cell.config.robot.home_rad),
        recent: VecDeque::new(),
        lesson: Duration::try_from_secs_f64(cell.config.teach.duration_s).unwrap_or(Duration::MAX),
        lesson_from: None,
    };
    match known {
        Some(action) => seeing.adopt(action)?,
        None => shared.say(format!("teaching    show the action for {:.1} s", cell.config.teach.duration_s)),
    }
    let mut next_metrics = Duration::ZERO;
    while !shared.stop.load(Relaxed) {
        let set = match latest.take(Duration::from_millis(100)) {
            Wait::Item(set) => set,
            Wait::Empty => continue,
            Wait::Ended(End::Finished) => {
                shared.say("source      no more pictures".to_owned());
                break;
            }
            Wait::Ended(End::Failed(error)) => {
                return Err(Error::Thread { thread: "capture", message: error.to_string() });
            }
            Wait::Ended(End::Abandoned) => {
                return Err(Error::Thread { thread: "capture", message: "it went away without a word".into() });
            }
        };
        if set.stuck {
            // The same picture again and again is no news: its age goes on growing.
            continue;
        }
        seeing.report.latencies.add("wait", set.age(epoch.elapsed()));
        let seen = vision.see(&set, &mut seeing.report.latencies)?;
        for (at, joints, following) in measured.try_iter() {
            seeing.comparator.measure(at, joints, following);
        }
        seeing.sample(&seen.sample, epoch)?;
        let now = epoch.elapsed();
        seeing.report.latencies.add("total", set.age(now));
        journal.seen(set.captured, &set, &seen);
        if now >= next_metrics {
            next_metrics = now + METRICS_EVERY;
            seeing.metrics(now);
        }
    }
    seeing.report.tracking = seeing.comparator.sums().figures();
    if let (Some(action), Some(follower)) = (&mut seeing.report.action, &seeing.follower) {
        action.learned.matched_share = follower.matched_share();
    }
    Ok(seeing.report)
}

impl Seeing<'_> {
    fn sample(&mut self, sample: &ArmSample, epoch: Instant) -> Result<(), Error> {
        self.report.frames += 1;
        self.report.complete += u64::from(sample.is_complete());
        let mut matched = false;
        if let Some(follower) = &mut self.follower {
            let before = follower.matched();
            if let Some(plan) = follower.follow(sample, &mut self.report.latencies)? {
                self.journal.plan(epoch.elapsed(), &plan);
                self.shared.plan.store(Some(plan.into()));
            }
            matched = follower.matched() > before;
            if let Some(c) = self.comparator.compare(sample, follower.retargeter()) {
                let joint = c.joint_error_rad.iter().fold(0.0_f64, |worst, e| worst.max(e.abs()));
                let tool = c.tool_error_m.iter().map(|e| e * e).sum::<f64>().sqrt() * 1e3;
                self.shared.status(|status| {
                    status.joint_error_rad = joint;
                    status.tool_error_mm = tool;
                });
            }
        }
        if sample.is_complete() {
            self.lesson_from.get_or_insert(sample.captured);
            self.recent.push_back((*sample, matched));
            while self
                .recent
                .front()
                .is_some_and(|(first, _)| sample.captured.saturating_sub(first.captured) > self.lesson)
            {
                self.recent.pop_front();
            }
        }
        self.learn_when_due(sample)?;
        let (frames, complete) = (self.report.frames, self.report.complete);
        let left = self
            .lesson_from
            .filter(|_| self.follower.is_none())
            .map(|from| self.lesson.saturating_sub(sample.captured.saturating_sub(from)).as_secs_f64());
        self.shared.status(|status| {
            status.frames = frames;
            status.complete = complete;
            status.age = epoch.elapsed().saturating_sub(sample.captured);
            status.detail = left.map_or_else(String::new, |left| format!("{left:.1} s to go"));
        });
        Ok(())
    }

    /// The first lesson is over, or the worker has been doing something else for as long as a lesson takes.
    fn learn_when_due(&mut self, sample: &ArmSample) -> Result<(), Error> {
        let shown = self.lesson_from.is_some_and(|from| sample.captured.saturating_sub(from) >= self.lesson);
        if !shown {
            return Ok(());
        }
        if self.follower.is_some() {
            let matched = self.recent.iter().filter(|(_, matched)| *matched).count() as f64;
            if matched >= RETEACH_BELOW * self.recent.len() as f64 {
                return Ok(());
            }
            self.shared.say("teaching    the worker does something else; learning that".to_owned());
        }
        let samples: Vec<ArmSample> = self.recent.iter().map(|(sample, _)| *sample).collect();
        // Whatever comes of it, the next lesson is as long as this one.
        self.lesson_from = Some(sample.captured);
        match Action::learn(&samples, self.cell) {
            Ok(action) => self.adopt(action),
            Err(Error::Follow(error)) => {
                self.shared.say(format!("teaching    nothing learned yet: {error}"));
                Ok(())
            }
            Err(other) => Err(other),
        }
    }

    fn adopt(&mut self, action: Action) -> Result<(), Error> {
        let l = &action.learned;
        let kind = if l.cyclic { "repeating" } else { "one-time" };
        self.shared.say(format!(
            "learned     {kind} action of {:.2} s from {} demonstration(s): {} motion elements, in {:.0} ms",
            l.duration_s, l.demonstrations, l.elements, l.learn_ms
        ));
        // A new action keeps the old correspondence of the worker's and the robot's space.
        let follower = match &self.follower {
            Some(old) => old.with_model(self.cell, action.model.clone())?,
            None => Follower::new(self.cell, action.model.clone())?,
        };
        self.follower = Some(follower);
        self.report.action = Some(action);
        self.shared.status(|status| status.stage = "following");
        Ok(())
    }

    fn metrics(&self, now: Duration) {
        let metric = |name: &str, value: f64, unit: &str| Metric { name: name.into(), value, unit: unit.into() };
        let mut metrics = vec![
            metric("frames", self.report.frames as f64, ""),
            metric("complete_samples", self.report.complete as f64, ""),
        ];
        for (stage, spread) in self.report.latencies.spread() {
            metrics.push(metric(&format!("latency.{stage}.p50"), spread.p50, "ms"));
            metrics.push(metric(&format!("latency.{stage}.p99"), spread.p99, "ms"));
        }
        self.journal.metrics(now, metrics);
    }
}
