//! The learned action: one Gaussian mixture over (t, h) per motion element, joined to one smooth motion.
//!
//! Per element of `element_s` (the paper's 1000 ms) the mixture of equation (5) is fitted by EM from a k-means start, and
//! conditioned on time by equations (7)-(10), in the corrected reading that `gmr-core` documents. Elements join with
//! continuous position and velocity. Where the action repeats, its end joins its beginning in the same way: the
//! demonstrations reach [`MotionModel::seam_s`] into the next repetition, and over that time the end fades into the start
//! with the cubic `s^2 (3 - 2 s)`, whose slope is zero at both ends.
//!
//! A query costs about a microsecond per element touched, and allocates one workspace.

use gmr_core::{ElementSequence, FitReport, GmmParams, SequenceRegressor, Trajectory, segment_fixed};
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::posture::{DIMENSION, PostureMatrix, PostureVector};
use crate::teach::Lesson;

/// Written into a model file; anything else is refused.
const FORMAT: &str = "ogg-motion-model/1";

/// Settings of the learning stage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LearnParams {
    /// Length of a motion element, seconds (paper: 1.0).
    pub element_s: f64,
    /// Gaussian components per element. Five resolve half a second of hand motion each with room to spare.
    pub components: usize,
    /// Independent starts per element; the best is kept.
    pub restarts: usize,
    /// Time over which two elements are blended, seconds.
    pub blend_s: f64,
    /// Seed of the starts.
    pub seed: u64,
}

impl Default for LearnParams {
    fn default() -> Self {
        Self { element_s: 1.0, components: 5, restarts: 3, blend_s: 0.2, seed: 0 }
    }
}

/// What learning did, per element.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LearnReport {
    /// EM iterations.
    pub iterations: usize,
    /// Final log-likelihood, nats.
    pub log_likelihood: f64,
    /// Covariances that had to be floored.
    pub floored: usize,
}

/// The learned action.
#[derive(Debug, Clone)]
pub struct MotionModel {
    file: ModelFile,
    regressor: SequenceRegressor,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelFile {
    format: String,
    /// Duration of one repetition, seconds.
    duration_s: f64,
    /// How far the sequence reaches into the next repetition; zero for an action that does not repeat.
    seam_s: f64,
    /// Mean of the demonstrated postures.
    centre: [f64; DIMENSION],
    /// Repetitions the model was learned from.
    demonstrations: usize,
    sequence: ElementSequence,
}

/// The model at one phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelPoint {
    /// Conditional mean, equation (9): m and rad.
    pub mean: PostureVector,
    /// Its derivative with respect to time, per second.
    pub rate: PostureVector,
    /// Conditional covariance, equation (10) in full.
    pub covariance: PostureMatrix,
}

