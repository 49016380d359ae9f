//! From what was just seen to what will be: the posture ahead of the latency.
//!
//! Where the worker's motion fits the learned action, the motion model says how it goes on. The posture seen, `z` with
//! covariance `R`, corrects the model's mean `m(s)` with covariance `V(s)` at the estimated phase `s` by Gaussian
//! conditioning, `d = V (V + R)^-1 (z - m(s))`, and the correction fades with the time constant `residual_s`, because
//! tomorrow's deviation resembles today's only for a while:
//!
//! ```text
//! h(now + tau) = m(s + tau) + exp(-tau / residual_s) d
//! ```
//!
//! Where it does not fit, or nothing was learned, a constant-velocity Kalman filter carries the posture on, and
//! [`Prediction::basis`] says so. The variance of the prediction is carried along in both cases.

use core::time::Duration;

use nalgebra::Cholesky;

use crate::error::Error;
use crate::kalman::ConstantVelocity;
use crate::model::MotionModel;
use crate::phase::{PhaseEstimate, PhaseFilter, PhaseParams};
use crate::posture::{DIMENSION, Posture, PostureMatrix, PostureVector};
use crate::sample::ArmSample;

/// Time constant of a deviation from the model, seconds. A worker who works 3 cm further left does so for about this
/// long at least; doubled or halved it changes predictions over 100 ms by less than a tenth of the deviation.
const RESIDUAL_S: f64 = 0.5;

/// Spectral densities of the acceleration for the baseline filter: m^2/s^3 for the wrist, rad^2/s^3 for the angles. On the
/// three sewing actions at 30 Hz with 4 mm of noise a quarter of it predicts 60 to 200 ms ahead by 8 to 13 % better, five
/// times of it by a quarter to a third worse (`cargo xtask bench follow`); the larger value loses less on quicker hands.
const ACCELERATION_DENSITY: f64 = 0.2;

/// What a prediction rests on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// The motion model, corrected by what was seen.
    Model,
    /// Constant velocity: nothing was learned, or the worker does something else.
    ConstantVelocity,
}

/// A posture expected at some time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expected {
    /// Wrist (m, `world`) and arm angles (rad).
    pub posture: PostureVector,
    /// Its rate, per second.
    pub rate: PostureVector,
    /// Variance of each coordinate.
    pub variance: PostureVector,
}

/// What one arm sample says about the near future.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Capture time of the sample.
    pub captured: Duration,
    /// What the prediction rests on.
    pub basis: Basis,
    /// Where in the action the worker is, if a model was used.
    pub phase: Option<PhaseEstimate>,
    /// Expected postures at `captured`, `captured + step`, `captured + 2 step` and so on.
    pub ahead: Vec<Expected>,
    /// Time between two expected postures.
    pub step: Duration,
}

/// Turns arm samples into predictions.
#[derive(Debug, Clone)]
pub struct Predictor {
    learned: Option<(MotionModel, PhaseFilter<DIMENSION>)>,
    kalman: ConstantVelocity<DIMENSION>,
    last: Option<[f64; DIMENSION]>,
    step: Duration,
    rows: usize,
}

impl Predictor {
    /// A predictor over `horizon`, in steps of `step`; without a model it extrapolates at constant velocity.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a step that is zero or longer than the horizon, or phase settings out of range.
    pub fn new(
        model: Option<MotionModel>,
        phase: PhaseParams,
        horizon: Duration,
        step: Duration,
    ) -> Result<Self, Error> {
        if step.is_zero() || step > horizon {
            let expected = format!("above 0 and at most the horizon of {} s", horizon.as_secs_f64());
            return Err(Error::Parameter { name: "prediction step", value: step.as_secs_f64(), expected });
        }
        let learned = match model {
            None => None,
            Some(model) => {
                let filter = PhaseFilter::new(model.duration_s(), model.is_cyclic(), phase, |t| {
                    let at = model.at(t);
                    (at.mean, at.covariance)
                })?;
                Some((model, filter))
            }
        };
        Ok(Self {
            learned,
            kalman: ConstantVelocity::new(ACCELERATION_DENSITY)?,
            last: None,
            step,
            rows: (horizon.as_nanos() / step.as_nanos()) as usize + 1,
        })
    }

    /// The motion model in use.
    pub fn model(&self) -> Option<&MotionModel> {
        self.learned.as_ref().map(|(model, _)| model)
    }

    /// Takes a sample. `Ok(None)`: a joint is lost, so that this sample says nothing; the caller coasts on the last
    /// prediction and watches its age.
    ///
    /// # Errors
    /// [`Error::NotFinite`] and [`Error::TimeRunsBackwards`] for unusable samples.
    pub fn observe(&mut self, sample: &ArmSample) -> Result<Option<Prediction>, Error> {
        let Some(posture) = Posture::of(sample) else { return Ok(None) };
        let row = self.last.map_or_else(|| posture.row(), |last| posture.unwrapped_near(&last));
        self.last = Some(row);
        let seen = PostureVector::from(row);
        let noise = posture.noise();
        self.kalman.update(sample.captured, &seen, &noise.diagonal())?;

        let Some((model, filter)) = &mut self.learned else {
            return Ok(Some(self.at_constant_velocity(sample.captured, None)));
        };
        let phase = filter.update(sample.captured, &seen, &noise)?;
        if !phase.matches {
            return Ok(Some(self.at_constant_velocity(sample.captured, Some(phase))));
        }
        let now = model.at(phase.phase_s);
        let correction = gain(&now.covariance, &noise) * (seen - now.mean);
        let ahead = (0..self.rows)
            .map(|i| {
                let tau = i as f64 * self.step.as_secs_f64();
                let at = model.at(phase.phase_s + tau);
                let fade = (-tau / RESIDUAL_S).exp();
                // Not knowing the phase by sigma_s moves the posture by rate * sigma_s.
                let from_phase = at.rate.component_mul(&at.rate) * phase.sigma_s * phase.sigma_s;
                Expected {
                    posture: at.mean + correction * fade,
                    rate: at.rate - correction * (fade / RESIDUAL_S),
                    variance: at.covariance.diagonal() * (1.0 - fade * fade) + noise.diagonal() + from_phase,
                }
            })
            .collect();
        Ok(Some(Prediction {
            captured: sample.captured,
            basis: Basis::Model,
            phase: Some(phase),
            ahead,
            step: self.step,
        }))
    }

    fn at_constant_velocity(&self, captured: Duration, phase: Option<PhaseEstimate>) -> Prediction {
        let ahead = (0..self.rows)
            .filter_map(|i| {
                let time = captured + self.step * i as u32;
                let (posture, rate) = self.kalman.at(time)?;
                Some(Expected { posture, rate, variance: self.kalman.variance_at(time)? })
            })
            .collect();
        Prediction { captured, basis: Basis::ConstantVelocity, phase, ahead, step: self.step }
    }
}

/// `V (V + R)^-1`; zero where the sum cannot be factored, which leaves the model uncorrected.
fn gain(model: &PostureMatrix, noise: &PostureMatrix) -> PostureMatrix {
    Cholesky::new(model + noise).map_or_else(PostureMatrix::zeros, |factor| factor.solve(model).transpose())
}
