//! Kinematics of a chain read from a URDF.

use kin::{Chain, IkOptions, UrdfOptions};
use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix6xX, Rotation3, Translation3, UnitQuaternion, Vector3};
use numpy::{
    IxDyn, PyArray1, PyArray2, PyArray3, PyArrayDyn, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::array::{borrowed, check_finite, check_len, moved, moved_under, moved2, moved3, ready, released};
use crate::failure::Failure;

/// How far `R R'` of a target may be from the identity.
const ROTATION_TOLERANCE: f64 = 1e-6;

/// Multiply-adds that a joint costs, sine and cosine included, about.
const OPERATIONS: usize = 100;
/// Steps that inverse kinematics takes, about.
const IK_STEPS: usize = 20;

/// Joint values `(m, n)`, whether the target was reached, and the remaining errors in m and rad, each `(m)`.
type IkAnswer<'py> =
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// A robot and the chain between two of its links.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct Robot {
    name: String,
    chain: Chain,
    tree: kin::Robot,
    /// Place of each joint of the chain in the robot's joint vector.
    places: Vec<usize>,
    /// The robot's joint vector with every joint at zero, brought within the limits.
    rest: Vec<f64>,
}

impl Robot {
    fn of(robot: &kin::Robot, base: Option<&str>, tip: Option<&str>) -> Result<Self, Failure> {
        let base = base.unwrap_or(&robot.root_link().name);
        let tip = match tip {
            Some(tip) => tip,
            None => only_leaf(robot)?,
        };
        let chain = robot.chain(base, tip)?;
        let places = chain.joints().iter().filter_map(|&joint| robot.dof_index(joint)).collect::<Vec<_>>();
        check_len("joints of the chain that move by themselves", chain.dof(), places.len())?;
        let rest = robot.dof_joints().map(|joint| 0.0_f64.clamp(joint.limits.lower, joint.limits.upper)).collect();
        Ok(Self { name: robot.name().to_owned(), chain, tree: robot.clone(), places, rest })
    }

    /// A vector of the chain as one of the robot: other joints as in `others`.
    fn spread(&self, values: &[f64], others: &[f64]) -> Vec<f64> {
        let mut all = others.to_vec();
        for (&place, value) in self.places.iter().zip(values) {
            all[place] = *value;
        }
        all
    }

    fn joint_vectors<'a>(&self, q: &'a PyReadonlyArray2<'_, f64>) -> Result<&'a [f64], Failure> {
        check_len("last axis of q", self.chain.dof(), q.shape()[1])?;
        let values = borrowed("q", q)?;
        check_finite("q", values)?;
        Ok(values)
    }
}

impl Robot {
    /// `work` on joint vectors of any leading axes.
    fn if_ready<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        tail: &[usize],
        work: impl Fn(&Self, Python<'_>, &[f64]) -> Vec<f64>,
    ) -> Option<Bound<'py, PyArrayDyn<f64>>> {
        let q = ready::<IxDyn>(q, self.chain.dof())?;
        let values = q.as_slice().ok()?;
        check_finite("q", values).ok()?;
        let (_, lead) = q.shape().split_last()?;
        moved_under(py, work(self, py, values), lead, tail).ok()
    }

    /// Homogeneous matrices, row by row.
    fn poses(&self, py: Python<'_>, values: &[f64]) -> Vec<f64> {
        released(py, OPERATIONS * values.len(), || {
            let mut poses = Vec::with_capacity(16 * values.len() / self.chain.dof().max(1));
            for q in values.chunks_exact(self.chain.dof()) {
                let matrix = self.chain.fk_matrix(q).to_homogeneous();
                poses.extend(matrix.transpose().as_slice());
            }
            poses
        })
    }

    /// Jacobians, row by row.
    fn jacobians(&self, py: Python<'_>, values: &[f64]) -> Vec<f64> {
        let dof = self.chain.dof();
        released(py, OPERATIONS * values.len(), || {
            let mut jacobian = Matrix6xX::zeros(dof);
            let mut rows = Vec::with_capacity(6 * values.len());
            for q in values.chunks_exact(dof) {
                self.chain.fk_jacobian_into(q, &mut jacobian);
                for row in jacobian.row_iter() {
                    rows.extend(row.iter());
                }
            }
            rows
        })
    }
}

