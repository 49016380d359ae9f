//! Gaussian mixtures: parameters, start, EM, report, the fitted mixture.
//!
//! A mixture over rows `x: (d)` is `p(x) = sum_n pi_n N(x | mu_n, Sigma_n)` (paper, eq. 5). EM runs in
//! the log domain on Cholesky factors only: the E step forms `W_n (x - mu_n)` with
//! `W_n = L_n^-1`, `Sigma_n = L_n L_n'`; the M step takes moments about the current means.

mod em;
mod factors;
mod maximise;
mod mixture;
mod params;
mod report;
mod select;
mod start;

pub(crate) use mixture::{LN_2_PI, check_dimensions};
pub use mixture::{Mixture, MixtureParts};
pub use params::{CovarianceKind, GmmParams, GmmPlan, MissingValues, Start};
pub use report::{FitReport, Floored, MissingReport, Regularisation, RestartOutcome, RestartReport, Stop};
pub use select::{Candidate, Criterion, Selection, select_components};
