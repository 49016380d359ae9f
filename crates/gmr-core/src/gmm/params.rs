//! Parameters of a fit, unchecked and checked.

use serde::{Deserialize, Serialize};

use super::em;
use super::mixture::Mixture;
use super::report::FitReport;
use crate::error::{Error, Result, check_len};
use crate::fusion::Fusion;
use crate::samples::Samples;

/// Shape of the covariances.
///
/// ```
/// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
/// # fn main() -> Result<(), gmr_core::Error> {
/// # let parts = MixtureParts {
/// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
/// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
/// # };
/// // Stored per component: two variances here, four numbers if the matrices were full.
/// assert_eq!(parts.covariances.len(), 4);
/// assert_eq!(Mixture::new(parts)?.covariance(0), [4.0, 0.0, 0.0, 9.0]);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CovarianceKind {
    /// Each component has its own symmetric matrix: `k d (d + 1) / 2` numbers.
    Full,
    /// One symmetric matrix shared by all components: `d (d + 1) / 2` numbers.
    Tied,
    /// Each component has its own axis-aligned variances: `k d` numbers.
    Diagonal,
    /// Each component has one variance: `k` numbers.
    Spherical,
}

/// Where the EM starts.
///
/// ```
/// # use gmr_core::{CovarianceKind, GmmParams, MissingValues, RestartOutcome, Samples, Start, Stop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let values = [-1.1, -1.0, -0.9, 0.9, 1.0, 1.1];
/// let samples = Samples::new(&values, 1)?;
/// let params = GmmParams { components: 2, start: Start::RandomSamples, ..GmmParams::default() };
/// let (mixture, _) = params.clone().validate()?.fit(&samples)?;
/// let warm = GmmParams { start: Start::Mixture(Box::new(mixture)), ..params }.validate()?;
/// // Nothing is left to do for a warm start at the optimum: the second step sees no change.
/// assert_eq!(warm.fit(&samples)?.1.iterations, 2);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// k-means++ seeds, then Lloyd iterations; each cluster becomes a component.
    KMeans,
    /// k-means++ seeds (Arthur and Vassilvitskii 2007); each sample goes to its nearest seed.
    KMeansPlusPlus,
    /// Distinct samples drawn at random as seeds; each sample goes to its nearest seed.
    RandomSamples,
    /// A given mixture (warm start). Restarts are pointless and refused.
    Mixture(Box<Mixture>),
}

/// What a fit does with NaN.
///
/// ```
/// # use gmr_core::{CovarianceKind, GmmParams, MissingValues, RestartOutcome, Samples, Start, Stop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let values = [1.0, 2.0, 3.0, f64::NAN];
/// let missing = MissingValues::Marginalise;
/// let plan = GmmParams { missing, ..GmmParams::default() }.validate()?;
/// assert!((plan.fit(&Samples::new(&values, 1)?)?.0.mean(0)[0] - 2.0).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MissingValues {
    /// A NaN is an error.
    Refuse,
    /// A NaN is a value that was not seen; it is integrated out exactly.
    Marginalise,
}

/// Freely set parameters of a mixture fit; [`GmmParams::validate`] turns them into a plan.
///
/// Data are expected in SI units; [`GmmParams::floor`] and [`GmmParams::ridge`] are variances in
/// those units squared.
///
/// ```
/// use gmr_core::{GmmParams, Samples};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // Two groups on a line, three samples each.
/// let values = [-1.1, -1.0, -0.9, 0.9, 1.0, 1.1];
/// let plan = GmmParams { components: 2, ..GmmParams::default() }.validate()?;
/// let (mixture, report) = plan.fit(&Samples::new(&values, 1)?)?;
/// let mut means = mixture.means().to_vec();
/// means.sort_by(f64::total_cmp);
/// assert!((means[0] + 1.0).abs() < 1e-9 && (means[1] - 1.0).abs() < 1e-9);
/// assert!(report.regularisation.floored.is_empty());
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GmmParams {
    /// Number of components `k`.
    pub components: usize,
    /// Shape of the covariances.
    pub covariance: CovarianceKind,
    /// Where the EM starts.
    pub start: Start,
    /// Independent starts; the one with the highest final log-likelihood is kept.
    pub restarts: usize,
    /// EM iterations at most, per start.
    pub max_iterations: usize,
    /// EM stops when the mean log-likelihood per sample (nats) changes by less than this.
    pub tolerance: f64,
    /// Added to every variance after each M step. Biases the fit on purpose; EM may then lose a
    /// little likelihood per step.
    pub ridge: f64,
    /// Lower bound of every covariance eigenvalue. Does nothing to healthy components, keeps EM
    /// monotone, and is reported whenever it acts. Zero turns it off: a collapse is then an outcome
    /// of its restart.
    pub floor: f64,
    /// Share of each covariance replaced by its mean variance times the identity, in `[0, 1)`.
    pub shrinkage: f64,
    /// What to do with missing values.
    pub missing: MissingValues,
    /// Seed of the start; the same seed and samples give the same bytes.
    pub seed: u64,
}

