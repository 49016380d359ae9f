//! The jerk-limited tracker.

use std::time::Duration;

use motion::{
    AccelerationSource, AgePolicy, EngageParams, JointLimits, Sample, State, Synchronisation, Target, TrackerParams,
};
use numpy::{PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::array::{borrowed, check_len, moved2};
use crate::failure::Failure;

/// A tracker that follows from the start, at a fixed time step.
#[pyclass(module = "ogg_rs._native")]
pub(crate) struct Tracker {
    inner: motion::Tracker,
    step: Duration,
    joints: usize,
}

fn duration(field: &'static str, seconds: f64) -> Result<Duration, Failure> {
    Duration::try_from_secs_f64(seconds).map_err(|_| {
        motion::Error::InvalidParameter { field, allowed: "a finite time, not negative", value: seconds }.into()
    })
}

impl Tracker {
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        moved2(py, flat(self.inner.states()), [self.joints, 3])
    }

    fn offer_slices(&mut self, position: &[f64], velocity: &[f64]) -> Result<(), Failure> {
        check_len("target position", self.joints, position.len())?;
        check_len("target velocity", self.joints, velocity.len())?;
        let samples: Vec<Sample> = position.iter().zip(velocity).map(|(p, v)| Sample::new(*p, *v)).collect();
        Ok(self.inner.offer(&Target::new(0.0, &samples))?)
    }
}

fn flat(states: &[State]) -> Vec<f64> {
    states.iter().flat_map(|s| [s.position_rad, s.velocity_rad_s, s.acceleration_rad_s2]).collect()
}

#[pymethods]
impl Tracker {
    /// `limits: (n, 5)` as lower, upper, velocity, acceleration, jerk; `start: (n)` at rest.
    #[new]
    fn new(
        limits: PyReadonlyArray2<'_, f64>,
        step_s: f64,
        start: Vec<f64>,
        bandwidth_rad_s: f64,
        coast_s: f64,
        fade_s: f64,
    ) -> PyResult<Self> {
        check_len("numbers per joint limit", 5, limits.shape()[1])?;
        let joints = limits.shape()[0];
        let limits = borrowed("limits", &limits)?.chunks_exact(5).map(|v| JointLimits {
            lower_rad: v[0],
            upper_rad: v[1],
            velocity_rad_s: v[2],
            acceleration_rad_s2: v[3],
            jerk_rad_s3: v[4],
        });
        let step = duration("dt", step_s)?;
        let params = TrackerParams {
            limits: limits.collect(),
            bandwidth_rad_s,
            synchronisation: Synchronisation::None,
            acceleration: AccelerationSource::Estimated,
            age: AgePolicy { coast: duration("coast_s", coast_s)?, fade: duration("fade_s", fade_s)? },
            max_step: step,
            horizon_capacity: 0,
            // Not used: the tracker takes over at rest and follows at once.
            engage: EngageParams {
                velocity_rad_s: 0.3,
                tolerance_rad: 0.02,
                gap_rad: 0.01,
                ramp: Duration::from_secs(1),
            },
        };
        let states: Vec<State> = start.iter().map(|q| State::at_rest(*q)).collect();
        let plan = params.validate().map_err(Failure::from)?;
        Ok(Self { inner: plan.take_over(&states).map_err(Failure::from)?, step, joints })
    }

    fn offer(&mut self, position: Vec<f64>, velocity: Vec<f64>) -> PyResult<()> {
        Ok(self.offer_slices(&position, &velocity)?)
    }

    fn stop(&mut self) {
        self.inner.stop();
    }

    #[getter]
    fn is_at_rest(&self) -> bool {
        self.inner.is_at_rest()
    }

    /// The last command, `(n, 3)`.
    fn command<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.states(py)
    }

    /// Moves on by one time step; the new command, `(n, 3)`.
    fn step<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.inner.update(self.step).map_err(Failure::from)?;
        self.states(py)
    }

    /// One target and one step per row; the commands, `(m, 3 n)`.
    fn track<'py>(
        &mut self,
        py: Python<'py>,
        positions: PyReadonlyArray2<'py, f64>,
        velocities: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (rows, joints) = (positions.shape()[0], self.joints);
        check_len("columns of positions", joints, positions.shape()[1])?;
        check_len("columns of velocities", joints, velocities.shape()[1])?;
        check_len("rows of velocities", rows, velocities.shape()[0])?;
        let (p, v) = (borrowed("positions", &positions)?, borrowed("velocities", &velocities)?);
        let commands = py.detach(|| {
            let mut commands = Vec::with_capacity(3 * p.len());
            for (position, velocity) in p.chunks_exact(joints).zip(v.chunks_exact(joints)) {
                self.offer_slices(position, velocity)?;
                self.inner.update(self.step)?;
                commands.extend(flat(self.inner.states()));
            }
            Ok::<_, Failure>(commands)
        })?;
        moved2(py, commands, [rows, 3 * joints])
    }
}
