//! The configuration of a cell: one TOML file, every key known, limits and time-outs mandatory.

mod check;

use std::path::{Path, PathBuf};

use follow::{LearnParams, PhaseParams, TeachParams};
use serde::{Deserialize, Serialize};

use crate::error::Error;

/// The built-in cell, as TOML.
pub const BUILTIN_CELL: &str = include_str!("../../assets/builtin-cell.toml");

/// Everything a run needs to know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The `ffmpeg` program for codecs other than H.264; looked for where absent.
    #[serde(default)]
    pub ffmpeg: Option<PathBuf>,
    /// Where pictures come from.
    pub source: Source,
    /// The network that finds keypoints.
    pub pose: Pose,
    /// Who is followed.
    pub worker: Worker,
    /// How pixels become metres.
    pub lift: Lift,
    /// The arm that follows.
    pub robot: Robot,
    /// What the arm may do at most.
    pub limits: Limits,
    /// How old things may become.
    pub timeouts: Timeouts,
    /// How the worker's arm maps to the robot's.
    pub retarget: Retarget,
    /// Teaching.
    pub teach: Teach,
    /// The control loop.
    pub control: Control,
    /// The bus.
    pub bus: Bus,
    /// The recording.
    pub record: Record,
}

/// Where pictures come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Source {
    /// The synthetic worker before a synthetic camera.
    Worker {
        /// Which sewing action.
        action: Action,
        /// Seed of the worker's small variations.
        seed: u64,
        /// Frames per second.
        fps: f64,
        /// Width and height in pixels.
        size_px: [u32; 2],
    },
    /// Video files; several are synchronised views.
    Video {
        /// The files, one per camera.
        files: Vec<PathBuf>,
        /// Play at the speed of the recording instead of as fast as the network allows (daemon only).
        #[serde(default = "yes")]
        realtime: bool,
    },
    /// A folder of images.
    Images {
        /// The folders, one per camera.
        folders: Vec<PathBuf>,
        /// Frames per second.
        fps: f64,
    },
    /// Video4Linux cameras.
    V4l2 {
        /// Device files, one per camera.
        devices: Vec<PathBuf>,
        /// Width and height asked for.
        size_px: [u32; 2],
        /// Frames per second asked for.
        fps: f64,
    },
}

fn yes() -> bool {
    true
}

/// The paper's three sewing actions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Action {
    /// Move the fabric.
    Move,
    /// Align the fabric.
    Align,
    /// Flip the fabric.
    Flip,
}

/// The network that finds keypoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// `builtin:NAME`, a model card, or an `.onnx` file whose card is known.
    pub card: String,
    /// Where the weights named by the card are looked for besides the card's own folder.
    #[serde(default)]
    pub weights_dir: Option<PathBuf>,
    /// ONNX Runtime's shared library, or `tract` for the pure-Rust runtime. Looked for where absent.
    #[serde(default)]
    pub onnxruntime: Option<String>,
    /// Execution provider.
    pub provider: String,
    /// Threads within one operator.
    pub threads: usize,
    /// Looks at every picture a second time, mirrored, and takes the mean of both answers: more exact, and twice the work.
    #[serde(default)]
    pub mirror: bool,
}

/// Who is followed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Worker {
    /// Which arm.
    pub side: Side,
}

/// Left or right, of the worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// The worker's left.
    Left,
    /// The worker's right.
    Right,
}

/// How pixels become metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "mode", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Lift {
    /// One calibrated camera; each joint lies on a horizontal plane of its own.
    Planes {
        /// Calibration file; the built-in worker brings its own.
        #[serde(default)]
        calibration: Option<PathBuf>,
        /// Height of the shoulder above the bench top.
        shoulder_height_m: f64,
        /// Height of the elbow.
        elbow_height_m: f64,
        /// Height of the wrist.
        wrist_height_m: f64,
        /// Standard deviation of these heights.
        height_sigma_m: f64,
    },
    /// Two or more calibrated cameras.
    Multiview {
        /// Calibration file.
        calibration: PathBuf,
    },
}

