//! A cell: everything a configuration names, opened and checked before anything moves.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use can_driver::{ControllerParams, HostParams, JointLimits as WireLimits};
use follow::{ControlParams, Lift, Mapping, Plane, RetargetParams, Retargeter};
use kin::{Camera, Chain, Robot, UrdfOptions};
use motion::{AccelerationSource, AgePolicy, EngageParams, JointLimits, Synchronisation, TrackerParams};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use pose::{ExecutionProvider, LibraryChoice, LibrarySearch, Model, Runtime, RuntimeOptions};

use crate::capture::{self, CameraRequest, MultiView, OpenOptions, Source as _};
use crate::config::{self, Config, RetargetMode, Source};
use crate::error::Error;
use crate::record::{RecorderOptions, RunInfo};
use crate::vision::Vision;
use crate::worker_source::WorkerSource;

/// Environment variable that names ONNX Runtime's shared library.
pub const ONNXRUNTIME_VARIABLE: &str = "OGG_ONNXRUNTIME";
/// Environment variable that names a folder of network weights.
pub const WEIGHTS_VARIABLE: &str = "OGG_WEIGHTS";

/// The bus carries a little more than the tracker uses, so that rounding to the wire never looks like a violation.
const WIRE_HEADROOM: f64 = 1.05;
/// Speed of the alignment at the start, rad/s.
const ALIGN_RAD_S: f64 = 0.5;
/// How long the plan reaches ahead of its capture time.
pub const HORIZON: Duration = Duration::from_millis(400);
/// Time between two rows of a plan: half a video frame at 25 Hz.
pub const PLAN_STEP: Duration = Duration::from_millis(20);

/// A checked cell.
#[derive(Debug)]
pub struct Cell {
    /// The configuration in force.
    pub config: Config,
    /// The robot.
    pub robot: Robot,
    /// The chain that is driven.
    pub chain: Chain,
    /// How pixels become metres.
    pub lift: Lift,
    /// Takes base coordinates to `world`.
    pub world_from_base: Isometry3<f64>,
}

