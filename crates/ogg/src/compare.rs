//! How well the robot follows: measured joints against what the worker's arm, seen at the same instant, asks for.

use std::collections::VecDeque;
use std::time::Duration;

use follow::{ArmSample, Posture, PostureVector, Retargeter};

use crate::summary::{Comparison, TrackingSums};

/// Measurements that are kept until their picture has been through the network: five seconds at 500 Hz.
const KEPT: usize = 2500;

/// Pairs arm samples with joint measurements.
#[derive(Debug, Clone)]
pub struct Comparator {
    measured: VecDeque<(Duration, Vec<f64>)>,
    following_since: Option<Duration>,
    /// Capture time of the first picture that was compared since the arm began to follow.
    compared_since: Option<Duration>,
    seed: Vec<f64>,
    sums: TrackingSums,
}

impl Comparator {
    /// `home_rad` is where the search for ideal joints begins.
    pub fn new(home_rad: &[f64]) -> Self {
        Self {
            measured: VecDeque::with_capacity(KEPT),
            following_since: None,
            compared_since: None,
            seed: home_rad.to_vec(),
            sums: TrackingSums::default(),
        }
    }

    /// Takes measured joints, in order of time; `following` is whether the arm was following then.
    pub fn measure(&mut self, at: Duration, joints_rad: Vec<f64>, following: bool) {
        match (following, self.following_since) {
            (true, None) => self.following_since = Some(at),
            (false, Some(_)) => {
                self.following_since = None;
                self.compared_since = None;
                self.measured.clear();
            }
            _ => {}
        }
        if !following || self.measured.back().is_some_and(|(last, _)| *last >= at) {
            return;
        }
        if self.measured.len() == KEPT {
            self.measured.pop_front();
        }
        self.measured.push_back((at, joints_rad));
    }

    /// Compares with the worker as seen at the sample's capture time. Nothing is added where the arm was not following
    /// then, or a joint of the worker was lost.
    pub fn compare(&mut self, sample: &ArmSample, retargeter: &Retargeter) -> Option<Comparison> {
        let posture = Posture::of(sample).filter(|_| sample.is_complete())?;
        self.following_since.filter(|since| *since <= sample.captured)?;
        let joints = self.joints_at(sample.captured)?;
        let first = *self.compared_since.get_or_insert(sample.captured);
        let wanted_tool = retargeter.ideal(&PostureVector::from(posture.row()), &mut self.seed);
        let tool = retargeter.world_from_tool(&joints).translation.vector;
        let comparison = Comparison {
            since_s: sample.captured.saturating_sub(first).as_secs_f64(),
            joint_error_rad: joints.iter().zip(&self.seed).map(|(have, want)| have - want).collect(),
            tool_error_m: [tool.x - wanted_tool.x, tool.y - wanted_tool.y, tool.z - wanted_tool.z],
        };
        self.sums.add(&comparison);
        Some(comparison)
    }

    /// The sums so far.
    pub fn sums(&self) -> &TrackingSums {
        &self.sums
    }

    /// Measured joints at a time between two measurements, on the straight line between them.
    fn joints_at(&self, at: Duration) -> Option<Vec<f64>> {
        let after = self.measured.partition_point(|(time, _)| *time < at);
        let (right_at, right) = self.measured.get(after)?;
        let Some((left_at, left)) = after.checked_sub(1).and_then(|i| self.measured.get(i)) else {
            return (*right_at == at).then(|| right.clone());
        };
        let share = (at - *left_at).as_secs_f64() / (*right_at - *left_at).as_secs_f64();
        Some(left.iter().zip(right).map(|(a, b)| a + share * (b - a)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(value: u64) -> Duration {
        Duration::from_millis(value)
    }

    #[test]
    fn joints_between_two_measurements_lie_on_their_line() {
        let mut comparator = Comparator::new(&[0.0]);
        comparator.measure(ms(0), vec![0.0], true);
        comparator.measure(ms(10), vec![1.0], true);
        assert_eq!(comparator.joints_at(ms(4)), Some(vec![0.4]));
        assert_eq!(comparator.joints_at(ms(11)), None);
    }

    #[test]
    fn a_pause_in_following_forgets_what_was_before() {
        let mut comparator = Comparator::new(&[0.0]);
        comparator.measure(ms(0), vec![0.0], true);
        comparator.measure(ms(10), vec![1.0], true);
        comparator.measure(ms(20), vec![1.0], false);
        assert_eq!(comparator.joints_at(ms(4)), None);
    }
}
