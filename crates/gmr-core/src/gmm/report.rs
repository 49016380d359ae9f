//! What a fit did.

use serde::{Deserialize, Serialize};

use crate::fusion::FusionReport;

/// Why an EM run ended.
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
