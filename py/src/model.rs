//! Learned motion models, as the `ogg` command writes them.

use std::path::PathBuf;

use std::collections::BTreeMap;
use std::time::Duration;

use follow::{
    ArmSample, DIMENSION, Demonstration, Evidence, JointSample, LearnParams, Lesson, TeachParams, TeachReport,
};
use nalgebra::{Matrix3, Point3};
use numpy::{PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::array::{borrowed, check_finite, check_len, moved2, moved3, released};
use crate::failure::Failure;

/// Multiply-adds that a posture with its rate and covariance costs, about.
const OPERATIONS: usize = 2000;

/// Means and rates `(m, 6)`, covariances `(m, 6, 6)`.
type Points<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>);

/// A learned action.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct MotionModel {
    inner: follow::MotionModel,
}

/// Variance of a joint that a Python caller gives without one, m^2. Teaching does not read it.
const GIVEN_VARIANCE_M2: f64 = 1e-6;

/// Samples of one recording: times `(n)`, joints `(n, 9)`; a joint with a NaN is lost.
fn arm_samples(times: &[f64], joints: &[f64]) -> Result<Vec<ArmSample>, Failure> {
    check_finite("t", times)?;
    let start = times.first().copied().unwrap_or(0.0);
    times
        .iter()
        .zip(joints.chunks_exact(9))
        .map(|(t, row)| {
            let captured = Duration::try_from_secs_f64(t - start).map_err(|_| Failure::Argument {
                what: "t",
                expected: "times that increase".to_owned(),
                got: t.to_string(),
            })?;
            let joint = |i: usize| {
                let [x, y, z] = [row[3 * i], row[3 * i + 1], row[3 * i + 2]];
                [x, y, z].iter().all(|v| v.is_finite()).then(|| JointSample {
                    position_m: Point3::new(x, y, z),
                    covariance_m2: Matrix3::from_diagonal_element(GIVEN_VARIANCE_M2),
                    evidence: Evidence::Measured,
                })
            };
            Ok(ArmSample { captured, shoulder: joint(0), elbow: joint(1), wrist: joint(2) })
        })
        .collect()
}

/// One stream is cut where it repeats; several are one repetition each, stretched to their median duration.
fn lesson_of(streams: &[Vec<ArmSample>], params: TeachParams) -> Result<Lesson, Failure> {
    if let [stream] = streams {
        return Ok(follow::teach(stream, &params)?);
    }
    // No autocorrelation exceeds one: every stream stays whole.
    let whole = TeachParams { period_threshold: 1.0, ..params };
    let lessons = streams.iter().map(|s| Ok(follow::teach(s, &whole)?)).collect::<Result<Vec<_>, Failure>>()?;
    let mut durations: Vec<f64> = lessons.iter().map(|l| l.report.duration_s).collect();
    durations.sort_by(f64::total_cmp);
    let Some(&duration_s) = durations.get(durations.len() / 2) else {
        return Err(
            follow::Error::TooLittleSeen { usable: 0, span_s: 0.0, needed: 1, needed_s: params.shortest_s }.into()
        );
    };
    let mut report =
        TeachReport { samples: 0, complete: 0, used: 0, bridged: 0, demonstrations: 0, duration_s, cyclic: false };
    let mut demonstrations = Vec::new();
    for lesson in lessons {
        report.samples += lesson.report.samples;
        report.complete += lesson.report.complete;
        report.used += lesson.report.used;
        report.bridged += lesson.report.bridged;
        for demonstration in lesson.demonstrations {
            let steps = demonstration.postures.len().saturating_sub(1).max(1);
            demonstrations.push(Demonstration { step_s: duration_s / steps as f64, ..demonstration });
        }
    }
    report.demonstrations = demonstrations.len();
    Ok(Lesson { demonstrations, report })
}

