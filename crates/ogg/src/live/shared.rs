//! What the threads share, and the signals that end them.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use arc_swap::ArcSwapOption;
use follow::{JointPlan, Phase};

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
pub(super) struct Status {
    lines: VecDeque<String>,
    pub(super) stage: &'static str,
    pub(super) detail: String,
    pub(super) frames: u64,
    pub(super) complete: u64,
    pub(super) age: Duration,
    pub(super) joint_error_rad: f64,
    pub(super) tool_error_mm: f64,
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
    pub(super) phase: Mutex<Option<Phase>>,
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

    pub(super) fn status(&self, change: impl FnOnce(&mut Status)) {
        change(&mut self.status.lock().unwrap_or_else(PoisonError::into_inner));
    }

    pub(super) fn say(&self, line: String) {
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