/// The arm that follows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// `builtin`, or a URDF file.
    pub urdf: String,
    /// First link of the chain.
    pub base: String,
    /// Last link of the chain.
    pub tip: String,
    /// Position of the base in `world`.
    pub base_in_world_m: [f64; 3],
    /// Rotation of the base about the vertical.
    pub base_yaw_deg: f64,
    /// Where the arm starts and the centre of its work, one angle per joint.
    pub home_rad: Vec<f64>,
}

/// What the arm may do at most, one number per joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Joint speed.
    pub velocity_rad_s: Vec<f64>,
    /// Joint acceleration.
    pub acceleration_rad_s2: Vec<f64>,
    /// Joint jerk.
    pub jerk_rad_s3: Vec<f64>,
    /// Kept away from the position limits of the URDF.
    pub position_margin_rad: f64,
    /// Speed of the tool.
    pub tool_speed_m_s: f64,
    /// Allows a tool speed above 0.25 m/s on a real bus.
    #[serde(default)]
    pub fast_tool: bool,
    /// Largest difference between command and measurement ...
    pub tracking_error_rad: f64,
    /// ... for this long.
    pub tracking_error_ms: u32,
}

/// How old things may become.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Timeouts {
    /// Age of the newest arm sample from which on the arm slows down along its path.
    pub frame_soft_ms: u32,
    /// Age at which it stops.
    pub frame_hard_ms: u32,
    /// Longest silence of the controller.
    pub feedback_ms: u32,
    /// Who may start again after vision was lost.
    pub reengage: Reengage,
}

/// Who may start again after vision was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reengage {
    /// A person (`SIGUSR1`).
    Operator,
    /// The daemon, by the slow alignment of the start. Simulated cells only.
    Automatic,
}

/// How the worker's arm maps to the robot's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Retarget {
    /// Which way.
    pub mode: RetargetMode,
    /// Metres of tool per metre of wrist, at most (mode `wrist`).
    pub scale: f64,
    /// A lesson that goes further from its centre than this, once scaled, is scaled down to it (mode `wrist`).
    pub work_radius_m: f64,
    /// Joints for elevation, flexion and inclination (mode `angles`).
    #[serde(default = "paper_joints")]
    pub angle_joints: [String; 3],
    /// Radians of joint per radian of arm; negative turns the sense round (mode `angles`).
    #[serde(default = "paper_scale")]
    pub angle_scale: [f64; 3],
}

/// The paper's joints 2, 3 and 4.
fn paper_joints() -> [String; 3] {
    ["joint2", "joint3", "joint4"].map(str::to_owned)
}

/// Senses for an arm whose upper arm rises with joint 2 and whose elbow points up.
fn paper_scale() -> [f64; 3] {
    [1.0, -1.0, 1.0]
}

/// Which way the worker's arm maps to the robot's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum RetargetMode {
    /// Wrist position, by inverse kinematics.
    Wrist,
    /// The three arm angles to joints 2, 3 and 4, as in the paper.
    Angles,
}

/// Teaching and learning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Teach {
    /// How long the worker shows the action before the arm follows (live; a recording teaches with all of itself).
    pub duration_s: f64,
    /// Cutting into demonstrations.
    #[serde(default)]
    pub cut: TeachParams,
    /// Fitting the mixtures.
    #[serde(default)]
    pub learn: LearnParams,
    /// Finding the worker's place in the action.
    #[serde(default)]
    pub phase: PhaseParams,
}

/// The control loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Control {
    /// Setpoints per second.
    pub rate_hz: f64,
    /// Offline: time from capture until the plan is there. Live, it is what it is.
    #[serde(default = "usual_latency")]
    pub offline_latency_ms: f64,
}

/// Exposure, transfer and a network at 25 frames per second.
fn usual_latency() -> f64 {
    60.0
}

