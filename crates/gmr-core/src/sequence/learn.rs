//! One mixture per element, from demonstrations.

use std::ops::Range;

use super::model::{ElementModel, ElementSequence, ElementSequenceParts};
use crate::error::{Error, Result, check_len};
use crate::fusion::{Fusion, FusionReading};
use crate::gmm::{FitReport, GmmPlan, Mixture};
use crate::samples::Samples;
use crate::segment::MotionElement;
use crate::trajectory::Trajectory;

impl ElementSequence {
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
}