impl Cell {
    /// Reads robot and calibration and checks them against the configuration.
    ///
    /// # Errors
    /// What is wrong with the URDF, the calibration, or their fit to the configuration.
    pub fn open(config: Config) -> Result<Self, Error> {
        let robot = match config.robot.urdf.as_str() {
            "builtin" => Robot::builtin(),
            path => Robot::from_urdf_file(Path::new(path), &UrdfOptions::default())?,
        };
        let chain = robot.chain(&config.robot.base, &config.robot.tip)?;
        if chain.dof() != config.robot.home_rad.len() {
            return Err(Error::Usage(format!(
                "robot.home_rad: {} numbers given, but the chain {} -> {} of {} has {} joints ({})",
                config.robot.home_rad.len(),
                chain.base(),
                chain.tip(),
                robot.name(),
                chain.dof(),
                chain.joint_names().join(", ")
            )));
        }
        let lift = lift(&config).or_else(|error| {
            // A file that cannot be read at all is the better news to start with.
            sources(&config, Some(Duration::ZERO), None)?;
            network(&config.pose)?;
            Err(error)
        })?;
        let [x, y, z] = config.robot.base_in_world_m;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), config.robot.base_yaw_deg.to_radians());
        let world_from_base = Isometry3::from_parts(Translation3::new(x, y, z), turn);
        Ok(Self { config, robot, chain, lift, world_from_base })
    }

    /// Loads the network on the runtime that the configuration asks for.
    ///
    /// # Errors
    /// [`Error::Pose`], with the file, what it holds and what was expected.
    pub fn vision(&self) -> Result<Vision, Error> {
        let (model, runtime) = open_network(&self.config.pose)?;
        let side = match self.config.worker.side {
            config::Side::Left => pose::Side::Left,
            config::Side::Right => pose::Side::Right,
        };
        let vision = Vision::load(&model, &runtime, side, self.lift.clone())?;
        if self.config.pose.mirror { vision.mirrored() } else { Ok(vision) }
    }

    /// Opens the pictures. `length` ends the synthetic worker; `epoch` is the zero of a camera's capture times.
    ///
    /// # Errors
    /// [`Error::Capture`] with the file, the place and what was expected.
    pub fn pictures(&self, length: Option<Duration>, epoch: Option<Instant>) -> Result<MultiView, Error> {
        let sources = sources(&self.config, length, epoch)?;
        for (source, camera) in sources.iter().zip(self.lift.cameras()) {
            let info = source.info();
            let [width, height] = camera.size_px;
            if [info.width, info.height] != camera.size_px {
                return Err(Error::Usage(format!(
                    "{}: pictures of {}x{} px, but its calibration {} is for {width}x{height} px",
                    info.name, info.width, info.height, camera.name
                )));
            }
        }
        Ok(MultiView::new(sources)?)
    }

    /// Tighter of configuration and URDF, per joint, inside the margin.
    fn limits(&self) -> Vec<JointLimits> {
        let l = &self.config.limits;
        self.chain
            .limits()
            .iter()
            .enumerate()
            .map(|(i, urdf)| JointLimits {
                lower_rad: urdf.lower.max(-std::f64::consts::TAU) + l.position_margin_rad,
                upper_rad: urdf.upper.min(std::f64::consts::TAU) - l.position_margin_rad,
                velocity_rad_s: urdf.velocity.min(l.velocity_rad_s[i]),
                acceleration_rad_s2: l.acceleration_rad_s2[i],
                jerk_rad_s3: l.jerk_rad_s3[i],
            })
            .collect()
    }

    fn wire_limits(&self) -> Vec<WireLimits> {
        let margin = 0.5 * self.config.limits.position_margin_rad;
        self.limits()
            .iter()
            .map(|l| WireLimits {
                min_rad: l.lower_rad - margin,
                max_rad: l.upper_rad + margin,
                velocity_rad_s: WIRE_HEADROOM * l.velocity_rad_s,
                acceleration_rad_s2: WIRE_HEADROOM * l.acceleration_rad_s2,
            })
            .collect()
    }

    /// Period of the control loop.
    pub fn period(&self) -> Duration {
        Duration::from_nanos((1e9 / self.config.control.rate_hz).round() as u64)
    }

    /// Settings of the control loop.
    pub fn control(&self) -> ControlParams {
        let t = &self.config.timeouts;
        let (soft, hard) = (ms(t.frame_soft_ms), ms(t.frame_hard_ms));
        ControlParams {
            tracker: TrackerParams {
                limits: self.limits(),
                bandwidth_rad_s: 40.0,
                synchronisation: Synchronisation::None,
                acceleration: AccelerationSource::Estimated,
                age: AgePolicy { coast: soft, fade: (hard - soft).max(ms(50)) },
                max_step: ms(20),
                horizon_capacity: 64,
                engage: EngageParams { velocity_rad_s: ALIGN_RAD_S, tolerance_rad: 0.03, gap_rad: 0.05, ramp: ms(500) },
            },
            frame_hard: hard,
            tracking_error_rad: self.config.limits.tracking_error_rad,
            tracking_error_for: ms(self.config.limits.tracking_error_ms),
            reengage_automatically: t.reengage == config::Reengage::Automatic,
        }
    }

    /// Settings of the host's protocol session.
    pub fn host(&self) -> HostParams {
        let standard = HostParams::standard(0, self.wire_limits(), self.period());
        HostParams { silent_after: self.feedback_limit().max(self.period() * 2), ..standard }
    }

    /// Settings of a controller for the simulated arm.
    pub fn controller(&self) -> ControllerParams {
        ControllerParams::standard(0, self.wire_limits())
    }

    /// Longest silence of the controller.
    pub fn feedback_limit(&self) -> Duration {
        ms(self.config.timeouts.feedback_ms)
    }

    /// Metres of tool per metre of wrist for a lesson that goes `radius_m` from its centre.
    pub fn scale(&self, radius_m: f64) -> f64 {
        let r = &self.config.retarget;
        if radius_m > 0.0 { r.scale.min(r.work_radius_m / radius_m) } else { r.scale }
    }

    /// The retargeting, centred on a posture of the worker, for a lesson that goes `radius_m` from it.
    ///
    /// # Errors
    /// [`Error::Follow`] for a home outside the joint limits, or joints that the mapping names and the chain lacks.
    pub fn retargeter(&self, centre: [f64; follow::DIMENSION], radius_m: f64) -> Result<Retargeter, Error> {
        let r = &self.config.retarget;
        let mapping = match r.mode {
            RetargetMode::Wrist => Mapping::Wrist { scale: self.scale(radius_m) },
            RetargetMode::Angles => Mapping::Angles { joints: r.angle_joints.clone(), scale: r.angle_scale },
        };
        let params = RetargetParams {
            mapping,
            world_from_base: self.world_from_base,
            home_rad: self.config.robot.home_rad.clone(),
            centre,
            tool_speed_m_s: self.config.limits.tool_speed_m_s,
        };
        Ok(Retargeter::new(self.chain.clone(), params)?)
    }

    /// What stands at the front of a recording.
    pub fn run_info(&self, pose: &str) -> RunInfo {
        let facts = BTreeMap::from([
            ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
            ("revision".to_owned(), option_env!("OGG_REVISION").unwrap_or("unknown").to_owned()),
            ("pose".to_owned(), pose.to_owned()),
            ("robot".to_owned(), self.robot.name().to_owned()),
        ]);
        RunInfo { facts, urdf: Some(self.robot.urdf().to_owned()), config: Some(self.config.to_toml()) }
    }

    /// Options of a recording that starts at `start_unix_ns`.
    pub fn recorder_options(&self, start_unix_ns: u64) -> RecorderOptions {
        let mut options = RecorderOptions::default();
        options.cameras = self.lift.cameras().len();
        options.start_unix_ns = start_unix_ns;
        options
    }
}

