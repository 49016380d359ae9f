//! The simulated arm, the synthetic worker, and pictures of it.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use can_driver::{Drive, Setpoint};
use kin::UrdfOptions;
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use sim::{Action, ArmParams, GroundTruth, KEYPOINT_COUNT, Keypoint, SceneVariation, Script, WorkerParams, WorkerPose};

use crate::array::{borrowed, check_finite, check_len, moved, moved2, moved3};
use crate::failure::Failure;

/// Positions and velocities, each `(n)` or `(m, n)`.
type Rows<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

fn seconds(what: &'static str, value: f64) -> Result<Duration, Failure> {
    Duration::try_from_secs_f64(value).map_err(|_| Failure::Argument {
        what,
        expected: "a finite time, not negative".to_owned(),
        got: value.to_string(),
    })
}

/// The plant.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct Arm {
    inner: Mutex<sim::Arm>,
    names: Vec<String>,
}

impl Arm {
    fn lock(&self) -> MutexGuard<'_, sim::Arm> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Arm {
    #[new]
    #[pyo3(signature = (urdf, *, start, gravity_m_s2, servo_hz, damping_ratio, gravity_compensation, substep_s))]
    fn new(
        urdf: Option<PathBuf>,
        start: Option<Vec<f64>>,
        gravity_m_s2: [f64; 3],
        servo_hz: f64,
        damping_ratio: f64,
        gravity_compensation: f64,
        substep_s: f64,
    ) -> PyResult<Self> {
        let robot = match urdf {
            Some(path) => {
                let options = UrdfOptions::default().resolve_meshes(false);
                kin::Robot::from_urdf_file(path, &options).map_err(Failure::from)?
            }
            None => kin::Robot::builtin(),
        };
        let rest = || robot.dof_joints().map(|j| 0.0_f64.clamp(j.limits.lower, j.limits.upper)).collect();
        let params = ArmParams {
            gravity_m_s2,
            servo_hz,
            damping_ratio,
            gravity_compensation,
            substep: seconds("substep_s", substep_s)?,
            ..ArmParams::new(start.unwrap_or_else(rest))
        };
        let names = robot.dof_names().into_iter().map(str::to_owned).collect();
        let inner = Mutex::new(sim::Arm::new(&robot, params).map_err(Failure::from)?);
        Ok(Self { inner, names })
    }

    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.names.clone()
    }

    /// Measured positions and velocities, `(1, n)` each.
    fn measured<'py>(&self, py: Python<'py>) -> PyResult<Rows<'py>> {
        let arm = self.lock();
        let positions = arm.measured().iter().map(|j| j.position_rad).collect();
        let velocities = arm.measured().iter().map(|j| j.velocity_rad_s).collect();
        let shape = [1, self.names.len()];
        Ok((moved2(py, positions, shape)?, moved2(py, velocities, shape)?))
    }

    /// One setpoint per row of `(m, n)`, `dt_s` each; what is measured after each, `(m, n)` each.
    fn run<'py>(
        &self,
        py: Python<'py>,
        positions: PyReadonlyArray2<'py, f64>,
        velocities: PyReadonlyArray2<'py, f64>,
        dt_s: f64,
        brake: bool,
    ) -> PyResult<Rows<'py>> {
        let (rows, joints) = (positions.shape()[0], self.names.len());
        check_len("columns of positions", joints, positions.shape()[1])?;
        check_len("columns of velocities", joints, velocities.shape()[1])?;
        check_len("rows of velocities", rows, velocities.shape()[0])?;
        let (p, v) = (borrowed("positions", &positions)?, borrowed("velocities", &velocities)?);
        let dt = seconds("dt", dt_s)?;
        let drive = if brake { Drive::Braked } else { Drive::Servo };
        let (q, qd) = py.detach(|| {
            let mut arm = self.lock();
            let (mut q, mut qd) = (Vec::with_capacity(p.len()), Vec::with_capacity(p.len()));
            for (position, velocity) in p.chunks_exact(joints).zip(v.chunks_exact(joints)) {
                let setpoints: Vec<Setpoint> = position
                    .iter()
                    .zip(velocity)
                    .map(|(&position_rad, &velocity_rad_s)| Setpoint { position_rad, velocity_rad_s })
                    .collect();
                arm.step(dt, &setpoints, drive)?;
                q.extend(arm.measured().iter().map(|j| j.position_rad));
                qd.extend(arm.measured().iter().map(|j| j.velocity_rad_s));
            }
            Ok::<_, Failure>((q, qd))
        })?;
        Ok((moved2(py, q, [rows, joints])?, moved2(py, qd, [rows, joints])?))
    }

    fn gravity_load<'py>(&self, py: Python<'py>, q: Vec<f64>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        check_len("q", self.names.len(), q.len())?;
        check_finite("q", &q)?;
        Ok(moved(py, self.lock().gravity_load(&q)))
    }
}

