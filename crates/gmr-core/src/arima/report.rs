//! What a fit did.

use serde::{Deserialize, Serialize};

/// Where the kept search began.
///
/// ```
/// # use gmr_core::{ArimaOrder, ArimaParams, ArimaStart, ArimaStop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // White noise of +-1: the variance is the mean square, nothing is searched.
/// let y: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let order = ArimaOrder { p: 0, d: 0, q: 0 };
/// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
/// assert_eq!(plan.fit(&y)?.1.start, ArimaStart::Closed);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ArimaStart {
    /// At the minimum of the conditional sum of squares, reached from the two-stage regression of
    /// Hannan and Rissanen (1982).
    ConditionalSquares,
    /// At one of the best points of a coarse grid over the whole region.
    Grid,
    /// Nothing to search: `p = q = 0`.
    Closed,
}

/// Why the kept search ended.
///
/// ```
/// # use gmr_core::{ArimaOrder, ArimaParams, ArimaStart, ArimaStop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // White noise of +-1: the variance is the mean square, nothing is searched.
/// let y: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let order = ArimaOrder { p: 0, d: 0, q: 0 };
/// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
/// assert_eq!(plan.fit(&y)?.1.stop, ArimaStop::Converged);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ArimaStop {
    /// The gradient fell below the tolerance.
    Converged,
    /// No step raised the likelihood any further; the usual end on a border of the region.
    NoFurtherGain,
    /// The iteration limit was reached first.
    IterationLimit,
}

/// What an ARIMA fit did.
///
/// ```
/// # use gmr_core::{ArimaOrder, ArimaParams, ArimaStart, ArimaStop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // White noise of +-1: the variance is the mean square, nothing is searched.
/// let y: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let order = ArimaOrder { p: 0, d: 0, q: 0 };
/// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
/// let report = plan.fit(&y)?.1;
/// // Each of 60 values has the log density -(ln(2 pi) + 1) / 2.
/// assert!((report.log_likelihood + 60.0 * 1.418_938_533_204_672_7).abs() < 1e-9);
/// assert!((report.aic - (2.0 - 2.0 * report.log_likelihood)).abs() < 1e-9);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ArimaReport {
    /// Exact log-likelihood (diffuse for `d > 0`) of the returned model.
    pub log_likelihood: f64,
    /// Free parameters, the variance included.
    pub parameters: usize,
    /// Akaike's criterion.
    pub aic: f64,
    /// Akaike's criterion corrected for small samples; infinite when there are too few values.
    pub aicc: f64,
    /// Schwarz' criterion.
    pub bic: f64,
    /// Values that count in the likelihood: observed minus `d`.
    pub observations: usize,
    /// Missing values.
    pub missing: usize,
    /// Iterations of the kept search.
    pub iterations: usize,
    /// Largest gradient component per value at the end.
    pub gradient: f64,
    /// Where the kept search began.
    pub start: ArimaStart,
    /// Why it ended.
    pub stop: ArimaStop,
    /// Whether a partial autocorrelation ended within 1e-6 of one: a unit root, so the likelihood
    /// has its maximum on the border of the region.
    pub on_border: bool,
}
