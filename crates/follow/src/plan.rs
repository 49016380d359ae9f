//! What the vision side hands to the control loop: where the joints should be over the next moments.

use core::time::Duration;

use motion::{Sample, Target};

/// Joint targets from a capture time on, at equal steps. Beyond the last row the control loop's age policy decides.
#[derive(Debug, Clone, PartialEq)]
pub struct JointPlan {
    /// Capture time of the sample this plan rests on: its age is the age of the information.
    pub captured: Duration,
    /// Time between two rows.
    pub step: Duration,
    /// Number of joints.
    pub joints: usize,
    /// `(rows, joints)`, row-major; the first row belongs to `captured`.
    pub rows: Vec<Sample>,
}

impl JointPlan {
    /// The plan as the tracker takes it, `now`.
    pub fn target(&self, now: Duration) -> Target<'_> {
        let (first, horizon) = self.rows.split_at(self.joints.min(self.rows.len()));
        let age_s = now.as_secs_f64() - self.captured.as_secs_f64();
        Target { age_s, joints: first, horizon, horizon_step: self.step }
    }

    /// Where the joints should be at capture time, rad.
    pub fn first_row(&self) -> impl Iterator<Item = f64> + '_ {
        self.rows.iter().take(self.joints).map(|sample| sample.position_rad)
    }
}

impl JointPlan {
    /// Joint positions `elapsed` after the first row: straight lines between rows, the last row beyond them.
    ///
    /// # Panics
    /// On a plan without rows; plans are made with at least one.
    pub fn positions_at(&self, elapsed: Duration) -> Vec<f64> {
        let count = self.rows.len() / self.joints;
        let place = (elapsed.as_secs_f64() / self.step.as_secs_f64()).min((count - 1) as f64);
        let row = place.floor() as usize;
        let next = (row + 1).min(count - 1);
        let share = place - row as f64;
        (0..self.joints)
            .map(|joint| {
                let (a, b) = (&self.rows[row * self.joints + joint], &self.rows[next * self.joints + joint]);
                a.position_rad + share * (b.position_rad - a.position_rad)
            })
            .collect()
    }
}