fn ms(value: u32) -> Duration {
    Duration::from_millis(u64::from(value))
}

/// Opens the files, folders or devices that the configuration names.
fn sources(
    config: &Config,
    length: Option<Duration>,
    epoch: Option<Instant>,
) -> Result<Vec<Box<dyn capture::Source>>, Error> {
    let open = |paths: &[PathBuf], fps: Option<f64>, size_px: Option<[u32; 2]>| {
        paths
            .iter()
            .enumerate()
            .map(|(camera, path)| {
                let mut options = OpenOptions::default();
                options.camera = camera;
                options.image_rate_hz = fps;
                options.epoch = epoch;
                options.ffmpeg.clone_from(&config.ffmpeg);
                if let (Some([width, height]), Some(rate_hz)) = (size_px, fps) {
                    options.request = CameraRequest { size: Some((width, height)), rate_hz: Some(rate_hz) };
                }
                capture::open(path, &options)
            })
            .collect::<Result<Vec<_>, _>>()
    };
    Ok(match &config.source {
        Source::Worker { action, seed, fps, size_px } => {
            vec![Box::new(WorkerSource::new(*action, *seed, *fps, *size_px, length)?) as Box<dyn capture::Source>]
        }
        Source::Video { files, .. } => open(files, None, None)?,
        Source::Images { folders, fps } => open(folders, Some(*fps), None)?,
        Source::V4l2 { devices, size_px, fps } => open(devices, Some(*fps), Some(*size_px))?,
    })
}

/// Finds card and weights of the network.
fn network(pose: &config::Pose) -> Result<Model, Error> {
    let mut folders: Vec<PathBuf> = pose.weights_dir.iter().cloned().collect();
    folders.extend(std::env::var_os(WEIGHTS_VARIABLE).map(PathBuf::from));
    Ok(Model::find(Path::new(&pose.card), &folders)?)
}

