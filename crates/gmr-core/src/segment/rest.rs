//! Cuts where the motion rests.

use serde::{Deserialize, Serialize};

use super::{MotionElement, elements_between, ends};
use crate::error::{Error, Result};
use crate::trajectory::Trajectory;

/// When a motion counts as at rest.
///
/// ```
/// use gmr_core::{Error, RestParams, Trajectory, segment_at_rest};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let line = Trajectory::new(vec![0.0, 1.0], vec![0.0, 1.0], 1)?;
/// let refused = segment_at_rest(&line, &RestParams { speed: 0.0, shortest_s: 0.2 });
/// assert_eq!(refused, Err(Error::InvalidParameter { name: "speed", allowed: "(0, inf)", value: 0.0 }));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RestParams {
    /// Speed (norm over all columns, per second) below which the motion rests.
    pub speed: f64,
    /// Shortest element; a rest that would make a shorter one does not cut.
    pub shortest_s: f64,
}

/// Cuts in the middle of each rest, a stretch with speed below the threshold.
///
/// Columns of different units have no common speed: cut the positions ([`Trajectory::select`]) and use
/// the elements on the whole. Rests at the very beginning and end do not cut.
///
/// ```
/// use gmr_core::{RestParams, Trajectory, segment_at_rest};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // 1 - cos(2 pi t) rests at t = 0, 0.5, 1, 1.5, 2.
/// let times: Vec<f64> = (0..=200).map(|i| f64::from(i) * 0.01).collect();
/// let values = times.iter().map(|t| 1.0 - (2.0 * std::f64::consts::PI * t).cos()).collect();
/// let motion = Trajectory::new(times, values, 1)?;
/// let elements = segment_at_rest(&motion, &RestParams { speed: 0.5, shortest_s: 0.2 })?;
/// assert_eq!(elements.len(), 4);
/// assert!((elements[1].start_s - 0.5).abs() < 0.011);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// A threshold that is not positive, or a trajectory of one sample.
pub fn segment_at_rest(trajectory: &Trajectory, params: &RestParams) -> Result<Vec<MotionElement>> {
    for (name, value) in [("speed", params.speed), ("shortest_s", params.shortest_s)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(Error::InvalidParameter { name, allowed: "(0, inf)", value });
        }
    }
    let (start, end) = ends(trajectory)?;
    let times = trajectory.times_s();
    let speeds = trajectory.speeds();
    let mut cuts = Vec::new();
    let mut previous = start;
    let mut i = 0;
    while i < times.len() {
        if speeds[i] >= params.speed {
            i += 1;
            continue;
        }
        let from = i;
        while i < times.len() && speeds[i] < params.speed {
            i += 1;
        }
        let middle = 0.5 * (times[from] + times[i - 1]);
        let inner = from > 0 && i < times.len();
        if inner && middle - previous >= params.shortest_s && end - middle >= params.shortest_s {
            cuts.push(middle);
            previous = middle;
        }
    }
    cuts.push(end);
    Ok(elements_between(start, &cuts))
}
