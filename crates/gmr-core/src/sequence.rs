//! Motion elements learned one by one and joined into one smooth motion.
//!
//! Each element has a mixture over `(t - start, h)`. Around the boundary between two elements, in a
//! window of length `blend_s`, the answer moves from one to the next with the weight
//! `w(s) = 6 s^5 - 15 s^4 + 10 s^3`, `s` in `[0, 1]`, whose first and second derivative vanish at
//! both ends. Position, velocity and acceleration of the joined mean are therefore continuous:
//! `m = (1 - w) m_0 + w m_1`, `m' = (1 - w) m_0' + w m_1' + w' (m_1 - m_0)`, and the covariance is that
//! of a mixture of the two, `(1 - w) V_0 + w V_1 + w (1 - w) (m_1 - m_0)(m_1 - m_0)'`.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, check_len};
use crate::fusion::{Fusion, FusionReading};
use crate::gmm::{FitReport, GmmPlan, Mixture};
use crate::regress::{Prediction, Regressor};
use crate::samples::Samples;
use crate::segment::MotionElement;
use crate::trajectory::Trajectory;

/// One learned element: where it lies and its mixture over `(t - start, h)`.
///
/// ```
/// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
/// # fn main() -> Result<(), gmr_core::Error> {
/// # let mixture = Mixture::new(MixtureParts {
/// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
/// # })?;
/// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
/// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
/// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
/// let sequence = ElementSequence::new(parts)?;
/// assert_eq!(sequence.parts().elements[0].element.duration_s(), 1.0);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ElementModel {
    /// The element on the motion's clock.
    pub element: MotionElement,
    /// Mixture of dimension `1 + d`, time first.
    pub mixture: Mixture,
}

/// The numbers of an [`ElementSequence`], as stored in a model file.
///
/// ```
/// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
/// # fn main() -> Result<(), gmr_core::Error> {
/// # let mixture = Mixture::new(MixtureParts {
/// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
/// # })?;
/// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
/// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
/// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
/// let sequence = ElementSequence::new(parts)?;
/// assert_eq!(sequence.parts().blend_s, 0.0);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ElementSequenceParts {
    /// Elements in order, each beginning where the one before ends.
    pub elements: Vec<ElementModel>,
    /// Length of the window around each boundary in which two elements are blended.
    pub blend_s: f64,
}

/// Learned elements in order, with the width of the joints between them.
///
/// Serialises as [`ElementSequenceParts`] and is checked again when read back.
///
/// ```
/// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
/// # fn main() -> Result<(), gmr_core::Error> {
/// # let mixture = Mixture::new(MixtureParts {
/// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
/// # })?;
/// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
/// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
/// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
/// let sequence = ElementSequence::new(parts)?;
/// assert_eq!((sequence.start_s(), sequence.end_s(), sequence.dim()), (0.0, 1.0, 1));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ElementSequenceParts", into = "ElementSequenceParts")]
pub struct ElementSequence {
    parts: ElementSequenceParts,
}

impl TryFrom<ElementSequenceParts> for ElementSequence {
    type Error = Error;

    fn try_from(parts: ElementSequenceParts) -> Result<Self> {
        Self::new(parts)
    }
}

impl From<ElementSequence> for ElementSequenceParts {
    fn from(sequence: ElementSequence) -> Self {
        sequence.parts
    }
}

