//! Number of components by an information criterion.

use std::ops::RangeInclusive;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::mixture::Mixture;
use super::params::{GmmParams, Start};
use super::report::FitReport;
use crate::error::{Error, Result};
use crate::samples::Samples;

/// What is minimised.
///
/// ```
/// use gmr_core::{Criterion, GmmParams, Samples, select_components};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let values: Vec<f64> = (0..40).map(|i| f64::from(i % 2) * 10.0 + 0.1 * (f64::from(i) * 1.7).sin()).collect();
/// let found = select_components(&Samples::new(&values, 1)?, &GmmParams::default(), 1..=3, Criterion::Bic)?;
/// let rows = found.table.iter().filter_map(|row| row.result.as_ref().ok());
/// let least = rows.map(|report| report.bic).fold(f64::INFINITY, f64::min);
/// assert_eq!(found.table[found.best].result.as_ref().map(|report| report.bic), Ok(least));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Criterion {
    /// Schwarz' criterion: consistent, prefers small models.
    Bic,
    /// Akaike's criterion: prefers prediction.
    Aic,
}

/// One row of the table.
///
/// ```
/// use gmr_core::{Criterion, GmmParams, Samples, select_components};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let samples = [-1.0, 0.0, 1.0];
/// let found = select_components(&Samples::new(&samples, 1)?, &GmmParams::default(), 1..=1, Criterion::Aic)?;
/// assert_eq!(found.table[0].components, 1);
/// assert_eq!(found.table[0].result.as_ref().map(|report| report.parameters), Ok(2));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Number of components.
    pub components: usize,
    /// The fit's report, or why there is none.
    pub result: Result<FitReport>,
}

/// The chosen mixture and the whole table.
///
/// ```
/// use gmr_core::{Criterion, GmmParams, Samples, select_components};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let samples = [-1.0, 0.0, 1.0];
/// let found = select_components(&Samples::new(&samples, 1)?, &GmmParams::default(), 1..=1, Criterion::Aic)?;
/// assert_eq!((found.best, found.table.len()), (0, 1));
/// assert!((found.mixture.covariance(0)[0] - 2.0 / 3.0).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Selection {
    /// The mixture with the lowest criterion.
    pub mixture: Mixture,
    /// Index of its row in the table.
    pub best: usize,
    /// All numbers of components in order.
    pub table: Vec<Candidate>,
}

/// Fits every number of components in `range`, in parallel, and keeps the lowest criterion.
///
/// `params.components` is ignored; a warm start is refused.
///
/// ```
/// use gmr_core::{Criterion, GmmParams, Samples, select_components};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // Three tight groups at 0, 10 and 20.
/// let values: Vec<f64> = (0..90).map(|i| f64::from(i % 3) * 10.0 + 0.1 * (f64::from(i) * 1.7).sin()).collect();
/// let found = select_components(&Samples::new(&values, 1)?, &GmmParams::default(), 1..=5, Criterion::Bic)?;
/// assert_eq!(found.table[found.best].components, 3);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Parameters that do not validate, or the last error when no number of components could be fitted.
pub fn select_components(
    samples: &Samples<'_>,
    params: &GmmParams,
    range: RangeInclusive<usize>,
    criterion: Criterion,
) -> Result<Selection> {
    if matches!(params.start, Start::Mixture(_)) {
        return Err(Error::InvalidParameter {
            name: "start",
            allowed: "no warm start in a selection",
            value: f64::NAN,
        });
    }
    let fits: Vec<(usize, Result<(Mixture, FitReport)>)> = range
        .into_par_iter()
        .map(|components| {
            let plan = GmmParams { components, ..params.clone() }.validate();
            (components, plan.and_then(|plan| plan.fit(samples)))
        })
        .collect();
    let mut best: Option<(f64, usize, Mixture)> = None;
    let mut table = Vec::with_capacity(fits.len());
    let mut last_error = Error::TooFewSamples { what: "numbers of components to try", needed: 1, got: 0 };
    for (index, (components, fit)) in fits.into_iter().enumerate() {
        let result = match fit {
            Ok((mixture, report)) => {
                let value = match criterion {
                    Criterion::Bic => report.bic,
                    Criterion::Aic => report.aic,
                };
                if best.as_ref().is_none_or(|(b, ..)| value < *b) {
                    best = Some((value, index, mixture));
                }
                Ok(report)
            }
            Err(error) => {
                last_error = error.clone();
                Err(error)
            }
        };
        table.push(Candidate { components, result });
    }
    match best {
        Some((_, best, mixture)) => Ok(Selection { mixture, best, table }),
        None => Err(last_error),
    }
}
