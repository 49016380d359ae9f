//! What goes into the recording, from the pipeline's own types.

use std::time::Duration;

use follow::{ArmSample, Evidence, JointPlan, JointSample};
use kin::{Camera, Robot};
use nalgebra::{Isometry3, UnitQuaternion};
use pose::{ArmJoint, ArmKeypoints};

use crate::capture::FrameSet;
use crate::cell::Cell;
use crate::link::Tick;
use crate::record::{
    CameraInfo, FramePose, JointStream, JointValue, KeypointState, Level, Metric, PixelPoint, RecordSink, Sample,
    Skeleton, SpacePoint,
};
use crate::vision::Seen;

/// Writes the stages of the pipeline to a recording.
#[derive(Debug, Clone)]
pub struct Journal {
    sink: RecordSink,
    robot: Robot,
    joint_names: Vec<String>,
    joint_places: Vec<usize>,
    world_from_base: Isometry3<f64>,
    side: &'static str,
    images: bool,
}

impl Journal {
    /// A journal of a cell's run.
    pub fn new(sink: RecordSink, cell: &Cell) -> Self {
        let joint_places = cell.chain.joints().iter().filter_map(|id| cell.robot.dof_index(*id)).collect();
        Self {
            sink,
            robot: cell.robot.clone(),
            joint_names: cell.chain.joint_names().to_vec(),
            joint_places,
            world_from_base: cell.world_from_base,
            side: match cell.config.worker.side {
                crate::config::Side::Left => "left",
                crate::config::Side::Right => "right",
            },
            images: cell.config.record.images,
        }
    }

    /// Cameras: intrinsics, and where they stand.
    pub fn cameras(&self, at: Duration, cameras: &[Camera]) {
        let mut frames = Vec::new();
        for (index, camera) in cameras.iter().enumerate() {
            let d = &camera.distortion;
            let info = CameraInfo {
                width_px: camera.size_px[0],
                height_px: camera.size_px[1],
                focal_px: [camera.intrinsics.fx_px, camera.intrinsics.fy_px],
                centre_px: [camera.intrinsics.cx_px, camera.intrinsics.cy_px],
                distortion: vec![d.k1, d.k2, d.p1, d.p2, d.k3, d.k4, d.k5, d.k6],
            };
            self.sink.put(at, Sample::Calibration { camera: index, info });
            let frame = crate::record::camera_frame(index, cameras.len());
            frames.push(frame_pose("world", &frame, &camera.camera_from_world.inverse()));
        }
        self.sink.put(at, Sample::Transforms(frames));
    }

    /// Pictures, what was found in them, and the arm in space.
    pub fn seen(&self, at: Duration, set: &FrameSet, seen: &Seen) {
        for (camera, frame) in set.frames.iter().enumerate() {
            if self.images {
                self.sink.put(at, Sample::Image { camera, image: frame.image.clone() });
            }
            let mut people = Vec::new();
            if let Some(worker) = seen.workers.get(camera).and_then(Option::as_ref) {
                people.push(person(worker));
            }
            if let Some(arm) = seen.arms.get(camera) {
                people.push(self.arm(arm));
            }
            let size_px = frame.image.dimensions();
            self.sink.put(at, Sample::Annotations { camera, size_px, people });
        }
        self.sample(at, &seen.sample);
    }

    fn arm(&self, arm: &ArmKeypoints) -> Skeleton {
        let points = ["shoulder", "elbow", "wrist"]
            .iter()
            .zip(arm.joints())
            .map(|(part, joint)| {
                let estimate = joint.estimate();
                PixelPoint {
                    name: format!("{}_{part}", self.side),
                    x_px: estimate.map_or(0.0, |e| e.u_px),
                    y_px: estimate.map_or(0.0, |e| e.v_px),
                    state: match joint {
                        ArmJoint::Measured(_) => KeypointState::Measured,
                        ArmJoint::Inferred(_) => KeypointState::Inferred,
                        ArmJoint::Lost => KeypointState::Lost,
                    },
                }
            })
            .collect();
        Skeleton { points, limbs: vec![(0, 1), (1, 2)], followed: true }
    }

