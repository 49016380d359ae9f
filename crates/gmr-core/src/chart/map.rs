//! Demonstrations into the chart and predictions back.

use std::f64::consts::TAU;

use super::turn::{conjugate, continued, exponential, logarithm, multiply, unit, wrap_rad};
use super::{Chart, Coordinate};
use crate::error::{Result, check_len};
use crate::trajectory::Trajectory;

impl Chart {
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