impl Default for GmmParams {
    /// One full-covariance component, k-means start, one restart, at most 500 iterations to
    /// 1e-6 nats, floor 1e-9 (a deviation of 32 um, 32 urad or 32 us), no ridge, no shrinkage,
    /// missing values refused, seed 0.
    fn default() -> Self {
        Self {
            components: 1,
            covariance: CovarianceKind::Full,
            start: Start::KMeans,
            restarts: 1,
            max_iterations: 500,
            tolerance: 1e-6,
            ridge: 0.0,
            floor: 1e-9,
            shrinkage: 0.0,
            missing: MissingValues::Refuse,
            seed: 0,
        }
    }
}

impl GmmParams {
    /// Checks every field.
    ///
    /// ```
    /// use gmr_core::{Error, GmmParams};
    /// let refused = GmmParams { shrinkage: 1.0, ..GmmParams::default() }.validate();
    /// assert_eq!(refused, Err(Error::InvalidParameter { name: "shrinkage", allowed: "[0, 1)", value: 1.0 }));
    /// ```
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] names the field, the allowed interval and the value.
    pub fn validate(self) -> Result<GmmPlan> {
        let reject = |name, allowed, value| Err(Error::InvalidParameter { name, allowed, value });
        if self.components == 0 {
            return reject("components", "at least 1", 0.0);
        }
        if self.restarts == 0 {
            return reject("restarts", "at least 1", 0.0);
        }
        if self.max_iterations == 0 {
            return reject("max_iterations", "at least 1", 0.0);
        }
        if !(self.tolerance >= 0.0 && self.tolerance.is_finite()) {
            return reject("tolerance", "[0, inf)", self.tolerance);
        }
        if !(self.ridge >= 0.0 && self.ridge <= 1e280) {
            return reject("ridge", "[0, 1e280]", self.ridge);
        }
        if !(self.floor >= 0.0 && self.floor <= 1e280) {
            return reject("floor", "[0, 1e280]", self.floor);
        }
        if !(self.shrinkage >= 0.0 && self.shrinkage < 1.0) {
            return reject("shrinkage", "[0, 1)", self.shrinkage);
        }
        if let Start::Mixture(mixture) = &self.start {
            if self.restarts != 1 {
                return reject("restarts", "1 with a warm start", self.restarts as f64);
            }
            if mixture.components() != self.components {
                return reject("components", "the number of components of the warm start", self.components as f64);
            }
            if mixture.covariance_kind() != self.covariance {
                return reject("covariance", "the kind of the warm start", f64::NAN);
            }
        }
        Ok(GmmPlan { params: self })
    }
}

/// Checked parameters; the only thing that can fit a mixture.
///
/// ```
/// # fn main() -> Result<(), gmr_core::Error> {
/// let plan = gmr_core::GmmParams { components: 3, ..Default::default() }.validate()?;
/// assert_eq!(plan.params().components, 3);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct GmmPlan {
    params: GmmParams,
}

impl GmmPlan {
    /// The checked parameters.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let plan = gmr_core::GmmParams::default().validate()?;
    /// assert_eq!(plan.params().floor, 1e-9);
    /// # Ok(())
    /// # }
    /// ```
    pub fn params(&self) -> &GmmParams {
        &self.params
    }

    /// Fits a mixture to `samples: (n, d)` by expectation maximisation.
    ///
    /// Runs on the current rayon thread pool; the result does not depend on its size.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, GmmParams, MissingValues, RestartOutcome, Samples, Start, Stop};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let values = [-1.0, 1.0];
    /// let plan = GmmParams::default().validate()?;
    /// let (mixture, report) = plan.fit(&Samples::new(&values, 1)?)?;
    /// assert!(mixture.mean(0)[0].abs() < 1e-12 && (mixture.covariance(0)[0] - 1.0).abs() < 1e-12);
    /// // Two samples of the density exp(-1/2) / sqrt(2 pi) each.
    /// assert!((report.log_likelihood + 2.837_877_066_409_345).abs() < 1e-9);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Fewer distinct samples than components, missing values where they are not accepted, or
    /// [`Error::AllRestartsFailed`] when every start ended in an empty or collapsed component.
    pub fn fit(&self, samples: &Samples<'_>) -> Result<(Mixture, FitReport)> {
        em::fit(&self.params, samples, None)
    }

    /// As [`GmmPlan::fit`], with the weights of every M step after the start fused with an ARIMA model's
    /// errors (paper, eqs. 11-14; see [`crate::FusionReading`]). The likelihood may then fall;
    /// the report tells what fusion did in every iteration.
    ///
    /// ```
    /// use gmr_core::{Fusion, FusionReading, GmmParams, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let values = [-1.1, -1.0, -0.9, 0.9, 1.0, 1.1];
    /// let plan = GmmParams { components: 2, ..GmmParams::default() }.validate()?;
    /// // Two components with equal errors support each other equally: the weights stay.
    /// let fusion = Fusion::new(&[1.0; 6], FusionReading::Components)?;
    /// let (mixture, report) = plan.fit_fused(&Samples::new(&values, 1)?, &fusion)?;
    /// assert!((mixture.weights()[0] - 0.5).abs() < 1e-9);
    /// assert_eq!(report.fusion.map(|f| f.steps.len()), Some(report.iterations));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`GmmPlan::fit`], or not one error per sample.
    pub fn fit_fused(&self, samples: &Samples<'_>, fusion: &Fusion<'_>) -> Result<(Mixture, FitReport)> {
        check_len("ARIMA errors", samples.len(), fusion.errors().len())?;
        em::fit(&self.params, samples, Some(fusion))
    }
}