impl MotionModel {
    /// Learns from a lesson.
    ///
    /// # Errors
    /// [`Error::Mixture`] where an element cannot be fitted, with which and why; [`Error::Parameter`].
    pub fn learn(lesson: &Lesson, params: &LearnParams) -> Result<(Self, Vec<LearnReport>), Error> {
        let report = &lesson.report;
        if !(params.element_s >= 2.0 * params.blend_s && params.element_s.is_finite() && params.blend_s >= 0.0) {
            let expected = format!("at least twice the blend of {} s", params.blend_s);
            return Err(Error::Parameter { name: "learn.element_s", value: params.element_s, expected });
        }
        let trajectories = lesson
            .demonstrations
            .iter()
            .map(|demo| {
                let times = (0..demo.postures.len()).map(|i| i as f64 * demo.step_s).collect();
                Trajectory::new(times, demo.postures.concat(), DIMENSION)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let longest = trajectories
            .iter()
            .max_by(|a, b| a.end_s().total_cmp(&b.end_s()))
            .ok_or(Error::TooLittleSeen { usable: 0, span_s: 0.0, needed: 1, needed_s: params.element_s })?;
        let elements = segment_fixed(longest, params.element_s)?;
        let plan = GmmParams {
            components: params.components,
            restarts: params.restarts,
            seed: params.seed,
            ..GmmParams::default()
        }
        .validate()?;
        let shortest = elements.iter().map(gmr_core::MotionElement::duration_s).fold(f64::INFINITY, f64::min);
        let blend_s = params.blend_s.min(0.5 * shortest);
        let (sequence, reports) = ElementSequence::learn(&trajectories, &elements, blend_s, &plan)?;
        let reports = reports.iter().map(LearnReport::of).collect();

        let rows = || lesson.demonstrations.iter().flat_map(|d| &d.postures);
        let count = rows().count() as f64;
        let centre = core::array::from_fn(|d| rows().map(|row| row[d]).sum::<f64>() / count);
        let seam_s = if report.cyclic { sequence.end_s() - report.duration_s } else { 0.0 };
        let file = ModelFile {
            format: FORMAT.to_owned(),
            duration_s: report.duration_s,
            seam_s: seam_s.max(0.0),
            centre,
            demonstrations: report.demonstrations,
            sequence,
        };
        Ok((Self::from_file(file)?, reports))
    }

    fn from_file(file: ModelFile) -> Result<Self, Error> {
        let wrong = |message: String| Err(Error::ModelFile { message });
        if file.format != FORMAT {
            return wrong(format!("format {:?}, expected {FORMAT:?}", file.format));
        }
        if file.sequence.dim() != DIMENSION {
            return wrong(format!("{} coordinates per posture, expected {DIMENSION}", file.sequence.dim()));
        }
        let end_s = file.sequence.end_s();
        if !(file.duration_s > 0.0 && file.seam_s >= 0.0 && file.duration_s + file.seam_s <= end_s + 1e-9) {
            return wrong(format!(
                "duration {} s and seam {} s, expected them within the {end_s} s of the elements",
                file.duration_s, file.seam_s
            ));
        }
        let regressor = file.sequence.regressor()?;
        Ok(Self { file, regressor })
    }

    /// Reads what [`MotionModel::to_json`] wrote.
    ///
    /// # Errors
    /// [`Error::ModelFile`] with line and column, or with what does not fit together.
    pub fn from_json(text: &str) -> Result<Self, Error> {
        let file: ModelFile = serde_json::from_str(text).map_err(|e| Error::ModelFile { message: e.to_string() })?;
        Self::from_file(file)
    }

    /// The model as JSON; every number survives the round trip exactly.
    ///
    /// # Panics
    /// Never: a model holds finite numbers only.
    pub fn to_json(&self) -> String {
        serde_json::to_string(&self.file).expect("a motion model is representable as JSON")
    }

    /// Duration of one repetition, seconds.
    pub fn duration_s(&self) -> f64 {
        self.file.duration_s
    }

    /// How far the demonstrations reach into the next repetition, seconds; zero where the action does not repeat.
    pub fn seam_s(&self) -> f64 {
        self.file.seam_s
    }

    /// Whether the end of the action joins its beginning.
    pub fn is_cyclic(&self) -> bool {
        self.file.seam_s > 0.0
    }

    /// Number of motion elements.
    pub fn elements(&self) -> usize {
        self.regressor.elements().len()
    }

    /// Repetitions the model was learned from.
    pub fn demonstrations(&self) -> usize {
        self.file.demonstrations
    }

    /// The elements with their mixtures.
    pub fn sequence(&self) -> &ElementSequence {
        &self.file.sequence
    }

    /// Mean of the demonstrated postures: what the robot's home stands for.
    pub fn centre(&self) -> [f64; DIMENSION] {
        self.file.centre
    }

    /// Largest distance of the wrist from the centre anywhere in the action, metres (in steps of 20 ms).
    pub fn radius_m(&self) -> f64 {
        let steps = (self.duration_s() / 0.02).ceil() as usize;
        (0..=steps)
            .map(|i| {
                let mean = self.at(self.duration_s() * i as f64 / steps as f64).mean;
                (0..3).map(|d| (mean[d] - self.file.centre[d]).powi(2)).sum::<f64>().sqrt()
            })
            .fold(0.0, f64::max)
    }

    /// The action at time `t_s`. Where it repeats, any time is good; else the ends are held.
    ///
    /// # Panics
    /// When `t_s` is not finite.
    pub fn at(&self, t_s: f64) -> ModelPoint {
        assert!(t_s.is_finite(), "a phase is a finite time, got {t_s}");
        let (duration, seam) = (self.file.duration_s, self.file.seam_s);
        if !self.is_cyclic() {
            return self.query(t_s.clamp(0.0, duration), !(0.0..=duration).contains(&t_s));
        }
        let phase = t_s.rem_euclid(duration);
        let start = self.query(phase, false);
        if phase >= seam {
            return start;
        }
        // The last repetition's continuation fades out while the first one's beginning fades in.
        let end = self.query(duration + phase, false);
        let x = phase / seam;
        let share = x * x * (3.0 - 2.0 * x);
        let slope = 6.0 * x * (1.0 - x) / seam;
        let gap = start.mean - end.mean;
        ModelPoint {
            mean: end.mean + gap * share,
            rate: end.rate * (1.0 - share) + start.rate * share + gap * slope,
            // Law of total covariance of the two.
            covariance: end.covariance * (1.0 - share)
                + start.covariance * share
                + gap * gap.transpose() * (share * (1.0 - share)),
        }
    }

    fn query(&self, t_s: f64, at_rest: bool) -> ModelPoint {
        let mut out = self.regressor.prediction();
        self.regressor
            .predict_into(t_s, &mut out)
            .expect("the workspace was made by this regressor, and the time is finite");
        ModelPoint {
            mean: PostureVector::from_column_slice(out.mean()),
            rate: if at_rest { PostureVector::zeros() } else { PostureVector::from_column_slice(out.velocity()) },
            covariance: PostureMatrix::from_row_slice(out.covariance()),
        }
    }
}

impl LearnReport {
    fn of(report: &FitReport) -> Self {
        Self {
            iterations: report.iterations,
            log_likelihood: report.log_likelihood,
            floored: report.regularisation.floored.len(),
        }
    }
}
