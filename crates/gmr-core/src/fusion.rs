//! Weight fusion of mixture and ARIMA model (paper, eqs. 11-14).
//!
//! `SI(R_i, R_j) = exp(-|R_i - R_j|)` (11), `A_i = sum_{j != i} SI(R_i, R_j) / (n - 1)` (12),
//! `omega_i = A_i / sum A` (13), `pi_i <- omega_i pi_i` (14).
//!
//! The paper leaves open what `i` runs over; both readings are here.
//!
//! - [`FusionReading::Components`]: `i` runs over the components, and `R_i` is the
//!   responsibility-weighted mean absolute ARIMA residual over the samples component `i` explains, in units of
//!   the residual's standard deviation. Components that the ARIMA model finds as reliable as the rest gain weight,
//!   outlying ones lose it.
//! - [`FusionReading::Literal`]: `i` runs over the two models. `SI` is symmetric, so `A` is the same for
//!   both and `omega = (1/2, 1/2)` whatever `R` is; (14) multiplies every weight by 1/2 and the total mass
//!   falls to 1/2. Normalised again, nothing has changed: this reading is plain EM, and the report shows it.
//!
//! In both, (14) is followed by `pi_i / sum pi`, without which it is no density.

use serde::{Deserialize, Serialize};

use crate::arima::{ArimaPlan, ArimaReport};
use crate::error::{Error, Result};
use crate::trajectory::Trajectory;

/// What the index of equations (11)-(14) runs over.
///
/// ```
/// use gmr_core::{Fusion, FusionReading};
/// # fn main() -> Result<(), gmr_core::Error> {
/// assert_eq!(Fusion::new(&[0.5], FusionReading::Literal)?.reading(), FusionReading::Literal);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FusionReading {
    /// The components of the mixture.
    Components,
    /// The two models, mixture and ARIMA.
    Literal,
}

/// What a fused fit needs beside the samples.
///
/// ```
/// use gmr_core::{Fusion, FusionReading};
/// # fn main() -> Result<(), gmr_core::Error> {
/// assert_eq!(Fusion::new(&[0.5, 1.5], FusionReading::Components)?.errors(), [0.5, 1.5]);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fusion<'a> {
    errors: &'a [f64],
    reading: FusionReading,
}

/// What fusion did in one M step.
///
/// ```
/// use gmr_core::{Fusion, FusionReading, GmmParams, Samples};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // One component supports itself: nothing changes.
/// let fusion = Fusion::new(&[0.5, 1.0, 1.5], FusionReading::Components)?;
/// let plan = GmmParams::default().validate()?;
/// let report = plan.fit_fused(&Samples::new(&[0.0, 1.0, 2.0], 1)?, &fusion)?.1.fusion;
/// let steps = report.map(|r| r.steps).unwrap_or_default();
/// assert_eq!((steps[0].reliability[0], steps[0].omega[0], steps[0].largest_change), (1.0, 1.0, 0.0));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FusionStep {
    /// `R_i`: per component, or of (mixture, ARIMA).
    pub reliability: Vec<f64>,
    /// `omega_i` (13), summing to one.
    pub omega: Vec<f64>,
    /// `sum omega_i pi_i` before it was normalised away.
    pub mass: f64,
    /// Largest change of a weight.
    pub largest_change: f64,
}

/// What fusion did in a fit.
///
/// ```
/// use gmr_core::{Fusion, FusionReading, GmmParams, Samples};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // The literal reading multiplies all weights by one half, which normalising takes back.
/// let fusion = Fusion::new(&[1.0, 1.0, 1.0], FusionReading::Literal)?;
/// let plan = GmmParams::default().validate()?;
/// let report = plan.fit_fused(&Samples::new(&[0.0, 1.0, 2.0], 1)?, &fusion)?.1.fusion;
/// let step = report.and_then(|r| r.steps.into_iter().next()).ok_or(gmr_core::Error::TooFewSamples { what: "steps", needed: 1, got: 0 })?;
/// assert_eq!((step.omega, step.mass, step.largest_change), (vec![0.5, 0.5], 0.5, 0.0));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FusionReport {
    /// The reading used.
    pub reading: FusionReading,
    /// One entry per M step after the start.
    pub steps: Vec<FusionStep>,
}

/// ARIMA errors of demonstrations.
///
/// ```
/// use gmr_core::{ArimaParams, Error, Trajectory, arima_errors};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // A constant column has no ARIMA model and no error.
/// let still = Trajectory::new((0..9).map(f64::from).collect(), vec![1.0; 9], 1)?;
/// let found = arima_errors(&[still], &ArimaParams::default().validate()?)?;
/// assert_eq!(found.errors[0], [0.0; 9]);
/// assert!(matches!(found.columns[0][0], Err(Error::Degenerate { .. })));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ArimaErrors {
    /// Per demonstration and sample: the mean over columns of `|residual| / standard deviation`.
    /// Samples without a residual (the first `d`) get the mean of the others, which
    /// neither favours nor harms the component that explains them.
    pub errors: Vec<Vec<f64>>,
    /// Per demonstration and column: the report, or why the column has no ARIMA model. A constant
    /// column ([`Error::Degenerate`]) is predicted exactly and takes no part in the mean.
    pub columns: Vec<Vec<Result<ArimaReport>>>,
}

