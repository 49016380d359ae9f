//! From expected postures to a joint plan, in one of two ways.
//!
//! * **Wrist**: the tool moves about its home as the worker's wrist moves about the centre of the lesson,
//!   `p_tool = p_home + scale R (x_wrist - x_centre)`, with the tool turned as at home; inverse kinematics on the branch of
//!   the last solution gives the joints.
//! * **Angles** (the paper's way): elevation, flexion and inclination of the worker's arm drive three joints about home,
//!   `q = q_home + s (angle - angle_centre)`.
//!
//! The plan keeps the tool below the speed cap by letting a governed point run after the wanted one, and joint speeds
//! below their limits and singularities at bay with [`kin::Chain::follow_pose`].

use core::time::Duration;

use kin::{AngleRetarget, ArmAngles, Chain, FollowOptions, FollowStatus, IkOptions, JointMap};
use motion::Sample;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use crate::error::Error;
use crate::plan::JointPlan;
use crate::posture::{DIMENSION, PostureVector};
use crate::predict::Prediction;

/// Share of the speed cap that the plan uses; the rest is for the tracker when it catches up.
const SPEED_SHARE: f64 = 0.9;

/// Which way the worker's arm maps to the robot's.
#[derive(Debug, Clone, PartialEq)]
pub enum Mapping {
    /// Wrist position to tool position.
    Wrist {
        /// Metres of tool per metre of wrist.
        scale: f64,
    },
    /// Arm angles to three joints.
    Angles {
        /// Joints for elevation, flexion and inclination.
        joints: [String; 3],
        /// Radians of joint per radian of arm; negative turns the sense round.
        scale: [f64; 3],
    },
}

/// Settings of the retargeting.
#[derive(Debug, Clone, PartialEq)]
pub struct RetargetParams {
    /// Which way.
    pub mapping: Mapping,
    /// Where the robot's base stands: takes base coordinates to `world`.
    pub world_from_base: Isometry3<f64>,
    /// Joints at the centre of the work, rad.
    pub home_rad: Vec<f64>,
    /// The posture of the worker that corresponds to home.
    pub centre: [f64; DIMENSION],
    /// Largest speed of the tool, m/s.
    pub tool_speed_m_s: f64,
}

/// How often something held a plan back, in rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HeldBack {
    /// The tool would have been too fast.
    pub tool_speed: u64,
    /// A joint would have been too fast.
    pub joint_speed: u64,
    /// A singularity was near.
    pub singular: u64,
    /// The wanted tool pose cannot be reached; the nearest one was taken.
    pub unreachable: u64,
}

/// Turns predictions into joint plans. Keeps the last plan, to go on from it.
#[derive(Debug, Clone)]
pub struct Retargeter {
    chain: Chain,
    params: RetargetParams,
    base_from_home: Isometry3<f64>,
    angles: Option<AngleRetarget>,
    last: Option<JointPlan>,
    held_back: HeldBack,
}

impl Retargeter {
    /// # Errors
    /// [`Error::JointCount`] unless home has one value per joint, [`Error::Kin`] for joints the chain does not have,
    /// [`Error::Parameter`] for a scale or speed out of range.
    pub fn new(chain: Chain, params: RetargetParams) -> Result<Self, Error> {
        if params.home_rad.len() != chain.dof() {
            return Err(Error::JointCount { what: "home_rad", got: params.home_rad.len(), expected: chain.dof() });
        }
        for (q, (limits, joint)) in params.home_rad.iter().zip(chain.limits().iter().zip(chain.joint_names())) {
            if !(*q >= limits.lower && *q <= limits.upper) {
                return Err(Error::HomeOutsideLimits {
                    joint: joint.clone(),
                    home_rad: *q,
                    lower_rad: limits.lower,
                    upper_rad: limits.upper,
                });
            }
        }
        if !(params.tool_speed_m_s > 0.0 && params.tool_speed_m_s.is_finite()) {
            let expected = "positive and finite".to_owned();
            return Err(Error::Parameter { name: "tool_speed_m_s", value: params.tool_speed_m_s, expected });
        }
        let angles = match &params.mapping {
            Mapping::Wrist { scale } => {
                if !(*scale > 0.0 && scale.is_finite()) {
                    let expected = "positive and finite".to_owned();
                    return Err(Error::Parameter { name: "retarget.scale", value: *scale, expected });
                }
                None
            }
            Mapping::Angles { joints, scale } => {
                let map = |i: usize| -> Result<JointMap, Error> {
                    let index = chain.joint_index(&joints[i]).ok_or_else(|| Error::UnknownJoint {
                        joint: joints[i].clone(),
                        known: chain.joint_names().join(", "),
                    })?;
                    let offset_rad = params.home_rad[index] - scale[i] * params.centre[3 + i];
                    Ok(JointMap { joint: joints[i].clone(), scale: scale[i], offset_rad })
                };
                Some(AngleRetarget::new(&chain, [map(0)?, map(1)?, map(2)?])?)
            }
        };
        let base_from_home = chain.fk(&params.home_rad);
        Ok(Self { chain, params, base_from_home, angles, last: None, held_back: HeldBack::default() })
    }

    /// The chain that is driven.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// Settings.
    pub fn params(&self) -> &RetargetParams {
        &self.params
    }

