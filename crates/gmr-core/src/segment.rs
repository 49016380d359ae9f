//! Cutting a demonstration into motion elements: by fixed period, at rest, or where the motion changes.

use std::ops::Range;

use serde::{Deserialize, Serialize};

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
/// A period that is not positive and finite, or a trajectory of one sample.
pub fn segment_fixed(trajectory: &Trajectory, period_s: f64) -> Result<Vec<MotionElement>> {
    if !(period_s > 0.0 && period_s.is_finite()) {
        return Err(Error::InvalidParameter { name: "period_s", allowed: "(0, inf)", value: period_s });
    }
    let (start, end) = ends(trajectory)?;
    let count = (((end - start) / period_s + 0.5).floor() as usize).max(1);
    let mut cuts: Vec<f64> = (1..count).map(|i| (i as f64).mul_add(period_s, start)).collect();
    cuts.push(end);
    Ok(elements_between(start, &cuts))
}

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
/// A `sigma` or penalty that is not positive, or fewer samples than one element needs.
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
        let opening = to + 1 - params.shortest;
        if opening >= params.shortest {
            alive.push(opening);
        }
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

#[cfg(test)]
mod tests {
    #![expect(clippy::float_cmp, reason = "these results are exact")]
    use super::*;

    fn zigzag(n: usize, corners: &[usize]) -> Trajectory {
        let mut slope = 1.0;
        let mut y = 0.0;
        let values = (0..n)
            .map(|i| {
                if corners.contains(&i) {
                    slope = -slope;
                }
                y += 0.1 * slope;
                // A deterministic ripple stands in for noise of deviation 0.01.
                y + 0.014 * (i as f64 * 2.4).sin()
            })
            .collect();
        Trajectory::new((0..n).map(|i| i as f64 * 0.1).collect(), values, 1).unwrap()
    }

    #[test]
    fn change_points_equal_the_exhaustive_search() {
        let motion = zigzag(16, &[6, 11]);
        let params = ChangePointParams { sigma: 0.01, penalty: None, shortest: 3 };
        let found = segment_change_points(&motion, &params).unwrap();
        let line = |from: usize, to: usize| {
            // Straight line by the textbook sums, independent of the running ones.
            let t = &motion.times_s()[from..to];
            let y = &motion.values()[from..to];
            let n = t.len() as f64;
            let (mt, my) = (t.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
            let b = t.iter().zip(y).map(|(t, y)| (t - mt) * (y - my)).sum::<f64>()
                / t.iter().map(|t| (t - mt) * (t - mt)).sum::<f64>();
            t.iter().zip(y).map(|(t, y)| (y - my - b * (t - mt)).powi(2)).sum::<f64>()
        };
        let penalty = 3.0 * 16f64.ln();
        let mut best = (f64::INFINITY, vec![]);
        for mask in 0u32..1 << 15 {
            let mut edges = vec![0];
            edges.extend((1..16).filter(|i| mask & (1 << (i - 1)) != 0));
            edges.push(16);
            if edges.windows(2).any(|e| e[1] - e[0] < 3) {
                continue;
            }
            let cost: f64 = edges.windows(2).map(|e| line(e[0], e[1]) / 1e-4 + penalty).sum();
            if cost < best.0 {
                best = (cost, edges);
            }
        }
        let cuts: Vec<f64> = best.1[1..best.1.len() - 1].iter().map(|&i| (i as f64 - 0.5) * 0.1).collect();
        assert_eq!(found.len(), cuts.len() + 1);
        for (element, cut) in found.iter().zip(&cuts) {
            assert!((element.end_s - cut).abs() < 1e-12);
        }
        assert!(found.len() >= 3);
    }

    #[test]
    fn a_straight_motion_has_no_change_point_and_no_rest() {
        let motion = zigzag(50, &[]);
        let params = ChangePointParams { sigma: 0.01, penalty: None, shortest: 5 };
        assert_eq!(segment_change_points(&motion, &params).unwrap().len(), 1);
        assert_eq!(segment_at_rest(&motion, &RestParams { speed: 0.1, shortest_s: 0.5 }).unwrap().len(), 1);
    }

    #[test]
    fn fixed_periods_cover_the_motion_without_gaps() {
        for n in [2, 11, 14, 15, 16, 26, 101] {
            let motion = zigzag(n, &[]);
            let elements = segment_fixed(&motion, 1.0).unwrap();
            assert!(elements[0].start_s == motion.start_s());
            assert!(elements[elements.len() - 1].end_s == motion.end_s());
            assert!(elements.windows(2).all(|e| e[0].end_s == e[1].start_s));
            assert!(elements.len() == 1 || elements.iter().all(|e| e.duration_s() > 0.49 && e.duration_s() < 1.5));
        }
    }
}
