//! Vision: picture by picture from the camera to a plan, and the lessons between.

use std::collections::VecDeque;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;
use follow::ArmSample;

use super::{Measured, Shared};
use crate::brain::{Action, Follower};
use crate::capture::{End, FrameSet, Latest, Wait};
use crate::cell::Cell;
use crate::compare::Comparator;
use crate::error::Error;
use crate::journal::Journal;
use crate::record::Metric;
use crate::summary::{Latencies, Tracking};
use crate::vision::Vision;

/// Metrics are recorded this often.
const METRICS_EVERY: Duration = Duration::from_millis(500);
/// Share of recent samples below which the model no longer fits what the worker does.
const RETEACH_BELOW: f64 = 0.2;

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
