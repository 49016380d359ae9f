//! A borrowed table of samples with optional weights.

use crate::error::{Error, MAX_MAGNITUDE, Result, check_len};

/// Row-major samples `x: (n, d)` with optional non-negative weights `w: (n)`.
///
/// NaN marks a missing value; whether those are accepted is decided by
/// [`crate::GmmParams::missing`]. Infinite values and magnitudes above 1e140 are refused
/// here, because their squares would overflow.
///
/// ```
/// # fn main() -> Result<(), gmr_core::Error> {
/// let values = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
/// let samples = gmr_core::Samples::new(&values, 2)?;
/// assert_eq!((samples.len(), samples.dim()), (3, 2));
/// assert_eq!(samples.row(1), [2.0, 3.0]);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Samples<'a> {
    values: &'a [f64],
    dim: usize,
    weights: Option<&'a [f64]>,
    missing: usize,
}

impl<'a> Samples<'a> {
    /// Views `values` as rows of `dim` numbers.
    ///
    /// ```
    /// use gmr_core::{Error, Samples};
    /// let ragged = Samples::new(&[1.0, 2.0, 3.0], 2).map(|s| s.len());
    /// assert!(matches!(ragged, Err(Error::Length { expected: 2, got: 3, .. })));
    /// ```
    ///
    /// # Errors
    /// `dim` zero, a length that is no multiple of `dim`, an infinite value or one above 1e140.
    pub fn new(values: &'a [f64], dim: usize) -> Result<Self> {
        if dim == 0 {
            return Err(Error::InvalidParameter { name: "dim", allowed: "at least 1", value: 0.0 });
        }
        if !values.len().is_multiple_of(dim) {
            return Err(Error::Length {
                what: "samples (a whole number of rows)",
                expected: values.len() / dim * dim,
                got: values.len(),
            });
        }
        let mut missing = 0;
        for (index, &value) in values.iter().enumerate() {
            if value.is_nan() {
                missing += 1;
            } else if value.is_infinite() {
                return Err(Error::NotFinite { what: "samples", index, value });
            } else if value.abs() > MAX_MAGNITUDE {
                return Err(Error::OutOfRange { what: "samples", index, value, limit: MAX_MAGNITUDE });
            }
        }
        Ok(Self { values, dim, weights: None, missing })
    }

    /// Attaches one non-negative, finite weight per row. A weight of 2 counts as two equal rows.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let samples = gmr_core::Samples::new(&[0.0, 1.0, f64::NAN, 3.0], 2)?.with_weights(&[1.0, 3.0])?;
    /// assert_eq!(samples.total_weight(), 4.0);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Wrong length, a negative or non-finite weight, or no positive weight at all.
    pub fn with_weights(mut self, weights: &'a [f64]) -> Result<Self> {
        check_len("sample weights", self.len(), weights.len())?;
        for &value in weights {
            if !(0.0..=MAX_MAGNITUDE).contains(&value) {
                return Err(Error::InvalidParameter { name: "sample weight", allowed: "[0, 1e140]", value });
            }
        }
        let total: f64 = weights.iter().sum();
        if !(total > 0.0) {
            return Err(Error::InvalidParameter { name: "total sample weight", allowed: "above 0", value: total });
        }
        self.weights = Some(weights);
        Ok(self)
    }

    /// Number of rows `n`.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let samples = gmr_core::Samples::new(&[0.0, 1.0, f64::NAN, 3.0], 2)?.with_weights(&[1.0, 3.0])?;
    /// assert_eq!(samples.len(), 2);
    /// # Ok(())
    /// # }
    /// ```
    pub fn len(&self) -> usize {
        self.values.len() / self.dim
    }

    /// Whether there is no row.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// assert!(gmr_core::Samples::new(&[], 2)?.is_empty());
    /// # Ok(())
    /// # }
    /// ```
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Number of columns `d`.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let samples = gmr_core::Samples::new(&[0.0, 1.0, f64::NAN, 3.0], 2)?.with_weights(&[1.0, 3.0])?;
    /// assert_eq!(samples.dim(), 2);
    /// # Ok(())
    /// # }
    /// ```
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// All values, row-major.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let samples = gmr_core::Samples::new(&[0.0, 1.0, f64::NAN, 3.0], 2)?.with_weights(&[1.0, 3.0])?;
    /// assert_eq!(samples.values()[1], 1.0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn values(&self) -> &'a [f64] {
        self.values
    }

    /// One row.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let samples = gmr_core::Samples::new(&[0.0, 1.0, f64::NAN, 3.0], 2)?.with_weights(&[1.0, 3.0])?;
    /// assert_eq!(samples.row(0), [0.0, 1.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn row(&self, index: usize) -> &'a [f64] {
        &self.values[index * self.dim..(index + 1) * self.dim]
    }

    /// Weight of a row; 1 when none were given.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let samples = gmr_core::Samples::new(&[0.0, 1.0, f64::NAN, 3.0], 2)?.with_weights(&[1.0, 3.0])?;
    /// assert_eq!(samples.weight(1), 3.0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn weight(&self, index: usize) -> f64 {
        self.weights.map_or(1.0, |w| w[index])
    }

    /// The weights, if given.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let samples = gmr_core::Samples::new(&[0.0, 1.0, f64::NAN, 3.0], 2)?.with_weights(&[1.0, 3.0])?;
    /// assert_eq!(samples.weights(), Some(&[1.0, 3.0][..]));
    /// # Ok(())
    /// # }
    /// ```
    pub fn weights(&self) -> Option<&'a [f64]> {
        self.weights
    }

    /// Number of missing (NaN) values.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let samples = gmr_core::Samples::new(&[0.0, 1.0, f64::NAN, 3.0], 2)?.with_weights(&[1.0, 3.0])?;
    /// assert_eq!(samples.missing(), 1);
    /// # Ok(())
    /// # }
    /// ```
    pub fn missing(&self) -> usize {
        self.missing
    }

    /// Sum of the weights; the number of rows when none were given.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let samples = gmr_core::Samples::new(&[0.0, 1.0, f64::NAN, 3.0], 2)?.with_weights(&[1.0, 3.0])?;
    /// assert_eq!(samples.total_weight(), 4.0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn total_weight(&self) -> f64 {
        self.weights.map_or(self.len() as f64, |w| w.iter().sum())
    }
}