impl ElementSequence {
    /// Checks that the elements follow one another and that the joints fit into them.
    ///
    /// ```
    /// use gmr_core::{ElementSequence, ElementSequenceParts};
    /// assert!(ElementSequence::new(ElementSequenceParts { elements: vec![], blend_s: 0.0 }).is_err());
    /// ```
    ///
    /// # Errors
    /// No element, a gap, an element shorter than `blend_s`, or mixtures of different dimension.
    pub fn new(parts: ElementSequenceParts) -> Result<Self> {
        let Some(first) = parts.elements.first() else {
            return Err(Error::TooFewSamples { what: "element sequence", needed: 1, got: 0 });
        };
        if !(parts.blend_s >= 0.0 && parts.blend_s.is_finite()) {
            return Err(Error::InvalidParameter { name: "blend_s", allowed: "[0, inf)", value: parts.blend_s });
        }
        let dim = first.mixture.dim();
        if dim < 2 {
            return Err(Error::InvalidParameter {
                name: "element mixture dimension",
                allowed: "at least 2 (time and one value)",
                value: dim as f64,
            });
        }
        let mut previous = first.element.start_s;
        for model in &parts.elements {
            check_len("element mixture dimension", dim, model.mixture.dim())?;
            let MotionElement { start_s, end_s } = model.element;
            if !((start_s - previous).abs() <= 1e-9) {
                return Err(Error::InvalidParameter {
                    name: "element start_s",
                    allowed: "the end of the element before",
                    value: start_s,
                });
            }
            if !(end_s > start_s && end_s.is_finite()) {
                return Err(Error::InvalidParameter {
                    name: "element end_s",
                    allowed: "after its start",
                    value: end_s,
                });
            }
            if parts.elements.len() > 1 && !(end_s - start_s >= parts.blend_s) {
                return Err(Error::InvalidParameter {
                    name: "blend_s",
                    allowed: "at most the shortest element",
                    value: parts.blend_s,
                });
            }
            previous = end_s;
        }
        if parts.elements.len() > 1 && parts.blend_s == 0.0 {
            return Err(Error::InvalidParameter {
                name: "blend_s",
                allowed: "above 0 with more than one element",
                value: 0.0,
            });
        }
        Ok(Self { parts })
    }

    /// Learns one mixture per element from one or more demonstrations.
    ///
    /// Demonstrations share one clock (see [`Trajectory::from_zero`]) and one meaning of columns.
    /// Each element is fitted to the samples of all of them within half a blend of its ends, so that
    /// the joints never extrapolate. Returns the sequence and one report per element.
    ///
    /// ```
    /// use gmr_core::{ElementSequence, GmmParams, Trajectory, segment_fixed};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// // A straight line, h = 2 t.
    /// let times: Vec<f64> = (0..=40).map(|i| f64::from(i) * 0.05).collect();
    /// let values = times.iter().map(|t| 2.0 * t).collect();
    /// let line = Trajectory::new(times, values, 1)?;
    /// let (elements, plan) = (segment_fixed(&line, 1.0)?, GmmParams::default().validate()?);
    /// let (sequence, reports) = ElementSequence::learn(&[line], &elements, 0.2, &plan)?;
    /// let regressor = sequence.regressor()?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_into(1.25, &mut out)?;
    /// assert_eq!(reports.len(), 2);
    /// assert!((out.mean()[0] - 2.5).abs() < 1e-3);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Demonstrations of different dimension, an element with too few samples, or a failed fit.
    pub fn learn(
        demonstrations: &[Trajectory],
        elements: &[MotionElement],
        blend_s: f64,
        plan: &GmmPlan,
    ) -> Result<(Self, Vec<FitReport>)> {
        Self::learn_with(demonstrations, elements, blend_s, |samples, _| plan.fit(samples))
    }

