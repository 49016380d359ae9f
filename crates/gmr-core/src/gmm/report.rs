//! What a fit did.

use serde::{Deserialize, Serialize};

use crate::fusion::FusionReport;

/// Why an EM run ended.
///
/// ```
/// # use gmr_core::{CovarianceKind, GmmParams, MissingValues, RestartOutcome, Samples, Start, Stop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let values = [-1.0, 1.0];
/// let plan = GmmParams::default().validate()?;
/// let (mixture, report) = plan.fit(&Samples::new(&values, 1)?)?;
/// assert!(matches!(report.stop, Stop::Converged { change } if change.abs() < 1e-6));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stop {
    /// The mean log-likelihood changed by less than the tolerance.
    Converged {
        /// The last change, in nats per sample.
        change: f64,
    },
    /// The iteration limit was reached first.
    IterationLimit {
        /// The last change, in nats per sample.
        change: f64,
    },
}

/// How one start ended.
///
/// ```
/// # use gmr_core::{CovarianceKind, GmmParams, MissingValues, RestartOutcome, Samples, Start, Stop};
/// use gmr_core::Error;
/// # fn main() -> Result<(), gmr_core::Error> {
/// // Without a floor, equal samples have a covariance of zero.
/// let plan = GmmParams { floor: 0.0, ..GmmParams::default() }.validate()?;
/// let Err(Error::AllRestartsFailed { restarts }) = plan.fit(&Samples::new(&[1.0, 1.0], 1)?) else { panic!() };
/// let collapsed = RestartOutcome::CollapsedComponent { component: 0, iteration: 0, pivot: 0.0 };
/// assert_eq!(restarts[0].outcome, collapsed);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RestartOutcome {
    /// A usable mixture.
    Fitted(Stop),
    /// A component lost all its samples.
    EmptyComponent {
        /// The component.
        component: usize,
        /// Iteration, from 1; 0 is the start.
        iteration: usize,
        /// Its share of the total weight.
        share: f64,
    },
    /// A covariance stopped being positive definite (only possible with floor and ridge zero).
    CollapsedComponent {
        /// The component.
        component: usize,
        /// Iteration, from 1; 0 is the start.
        iteration: usize,
        /// Value of the failing Cholesky pivot.
        pivot: f64,
    },
    /// A sample lies so far from every component that its log density is not finite.
    NoSupport {
        /// Iteration, from 1.
        iteration: usize,
    },
}

/// One start of a fit.
///
/// ```
/// # use gmr_core::{CovarianceKind, GmmParams, MissingValues, RestartOutcome, Samples, Start, Stop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let values = [-1.0, 1.0];
/// let plan = GmmParams::default().validate()?;
/// let (mixture, report) = plan.fit(&Samples::new(&values, 1)?)?;
/// assert_eq!(report.restarts[0].iterations, report.iterations);
/// assert!((report.restarts[0].log_likelihood.unwrap_or(0.0) + 1.418_938_533_204_672_7).abs() < 1e-9);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RestartReport {
    /// How it ended.
    pub outcome: RestartOutcome,
    /// EM iterations done.
    pub iterations: usize,
    /// Mean log-likelihood per sample of its final mixture (nats), if it has one.
    pub log_likelihood: Option<f64>,
}

/// A component whose covariance was raised to the floor.
///
/// ```
/// # use gmr_core::{CovarianceKind, GmmParams, MissingValues, RestartOutcome, Samples, Start, Stop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // Equal samples: the variance of zero is raised to the floor.
/// let plan = GmmParams::default().validate()?;
/// let (mixture, report) = plan.fit(&Samples::new(&[1.0, 1.0], 1)?)?;
/// assert_eq!(report.regularisation.floored[0].smallest_eigenvalue, 0.0);
/// assert!((mixture.covariance(0)[0] - 1e-9).abs() < 1e-20);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Floored {
    /// The component (0 for a tied covariance).
    pub component: usize,
    /// First iteration in which the floor acted (0 is the start).
    pub first_iteration: usize,
    /// Last iteration in which the floor acted; equal to the report's `iterations` when the
    /// returned covariance itself is a floored one.
    pub last_iteration: usize,
    /// In how many iterations it acted.
    pub times: usize,
    /// Smallest eigenvalue that was raised.
    pub smallest_eigenvalue: f64,
}