#[pymethods]
impl MotionModel {
    /// Learns from recordings of an arm, each `(times (n), joints (n, 3, 3))`: shoulder, elbow, wrist.
    ///
    /// Returns the model and what teaching did.
    #[staticmethod]
    #[pyo3(signature = (demonstrations, *, element_s, components, restarts, blend_s, seed, rate_hz, longest_gap_s, smoothing_s, shortest_period_s))]
    #[expect(clippy::too_many_arguments, reason = "a keyword-only Python signature")]
    fn teach(
        py: Python<'_>,
        demonstrations: Vec<(PyReadonlyArray1<'_, f64>, PyReadonlyArray3<'_, f64>)>,
        element_s: f64,
        components: usize,
        restarts: usize,
        blend_s: f64,
        seed: u64,
        rate_hz: f64,
        longest_gap_s: f64,
        smoothing_s: f64,
        shortest_period_s: f64,
    ) -> PyResult<(Self, BTreeMap<&'static str, f64>)> {
        let mut streams = Vec::with_capacity(demonstrations.len());
        for (times, joints) in &demonstrations {
            check_len("joints of a sample", 3, joints.shape()[1])?;
            check_len("coordinates of a joint", 3, joints.shape()[2])?;
            check_len("samples of a demonstration", times.shape()[0], joints.shape()[0])?;
            streams.push(arm_samples(borrowed("t", times)?, borrowed("joints", joints)?)?);
        }
        let teach = TeachParams { rate_hz, longest_gap_s, smoothing_s, shortest_period_s, ..TeachParams::default() };
        let learn = LearnParams { element_s, components, restarts, blend_s, seed };
        let (inner, report) = py.detach(|| {
            let lesson = lesson_of(&streams, teach)?;
            let (model, _) = follow::MotionModel::learn(&lesson, &learn)?;
            Ok::<_, Failure>((model, lesson.report))
        })?;
        let counts = [
            ("samples", report.samples),
            ("complete", report.complete),
            ("used", report.used),
            ("bridged", report.bridged),
            ("demonstrations", report.demonstrations),
        ];
        let mut said: BTreeMap<_, _> = counts.into_iter().map(|(name, count)| (name, count as f64)).collect();
        said.insert("duration_s", report.duration_s);
        said.insert("cyclic", f64::from(u8::from(report.cyclic)));
        Ok((Self { inner }, said))
    }

    #[new]
    fn new(text: &str) -> PyResult<Self> {
        Ok(Self { inner: follow::MotionModel::from_json(text).map_err(Failure::from)? })
    }

    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let text = std::fs::read_to_string(&path).map_err(|source| Failure::File { path, source })?;
        Self::new(&text)
    }

    fn save(&self, path: PathBuf) -> PyResult<()> {
        Ok(std::fs::write(&path, self.inner.to_json()).map_err(|source| Failure::File { path, source })?)
    }

    fn to_json(&self) -> String {
        self.inner.to_json()
    }

    #[getter]
    fn duration_s(&self) -> f64 {
        self.inner.duration_s()
    }

    #[getter]
    fn is_cyclic(&self) -> bool {
        self.inner.is_cyclic()
    }

    #[getter]
    fn elements(&self) -> usize {
        self.inner.elements()
    }

    #[getter]
    fn demonstrations(&self) -> usize {
        self.inner.demonstrations()
    }

    /// Means, rates and covariances at times `(m)`.
    fn at<'py>(&self, py: Python<'py>, times_s: PyReadonlyArray1<'py, f64>) -> PyResult<Points<'py>> {
        let times = borrowed("t", &times_s)?;
        check_finite("t", times)?;
        let points: Vec<_> =
            released(py, OPERATIONS * times.len(), || times.iter().map(|t| self.inner.at(*t)).collect());
        let means = points.iter().flat_map(|p| p.mean.iter().copied()).collect();
        let rates = points.iter().flat_map(|p| p.rate.iter().copied()).collect();
        // Symmetric: the order of rows and columns does not matter.
        let covariances = points.iter().flat_map(|p| p.covariance.iter().copied()).collect();
        let count = points.len();
        Ok((
            moved2(py, means, [count, DIMENSION])?,
            moved2(py, rates, [count, DIMENSION])?,
            moved3(py, covariances, [count, DIMENSION, DIMENSION])?,
        ))
    }
}