    /// As [`ElementSequence::learn`], with weights fused with ARIMA errors (paper, eqs. 11-14).
    ///
    /// `errors` has one list per demonstration, see [`crate::arima_errors`].
    ///
    /// ```
    /// use gmr_core::{ElementSequence, GmmParams, Trajectory, segment_fixed};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// // A straight line, h = 2 t.
    /// let times: Vec<f64> = (0..=40).map(|i| f64::from(i) * 0.05).collect();
    /// let values = times.iter().map(|t| 2.0 * t).collect();
    /// let line = Trajectory::new(times, values, 1)?;
    /// let (elements, plan) = (segment_fixed(&line, 1.0)?, GmmParams::default().validate()?);
    /// let errors = [vec![1.0; 41]];
    /// let reading = gmr_core::FusionReading::Components;
    /// let (sequence, _) = ElementSequence::learn_fused(&[line], &elements, 0.2, &plan, &errors, reading)?;
    /// assert_eq!(sequence.parts().elements.len(), 2);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`ElementSequence::learn`], or errors that do not match the demonstrations.
    pub fn learn_fused(
        demonstrations: &[Trajectory],
        elements: &[MotionElement],
        blend_s: f64,
        plan: &GmmPlan,
        errors: &[Vec<f64>],
        reading: FusionReading,
    ) -> Result<(Self, Vec<FitReport>)> {
        check_len("ARIMA errors, demonstrations", demonstrations.len(), errors.len())?;
        for (demonstration, errors) in demonstrations.iter().zip(errors) {
            check_len("ARIMA errors, samples", demonstration.len(), errors.len())?;
        }
        Self::learn_with(demonstrations, elements, blend_s, |samples, ranges| {
            let chosen: Vec<f64> =
                errors.iter().zip(ranges).flat_map(|(e, range)| e[range.clone()].iter().copied()).collect();
            plan.fit_fused(samples, &Fusion::new(&chosen, reading)?)
        })
    }

    fn learn_with(
        demonstrations: &[Trajectory],
        elements: &[MotionElement],
        blend_s: f64,
        fit: impl Fn(&Samples<'_>, &[Range<usize>]) -> Result<(Mixture, FitReport)>,
    ) -> Result<(Self, Vec<FitReport>)> {
        let Some(first) = demonstrations.first() else {
            return Err(Error::TooFewSamples { what: "demonstrations", needed: 1, got: 0 });
        };
        let dim = first.dim();
        let mut models = Vec::with_capacity(elements.len());
        let mut reports = Vec::with_capacity(elements.len());
        for &element in elements {
            let mut rows = Vec::new();
            let mut ranges = Vec::with_capacity(demonstrations.len());
            for demonstration in demonstrations {
                check_len("demonstration dimension", dim, demonstration.dim())?;
                rows.extend(element.samples(demonstration, 0.5 * blend_s));
                ranges.push(element.range(demonstration, 0.5 * blend_s));
            }
            let (mixture, report) = fit(&Samples::new(&rows, dim + 1)?, &ranges)?;
            models.push(ElementModel { element, mixture });
            reports.push(report);
        }
        Ok((Self::new(ElementSequenceParts { elements: models, blend_s })?, reports))
    }

    /// The numbers, for storage.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// assert_eq!(sequence.parts().elements.len(), 1);
    /// # Ok(())
    /// # }
    /// ```
    pub fn parts(&self) -> &ElementSequenceParts {
        &self.parts
    }

    /// Start of the first element.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// assert_eq!(sequence.start_s(), 0.0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn start_s(&self) -> f64 {
        self.parts.elements[0].element.start_s
    }

    /// End of the last element.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// assert_eq!(sequence.end_s(), 1.0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn end_s(&self) -> f64 {
        self.parts.elements[self.parts.elements.len() - 1].element.end_s
    }

    /// Number of values per sample (without time).
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// assert_eq!(sequence.dim(), 1);
    /// # Ok(())
    /// # }
    /// ```
    pub fn dim(&self) -> usize {
        self.parts.elements[0].mixture.dim() - 1
    }

    /// Prepares the sequence for queries.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// assert_eq!(sequence.regressor()?.elements().len(), 1);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`Regressor::new`].
    pub fn regressor(&self) -> Result<SequenceRegressor> {
        let outputs: Vec<usize> = (1..=self.dim()).collect();
        let regressors = self
            .parts
            .elements
            .iter()
            .map(|model| Regressor::new(&model.mixture, &[0], &outputs))
            .collect::<Result<Vec<_>>>()?;
        Ok(SequenceRegressor {
            elements: self.parts.elements.iter().map(|m| m.element).collect(),
            regressors,
            blend_s: self.parts.blend_s,
        })
    }
}

