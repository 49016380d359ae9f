//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

use crate::config::{Action, RetargetMode, Side};

/// A robot arm follows a worker's arm: camera, pose, motion model, kinematics, limits, CAN.
#[derive(Debug, Parser)]
#[command(name = "ogg", version, propagate_version = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Follow a worker.
    #[command(subcommand)]
    Follow(Follow),
    /// Print the joints, limits and frames of a robot.
    Describe {
        /// A URDF file; the built-in arm where absent.
        urdf: Option<PathBuf>,
        /// First link of the chain.
        #[arg(long)]
        base: Option<String>,
        /// Last link of the chain.
        #[arg(long)]
        tip: Option<String>,
    },
    /// Print what a motion model or a recording (.mcap) holds.
    Inspect {
        /// The file.
        file: PathBuf,
    },
    /// Score a pose network, or draw what it finds.
    #[command(subcommand)]
    Pose(crate::commands::PoseCommand),
    /// Run the controller side of the joint protocol on a CAN interface, with the simulated arm behind it.
    Controller(crate::can_tools::ControllerArgs),
    /// Look at a CAN bus: monitor, log, replay.
    #[command(subcommand)]
    Can(crate::can_tools::CanCommand),
}

/// Ways to follow.
#[derive(Debug, Subcommand)]
pub enum Follow {
    /// Teach, learn, follow, and keep following until stopped.
    Daemon(FollowArgs),
    /// Take a recording once: learn from it, follow it, print a summary.
    Run(FollowArgs),
    /// Print a configuration to start from.
    Config,
    /// Check a configuration, and everything it names, without moving anything.
    CheckConfig(FollowArgs),
}

/// What a run may override in its configuration.
#[derive(Debug, Clone, Default, Args)]
pub struct FollowArgs {
    /// Configuration file; the built-in cell where absent.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Pictures: a video file or a folder of images, once per view; `/dev/videoN` for a camera; `worker` for the synthetic
    /// one.
    #[arg(long, value_name = "SOURCE", num_args = 1.., action = clap::ArgAction::Append)]
    pub input: Vec<PathBuf>,
    /// Frames per second of a folder of images or a camera.
    #[arg(long, value_name = "HZ")]
    pub fps: Option<f64>,
    /// The `ffmpeg` program for codecs other than H.264; looked for on the PATH where absent.
    #[arg(long, value_name = "PROGRAM")]
    pub ffmpeg: Option<PathBuf>,
    /// Camera calibration (Pose2Sim TOML, ROS or OpenCV YAML).
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
    /// Pose network: a model card, an .onnx file, or `builtin:ogg-lite`.
    #[arg(long, value_name = "CARD")]
    pub model: Option<String>,
    /// Where the weights a card names are looked for.
    #[arg(long, value_name = "FOLDER")]
    pub weights: Option<PathBuf>,
    /// ONNX Runtime's shared library, or `tract`.
    #[arg(long, value_name = "FILE")]
    pub onnxruntime: Option<String>,
    /// Which arm of the worker is followed.
    #[arg(long)]
    pub side: Option<Side>,
    /// Which action the synthetic worker does.
    #[arg(long)]
    pub action: Option<Action>,
    /// Robot description (URDF).
    #[arg(long, value_name = "URDF")]
    pub robot: Option<String>,
    /// How the worker's arm maps to the robot's.
    #[arg(long)]
    pub retarget: Option<RetargetMode>,
    /// `in-process`, or a SocketCAN interface such as `can0`.
    #[arg(long, value_name = "BUS")]
    pub bus: Option<String>,
    /// A motion model to follow with, instead of teaching one.
    #[arg(long, value_name = "FILE")]
    pub motion_model: Option<PathBuf>,
    /// Where the learned motion model is saved (beside the recording where absent).
    #[arg(long, value_name = "FILE")]
    pub save_motion_model: Option<PathBuf>,
    /// Folder for recordings.
    #[arg(long, value_name = "FOLDER")]
    pub record: Option<PathBuf>,
    /// Write the summary as JSON, too.
    #[arg(long, value_name = "FILE")]
    pub summary: Option<PathBuf>,
    /// Wrist positions made by other means, to compare with (CSV with `t_s` and `rwri_x`, `rwri_y`, `rwri_z` in metres).
    #[arg(long, value_name = "CSV")]
    pub reference: Option<PathBuf>,
    /// Stop by itself after this time (daemon).
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
}
