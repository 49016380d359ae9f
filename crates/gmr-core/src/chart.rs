//! Angles and orientations on their manifold.
//!
//! A mixture lives in a flat space. A [`Chart`] takes demonstrations there and predictions back: angles
//! are unwrapped along the motion and laid on the turn nearest to a centre; orientations go through the
//! logarithm at a centre, `v = log(c^-1 q)`, a rotation vector in radians, likewise continued along the
//! motion. The way back is wrapping and `q = c exp(v)`; it cannot leave the manifold. Nothing happens at
//! `+-pi`: neighbouring samples stay neighbours.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

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
    /// Four columns `(w, x, y, z)`: a unit quaternion; three columns in the chart.
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

/// The flat coordinates of a set of demonstrations.
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
pub struct Chart {
    coordinates: Vec<Coordinate>,
}

/// The angle in `(-pi, pi]` that differs from `angle_rad` by whole turns.
///
/// ```
/// assert!((gmr_core::wrap_rad(3.5) + 2.783_185_307_179_586).abs() < 1e-15);
/// ```
pub fn wrap_rad(angle_rad: f64) -> f64 {
    let turned = angle_rad - TAU * (angle_rad / TAU).round();
    if turned <= -PI { turned + TAU } else { turned }
}

/// Adds whole turns so that no step exceeds half a turn.
///
/// ```
/// let mut angles = [3.0, -3.0];
/// gmr_core::unwrap_rad(&mut angles);
/// assert!((angles[1] - 3.283_185_307_179_586).abs() < 1e-15);
/// ```
pub fn unwrap_rad(angles_rad: &mut [f64]) {
    for i in 1..angles_rad.len() {
        let previous = angles_rad[i - 1];
        angles_rad[i] = previous + wrap_rad(angles_rad[i] - previous);
    }
}