/// Where a query lies in the motion.
///
/// ```
/// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
/// # fn main() -> Result<(), gmr_core::Error> {
/// # let mixture = Mixture::new(MixtureParts {
/// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
/// # })?;
/// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
/// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
/// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
/// let sequence = ElementSequence::new(parts)?;
/// let regressor = sequence.regressor()?;
/// let mut out = regressor.prediction();
/// regressor.predict_into(3.0, &mut out)?;
/// // The end of the motion, held: 1 + 2 * 0.5.
/// assert_eq!(out.phase(), Phase::After);
/// assert!((out.mean()[0] - 2.0).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Before the motion: the answer is its first point, at rest.
    Before,
    /// Within the motion.
    Within,
    /// After the motion: the answer is its last point, at rest.
    After,
}

/// An [`ElementSequence`] prepared for queries; a query allocates nothing.
///
/// ```
/// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
/// # fn main() -> Result<(), gmr_core::Error> {
/// # let mixture = Mixture::new(MixtureParts {
/// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
/// # })?;
/// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
/// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
/// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
/// let sequence = ElementSequence::new(parts)?;
/// let regressor = sequence.regressor()?;
/// let mut out = regressor.prediction();
/// regressor.predict_into(0.75, &mut out)?;
/// assert!((out.mean()[0] - 1.5).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct SequenceRegressor {
    elements: Vec<MotionElement>,
    regressors: Vec<Regressor>,
    blend_s: f64,
}

/// Result and working space of a query; made once by [`SequenceRegressor::prediction`].
///
/// ```
/// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
/// # fn main() -> Result<(), gmr_core::Error> {
/// # let mixture = Mixture::new(MixtureParts {
/// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
/// # })?;
/// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
/// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
/// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
/// let sequence = ElementSequence::new(parts)?;
/// let regressor = sequence.regressor()?;
/// let mut out = regressor.prediction();
/// regressor.predict_into(0.75, &mut out)?;
/// assert!((out.mean()[0] - 1.5).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct SequencePrediction {
    mean: Vec<f64>,
    velocity: Vec<f64>,
    covariance: Vec<f64>,
    phase: Phase,
    element: usize,
    log_density: f64,
    /// One prediction per element, because elements may differ in their number of components.
    work: Vec<Prediction>,
}

impl SequencePrediction {
    /// Mean `m(t)`, `(d)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_into(0.75, &mut out)?;
    /// assert!((out.mean()[0] - 1.5).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Velocity `dm/dt`, `(d)`, per second; zero outside the motion.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_into(0.75, &mut out)?;
    /// assert!((out.velocity()[0] - 2.0).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn velocity(&self) -> &[f64] {
        &self.velocity
    }

    /// Covariance, `(d, d)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_into(0.75, &mut out)?;
    /// assert!((out.covariance()[0] - 1.0).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn covariance(&self) -> &[f64] {
        &self.covariance
    }

    /// Whether the query lay before, within or after the motion.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_into(0.75, &mut out)?;
    /// assert_eq!(out.phase(), Phase::Within);
    /// # Ok(())
    /// # }
    /// ```
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Log density of the time under the element (blended in a joint): how usual this moment is.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_into(0.75, &mut out)?;
    /// // ln N(0.75 | 0.5, 1)
    /// assert!((out.log_density() + 0.918_938_533_204_672_7 + 0.031_25).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn log_density(&self) -> f64 {
        self.log_density
    }

    /// Index of the element the query fell into.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_into(0.75, &mut out)?;
    /// assert_eq!(out.element(), 0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn element(&self) -> usize {
        self.element
    }
}

impl SequenceRegressor {
    /// Space for the results and the work of a query.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// let mut out = regressor.prediction();
    /// assert_eq!(out.mean(), [0.0]); // nothing asked yet
    /// # Ok(())
    /// # }
    /// ```
    pub fn prediction(&self) -> SequencePrediction {
        let work: Vec<Prediction> = self.regressors.iter().map(Regressor::prediction).collect();
        let d = self.regressors[0].outputs().len();
        SequencePrediction {
            mean: vec![0.0; d],
            velocity: vec![0.0; d],
            covariance: vec![0.0; d * d],
            phase: Phase::Before,
            element: 0,
            log_density: f64::NEG_INFINITY,
            work,
        }
    }