/// The bus.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Bus {
    /// In this process, with the simulated arm behind it.
    InProcess {},
    /// A SocketCAN interface.
    Socketcan {
        /// Its name, such as `can0`.
        interface: String,
    },
}

/// The recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Where recordings go.
    pub folder: PathBuf,
    /// Whether camera pictures are recorded.
    pub images: bool,
}

impl Config {
    /// The built-in cell.
    ///
    /// # Panics
    /// Never: the tests read the embedded file.
    pub fn builtin() -> Self {
        Self::parse(BUILTIN_CELL, Path::new("builtin-cell.toml")).expect("the embedded configuration is valid")
    }

    /// Reads and checks a file.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be read, [`Error::Config`] with line and key where it is wrong.
    pub fn load(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::File {
            path: path.to_path_buf(),
            expected: "a configuration file (`ogg follow config` prints one)",
            source,
        })?;
        Self::parse(&text, path)
    }

    fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let config: Self = toml::from_str(text)
            .map_err(|e| Error::Config { path: path.to_path_buf(), message: e.to_string().trim_end().to_owned() })?;
        config.checked(path)
    }

    /// Checks the relations between keys; `path` is named in the error.
    ///
    /// # Errors
    /// [`Error::Config`] with the key, what it holds and what was expected.
    pub fn checked(self, path: &Path) -> Result<Self, Error> {
        match self.check() {
            Ok(()) => Ok(self),
            Err(message) => Err(Error::Config { path: path.to_path_buf(), message }),
        }
    }

    /// The configuration as TOML, as it is recorded.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a configuration is always representable as TOML")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edited(from: &str, to: &str) -> Result<Config, Error> {
        assert!(BUILTIN_CELL.contains(from), "{from}");
        Config::parse(&BUILTIN_CELL.replacen(from, to, 1), Path::new("cell.toml"))
    }

    #[test]
    fn the_builtin_cell_is_valid_and_survives_a_round_trip() {
        let config = Config::builtin();
        assert_eq!(Config::parse(&config.to_toml(), Path::new("again")).unwrap(), config);
    }

    /// Each edit is refused, and the message names the key.
    #[test]
    fn wrong_configurations_name_file_and_key() {
        let corpus = [
            ("rate_hz = 200.0", "rate_hz = 200.0\nrate_khz = 1", "rate_khz"),
            ("rate_hz = 200.0", "rate_hz = 5.0", "control.rate_hz"),
            ("rate_hz = 200.0", "rate_hz = nan", "control.rate_hz"),
            ("jerk_rad_s3 = [600.0, 600.0, 900.0, 900.0, 900.0, 900.0]", "", "jerk_rad_s3"),
            ("frame_hard_ms = 600", "", "frame_hard_ms"),
            ("frame_hard_ms = 600", "frame_hard_ms = 100", "timeouts.frame_hard_ms"),
            ("velocity_rad_s = [3.0,", "velocity_rad_s = [0.0,", "limits.velocity_rad_s"),
            ("velocity_rad_s = [3.0, 3.0,", "velocity_rad_s = [3.0,", "limits.velocity_rad_s"),
            ("tool_speed_m_s = 1.0", "tool_speed_m_s = -1.0", "limits.tool_speed_m_s"),
            ("kind = \"worker\"", "kind = \"telepathy\"", "telepathy"),
            ("side = \"right\"", "side = \"middle\"", "middle"),
            ("fps = 30.0", "fps = 0.0", "source.fps"),
            ("scale = 1.0", "scale = inf", "retarget.scale"),
            ("duration_s = 6.8", "duration_s = 0.1", "teach.duration_s"),
            ("[limits]", "[limit]", "limit"),
            ("kind = \"in-process\"", "kind = \"socketcan\"\ninterface = \"can0\"", "limits.tool_speed_m_s"),
        ];
        for (from, to, name) in corpus {
            let message = edited(from, to).expect_err(to).to_string();
            assert!(message.contains("cell.toml") && message.contains(name), "{to}: {message}");
        }
    }
}
