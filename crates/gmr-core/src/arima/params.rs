//! What is asked of a fit.

use serde::{Deserialize, Serialize};

use super::filter::MAX_STATE;
use crate::error::{Error, Result};

/// Orders of an ARIMA model.
///
/// ```
/// # use gmr_core::{ArimaOrder, ArimaParams, ArimaStart, ArimaStop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // White noise of +-1: the variance is the mean square, nothing is searched.
/// let y: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let order = ArimaOrder { p: 0, d: 0, q: 0 };
/// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
/// assert_eq!(plan.fit(&y)?.1.parameters, 1); // the variance
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ArimaOrder {
    /// Autoregressive order.
    pub p: usize,
    /// Differences taken.
    pub d: usize,
    /// Moving average order.
    pub q: usize,
}

/// Freely set parameters of an ARIMA fit.
///
/// ```
/// use gmr_core::{ArimaOrder, ArimaParams};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // A straight line with a little alternating noise: one difference leaves the drift.
/// let y: Vec<f64> = (0..60).map(|i| 0.5 * f64::from(i) + 0.01 * f64::from(i % 2)).collect();
/// let plan = ArimaParams { order: ArimaOrder { p: 1, d: 1, q: 0 }, constant: true, ..ArimaParams::default() }.validate()?;
/// let (model, report) = plan.fit(&y)?;
/// assert!((model.parts().mean - 0.5).abs() < 1e-3);
/// assert_eq!(report.observations, 59);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArimaParams {
    /// Orders.
    pub order: ArimaOrder,
    /// Whether the mean (`d = 0`) or drift (`d = 1`) is estimated; otherwise it is zero.
    pub constant: bool,
    /// Quasi-Newton iterations at most, per start.
    pub max_iterations: usize,
    /// Largest gradient component of the log-likelihood per value at which the search stops.
    pub tolerance: f64,
}

impl Default for ArimaParams {
    /// ARIMA(1, 0, 0) with a mean, at most 200 iterations, tolerance 1e-6.
    fn default() -> Self {
        Self { order: ArimaOrder { p: 1, d: 0, q: 0 }, constant: true, max_iterations: 200, tolerance: 1e-6 }
    }
}

/// Checked parameters; the only thing that can fit an ARIMA model.
///
/// ```
/// # use gmr_core::{ArimaOrder, ArimaParams, ArimaStart, ArimaStop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // White noise of +-1: the variance is the mean square, nothing is searched.
/// let y: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let order = ArimaOrder { p: 0, d: 0, q: 0 };
/// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
/// assert_eq!(plan.params().order, order);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArimaPlan {
    pub(super) params: ArimaParams,
}

impl ArimaParams {
    /// Checks every field.
    ///
    /// ```
    /// use gmr_core::{ArimaOrder, ArimaParams};
    /// let order = ArimaOrder { p: 1, d: 5, q: 0 };
    /// assert!(ArimaParams { order, constant: false, ..ArimaParams::default() }.validate().is_err());
    /// ```
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] with the field, the allowed interval and the value.
    pub fn validate(self) -> Result<ArimaPlan> {
        let ArimaOrder { p, d, q } = self.order;
        if p.max(q + 1) >= MAX_STATE || d > 4 {
            return Err(Error::InvalidParameter {
                name: "order",
                allowed: "p <= 23, q <= 22, d <= 4",
                value: p.max(q).max(d) as f64,
            });
        }
        if self.max_iterations == 0 {
            return Err(Error::InvalidParameter { name: "max_iterations", allowed: "at least 1", value: 0.0 });
        }
        if !(self.tolerance > 0.0 && self.tolerance.is_finite()) {
            return Err(Error::InvalidParameter { name: "tolerance", allowed: "(0, inf)", value: self.tolerance });
        }
        Ok(ArimaPlan { params: self })
    }
}

impl ArimaPlan {
    /// The checked parameters.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let plan = gmr_core::ArimaParams::default().validate()?;
    /// assert_eq!(plan.params().order.p, 1);
    /// # Ok(())
    /// # }
    /// ```
    pub fn params(&self) -> &ArimaParams {
        &self.params
    }
}
