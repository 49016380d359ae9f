//! Cuts where a piecewise straight line bends.

use serde::{Deserialize, Serialize};

use super::{MotionElement, elements_between};
use crate::error::{Error, Result};
use crate::trajectory::Trajectory;

/// How change points are found.
///
/// ```
/// use gmr_core::{ChangePointParams, Trajectory, segment_change_points};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let times: Vec<f64> = (0..=20).map(f64::from).collect();
/// let bent = Trajectory::new(times.clone(), times.iter().map(|t| (t - 10.0).abs()).collect(), 1)?;
/// // A cut that costs more than the bend explains is not made.
/// let params = ChangePointParams { sigma: 1.0, penalty: Some(1e6), shortest: 3 };
/// assert_eq!(segment_change_points(&bent, &params)?.len(), 1);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChangePointParams {
    /// Standard deviation of the measurement noise, one for all columns.
    pub sigma: f64,
    /// Cost of one more element, in units of twice the log-likelihood. With `None`, Schwarz' criterion:
    /// `(2 d + 1) ln n`, two numbers per column and the place of the cut.
    pub penalty: Option<f64>,
    /// Fewest samples of an element, at least 3.
    pub shortest: usize,
}

/// Cuts where a piecewise straight line explains the motion best.
///
/// Minimises `sum over elements of (squared residuals of a straight line per column) / sigma^2 + penalty`
/// exactly, by dynamic programming with the pruning of Killick, Fearnhead and Eckley (2012); each
/// element's cost comes from running sums in O(d). Cuts fall halfway between two samples.
///
/// ```
/// use gmr_core::{ChangePointParams, Trajectory, segment_change_points};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // Down for a second, then up.
/// let times: Vec<f64> = (0..=40).map(|i| f64::from(i) * 0.05).collect();
/// let values = times.iter().map(|t| (t - 1.0).abs()).collect();
/// let params = ChangePointParams { sigma: 0.01, penalty: Some(10.0), shortest: 3 };
/// let elements = segment_change_points(&Trajectory::new(times, values, 1)?, &params)?;
/// assert_eq!(elements.len(), 2);
/// assert!((elements[0].end_s - 1.0).abs() < 0.051);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// A `sigma` or penalty that is not positive, fewer samples than one element needs, or residuals whose squares over
/// `sigma^2` are no numbers.
pub fn segment_change_points(trajectory: &Trajectory, params: &ChangePointParams) -> Result<Vec<MotionElement>> {
    let (n, d) = (trajectory.len(), trajectory.dim());
    let penalty = params.penalty.unwrap_or((2.0 * d as f64 + 1.0) * (n as f64).ln());
    for (name, value) in [("sigma", params.sigma), ("penalty", penalty)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(Error::InvalidParameter { name, allowed: "(0, inf)", value });
        }
    }
    if params.shortest < 3 {
        return Err(Error::InvalidParameter { name: "shortest", allowed: "at least 3", value: params.shortest as f64 });
    }
    if n < params.shortest {
        return Err(Error::TooFewSamples { what: "change points", needed: params.shortest, got: n });
    }
    let sums = LineSums::new(trajectory);
    let precision = 1.0 / (params.sigma * params.sigma);
    if !precision.is_finite() {
        return Err(Error::InvalidParameter { name: "sigma", allowed: "above 1e-154", value: params.sigma });
    }
    let mut best = vec![f64::INFINITY; n + 1];
    let mut last = vec![0; n + 1];
    best[0] = -penalty;
    let mut alive: Vec<usize> = vec![0];
    for to in params.shortest..=n {
        let mut costs = Vec::with_capacity(alive.len());
        for &from in &alive {
            let cost = best[from] + precision * sums.residual(from, to);
            costs.push(cost);
            if cost + penalty < best[to] {
                best[to] = cost + penalty;
                last[to] = from;
            }
        }
        // A start that is worse than the best by more than a penalty can never win later.
        let mut cost = costs.iter();
        alive.retain(|_| cost.next().is_some_and(|c| *c <= best[to]));
        alive.push(to + 1 - params.shortest);
    }
    if !best[n].is_finite() {
        let what = "squared residuals in units of sigma";
        return Err(Error::OutOfRange { what, index: 0, value: best[n], limit: f64::MAX });
    }
    let mut cuts = Vec::new();
    let mut to = n;
    while last[to] > 0 {
        to = last[to];
        cuts.push(0.5 * (trajectory.times_s()[to - 1] + trajectory.times_s()[to]));
    }
    cuts.reverse();
    cuts.push(trajectory.end_s());
    Ok(elements_between(trajectory.start_s(), &cuts))
}

/// Running sums that give the squared residual of a straight line over any stretch.
struct LineSums {
    dim: usize,
    /// `(n + 1)` rows of `[sum t, sum t^2]` and per column `[sum y, sum t y, sum y^2]`.
    rows: Vec<f64>,
}

impl LineSums {
    fn new(trajectory: &Trajectory) -> Self {
        let (n, dim) = (trajectory.len(), trajectory.dim());
        let stride = 2 + 3 * dim;
        let middle = 0.5 * (trajectory.start_s() + trajectory.end_s());
        let means: Vec<f64> = (0..dim).map(|c| trajectory.column(c).iter().sum::<f64>() / n as f64).collect();
        let mut rows = vec![0.0; stride];
        for i in 0..n {
            let t = trajectory.times_s()[i] - middle;
            let at = rows.len() - stride;
            let mut row = rows[at..].to_vec();
            row[0] += t;
            row[1] += t * t;
            for (c, v) in trajectory.row(i).iter().enumerate() {
                let y = v - means[c];
                row[2 + 3 * c] += y;
                row[3 + 3 * c] += t * y;
                row[4 + 3 * c] += y * y;
            }
            rows.extend(row);
        }
        Self { dim, rows }
    }

    fn residual(&self, from: usize, to: usize) -> f64 {
        let stride = 2 + 3 * self.dim;
        let (a, b) = (&self.rows[from * stride..(from + 1) * stride], &self.rows[to * stride..(to + 1) * stride]);
        let n = (to - from) as f64;
        let (t, tt) = (b[0] - a[0], b[1] - a[1]);
        let spread = tt - t * t / n;
        (0..self.dim)
            .map(|c| {
                let i = 2 + 3 * c;
                let (y, ty, yy) = (b[i] - a[i], b[i + 1] - a[i + 1], b[i + 2] - a[i + 2]);
                let slope = ty - t * y / n;
                (yy - y * y / n - slope * slope / spread).max(0.0)
            })
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_makes_no_residual_negative() {
        // An exactly straight motion: every residual is rounding, of either sign before it is cut off.
        let times: Vec<f64> = (0..80).map(|i| f64::from(i) * 0.1).collect();
        let values = times.iter().map(|t| 1e3 * t).collect();
        let sums = LineSums::new(&Trajectory::new(times, values, 1).unwrap());
        for from in 0..77 {
            for to in from + 3..=80 {
                let residual = sums.residual(from, to);
                assert!((0.0..1e-4).contains(&residual), "{from} {to}: {residual:e}");
            }
        }
    }
}
