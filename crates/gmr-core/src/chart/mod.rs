//! Angles and orientations on their manifold.
//!
//! A mixture lives in a flat space. A [`Chart`] takes demonstrations there and predictions back: angles
//! are unwrapped along the motion and laid on the turn nearest to a centre; orientations go through the
//! logarithm at a centre, `v = log(c^-1 q)`, a rotation vector in radians, likewise continued along the
//! motion. The way back is wrapping and `q = c exp(v)`; it cannot leave the manifold. Nothing happens at
//! `+-pi`: neighbouring samples stay neighbours.

mod map;
#[cfg(test)]
mod tests;
mod turn;

use serde::{Deserialize, Serialize};

pub use turn::{unwrap_rad, wrap_rad};

use self::turn::{mean_rotation, unit};
use crate::error::{Error, Result, check_len};
use crate::trajectory::Trajectory;

/// What a column, or a group of columns, of a demonstration is.
///
/// ```
/// use gmr_core::{Chart, Coordinate, CoordinateKind, Trajectory};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let motion = Trajectory::new(vec![0.0, 1.0], vec![7.0, 0.25, 8.0, 0.75], 2)?;
/// let chart = Chart::fit(&[CoordinateKind::Linear, CoordinateKind::Angle], &[motion])?;
/// let Coordinate::Angle { centre_rad } = chart.coordinates()[1] else { panic!() };
/// assert!((centre_rad - 0.5).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CoordinateKind {
    /// One column on a line.
    Linear,
    /// One column in radians on a circle.
    Angle,
    /// Four columns `(w, x, y, z)`: a unit quaternion of either sign, used with length one when it is within 0.001 of
    /// it; three columns in the chart.
    Rotation,
}

/// A coordinate with the point its chart is centred on.
///
/// ```
/// use gmr_core::{Chart, Coordinate};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let chart = Chart::new(vec![Coordinate::Angle { centre_rad: 3.0 }])?;
/// let mut back = [0.0];
/// chart.decode_into(&[4.0], &mut back)?;
/// assert!((back[0] - (4.0 - std::f64::consts::TAU)).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Coordinate {
    /// On a line.
    Linear,
    /// On a circle.
    Angle {
        /// Centre in radians.
        centre_rad: f64,
    },
    /// An orientation.
    Rotation {
        /// Centre, a unit quaternion `(w, x, y, z)`.
        centre: [f64; 4],
    },
}

/// The flat coordinates of a set of demonstrations. Checked again when read back.
///
/// ```
/// use gmr_core::{Chart, CoordinateKind, Trajectory};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // An angle that passes through pi: 3.1 rad, then -3.1 rad, which is 3.183 rad.
/// let motion = Trajectory::new(vec![0.0, 1.0], vec![3.1, -3.1], 1)?;
/// let chart = Chart::fit(&[CoordinateKind::Angle], std::slice::from_ref(&motion))?;
/// let flat = chart.encode(&motion)?;
/// assert!((flat.values()[1] - flat.values()[0] - 0.083_185_307).abs() < 1e-9);
/// let mut back = [0.0];
/// chart.decode_into(flat.row(1), &mut back)?;
/// assert!((back[0] + 3.1).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Unchecked")]
pub struct Chart {
    coordinates: Vec<Coordinate>,
}

/// A chart as a file holds it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Unchecked {
    coordinates: Vec<Coordinate>,
}

impl TryFrom<Unchecked> for Chart {
    type Error = Error;

    fn try_from(file: Unchecked) -> Result<Self> {
        Self::new(file.coordinates)
    }
}

impl CoordinateKind {
    fn columns(self) -> usize {
        if self == Self::Rotation { 4 } else { 1 }
    }
}

