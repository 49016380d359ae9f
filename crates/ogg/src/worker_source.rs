//! The synthetic worker before a synthetic camera, as a source of pictures.

use std::sync::Arc;
use std::time::Duration;

use sim::{Scene, Script, Worker, WorkerParams, default_camera};

use crate::capture::{Error as CaptureError, Frame, Source, SourceInfo};
use crate::config::Action;
use crate::error::Error;

/// Renders the worker at a fixed rate. As a recording it ends after a given time; live it goes on.
#[derive(Debug)]
pub struct WorkerSource {
    worker: Worker,
    scene: Scene,
    info: SourceInfo,
    period: Duration,
    frames: Option<u64>,
    next: u64,
}

impl WorkerSource {
    /// A worker doing `action` over and over; `length` ends it.
    ///
    /// # Errors
    /// [`Error::Sim`] for a picture size or a rate out of range.
    pub fn new(
        action: Action,
        seed: u64,
        fps: f64,
        size_px: [u32; 2],
        length: Option<Duration>,
    ) -> Result<Self, Error> {
        let params = WorkerParams { seed, script: Script::Repeat(action.into()), ..WorkerParams::default() };
        let camera = default_camera(size_px)?;
        let period = Duration::try_from_secs_f64(1.0 / fps)
            .map_err(|_| Error::Usage(format!("source.fps: {fps} given, expected a positive number")))?;
        let frames = length.map(|length| (length.as_secs_f64() * fps).floor() as u64);
        let info = SourceInfo {
            name: format!("synthetic worker, action {}", sim::Action::from(action).name()),
            width: size_px[0],
            height: size_px[1],
            rate_hz: Some(fps),
            frames,
            decoder: "renderer".to_owned(),
            live: false,
        };
        Ok(Self { scene: Scene::new(camera, &params), worker: Worker::new(params)?, info, period, frames, next: 0 })
    }

    /// The camera the worker is seen through.
    pub fn camera(&self) -> &kin::Camera {
        self.scene.camera()
    }
}

impl Source for WorkerSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, CaptureError> {
        if self.frames.is_some_and(|frames| self.next >= frames) {
            return Ok(None);
        }
        let nanos = u128::from(self.next) * self.period.as_nanos();
        let time = Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX));
        let (image, _) = self.scene.render(&self.worker.pose_at(time));
        let frame = Frame { image: Arc::new(image), captured: time, media_time: time, sequence: self.next, camera: 0 };
        self.next += 1;
        Ok(Some(frame))
    }
}

impl From<Action> for sim::Action {
    fn from(action: Action) -> Self {
        match action {
            Action::Move => Self::Move,
            Action::Align => Self::Align,
            Action::Flip => Self::Flip,
        }
    }
}

#[cfg(test)]
mod tests {
    use sim::Keypoint;

    use super::*;
    use crate::config::{Config, Lift};

    /// The heights in the built-in cell are what one would measure at the bench: those of the joints, over all actions.
    #[test]
    fn the_planes_of_the_builtin_cell_are_where_the_joints_are() {
        let Lift::Planes { shoulder_height_m, elbow_height_m, wrist_height_m, height_sigma_m, .. } =
            Config::builtin().lift
        else {
            panic!("the built-in cell has one camera");
        };
        let worker = Worker::new(WorkerParams::default()).unwrap();
        let planes = [
            (Keypoint::RightShoulder, shoulder_height_m),
            (Keypoint::RightElbow, elbow_height_m),
            (Keypoint::RightWrist, wrist_height_m),
        ];
        let measured = planes.map(|(keypoint, height_m)| {
            let heights: Vec<f64> =
                (0..270).map(|i| worker.pose_at(Duration::from_millis(100 * i)).joint(keypoint).z).collect();
            let mean = heights.iter().sum::<f64>() / heights.len() as f64;
            let spread = (heights.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / heights.len() as f64).sqrt();
            (mean, spread, height_m)
        });
        for (mean, spread, height_m) in measured {
            assert!(
                (mean - height_m).abs() < 0.01 && spread < 2.0 * height_sigma_m,
                "mean, spread, configured: {measured:.3?}"
            );
        }
    }
}