    fn sample(&self, at: Duration, sample: &ArmSample) {
        let joints = [("shoulder", sample.shoulder), ("elbow", sample.elbow), ("wrist", sample.wrist)];
        let point = |part: &str, joint: Option<JointSample>| SpacePoint {
            name: format!("{}_{part}", self.side),
            position_m: joint.map_or([0.0; 3], |j| j.position_m.into()),
            covariance_m2: joint.map(|j| {
                let mut rows = [0.0; 9];
                rows.copy_from_slice(j.covariance_m2.transpose().as_slice());
                rows
            }),
            state: match joint.map(|j| j.evidence) {
                Some(Evidence::Measured) => KeypointState::Measured,
                Some(Evidence::Inferred) => KeypointState::Inferred,
                None => KeypointState::Lost,
            },
        };
        let points = joints.iter().map(|(part, joint)| point(part, *joint)).collect();
        self.sink.put(at, Sample::Keypoints { frame: "world".to_owned(), points });
    }

    /// Targets of a plan, at the time it became known.
    pub fn plan(&self, at: Duration, plan: &JointPlan) {
        let values = self
            .joint_names
            .iter()
            .zip(&plan.rows)
            .map(|(name, row)| JointValue {
                name: name.clone(),
                position: Some(row.position_rad),
                velocity: Some(row.velocity_rad_s),
                ..JointValue::default()
            })
            .collect();
        self.sink.put(at, Sample::Joints(JointStream::Target, values));
    }

    /// Setpoints and measured joints of a tick; with `frames` also where every link is.
    pub fn tick(&self, at: Duration, tick: &Tick, frames: bool) {
        if let Some((_, q)) = &tick.measured {
            let values = self.values(q.iter().map(|q| (Some(*q), None, None)));
            self.sink.put(at, Sample::Joints(JointStream::Measured, values));
            if frames {
                self.links(at, q);
            }
        }
        if let Some(states) = &tick.command {
            let state =
                states.iter().map(|s| (Some(s.position_rad), Some(s.velocity_rad_s), Some(s.acceleration_rad_s2)));
            self.sink.put(at, Sample::Joints(JointStream::Setpoint, self.values(state)));
        }
    }

    fn values(&self, values: impl Iterator<Item = (Option<f64>, Option<f64>, Option<f64>)>) -> Vec<JointValue> {
        self.joint_names
            .iter()
            .zip(values)
            .map(|(name, (position, velocity, acceleration))| JointValue {
                name: name.clone(),
                position,
                velocity,
                acceleration,
                effort: None,
            })
            .collect()
    }

    fn links(&self, at: Duration, chain_q: &[f64]) {
        let mut q = vec![0.0; self.robot.dof()];
        for (place, value) in self.joint_places.iter().zip(chain_q) {
            q[*place] = *value;
        }
        let links = self.robot.links();
        let mut frames = vec![frame_pose("world", &self.robot.root_link().name, &self.world_from_base)];
        for joint in self.robot.joints() {
            let Ok(id) = self.robot.joint_id(&joint.name) else { continue };
            let pose = self.robot.parent_from_child(id, &q);
            frames.push(frame_pose(&links[joint.parent.index()].name, &links[joint.child.index()].name, &pose));
        }
        self.sink.put(at, Sample::Transforms(frames));
    }

    /// A line of the log.
    pub fn log(&self, at: Duration, level: Level, message: &str) {
        self.sink.put(at, Sample::Log { level, name: "ogg".to_owned(), message: message.to_owned() });
    }

    /// Numbers about the run.
    pub fn metrics(&self, at: Duration, metrics: Vec<Metric>) {
        self.sink.put(at, Sample::Metrics(metrics));
    }
}

fn person(person: &pose::Person) -> Skeleton {
    let mut places = vec![None; person.keypoints.len()];
    let mut points = Vec::new();
    for (index, (part, keypoint)) in person.skeleton.parts().iter().zip(&person.keypoints).enumerate() {
        if let Some(k) = keypoint {
            places[index] = Some(points.len());
            points.push(PixelPoint {
                name: part.name().to_owned(),
                x_px: f64::from(k.u_px),
                y_px: f64::from(k.v_px),
                state: KeypointState::Measured,
            });
        }
    }
    let limbs = person.skeleton.bones().iter().filter_map(|(a, b)| places[*a].zip(places[*b])).collect();
    Skeleton { points, limbs, followed: false }
}

fn frame_pose(parent: &str, child: &str, pose: &Isometry3<f64>) -> FramePose {
    let rotation: &UnitQuaternion<f64> = &pose.rotation;
    FramePose {
        parent: parent.to_owned(),
        child: child.to_owned(),
        translation_m: pose.translation.vector.into(),
        rotation_xyzw: [rotation.i, rotation.j, rotation.k, rotation.w],
    }
}