/// The worker.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct Worker {
    inner: sim::Worker,
}

/// Joints `(m, 18, 3)`, action of each row, phase `(m)`.
type Poses<'py> = (Bound<'py, PyArray3<f64>>, Vec<&'static str>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl Worker {
    #[new]
    fn new(seed: u64, action: &str, repetitions: u32, period_s: f64, variation: f64, amplitude: f64) -> PyResult<Self> {
        let script = match Action::ALL.iter().find(|a| a.name() == action) {
            Some(action) => Script::Repeat(*action),
            None if action == "round" => Script::Round { repetitions },
            None => {
                let expected = "'move', 'align', 'flip' or 'round'".to_owned();
                return Err(Failure::Argument { what: "action", expected, got: format!("{action:?}") }.into());
            }
        };
        let params = WorkerParams { seed, script, period_s, variation, amplitude, ..WorkerParams::default() };
        Ok(Self { inner: sim::Worker::new(params).map_err(Failure::from)? })
    }

    fn poses<'py>(&self, py: Python<'py>, times_s: PyReadonlyArray1<'py, f64>) -> PyResult<Poses<'py>> {
        let times = borrowed("t", &times_s)?;
        let instants = times.iter().map(|&t| seconds("t", t)).collect::<Result<Vec<_>, _>>()?;
        let poses: Vec<WorkerPose> = py.detach(|| instants.iter().map(|&t| self.inner.pose_at(t)).collect());
        let joints = poses.iter().flat_map(|p| p.joints_m).flat_map(|j| [j.x, j.y, j.z]).collect();
        let actions = poses.iter().map(|p| p.action.name()).collect();
        let phases = poses.iter().map(|p| p.phase).collect();
        Ok((moved3(py, joints, [poses.len(), KEYPOINT_COUNT, 3])?, actions, moved(py, phases)))
    }
}

/// Names of the 18 keypoints.
#[pyfunction]
pub(crate) fn worker_keypoints() -> Vec<&'static str> {
    Keypoint::ALL.iter().map(|k| k.name()).collect()
}

/// Picture `(height, width, 3)`, joints in metres `(18, 3)`, joints in pixels `(18, 2)`, COCO visibility `(18)`, box and
/// area in pixels `(5)`.
type Frame<'py> = (
    Bound<'py, PyArray3<u8>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<u8>>,
    Bound<'py, PyArray1<f64>>,
);

fn frame<'py>(py: Python<'py>, picture: image::RgbImage, truth: &GroundTruth) -> PyResult<Frame<'py>> {
    let (width, height) = picture.dimensions();
    let metres = truth.points_m.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    let pixels = truth.points_px.iter().flat_map(|p| p.map_or([f64::NAN; 2], |p| [p.x, p.y])).collect();
    let visibility = truth.visibility.iter().map(|v| v.coco_flag()).collect();
    let mut place = truth.box_px.unwrap_or([f64::NAN; 4]).to_vec();
    place.push(truth.area_px);
    Ok((
        moved3(py, picture.into_raw(), [height as usize, width as usize, 3])?,
        moved2(py, metres, [KEYPOINT_COUNT, 3])?,
        moved2(py, pixels, [KEYPOINT_COUNT, 2])?,
        moved(py, visibility),
        moved(py, place),
    ))
}

/// The usual camera's view of one worker.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct Scene {
    inner: Mutex<sim::Scene>,
    worker: sim::Worker,
}

#[pymethods]
impl Scene {
    #[new]
    fn new(worker: &Worker, width: u32, height: u32) -> PyResult<Self> {
        let camera = sim::default_camera([width, height]).map_err(Failure::from)?;
        let worker = worker.inner.clone();
        Ok(Self { inner: Mutex::new(sim::Scene::new(camera, worker.params())), worker })
    }

    fn render<'py>(&self, py: Python<'py>, t_s: f64) -> PyResult<Frame<'py>> {
        let t = seconds("t", t_s)?;
        let (picture, truth) = py.detach(|| {
            let mut scene = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
            scene.render(&self.worker.pose_at(t))
        });
        frame(py, picture, &truth)
    }
}

/// A picture of a worker, an instant, a camera and a look that are all drawn from `seed`.
#[pyfunction]
pub(crate) fn random_frame(py: Python<'_>, seed: u64, width: u32, height: u32) -> PyResult<Frame<'_>> {
    let drawn = py.detach(|| {
        let variation = SceneVariation::random(seed, [width, height])?;
        let worker = sim::Worker::new(variation.worker.clone())?;
        Ok::<_, sim::Error>(sim::Scene::varied(&variation).render(&worker.pose_at(variation.at)))
    });
    let (picture, truth) = drawn.map_err(Failure::from)?;
    frame(py, picture, &truth)
}