/// Product of two quaternions `(w, x, y, z)`.
fn multiply(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

fn conjugate(q: [f64; 4]) -> [f64; 4] {
    [q[0], -q[1], -q[2], -q[3]]
}

/// Rotation vector of a unit quaternion, of length at most pi.
fn logarithm(q: [f64; 4]) -> [f64; 3] {
    let sign = if q[0] < 0.0 { -1.0 } else { 1.0 };
    let (w, v) = (sign * q[0], [sign * q[1], sign * q[2], sign * q[3]]);
    let sine = v[0].hypot(v[1]).hypot(v[2]);
    // angle / sin(angle / 2), with its limit 2 where the quotient loses meaning.
    let factor = if sine < 1e-150 { 2.0 } else { 2.0 * sine.atan2(w) / sine };
    v.map(|x| factor * x)
}

/// Unit quaternion of a rotation vector.
fn exponential(v: [f64; 3]) -> [f64; 4] {
    let angle = v[0].hypot(v[1]).hypot(v[2]);
    let half = 0.5 * angle;
    let factor = if angle < 1e-150 { 0.5 } else { half.sin() / angle };
    [half.cos(), factor * v[0], factor * v[1], factor * v[2]]
}

/// The rotation vector of the same rotation that lies nearest to `near`.
fn continued(v: [f64; 3], near: [f64; 3]) -> [f64; 3] {
    let angle = v[0].hypot(v[1]).hypot(v[2]);
    if angle < 1e-12 {
        // Near the identity every axis will do: take the one that was being turned about.
        let length = near[0].hypot(near[1]).hypot(near[2]);
        let turns = (length / TAU).round();
        return if turns > 0.0 { std::array::from_fn(|i| v[i] + near[i] / length * turns * TAU) } else { v };
    }
    let along: f64 = (0..3).map(|i| v[i] * near[i]).sum::<f64>() / angle;
    let turns = ((along - angle) / TAU).round();
    v.map(|x| x * (1.0 + turns * TAU / angle))
}

fn unit(q: &[f64]) -> Result<[f64; 4]> {
    let length = q[0].hypot(q[1]).hypot(q[2].hypot(q[3]));
    if !((length - 1.0).abs() <= 1e-3) {
        return Err(Error::InvalidParameter { name: "quaternion length", allowed: "1 within 0.001", value: length });
    }
    Ok(std::array::from_fn(|i| q[i] / length))
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
    pub fn new(coordinates: Vec<Coordinate>) -> Result<Self> {
        if coordinates.is_empty() {
            return Err(Error::TooFewSamples { what: "chart coordinates", needed: 1, got: 0 });
        }
        for coordinate in &coordinates {
            match coordinate {
                Coordinate::Linear => {}
                Coordinate::Angle { centre_rad } if centre_rad.is_finite() => {}
                Coordinate::Angle { centre_rad } => {
                    return Err(Error::NotFinite { what: "chart centre", index: 0, value: *centre_rad });
                }
                Coordinate::Rotation { centre } => {
                    unit(centre)?;
                }
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

    /// A demonstration in flat coordinates, continuous along the motion.
    ///
    /// ```
    /// use gmr_core::{Chart, Coordinate, Trajectory};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let chart = Chart::new(vec![Coordinate::Rotation { centre: [1.0, 0.0, 0.0, 0.0] }])?;
    /// // A quarter turn about z has the logarithm (0, 0, pi / 2).
    /// let half = std::f64::consts::FRAC_1_SQRT_2;
    /// let flat = chart.encode(&Trajectory::new(vec![0.0], vec![half, 0.0, 0.0, half], 4)?)?;
    /// assert!((flat.values()[2] - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Columns that do not match, or quaternions not of length one.
    pub fn encode(&self, demonstration: &Trajectory) -> Result<Trajectory> {
        check_len("chart columns", self.columns(), demonstration.dim())?;
        let flat = self.flat_columns();
        let mut values = Vec::with_capacity(demonstration.len() * flat);
        for i in 0..demonstration.len() {
            let mut row = vec![0.0; flat];
            let previous = (i > 0).then(|| values[(i - 1) * flat..].to_vec());
            self.encode_row(demonstration.row(i), previous.as_deref(), &mut row)?;
            values.extend(row);
        }
        // The whole motion moves by the turns that bring its mean nearest to the centre.
        let mut at = 0;
        for coordinate in &self.coordinates {
            match coordinate {
                Coordinate::Angle { centre_rad } => {
                    let mean = values.iter().skip(at).step_by(flat).sum::<f64>() / demonstration.len() as f64;
                    let turns = TAU * ((mean - centre_rad) / TAU).round();
                    values.iter_mut().skip(at).step_by(flat).for_each(|v| *v -= turns);
                    at += 1;
                }
                Coordinate::Linear => at += 1,
                Coordinate::Rotation { .. } => at += 3,
            }
        }
        Trajectory::new(demonstration.times_s().to_vec(), values, flat)
    }

    /// One row in flat coordinates, on the branch nearest to `previous`, or to the centre.
    ///
    /// ```
    /// use gmr_core::{Chart, Coordinate};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// // A quarter turn about z is the rotation vector (0, 0, pi / 2).
    /// let chart = Chart::new(vec![Coordinate::Rotation { centre: [1.0, 0.0, 0.0, 0.0] }])?;
    /// let mut flat = [0.0; 3];
    /// chart.encode_row(&[0.5_f64.sqrt(), 0.0, 0.0, 0.5_f64.sqrt()], None, &mut flat)?;
    /// assert!((flat[2] - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Wrong lengths, or a quaternion not of length one.
    pub fn encode_row(&self, row: &[f64], previous: Option<&[f64]>, out: &mut [f64]) -> Result<()> {
        check_len("chart columns", self.columns(), row.len())?;
        check_len("flat columns", self.flat_columns(), out.len())?;
        if let Some(previous) = previous {
            check_len("previous flat columns", out.len(), previous.len())?;
        }
        let (mut i, mut o) = (0, 0);
        for coordinate in &self.coordinates {
            match coordinate {
                Coordinate::Linear => out[o] = row[i],
                Coordinate::Angle { centre_rad } => {
                    let near = previous.map_or(*centre_rad, |p| p[o]);
                    out[o] = near + wrap_rad(row[i] - near);
                }
                Coordinate::Rotation { centre } => {
                    let v = logarithm(multiply(conjugate(*centre), unit(&row[i..i + 4])?));
                    let v = previous.map_or(v, |p| continued(v, [p[o], p[o + 1], p[o + 2]]));
                    out[o..o + 3].copy_from_slice(&v);
                    i += 3;
                    o += 2;
                }
            }
            i += 1;
            o += 1;
        }
        Ok(())
    }

    /// A flat point (for instance a predicted mean) back on the manifold. Allocates nothing.
    ///
    /// ```
    /// use gmr_core::{Chart, Coordinate};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let chart = Chart::new(vec![Coordinate::Angle { centre_rad: 3.0 }])?;
    /// let mut angle = [0.0];
    /// chart.decode_into(&[3.5], &mut angle)?;
    /// assert!((angle[0] + 2.783_185_307_179_586).abs() < 1e-15);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Wrong lengths.
    pub fn decode_into(&self, flat: &[f64], out: &mut [f64]) -> Result<()> {
        check_len("flat columns", self.flat_columns(), flat.len())?;
        check_len("chart columns", self.columns(), out.len())?;
        let (mut i, mut o) = (0, 0);
        for coordinate in &self.coordinates {
            match coordinate {
                Coordinate::Linear => out[o] = flat[i],
                Coordinate::Angle { .. } => out[o] = wrap_rad(flat[i]),
                Coordinate::Rotation { centre } => {
                    let q = multiply(*centre, exponential([flat[i], flat[i + 1], flat[i + 2]]));
                    out[o..o + 4].copy_from_slice(&q);
                    i += 2;
                    o += 3;
                }
            }
            i += 1;
            o += 1;
        }
        Ok(())
    }
}

fn mean_rotation(all: &[[f64; 4]]) -> [f64; 4] {
    let mut mean = all[0];
    // Each step contracts by the square of the spread; twenty settle anything within a half turn.
    for _ in 0..20 {
        let mut step = [0.0; 3];
        for q in all {
            for (s, v) in step.iter_mut().zip(logarithm(multiply(conjugate(mean), *q))) {
                *s += v / all.len() as f64;
            }
        }
        let next = multiply(mean, exponential(step));
        let length = next.iter().map(|v| v * v).sum::<f64>().sqrt();
        mean = next.map(|v| v / length);
        if step.iter().all(|s| s.abs() < 1e-14) {
            break;
        }
    }
    mean
}

#[cfg(test)]
mod tests {
    #![expect(clippy::float_cmp, reason = "these results are exact")]
    use super::*;
    use crate::{GmmParams, Regressor, Samples};

    #[test]
    fn wrapping_is_idempotent_and_keeps_the_point() {
        for i in -1000..1000 {
            let a = f64::from(i) * 0.037;
            let w = wrap_rad(a);
            assert!(w > -PI && w <= PI);
            assert!((w.sin() - a.sin()).abs() < 1e-12 && (w.cos() - a.cos()).abs() < 1e-12);
        }
        assert!(wrap_rad(PI) == PI && wrap_rad(-PI) == PI);
    }

    #[test]
    fn a_motion_through_pi_is_learned_like_the_same_motion_through_zero() {
        let times: Vec<f64> = (0..=100).map(|i| f64::from(i) * 0.01).collect();
        let swing = |t: f64| 1.2 * (5.0 * t).sin();
        let predict = |offset: f64| -> Vec<f64> {
            let values = times.iter().map(|&t| wrap_rad(swing(t) + offset)).collect();
            let motion = Trajectory::new(times.clone(), values, 1).unwrap();
            let chart = Chart::fit(&[CoordinateKind::Angle], std::slice::from_ref(&motion)).unwrap();
            let flat = chart.encode(&motion).unwrap();
            let rows: Vec<f64> = times.iter().zip(flat.values()).flat_map(|(t, v)| [*t, *v]).collect();
            let plan = GmmParams { components: 8, ..GmmParams::default() }.validate().unwrap();
            let (mixture, _) = plan.fit(&Samples::new(&rows, 2).unwrap()).unwrap();
            let regressor = Regressor::new(&mixture, &[0], &[1]).unwrap();
            let mut out = regressor.prediction();
            let mut angle = [0.0];
            times
                .iter()
                .map(|t| {
                    regressor.predict_into(&[*t], &mut out).unwrap();
                    chart.decode_into(out.mean(), &mut angle).unwrap();
                    wrap_rad(angle[0] - offset)
                })
                .collect()
        };
        let (plain, turned) = (predict(0.0), predict(PI));
        for ((a, b), t) in plain.iter().zip(&turned).zip(&times) {
            assert!((a - b).abs() < 1e-6, "the turn changes the prediction at {t}");
            assert!((a - swing(*t)).abs() < 0.1);
        }
    }

    #[test]
    fn orientations_go_through_a_full_turn_and_come_back() {
        let axis = [0.6, 0.0, 0.8];
        let times: Vec<f64> = (0..=300).map(|i| f64::from(i) * 0.01).collect();
        let mut values = Vec::new();
        for t in &times {
            let q = exponential(axis.map(|a| a * 3.0 * t));
            // A sensor is free to report either sign.
            let sign = if (t * 7.0).sin() > 0.0 { 1.0 } else { -1.0 };
            values.extend(q.map(|v| sign * v));
        }
        let motion = Trajectory::new(times, values, 4).unwrap();
        let chart = Chart::fit(&[CoordinateKind::Rotation], std::slice::from_ref(&motion)).unwrap();
        let flat = chart.encode(&motion).unwrap();
        for i in 1..flat.len() {
            let step: f64 = flat.row(i).iter().zip(flat.row(i - 1)).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            assert!((step - 0.03).abs() < 1e-9, "step {step} at {i}");
        }
        let mut q = [0.0; 4];
        for i in 0..flat.len() {
            chart.decode_into(flat.row(i), &mut q).unwrap();
            let dot: f64 = q.iter().zip(motion.row(i)).map(|(a, b)| a * b).sum();
            assert!((dot.abs() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_quaternion_that_is_no_rotation_is_refused() {
        let motion = Trajectory::new(vec![0.0], vec![0.5, 0.0, 0.0, 0.0], 4).unwrap();
        assert!(Chart::fit(&[CoordinateKind::Rotation], &[motion]).is_err());
    }
}