/// Reads the calibration and pairs it with the views.
fn lift(config: &Config) -> Result<Lift, Error> {
    match &config.lift {
        config::Lift::Planes { calibration, shoulder_height_m, elbow_height_m, wrist_height_m, height_sigma_m } => {
            let plane = |height_m: &f64| Plane { height_m: *height_m, sigma_m: *height_sigma_m };
            let camera = match (calibration, &config.source) {
                (None, Source::Worker { size_px, .. }) => sim::default_camera(*size_px)?,
                (Some(path), _) => one_camera(path)?,
                (None, _) => {
                    return Err(Error::Usage(
                        "lift.calibration: a camera calibration file is needed for this source (--calibration FILE)"
                            .into(),
                    ));
                }
            };
            let planes = [plane(shoulder_height_m), plane(elbow_height_m), plane(wrist_height_m)];
            Ok(Lift::Planes { camera: Box::new(camera), planes })
        }
        config::Lift::Multiview { calibration } => {
            let cameras = kin::read_cameras(calibration)?;
            let views: Vec<&PathBuf> = match &config.source {
                Source::Video { files, .. } => files.iter().collect(),
                Source::Images { folders, .. } => folders.iter().collect(),
                Source::V4l2 { devices, .. } => devices.iter().collect(),
                Source::Worker { .. } => vec![],
            };
            Ok(Lift::MultiView { cameras: paired(calibration, &cameras, &views)? })
        }
    }
}

fn one_camera(path: &Path) -> Result<Camera, Error> {
    let mut cameras = kin::read_cameras(path)?;
    if cameras.len() == 1 {
        return Ok(cameras.remove(0));
    }
    Err(Error::Content {
        path: path.to_path_buf(),
        message: format!("{} cameras, expected one for a single view", cameras.len()),
    })
}

/// The camera of each view: the one whose name is the view's file name, or by order where no name matches.
fn paired(path: &Path, cameras: &[Camera], views: &[&PathBuf]) -> Result<Vec<Camera>, Error> {
    let stem = |view: &&PathBuf| view.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let by_name: Vec<Option<&Camera>> =
        views.iter().map(|view| cameras.iter().find(|camera| camera.name == stem(view))).collect();
    if by_name.iter().all(Option::is_some) {
        return Ok(by_name.into_iter().flatten().cloned().collect());
    }
    if by_name.iter().all(Option::is_none) && cameras.len() == views.len() {
        return Ok(cameras.to_vec());
    }
    let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
    Err(Error::Content {
        path: path.to_path_buf(),
        message: format!(
            "cameras {}, expected one for each of the views {}",
            names.join(", "),
            views.iter().map(stem).collect::<Vec<_>>().join(", ")
        ),
    })
}

/// The network that a configuration names, and the runtime it asks for.
///
/// # Errors
/// [`Error::Usage`] for an unknown provider, [`Error::Pose`] for a model or a library that is not there or not what it says.
pub(crate) fn open_network(pose: &config::Pose) -> Result<(Model, Runtime), Error> {
    let model = network(pose)?;
    let provider: ExecutionProvider = serde_json::from_value(pose.provider.clone().into())
        .map_err(|e| Error::Usage(format!("pose.provider: {e}")))?;
    let library = if pose.onnxruntime.as_deref() == Some("tract") {
        LibraryChoice::PureRust
    } else {
        let explicit = pose.onnxruntime.as_ref().map(PathBuf::from);
        let environment = std::env::var_os(ONNXRUNTIME_VARIABLE).map(PathBuf::from);
        let binary = std::env::current_exe().ok();
        let python: Vec<PathBuf> = ["VIRTUAL_ENV", "CONDA_PREFIX"]
            .iter()
            .filter_map(std::env::var_os)
            .flat_map(|prefix| pose::python_site_packages(Path::new(&prefix)))
            .collect();
        LibraryChoice::Search(pose::onnxruntime_candidates(&LibrarySearch {
            explicit: explicit.as_deref(),
            environment: environment.as_deref(),
            binary_dir: binary.as_deref().and_then(Path::parent),
            python: &python,
            system: true,
        }))
    };
    let threads = Some(pose.threads);
    let runtime = Runtime::load(RuntimeOptions { library, provider, fallback: None, threads, spin: false })?;
    Ok((model, runtime))
}