/// The one link that carries no other.
fn only_leaf(robot: &kin::Robot) -> Result<&str, Failure> {
    let parents: Vec<usize> = robot.joints().iter().map(|joint| joint.parent.index()).collect();
    let links = robot.links().iter().enumerate();
    let leaves: Vec<&str> = links.filter(|(i, _)| !parents.contains(i)).map(|(_, link)| link.name.as_str()).collect();
    match leaves[..] {
        [leaf] => Ok(leaf),
        _ => Err(Failure::Argument {
            what: "tip",
            expected: format!("one of the end links {leaves:?}"),
            got: "None".to_owned(),
        }),
    }
}

/// The pose of a homogeneous matrix.
fn pose_of(matrix: &[f64]) -> Result<Isometry3<f64>, Failure> {
    let rotation = Matrix3::from_fn(|i, j| matrix[4 * i + j]);
    let skew = (rotation * rotation.transpose() - Matrix3::identity()).abs().max();
    let last_row = [0.0, 0.0, 0.0, 1.0].iter().zip(&matrix[12..]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    if !(skew <= ROTATION_TOLERANCE && last_row <= ROTATION_TOLERANCE && rotation.determinant() > 0.0) {
        return Err(Failure::Argument {
            what: "target",
            expected: format!("a right-handed rotation orthonormal within {ROTATION_TOLERANCE:e}, last row 0 0 0 1"),
            got: format!("{matrix:?}"),
        });
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Ok(Isometry3::from_parts(Translation3::new(matrix[3], matrix[7], matrix[11]), rotation))
}

#[pymethods]
impl Robot {
    #[staticmethod]
    #[pyo3(signature = (path, base=None, tip=None))]
    fn from_urdf(path: std::path::PathBuf, base: Option<&str>, tip: Option<&str>) -> PyResult<Self> {
        let options = UrdfOptions::default().resolve_meshes(false);
        let robot = kin::Robot::from_urdf_file(path, &options).map_err(Failure::from)?;
        Ok(Self::of(&robot, base, tip)?)
    }

    #[staticmethod]
    fn builtin() -> PyResult<Self> {
        Ok(Self::of(&kin::Robot::builtin(), Some("base_link"), Some("tool0"))?)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    #[getter]
    fn base(&self) -> &str {
        self.chain.base()
    }

    #[getter]
    fn tip(&self) -> &str {
        self.chain.tip()
    }

    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.chain.joint_names().to_vec()
    }

    /// `(n, 2)`: lower, upper.
    #[getter]
    fn position_limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let limits = self.chain.limits().iter().flat_map(|limits| [limits.lower, limits.upper]).collect();
        moved2(py, limits, [self.chain.dof(), 2])
    }

    /// [`Robot::fk`] of any leading axes, for an array of finite numbers that is ready for it; else `None`.
    fn fk_if_ready<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> Option<Bound<'py, PyArrayDyn<f64>>> {
        self.if_ready(py, q, &[4, 4], Self::poses)
    }

    /// [`Robot::jacobian`] of any leading axes, for an array of finite numbers that is ready for it; else `None`.
    fn jacobian_if_ready<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> Option<Bound<'py, PyArrayDyn<f64>>> {
        self.if_ready(py, q, &[6, self.chain.dof()], Self::jacobians)
    }

    /// `(m, n)` to `(m, 4, 4)`.
    fn fk<'py>(&self, py: Python<'py>, q: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        moved3(py, self.poses(py, self.joint_vectors(&q)?), [q.shape()[0], 4, 4])
    }

    /// `(m, n)` to `(m, 6, n)`, linear rows first.
    fn jacobian<'py>(&self, py: Python<'py>, q: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        moved3(py, self.jacobians(py, self.joint_vectors(&q)?), [q.shape()[0], 6, self.chain.dof()])
    }

    /// Targets `(m, 4, 4)` and seeds `(m, n)`.
    fn ik<'py>(
        &self,
        py: Python<'py>,
        targets: PyReadonlyArray3<'py, f64>,
        seeds: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<IkAnswer<'py>> {
        let (count, dof) = (targets.shape()[0], self.chain.dof());
        check_len("rows of a target", 4, targets.shape()[1])?;
        check_len("columns of a target", 4, targets.shape()[2])?;
        check_len("number of seeds", count, seeds.shape()[0])?;
        let mut q = self.joint_vectors(&seeds)?.to_vec();
        let numbers = borrowed("target", &targets)?;
        check_finite("target", numbers)?;
        let poses = numbers.chunks_exact(16).map(pose_of).collect::<Result<Vec<_>, _>>()?;
        let options = IkOptions::default();
        let reports: Vec<_> = released(py, IK_STEPS * OPERATIONS * q.len(), || {
            let pairs = poses.iter().zip(q.chunks_exact_mut(dof));
            pairs.map(|(pose, q)| self.chain.ik(pose, &options, q)).collect()
        });
        Ok((
            moved2(py, q, [count, dof])?,
            moved(py, reports.iter().map(kin::IkReport::reached).collect()),
            moved(py, reports.iter().map(|r| r.position_error_m).collect()),
            moved(py, reports.iter().map(|r| r.rotation_error_rad).collect()),
        ))
    }

    /// `(m, n)` to `(m, n, n)`.
    fn mass_matrix<'py>(&self, py: Python<'py>, q: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (values, n) = (self.joint_vectors(&q)?, self.chain.dof());
        let entries = released(py, n * OPERATIONS * values.len(), || {
            let dynamics = self.tree.dynamics(Vector3::zeros());
            let mut scratch = dynamics.scratch();
            let mut matrix = DMatrix::zeros(dynamics.dof(), dynamics.dof());
            let mut entries = Vec::with_capacity(values.len() * n);
            for q in values.chunks_exact(n) {
                dynamics.mass_matrix(&self.spread(q, &self.rest), &mut scratch, &mut matrix)?;
                let rows = self.places.iter().flat_map(|&i| self.places.iter().map(move |&j| (i, j)));
                entries.extend(rows.map(|at| matrix[at]));
            }
            Ok::<_, kin::Error>(entries)
        });
        moved3(py, entries.map_err(Failure::from)?, [q.shape()[0], n, n])
    }

    /// Three times `(m, n)` and gravity in the root link to `(m, n)`.
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: PyReadonlyArray2<'py, f64>,
        qd: PyReadonlyArray2<'py, f64>,
        qdd: PyReadonlyArray2<'py, f64>,
        gravity_m_s2: [f64; 3],
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let n = self.chain.dof();
        check_len("rows of qd", q.shape()[0], qd.shape()[0])?;
        check_len("rows of qdd", q.shape()[0], qdd.shape()[0])?;
        check_finite("gravity", &gravity_m_s2)?;
        let [q_rows, qd_rows, qdd_rows] =
            [self.joint_vectors(&q)?, self.joint_vectors(&qd)?, self.joint_vectors(&qdd)?];
        let efforts = released(py, n * OPERATIONS * q_rows.len(), || {
            let dynamics = self.tree.dynamics(Vector3::from(gravity_m_s2));
            let mut scratch = dynamics.scratch();
            let still = vec![0.0; dynamics.dof()];
            let mut all = vec![0.0; dynamics.dof()];
            let mut efforts = Vec::with_capacity(q_rows.len());
            let rows = q_rows.chunks_exact(n).zip(qd_rows.chunks_exact(n)).zip(qdd_rows.chunks_exact(n));
            for ((q, qd), qdd) in rows {
                let (q, qd, qdd) = (self.spread(q, &self.rest), self.spread(qd, &still), self.spread(qdd, &still));
                dynamics.inverse_dynamics(&q, &qd, &qdd, &mut scratch, &mut all)?;
                efforts.extend(self.places.iter().map(|&place| all[place]));
            }
            Ok::<_, kin::Error>(efforts)
        });
        moved2(py, efforts.map_err(Failure::from)?, [q.shape()[0], n])
    }
}