    /// What held plans back so far.
    pub fn held_back(&self) -> HeldBack {
        self.held_back
    }

    /// Pose of the tool in `world` for joint values.
    ///
    /// # Panics
    /// When `q` does not have one value per joint.
    pub fn world_from_tool(&self, q: &[f64]) -> Isometry3<f64> {
        self.params.world_from_base * self.chain.fk(q)
    }

    /// Joints that stand for a posture, without any speed limit, and the tool position in `world` that they are to reach.
    /// `q` holds where to start from and receives the joints.
    ///
    /// # Panics
    /// When `q` does not have one value per joint.
    pub fn ideal(&self, posture: &PostureVector, q: &mut [f64]) -> Point3<f64> {
        if let Some(angles) = &self.angles {
            q.copy_from_slice(&self.params.home_rad);
            angles.apply_to(&arm_angles(posture), q);
            return self.world_from_tool(q).translation.vector.into();
        }
        let target = self.tool_target(posture);
        self.chain.ik(&target, &IkOptions::on_branch(), q);
        self.params.world_from_base * Point3::from(target.translation.vector)
    }

    /// The plan for a prediction.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a prediction that is not finite, [`Error::Kin`].
    pub fn plan(&mut self, prediction: &Prediction) -> Result<JointPlan, Error> {
        let joints = self.chain.dof();
        if !prediction.ahead.iter().all(|e| e.posture.iter().chain(e.rate.iter()).all(|v| v.is_finite())) {
            return Err(Error::NotFinite { what: "prediction" });
        }
        let step_s = prediction.step.as_secs_f64();
        let (mut q, mut since_s) = self.start_of_plan(prediction.captured);
        let mut tool = self.chain.fk(&q).translation.vector;
        let mut rows: Vec<f64> = Vec::with_capacity(prediction.ahead.len() * joints);
        for expected in &prediction.ahead {
            if let Some(angles) = &self.angles {
                q.copy_from_slice(&self.params.home_rad);
                angles.apply_to(&arm_angles(&expected.posture), &mut q);
            } else {
                let mut target = self.tool_target(&expected.posture);
                tool = self.governed(&tool, &target.translation.vector, since_s);
                target.translation.vector = tool;
                let report = self.chain.follow_pose(&target, since_s, &FollowOptions::default(), &mut q)?;
                self.held_back.unreachable += u64::from(!report.ik.reached());
                self.held_back.joint_speed += u64::from(report.status == FollowStatus::SpeedLimited);
                self.held_back.singular += u64::from(report.status == FollowStatus::Singular);
            }
            rows.extend_from_slice(&q);
            since_s = step_s;
        }
        let plan = JointPlan {
            captured: prediction.captured,
            step: prediction.step,
            joints,
            rows: with_velocities(&rows, joints, step_s),
        };
        self.last = Some(plan.clone());
        Ok(plan)
    }

    /// Where the new plan starts: where the last one said the joints would be at its first instant, and how long ago that
    /// was known; home, and all the time in the world, where there is no last plan.
    fn start_of_plan(&self, captured: Duration) -> (Vec<f64>, f64) {
        match &self.last {
            Some(last) => {
                let elapsed = captured.saturating_sub(last.captured);
                (last.positions_at(elapsed), elapsed.as_secs_f64().max(1e-3))
            }
            None => (self.params.home_rad.clone(), 60.0),
        }
    }

    /// The wanted tool pose in the base frame.
    fn tool_target(&self, posture: &PostureVector) -> Isometry3<f64> {
        let scale = match self.params.mapping {
            Mapping::Wrist { scale } => scale,
            Mapping::Angles { .. } => 1.0,
        };
        let moved = Vector3::from_fn(|d, _| posture[d] - self.params.centre[d]);
        let base_from_world: UnitQuaternion<f64> = self.params.world_from_base.rotation.inverse();
        let mut target = self.base_from_home;
        target.translation.vector += base_from_world * (moved * scale);
        target
    }

    /// As far from `from` to `wanted` as the speed cap lets the tool go in `dt_s`.
    fn governed(&mut self, from: &Vector3<f64>, wanted: &Vector3<f64>, dt_s: f64) -> Vector3<f64> {
        let way = wanted - from;
        let reach = SPEED_SHARE * self.params.tool_speed_m_s * dt_s;
        let distance = way.norm();
        if distance <= reach {
            return *wanted;
        }
        self.held_back.tool_speed += 1;
        from + way * (reach / distance)
    }
}

fn arm_angles(posture: &PostureVector) -> ArmAngles {
    ArmAngles::from_array([posture[3], posture[4], posture[5]])
}

/// Central differences inside, one-sided ones at the ends.
fn with_velocities(rows: &[f64], joints: usize, step_s: f64) -> Vec<Sample> {
    let count = rows.len() / joints;
    let at = |row: usize, joint: usize| rows[row * joints + joint];
    (0..count)
        .flat_map(|row| (0..joints).map(move |joint| (row, joint)))
        .map(|(row, joint)| {
            let (before, after) = (row.saturating_sub(1), (row + 1).min(count - 1));
            let span_s = (after - before) as f64 * step_s;
            let velocity = if after > before { (at(after, joint) - at(before, joint)) / span_s } else { 0.0 };
            Sample::new(at(row, joint), velocity)
        })
        .collect()
}