impl Chart {
    /// A chart with given centres.
    ///
    /// ```
    /// use gmr_core::{Chart, Coordinate, Error};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// assert!(matches!(Chart::new(vec![]), Err(Error::TooFewSamples { needed: 1, .. })));
    /// assert_eq!(Chart::new(vec![Coordinate::Linear])?.columns(), 1);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// No coordinate, a centre that is not finite, or a quaternion that is not of length one.
    pub fn new(mut coordinates: Vec<Coordinate>) -> Result<Self> {
        if coordinates.is_empty() {
            return Err(Error::TooFewSamples { what: "chart coordinates", needed: 1, got: 0 });
        }
        for coordinate in &mut coordinates {
            match coordinate {
                Coordinate::Linear => {}
                Coordinate::Angle { centre_rad } if centre_rad.is_finite() => {}
                Coordinate::Angle { centre_rad } => {
                    return Err(Error::NotFinite { what: "chart centre", index: 0, value: *centre_rad });
                }
                Coordinate::Rotation { centre } => *centre = unit(centre)?,
            }
        }
        Ok(Self { coordinates })
    }

    /// Centres each angle and orientation on the mean of all demonstrations (circular mean; Karcher
    /// mean by repeated logarithms).
    ///
    /// ```
    /// use gmr_core::{Chart, Coordinate, CoordinateKind, Trajectory};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// // The mean of 3 rad and -3 rad is a half turn.
    /// let motion = Trajectory::new(vec![0.0, 1.0], vec![3.0, -3.0], 1)?;
    /// let chart = Chart::fit(&[CoordinateKind::Angle], &[motion])?;
    /// let Coordinate::Angle { centre_rad } = chart.coordinates()[0] else { panic!() };
    /// assert!((centre_rad.abs() - std::f64::consts::PI).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// No demonstration, columns that do not match `kinds`, or quaternions not of length one.
    pub fn fit(kinds: &[CoordinateKind], demonstrations: &[Trajectory]) -> Result<Self> {
        if demonstrations.is_empty() {
            return Err(Error::TooFewSamples { what: "demonstrations", needed: 1, got: 0 });
        }
        let columns: usize = kinds.iter().map(|k| k.columns()).sum();
        for demonstration in demonstrations {
            check_len("chart columns", columns, demonstration.dim())?;
        }
        let rows = || demonstrations.iter().flat_map(|d| (0..d.len()).map(move |i| d.row(i)));
        let mut at = 0;
        let mut coordinates = Vec::with_capacity(kinds.len());
        for kind in kinds {
            coordinates.push(match kind {
                CoordinateKind::Linear => Coordinate::Linear,
                CoordinateKind::Angle => {
                    let (sine, cosine) = rows().fold((0.0, 0.0), |(s, c), r| (s + r[at].sin(), c + r[at].cos()));
                    Coordinate::Angle { centre_rad: f64::atan2(sine, cosine) }
                }
                CoordinateKind::Rotation => {
                    let all = rows().map(|r| unit(&r[at..at + 4])).collect::<Result<Vec<_>>>()?;
                    Coordinate::Rotation { centre: mean_rotation(&all) }
                }
            });
            at += kind.columns();
        }
        Self::new(coordinates)
    }

    /// The coordinates with their centres.
    ///
    /// ```
    /// use gmr_core::{Chart, Coordinate};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// assert_eq!(Chart::new(vec![Coordinate::Linear])?.coordinates(), [Coordinate::Linear]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn coordinates(&self) -> &[Coordinate] {
        &self.coordinates
    }

    /// Columns of a demonstration.
    ///
    /// ```
    /// use gmr_core::{Chart, Coordinate};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// assert_eq!(Chart::new(vec![Coordinate::Rotation { centre: [1.0, 0.0, 0.0, 0.0] }])?.columns(), 4);
    /// # Ok(())
    /// # }
    /// ```
    pub fn columns(&self) -> usize {
        self.coordinates.iter().map(|c| if matches!(c, Coordinate::Rotation { .. }) { 4 } else { 1 }).sum()
    }

    /// Columns in the chart.
    ///
    /// ```
    /// use gmr_core::{Chart, Coordinate};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let chart = Chart::new(vec![Coordinate::Linear, Coordinate::Rotation { centre: [1.0, 0.0, 0.0, 0.0] }])?;
    /// assert_eq!((chart.columns(), chart.flat_columns()), (5, 4));
    /// # Ok(())
    /// # }
    /// ```
    pub fn flat_columns(&self) -> usize {
        self.coordinates.iter().map(|c| if matches!(c, Coordinate::Rotation { .. }) { 3 } else { 1 }).sum()
    }
}
