//! Teach, learn, follow: what becomes of arm samples. The same for live pictures and for recordings.

use std::time::{Duration, Instant};

use follow::{ArmSample, Basis, JointPlan, LearnParams, Lesson, MotionModel, Predictor, Retargeter, teach};

use crate::cell::{Cell, HORIZON, PLAN_STEP};
use crate::error::Error;
use crate::summary::{Latencies, Learned};

/// A learned action with what the learning reports.
#[derive(Debug, Clone)]
pub struct Action {
    /// The model.
    pub model: MotionModel,
    /// Facts for the summary.
    pub learned: Learned,
}

impl Action {
    /// Learns from the samples of a lesson.
    ///
    /// # Errors
    /// [`Error::Follow`] where too little was seen, or the mixtures cannot be fitted.
    pub fn learn(samples: &[ArmSample], cell: &Cell) -> Result<Self, Error> {
        let started = Instant::now();
        let lesson: Lesson = teach(samples, &cell.config.teach.cut)?;
        let learn: &LearnParams = &cell.config.teach.learn;
        let (model, reports) = MotionModel::learn(&lesson, learn)?;
        let floored: usize = reports.iter().map(|report| report.floored).sum();
        if floored > 0 {
            tracing::info!(floored, "covariances were held at their floor while learning");
        }
        let learned = Learned {
            demonstrations: lesson.report.demonstrations,
            elements: model.elements(),
            duration_s: model.duration_s(),
            cyclic: model.is_cyclic(),
            matched_share: None,
            scale: cell.scale(model.radius_m()),
            learn_ms: started.elapsed().as_secs_f64() * 1e3,
        };
        Ok(Self { model, learned })
    }

    /// An action that was learned before.
    pub fn known(model: MotionModel, cell: &Cell) -> Self {
        let learned = Learned {
            demonstrations: model.demonstrations(),
            elements: model.elements(),
            duration_s: model.duration_s(),
            cyclic: model.is_cyclic(),
            matched_share: None,
            scale: cell.scale(model.radius_m()),
            learn_ms: 0.0,
        };
        Self { model, learned }
    }
}

/// Follows with a learned action: samples in, joint plans out.
#[derive(Debug, Clone)]
pub struct Follower {
    predictor: Predictor,
    retargeter: Retargeter,
    with_model: u64,
    predictions: u64,
}

impl Follower {
    /// A follower in a cell.
    ///
    /// # Errors
    /// [`Error::Follow`] for settings out of range.
    pub fn new(cell: &Cell, model: MotionModel) -> Result<Self, Error> {
        let retargeter = cell.retargeter(model.centre(), model.radius_m())?;
        let predictor = Predictor::new(Some(model), cell.config.teach.phase, HORIZON, PLAN_STEP)?;
        Ok(Self { predictor, retargeter, with_model: 0, predictions: 0 })
    }

    /// A follower of another action, which keeps the correspondence of the worker's and the robot's space.
    ///
    /// # Errors
    /// [`Error::Follow`] for settings out of range.
    pub fn with_model(&self, cell: &Cell, model: MotionModel) -> Result<Self, Error> {
        let predictor = Predictor::new(Some(model), cell.config.teach.phase, HORIZON, PLAN_STEP)?;
        Ok(Self { predictor, retargeter: self.retargeter.clone(), with_model: 0, predictions: 0 })
    }

    /// Predictions that rested on the model so far.
    pub fn matched(&self) -> u64 {
        self.with_model
    }

    /// The plan for a sample; `None` where a joint is lost.
    ///
    /// # Errors
    /// [`Error::Follow`] for samples that are not finite or out of order.
    pub fn follow(&mut self, sample: &ArmSample, latencies: &mut Latencies) -> Result<Option<JointPlan>, Error> {
        let started = Instant::now();
        let Some(prediction) = self.predictor.observe(sample)? else { return Ok(None) };
        self.predictions += 1;
        self.with_model += u64::from(prediction.basis == Basis::Model);
        let plan = self.retargeter.plan(&prediction)?;
        latencies.add("predict", started.elapsed());
        Ok(Some(plan))
    }

    /// A plan that rests where a sample is, as seen at `captured`.
    ///
    /// # Errors
    /// As [`Follower::follow`].
    pub fn rest_at(&mut self, sample: &ArmSample, captured: Duration) -> Result<Option<JointPlan>, Error> {
        let plan = self.clone().follow(sample, &mut Latencies::default())?;
        Ok(plan.map(|plan| {
            let rows = plan.first_row().map(|q| motion::Sample::new(q, 0.0)).collect();
            JointPlan { captured, rows, ..plan }
        }))
    }

    /// The retargeting in use.
    pub fn retargeter(&self) -> &Retargeter {
        &self.retargeter
    }

    /// Share of predictions that rested on the model; `None` before the first.
    pub fn matched_share(&self) -> Option<f64> {
        (self.predictions > 0).then(|| self.with_model as f64 / self.predictions as f64)
    }
}
