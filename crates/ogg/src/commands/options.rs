//! Configuration file plus command line: what a run really uses.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::say;
use crate::cell::Cell;
use crate::cli::FollowArgs;
use crate::config::{Bus, Config, Lift, Source};
use crate::error::Error;

/// Reads the configuration and lays the command line over it.
pub(super) fn resolve(args: &FollowArgs) -> Result<Config, Error> {
    let mut config = match &args.config {
        Some(path) => Config::load(path)?,
        None => Config::builtin(),
    };
    if !args.input.is_empty() {
        config.source = source(&args.input, args.fps)?;
    }
    config.ffmpeg = args.ffmpeg.clone().or(config.ffmpeg);
    if let Source::Worker { action, .. } = &mut config.source {
        *action = args.action.unwrap_or(*action);
    } else if args.action.is_some() {
        return Err(Error::Usage("--action is for the synthetic worker; leave out --input".into()));
    }
    if let Some(calibration) = &args.calibration {
        lay_calibration(&mut config, calibration);
    }
    if let Some(card) = &args.model {
        config.pose.card.clone_from(card);
    }
    config.pose.weights_dir = args.weights.clone().or(config.pose.weights_dir);
    config.pose.onnxruntime = args.onnxruntime.clone().or(config.pose.onnxruntime);
    config.worker.side = args.side.unwrap_or(config.worker.side);
    if let Some(urdf) = &args.robot {
        config.robot.urdf.clone_from(urdf);
    }
    config.retarget.mode = args.retarget.unwrap_or(config.retarget.mode);
    match args.bus.as_deref() {
        None => {}
        Some("in-process") => config.bus = Bus::InProcess {},
        Some(interface) => config.bus = Bus::Socketcan { interface: interface.to_owned() },
    }
    if let Some(folder) = &args.record {
        config.record.folder.clone_from(folder);
    }
    config.checked(args.config.as_deref().unwrap_or(Path::new("command line")))
}

/// What `--input` names: `worker`, video files, folders of images, or V4L2 devices; all of one kind.
fn source(inputs: &[PathBuf], fps: Option<f64>) -> Result<Source, Error> {
    if inputs == [PathBuf::from("worker")] {
        return Ok(Config::builtin().source);
    }
    let kind = |path: &PathBuf| -> Result<&'static str, Error> {
        let text = path.to_string_lossy();
        if text.starts_with("/dev/video") {
            return Ok("v4l2");
        }
        let meta = std::fs::metadata(path).map_err(|source| Error::File {
            path: path.clone(),
            expected: "a video file, a folder of images or a /dev/video device",
            source,
        })?;
        Ok(if meta.is_dir() { "images" } else { "video" })
    };
    let first = kind(&inputs[0])?;
    for input in inputs {
        let other = kind(input)?;
        if other != first {
            return Err(Error::Usage(format!(
                "--input: {} is of kind {first}, but {} is of kind {other}; all views must be of one kind",
                inputs[0].display(),
                input.display()
            )));
        }
    }
    let needs_fps = |what: &str| {
        fps.ok_or_else(|| Error::Usage(format!("--fps: {what} need the rate of their pictures, such as --fps 30")))
    };
    Ok(match first {
        "video" => Source::Video { files: inputs.to_vec(), realtime: true },
        "images" => Source::Images { folders: inputs.to_vec(), fps: needs_fps("folders of images")? },
        _ => Source::V4l2 { devices: inputs.to_vec(), size_px: [1280, 720], fps: needs_fps("cameras")? },
    })
}

/// A calibration with several views means triangulation, one with a single view the planes of the configuration.
fn lay_calibration(config: &mut Config, file: &Path) {
    let views = match &config.source {
        Source::Worker { .. } => 1,
        Source::Video { files, .. } => files.len(),
        Source::Images { folders, .. } => folders.len(),
        Source::V4l2 { devices, .. } => devices.len(),
    };
    match &mut config.lift {
        Lift::Planes { calibration, .. } if views == 1 => *calibration = Some(file.to_path_buf()),
        lift => *lift = Lift::Multiview { calibration: file.to_path_buf() },
    }
}

/// `ogg follow check-config`: everything a configuration names is opened, nothing moves.
pub(super) fn check(args: &FollowArgs) -> Result<(), Error> {
    let cell = Cell::open(resolve(args)?)?;
    let vision = cell.vision()?;
    let pictures = cell.pictures(Some(Duration::ZERO), None)?;
    cell.retargeter([0.0; follow::DIMENSION], 0.0)?;
    let names: Vec<&str> = pictures.infos().map(|info| info.name.as_str()).collect();
    say(format_args!("source      {}", names.join(", ")));
    say(format_args!("pose        {}", vision.describe()));
    say(format_args!("robot       {}: {}", cell.robot.name(), cell.chain.joint_names().join(", ")));
    say("configuration is complete");
    Ok(())
}

/// A number of seconds from the command line.
pub(super) fn duration(option: &str, seconds: f64) -> Result<Duration, Error> {
    Duration::try_from_secs_f64(seconds)
        .ok()
        .filter(|d| !d.is_zero())
        .ok_or_else(|| Error::Usage(format!("{option}: {seconds} given, expected a positive number of seconds")))
}
