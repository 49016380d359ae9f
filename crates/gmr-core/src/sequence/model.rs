//! Learned elements in order: what a model file holds, checked.

use serde::{Deserialize, Serialize};

use super::regressor::SequenceRegressor;
use crate::error::{Error, Result, check_len};
use crate::gmm::Mixture;
use crate::regress::Regressor;
use crate::segment::MotionElement;

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
