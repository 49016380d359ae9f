//! A demonstration: strictly increasing times with one row of values each.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, check_len, check_values};

/// The numbers of a [`Trajectory`], as stored.
///
/// ```
/// use gmr_core::{Trajectory, TrajectoryParts};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let parts = TrajectoryParts { dim: 1, times_s: vec![0.0, 1.0], values: vec![2.0, 4.0] };
/// assert_eq!(Trajectory::try_from(parts)?.end_s(), 1.0);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryParts {
    /// Columns per row.
    pub dim: usize,
    /// Times in seconds, strictly increasing, `(n)`.
    pub times_s: Vec<f64>,
    /// Values `(n, dim)` row-major.
    pub values: Vec<f64>,
}

/// One demonstration: times in seconds and values `h: (n, d)`, row-major.
///
/// ```
/// # fn main() -> Result<(), gmr_core::Error> {
/// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
/// assert_eq!((motion.len(), motion.dim(), motion.end_s()), (3, 2, 7.5));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "TrajectoryParts", into = "TrajectoryParts")]
pub struct Trajectory {
    parts: TrajectoryParts,
}

impl TryFrom<TrajectoryParts> for Trajectory {
    type Error = Error;

    fn try_from(parts: TrajectoryParts) -> Result<Self> {
        Self::new(parts.times_s, parts.values, parts.dim)
    }
}

impl From<Trajectory> for TrajectoryParts {
    fn from(trajectory: Trajectory) -> Self {
        trajectory.parts
    }
}

impl Trajectory {
    /// Checks times and values.
    ///
    /// ```
    /// use gmr_core::{Error, Trajectory};
    /// let standing = Trajectory::new(vec![1.0, 1.0], vec![0.0, 0.0], 1);
    /// assert_eq!(standing, Err(Error::TimeNotIncreasing { index: 1, time_s: 1.0, previous_s: 1.0 }));
    /// ```
    ///
    /// # Errors
    /// Empty, lengths that do not match, values that are not finite, times that do not increase.
    pub fn new(times_s: Vec<f64>, values: Vec<f64>, dim: usize) -> Result<Self> {
        if dim == 0 || times_s.is_empty() {
            return Err(Error::TooFewSamples { what: "trajectory", needed: 1, got: 0 });
        }
        check_len("trajectory values", times_s.len() * dim, values.len())?;
        check_values("trajectory times", &times_s)?;
        check_values("trajectory values", &values)?;
        for (index, pair) in times_s.windows(2).enumerate() {
            if !(pair[1] > pair[0]) {
                return Err(Error::TimeNotIncreasing { index: index + 1, time_s: pair[1], previous_s: pair[0] });
            }
        }
        Ok(Self { parts: TrajectoryParts { dim, times_s, values } })
    }

    /// Number of samples `n`.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// assert_eq!(motion.len(), 3);
    /// # Ok(())
    /// # }
    /// ```
    pub fn len(&self) -> usize {
        self.parts.times_s.len()
    }

    /// Never true: a trajectory has at least one sample.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// assert!(!motion.is_empty());
    /// # Ok(())
    /// # }
    /// ```
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Columns per row `d`.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// assert_eq!(motion.dim(), 2);
    /// # Ok(())
    /// # }
    /// ```
    pub fn dim(&self) -> usize {
        self.parts.dim
    }

    /// Times in seconds.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// assert_eq!(motion.times_s(), [5.0, 6.0, 7.5]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn times_s(&self) -> &[f64] {
        &self.parts.times_s
    }

    /// Values, row-major.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// assert_eq!(motion.values()[..2], [1.0, 2.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn values(&self) -> &[f64] {
        &self.parts.values
    }

    /// One row, `(d)`.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// assert_eq!(motion.row(1), [3.0, 4.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn row(&self, index: usize) -> &[f64] {
        &self.parts.values[index * self.parts.dim..(index + 1) * self.parts.dim]
    }

    /// Time of the first sample.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// assert_eq!(motion.start_s(), 5.0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn start_s(&self) -> f64 {
        self.parts.times_s[0]
    }

    /// Time of the last sample.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// assert_eq!(motion.end_s(), 7.5);
    /// # Ok(())
    /// # }
    /// ```
    pub fn end_s(&self) -> f64 {
        self.parts.times_s[self.len() - 1]
    }

    /// The same trajectory with its clock starting at zero.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let late = gmr_core::Trajectory::new(vec![5.0, 6.0], vec![2.0, 4.0], 1)?;
    /// assert_eq!(late.from_zero().times_s(), [0.0, 1.0]);
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn from_zero(&self) -> Self {
        let start = self.start_s();
        let mut parts = self.parts.clone();
        parts.times_s.iter_mut().for_each(|t| *t -= start);
        Self { parts }
    }

    /// The same trajectory with only some columns, in the given order.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// assert_eq!(motion.select(&[1])?.values(), [2.0, 4.0, 6.0]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// An empty list, or a column out of bounds or listed twice.
    pub fn select(&self, columns: &[usize]) -> Result<Self> {
        crate::gmm::check_dimensions("trajectory columns", columns, self.dim())?;
        let values = (0..self.len()).flat_map(|i| columns.iter().map(move |&c| self.row(i)[c])).collect();
        Self::new(self.parts.times_s.clone(), values, columns.len())
    }

    /// One column, `(n)`. Panics, as [`Self::row`] does, when there is no such.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
    /// assert_eq!(motion.column(0), [1.0, 3.0, 5.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn column(&self, column: usize) -> Vec<f64> {
        self.parts.values.chunks_exact(self.parts.dim).map(|row| row[column]).collect()
    }

    /// Linear interpolation at `time_s`, clamped to the ends, into `out: (d)`.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let line = gmr_core::Trajectory::new(vec![0.0, 1.0], vec![2.0, 4.0], 1)?;
    /// let mut out = [0.0];
    /// line.interpolate_into(0.25, &mut out)?;
    /// assert!((out[0] - 2.5).abs() < 1e-15);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// A time that is not finite, or an `out` of another length.
    pub fn interpolate_into(&self, time_s: f64, out: &mut [f64]) -> Result<()> {
        check_len("interpolated row", self.dim(), out.len())?;
        if !time_s.is_finite() {
            return Err(Error::NotFinite { what: "time_s", index: 0, value: time_s });
        }
        let times = self.times_s();
        let after = times.partition_point(|&t| t <= time_s);
        if after == 0 || after == times.len() {
            let row = if after == 0 { 0 } else { after - 1 };
            out.copy_from_slice(self.row(row));
            return Ok(());
        }
        let share = (time_s - times[after - 1]) / (times[after] - times[after - 1]);
        for ((o, a), b) in out.iter_mut().zip(self.row(after - 1)).zip(self.row(after)) {
            *o = share.mul_add(b - a, *a);
        }
        Ok(())
    }

    /// Speed (norm of the central difference, one-sided at the ends) of each sample, `(n)`.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let line = gmr_core::Trajectory::new(vec![0.0, 1.0, 2.0], vec![0.0, 3.0, 6.0], 1)?;
    /// assert!(line.speeds().iter().all(|v| (v - 3.0).abs() < 1e-15));
    /// # Ok(())
    /// # }
    /// ```
    pub fn speeds(&self) -> Vec<f64> {
        let n = self.len();
        (0..n)
            .map(|i| {
                let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
                if a == b {
                    return 0.0;
                }
                let dt = self.times_s()[b] - self.times_s()[a];
                let squares: f64 = self.row(a).iter().zip(self.row(b)).map(|(a, b)| (b - a) * (b - a)).sum();
                squares.sqrt() / dt
            })
            .collect()
    }
}
