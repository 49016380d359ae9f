//! Pictures of one instant to one arm sample: network, worker, gate, lift; and how long each took.

use std::time::Instant;

use follow::{ArmPixels, ArmSample, Evidence, Lift, PixelSample};
use pose::{
    ArmGate, ArmJoint, ArmKeypoints, Estimator, GateOptions, ImageView, Model, Person, Runtime, Side, WorkerOptions,
    WorkerTracker,
};

use crate::capture::FrameSet;
use crate::error::Error;
use crate::summary::Latencies;

/// One camera's own state.
struct View {
    estimator: Estimator,
    worker: WorkerTracker,
    gate: ArmGate,
}

/// What was seen in one set of pictures.
#[derive(Debug, Clone)]
pub struct Seen {
    /// The arm in `world`.
    pub sample: ArmSample,
    /// The gated arm per view.
    pub arms: Vec<ArmKeypoints>,
    /// The worker per view, as the network saw them; `None` where nobody was found.
    pub workers: Vec<Option<Person>>,
}

/// The chain from pictures to arm samples.
pub struct Vision {
    views: Vec<View>,
    lift: Lift,
}

impl std::fmt::Debug for Vision {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Vision").field("views", &self.views.len()).field("lift", &self.lift).finish()
    }
}

impl Vision {
    /// One network per camera of the lift, sharing a runtime.
    ///
    /// # Errors
    /// [`Error::Pose`] for weights that are missing, damaged or not what their card says.
    pub fn load(model: &Model, runtime: &Runtime, side: Side, lift: Lift) -> Result<Self, Error> {
        let views = lift
            .cameras()
            .iter()
            .map(|_| {
                Ok(View {
                    estimator: Estimator::load(model, runtime)?,
                    worker: WorkerTracker::new(WorkerOptions::default())?,
                    gate: ArmGate::new(side, GateOptions::default())?,
                })
            })
            .collect::<Result<Vec<_>, Error>>()?;
        Ok(Self { views, lift })
    }

    /// Looks at every picture a second time, mirrored.
    ///
    /// # Errors
    /// [`Error::Pose`] for a network that does not answer with maps.
    pub fn mirrored(self) -> Result<Self, Error> {
        let mirrored = |view: View| Ok(View { estimator: view.estimator.mirrored()?, ..view });
        Ok(Self { views: self.views.into_iter().map(mirrored).collect::<Result<_, Error>>()?, lift: self.lift })
    }

    /// The lift with its cameras.
    pub fn lift(&self) -> &Lift {
        &self.lift
    }

    /// Network and runtime, for logs and recordings.
    pub fn describe(&self) -> String {
        self.views.first().map_or_else(String::new, |view| {
            format!("{} on {}", view.estimator.card().name, view.estimator.runtime_info())
        })
    }

    /// Looks at one set of pictures.
    ///
    /// # Errors
    /// [`Error::Pose`] where the network fails, [`Error::Follow`] unless there is one picture per camera.
    pub fn see(&mut self, set: &FrameSet, latencies: &mut Latencies) -> Result<Seen, Error> {
        let mut arms = Vec::with_capacity(self.views.len());
        let mut workers = Vec::with_capacity(self.views.len());
        let started = Instant::now();
        for (view, frame) in self.views.iter_mut().zip(&set.frames) {
            let (width, height) = frame.image.dimensions();
            let image = ImageView::new(width as usize, height as usize, frame.image.as_raw())?;
            let people = view.estimator.estimate(image)?;
            let worker = view.worker.update(set.captured, &people).person(&people).cloned();
            arms.push(view.gate.update(set.captured, worker.as_ref()));
            workers.push(worker);
        }
        latencies.add("pose", started.elapsed());
        let started = Instant::now();
        let pixels: Vec<ArmPixels> = arms.iter().map(arm_pixels).collect();
        let sample = self.lift.lift(set.captured, &pixels)?;
        latencies.add("lift", started.elapsed());
        Ok(Seen { sample, arms, workers })
    }
}

fn arm_pixels(arm: &ArmKeypoints) -> ArmPixels {
    let joint = |joint: &ArmJoint| {
        let evidence = if joint.is_measured() { Evidence::Measured } else { Evidence::Inferred };
        joint.estimate().map(|e| PixelSample { u_px: e.u_px, v_px: e.v_px, sigma_px: e.sigma_px, evidence })
    };
    ArmPixels { shoulder: joint(&arm.shoulder), elbow: joint(&arm.elbow), wrist: joint(&arm.wrist) }
}
