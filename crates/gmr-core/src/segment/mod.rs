//! Cutting a demonstration into motion elements: by fixed period, at rest, or where the motion changes.

mod change_points;
mod rest;
#[cfg(test)]
mod tests;

use std::ops::Range;

use serde::{Deserialize, Serialize};

pub use change_points::{ChangePointParams, segment_change_points};
pub use rest::{RestParams, segment_at_rest};

use crate::error::{Error, Result};
use crate::trajectory::Trajectory;

/// A piece of a demonstration between two boundaries.
///
/// ```
/// let element = gmr_core::MotionElement { start_s: 0.5, end_s: 2.0 };
/// assert_eq!(element.duration_s(), 1.5);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MotionElement {
    /// Where it begins, on the demonstration's clock.
    pub start_s: f64,
    /// Where it ends.
    pub end_s: f64,
}

impl MotionElement {
    /// Its length.
    ///
    /// ```
    /// assert_eq!(gmr_core::MotionElement { start_s: 0.5, end_s: 2.0 }.duration_s(), 1.5);
    /// ```
    pub fn duration_s(&self) -> f64 {
        self.end_s - self.start_s
    }

    /// Indices of the samples within `margin_s` of the element.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// let element = gmr_core::MotionElement { start_s: 6.0, end_s: 7.0 };
    /// assert_eq!((element.range(&motion, 0.0), element.range(&motion, 1.0)), (1..2, 0..3));
    /// # Ok(())
    /// # }
    /// ```
    pub fn range(&self, trajectory: &Trajectory, margin_s: f64) -> Range<usize> {
        let times = trajectory.times_s();
        // Half a nanosecond absorbs the rounding of `i * period` against the sample clock.
        let from = times.partition_point(|&t| t < self.start_s - margin_s - 5e-10);
        let to = times.partition_point(|&t| t <= self.end_s + margin_s + 5e-10);
        from..to.max(from)
    }

    /// Rows `(t - start, h)` of the samples within `margin_s` of the element, `(m, 1 + d)`.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// let element = gmr_core::MotionElement { start_s: 5.5, end_s: 7.0 };
    /// assert_eq!(element.samples(&motion, 0.0), [0.5, 3.0, 4.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn samples(&self, trajectory: &Trajectory, margin_s: f64) -> Vec<f64> {
        let range = self.range(trajectory, margin_s);
        let mut rows = Vec::with_capacity(range.len() * (trajectory.dim() + 1));
        for i in range {
            rows.push(trajectory.times_s()[i] - self.start_s);
            rows.extend_from_slice(trajectory.row(i));
        }
        rows
    }
}

/// Cuts at multiples of `period_s` from the first sample (paper: 1000 ms). A remainder shorter than
/// half a period joins the last element; a longer one becomes an element of its own.
///
/// ```
/// use gmr_core::{Trajectory, segment_fixed};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let times: Vec<f64> = (0..=23).map(|i| f64::from(i) * 0.1).collect();
/// let line = Trajectory::new(times.clone(), times, 1)?;
/// let elements = segment_fixed(&line, 1.0)?;
/// assert_eq!(elements.len(), 2);
/// assert!((elements[1].end_s - 2.3).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// A period that is not positive and finite, a trajectory of one sample, or more elements than intervals between
/// samples.
pub fn segment_fixed(trajectory: &Trajectory, period_s: f64) -> Result<Vec<MotionElement>> {
    if !(period_s > 0.0 && period_s.is_finite()) {
        return Err(Error::InvalidParameter { name: "period_s", allowed: "(0, inf)", value: period_s });
    }
    let (start, end) = ends(trajectory)?;
    let count = ((end - start) / period_s + 0.5).floor() as usize;
    if count >= trajectory.len() {
        let needed = count.saturating_add(1);
        return Err(Error::TooFewSamples { what: "segmentation by fixed period", needed, got: trajectory.len() });
    }
    let mut cuts: Vec<f64> = (1..count).map(|i| (i as f64).mul_add(period_s, start)).collect();
    cuts.push(end);
    Ok(elements_between(start, &cuts))
}

fn ends(trajectory: &Trajectory) -> Result<(f64, f64)> {
    if trajectory.len() < 2 {
        return Err(Error::TooFewSamples { what: "segmentation", needed: 2, got: trajectory.len() });
    }
    Ok((trajectory.start_s(), trajectory.end_s()))
}

fn elements_between(start: f64, cuts: &[f64]) -> Vec<MotionElement> {
    let mut from = start;
    cuts.iter()
        .map(|&to| {
            let element = MotionElement { start_s: from, end_s: to };
            from = to;
            element
        })
        .collect()
}