/// Everything that was added to covariances.
///
/// ```
/// # use gmr_core::{CovarianceKind, GmmParams, MissingValues, RestartOutcome, Samples, Start, Stop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let values = [-1.0, 1.0];
/// let plan = GmmParams::default().validate()?;
/// let (mixture, report) = plan.fit(&Samples::new(&values, 1)?)?;
/// assert_eq!((report.regularisation.ridge, report.regularisation.floor), (0.0, 1e-9));
/// assert!(report.regularisation.floored.is_empty());
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Regularisation {
    /// Ridge added to every variance in every M step.
    pub ridge: f64,
    /// Shrinkage applied in every M step.
    pub shrinkage: f64,
    /// Floor in force.
    pub floor: f64,
    /// Where the floor acted.
    pub floored: Vec<Floored>,
}

/// Missing values of a fit, all integrated out.
///
/// ```
/// # use gmr_core::{CovarianceKind, GmmParams, MissingValues, RestartOutcome, Samples, Start, Stop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let values = [1.0, 2.0, 3.0, f64::NAN, f64::NAN, f64::NAN, 4.0, 7.0];
/// let missing = MissingValues::Marginalise;
/// let plan = GmmParams { missing, ..GmmParams::default() }.validate()?;
/// let report = plan.fit(&Samples::new(&values, 2)?)?.1.missing.unwrap_or_default();
/// assert_eq!((report.values, report.partial_rows, report.unused_rows), (3, 1, 1));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct MissingReport {
    /// Missing values. The start, and only the start, saw their column's mean instead.
    pub values: usize,
    /// Rows with some but not all values missing.
    pub partial_rows: usize,
    /// Rows with every value missing or weight zero; they take no part.
    pub unused_rows: usize,
}

/// What a fit did; nothing is repaired that is not listed here.
///
/// ```
/// # use gmr_core::{CovarianceKind, GmmParams, MissingValues, RestartOutcome, Samples, Start, Stop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let values = [-1.0, 1.0];
/// let plan = GmmParams::default().validate()?;
/// let (mixture, report) = plan.fit(&Samples::new(&values, 1)?)?;
/// assert_eq!((report.parameters, report.history.len()), (2, report.iterations)); // a mean and a variance
/// assert!((report.aic - (4.0 - 2.0 * report.log_likelihood)).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Why the kept run stopped.
    pub stop: Stop,
    /// EM iterations of the kept run.
    pub iterations: usize,
    /// Mean log-likelihood per sample before each M step of the kept run (nats).
    pub history: Vec<f64>,
    /// Log-likelihood of the returned mixture, summed over samples with their weights (nats).
    pub log_likelihood: f64,
    /// Free parameters of the mixture.
    pub parameters: usize,
    /// Bayesian information criterion `parameters ln n - 2 ln L`, `n` the total weight.
    pub bic: f64,
    /// Akaike information criterion `2 parameters - 2 ln L`.
    pub aic: f64,
    /// All starts in order.
    pub restarts: Vec<RestartReport>,
    /// Index of the kept start.
    pub best_restart: usize,
    /// Lloyd iterations of the k-means start of the kept run; 0 for other starts.
    pub k_means_iterations: usize,
    /// What was added to covariances in the kept run.
    pub regularisation: Regularisation,
    /// M steps in which a component moved so far that its moments were taken again about its new
    /// mean, to keep all digits.
    pub recentred: usize,
    /// Missing values, if there were any.
    pub missing: Option<MissingReport>,
    /// What weight fusion did in the kept run, if it was asked for.
    pub fusion: Option<FusionReport>,
}