impl<'a> Fusion<'a> {
    /// One non-negative error per sample, in units of the residual's standard deviation.
    ///
    /// ```
    /// use gmr_core::{Fusion, FusionReading};
    /// assert!(Fusion::new(&[-0.5], FusionReading::Components).is_err());
    /// assert!(Fusion::new(&[f64::NAN], FusionReading::Components).is_err());
    /// ```
    ///
    /// # Errors
    /// A negative or non-finite error.
    pub fn new(errors: &'a [f64], reading: FusionReading) -> Result<Self> {
        for &value in errors {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Error::InvalidParameter { name: "ARIMA error", allowed: "[0, inf)", value });
            }
        }
        Ok(Self { errors, reading })
    }

    /// The errors.
    ///
    /// ```
    /// use gmr_core::{Fusion, FusionReading};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// assert_eq!(Fusion::new(&[0.5, 1.5], FusionReading::Components)?.errors(), [0.5, 1.5]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn errors(&self) -> &'a [f64] {
        self.errors
    }

    /// The reading.
    ///
    /// ```
    /// use gmr_core::{Fusion, FusionReading};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// assert_eq!(Fusion::new(&[], FusionReading::Literal)?.reading(), FusionReading::Literal);
    /// # Ok(())
    /// # }
    /// ```
    pub fn reading(&self) -> FusionReading {
        self.reading
    }

    /// Equations (11)-(14) on weights, given each component's mean error.
    pub(crate) fn apply(&self, weights: &mut [f64], reliability: &[f64]) -> FusionStep {
        let before = weights.to_vec();
        let (reliability, omega) = match self.reading {
            FusionReading::Components => (reliability.to_vec(), mutual_support(reliability)),
            FusionReading::Literal => {
                let arima: f64 = before.iter().zip(reliability).map(|(w, r)| w * r).sum();
                // A maximum likelihood mixture explains its samples with a root mean square
                // standardised residual of one by construction.
                let pair = vec![1.0, arima];
                let omega = mutual_support(&pair);
                (pair, omega)
            }
        };
        for (i, w) in weights.iter_mut().enumerate() {
            *w *= match self.reading {
                FusionReading::Components => omega[i],
                FusionReading::Literal => omega[0],
            };
        }
        let mass: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= mass);
        let largest_change = weights.iter().zip(&before).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
        FusionStep { reliability, omega, mass, largest_change }
    }
}

/// `omega` of equations (11)-(13).
///
/// ```
/// // Two sources support each other equally, whatever they say.
/// assert_eq!(gmr_core::mutual_support(&[0.3, 7.0]), [0.5, 0.5]);
/// // Of three, the outlier gets the least.
/// let omega = gmr_core::mutual_support(&[1.0, 1.0, 3.0]);
/// let (near, far) = ((1.0 + (-2.0_f64).exp()) / 2.0, (-2.0_f64).exp());
/// assert!((omega[2] - far / (2.0 * near + far)).abs() < 1e-15);
/// ```
pub fn mutual_support(reliability: &[f64]) -> Vec<f64> {
    let n = reliability.len();
    // The 1 / (n - 1) of (12) cancels in (13).
    let support: Vec<f64> = (0..n)
        .map(|i| (0..n).filter(|&j| j != i).map(|j| (-(reliability[i] - reliability[j]).abs()).exp()).sum())
        .collect();
    let total: f64 = support.iter().sum();
    if total > 0.0 {
        support.iter().map(|a| a / total).collect()
    } else {
        // One alone, or every distance underflows: nobody supports anybody, and nobody is preferred.
        vec![1.0 / n as f64; n]
    }
}

/// Fits an ARIMA model to each column of each demonstration and returns its standardised errors.
///
/// ```
/// use gmr_core::{ArimaOrder, ArimaParams, Trajectory, arima_errors};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // A saw tooth of +-1 has residuals of one size, one standard deviation each, after the first.
/// let times: Vec<f64> = (0..60).map(f64::from).collect();
/// let values = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let demonstration = Trajectory::new(times, values, 1)?;
/// let order = ArimaOrder { p: 0, d: 0, q: 0 };
/// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
/// let errors = arima_errors(&[demonstration], &plan)?;
/// assert!(errors.errors[0].iter().all(|e| (e - 1.0).abs() < 1e-9));
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// A column that cannot be fitted for another reason than being constant.
pub fn arima_errors(demonstrations: &[Trajectory], plan: &ArimaPlan) -> Result<ArimaErrors> {
    let mut out = ArimaErrors { errors: Vec::new(), columns: Vec::new() };
    for demonstration in demonstrations {
        let n = demonstration.len();
        let mut sums = vec![0.0; n];
        let mut counts = vec![0usize; n];
        let mut columns = Vec::with_capacity(demonstration.dim());
        for column in 0..demonstration.dim() {
            let y = demonstration.column(column);
            match plan.fit(&y) {
                Ok((model, report)) => {
                    for (t, residual) in model.filter(&y)?.residuals.iter().enumerate() {
                        if let Some(innovation) = residual {
                            sums[t] += innovation.value.abs() / innovation.variance.sqrt();
                            counts[t] += 1;
                        }
                    }
                    columns.push(Ok(report));
                }
                Err(error @ Error::Degenerate { .. }) => columns.push(Err(error)),
                Err(error) => return Err(error),
            }
        }
        let total: usize = counts.iter().sum();
        let mean = if total > 0 { sums.iter().sum::<f64>() / total as f64 } else { 0.0 };
        out.errors.push(sums.iter().zip(&counts).map(|(s, &c)| if c > 0 { s / c as f64 } else { mean }).collect());
        out.columns.push(columns);
    }
    Ok(out)
}