    /// The elements in order.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// assert_eq!(regressor.elements()[0].end_s, 1.0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn elements(&self) -> &[MotionElement] {
        &self.elements
    }

    /// Mean, velocity and covariance at `time_s` on the motion's clock. Allocates nothing.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts, MotionElement, Phase};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let mixture = Mixture::new(MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.5, 1.0], covariances: vec![1.0, 2.0, 2.0, 5.0],
    /// # })?;
    /// # let element = MotionElement { start_s: 0.0, end_s: 1.0 };
    /// // One element of a second, on the line 1 + 2 (t - 0.5) with variance 1.
    /// let parts = ElementSequenceParts { elements: vec![ElementModel { element, mixture }], blend_s: 0.0 };
    /// let sequence = ElementSequence::new(parts)?;
    /// let regressor = sequence.regressor()?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_into(0.75, &mut out)?;
    /// assert!((out.mean()[0] - 1.5).abs() < 1e-12 && (out.velocity()[0] - 2.0).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// A time that is not finite, or a prediction made for another sequence.
    pub fn predict_into(&self, time_s: f64, out: &mut SequencePrediction) -> Result<()> {
        check_len("sequence prediction", self.regressors.len(), out.work.len())?;
        if !time_s.is_finite() {
            return Err(Error::NotFinite { what: "time_s", index: 0, value: time_s });
        }
        let last = self.elements.len() - 1;
        let (start, end) = (self.elements[0].start_s, self.elements[last].end_s);
        out.phase = if time_s < start {
            Phase::Before
        } else if time_s > end {
            Phase::After
        } else {
            Phase::Within
        };
        let t = time_s.clamp(start, end);
        let index = self.elements.partition_point(|e| e.end_s <= t).min(last);
        out.element = index;
        let half = 0.5 * self.blend_s;
        // The neighbour whose joint window contains t, and the boundary between the two.
        let neighbour = if index > 0 && t < self.elements[index].start_s + half {
            Some((index - 1, index, self.elements[index].start_s))
        } else if index < last && t > self.elements[index].end_s - half {
            Some((index, index + 1, self.elements[index].end_s))
        } else {
            None
        };
        if let Some((from, to, boundary)) = neighbour {
            self.query(from, t, &mut out.work)?;
            self.query(to, t, &mut out.work)?;
            let s = ((t - (boundary - half)) / self.blend_s).clamp(0.0, 1.0);
            let w = s * s * s * (s * (s * 6.0 - 15.0) + 10.0);
            let slope = 30.0 * s * s * (1.0 - s) * (1.0 - s) / self.blend_s;
            let (a, b) = (&out.work[from], &out.work[to]);
            out.log_density = (1.0 - w) * a.log_density() + w * b.log_density();
            let d = out.mean.len();
            for i in 0..d {
                let gap = b.mean()[i] - a.mean()[i];
                out.mean[i] = w.mul_add(gap, a.mean()[i]);
                let (va, vb) = (a.jacobian()[i], b.jacobian()[i]);
                out.velocity[i] = slope.mul_add(gap, w.mul_add(vb - va, va));
                for j in 0..d {
                    let other = b.mean()[j] - a.mean()[j];
                    let (ca, cb) = (a.covariance()[i * d + j], b.covariance()[i * d + j]);
                    out.covariance[i * d + j] = (w * (1.0 - w)) * (gap * other) + w.mul_add(cb - ca, ca);
                }
            }
        } else {
            self.query(index, t, &mut out.work)?;
            let a = &out.work[index];
            out.mean.copy_from_slice(a.mean());
            out.velocity.copy_from_slice(a.jacobian());
            out.covariance.copy_from_slice(a.covariance());
            out.log_density = a.log_density();
        }
        if out.phase != Phase::Within {
            out.velocity.fill(0.0);
        }
        Ok(())
    }

    fn query(&self, element: usize, t: f64, work: &mut [Prediction]) -> Result<()> {
        let local = t - self.elements[element].start_s;
        self.regressors[element].predict_with_jacobian_into(&[local], &mut work[element])
    }
}
