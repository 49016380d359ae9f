//! `ogg pose video`: what a network finds, drawn.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use image::RgbImage;
use pose::{ArmGate, GateOptions, ImageView, Side, WorkerOptions, WorkerTracker};

use super::mp4::Mp4Writer;
use super::stages::Stages;
use super::{VideoArgs, paint, unwritable};
use crate::capture::{self, OpenOptions};
use crate::commands::say;
use crate::config;
use crate::error::Error;
use crate::progress::Progress;

/// Pictures go into a video or into a folder.
enum Sink {
    Video(Box<Mp4Writer>),
    Folder(PathBuf),
}

impl Sink {
    fn open(out: &Path, rate_hz: f64) -> Result<Self, Error> {
        match out.extension().and_then(|e| e.to_str()) {
            Some("mp4") => Ok(Self::Video(Box::new(Mp4Writer::create(out, rate_hz)?))),
            Some(other) => {
                Err(Error::Usage(format!("--out: .{other} given, expected a file .mp4, or a folder for pictures")))
            }
            None => {
                std::fs::create_dir_all(out).map_err(unwritable(out))?;
                Ok(Self::Folder(out.to_owned()))
            }
        }
    }

    fn put(&mut self, image: &RgbImage, sequence: u64, time: Duration) -> Result<(), Error> {
        match self {
            Self::Video(writer) => writer.push(image, time),
            Self::Folder(folder) => {
                let path = folder.join(format!("{sequence:06}.png"));
                image.save(&path).map_err(|source| capture::Error::Image { path, source })?;
                Ok(())
            }
        }
    }

    fn finish(self) -> Result<(), Error> {
        match self {
            Self::Video(writer) => writer.finish(),
            Self::Folder(_) => Ok(()),
        }
    }
}

pub(super) fn run(args: &VideoArgs) -> Result<(), Error> {
    let options = OpenOptions { image_rate_hz: args.fps, ffmpeg: args.ffmpeg.clone(), ..OpenOptions::default() };
    let mut source = capture::open(&args.input, &options)?;
    let (rate_hz, total) = (source.info().rate_hz.unwrap_or(30.0), source.info().frames);
    let mut estimator = args.network.open()?;
    let mut worker = WorkerTracker::new(WorkerOptions::default())?;
    let side = match args.side {
        config::Side::Left => Side::Left,
        config::Side::Right => Side::Right,
    };
    let mut gate = ArmGate::new(side, GateOptions::default())?;
    let mut sink = Sink::open(&args.out, rate_hz)?;
    let mut json = match &args.json {
        Some(path) => Some((path, BufWriter::new(File::create(path).map_err(unwritable(path))?))),
        None => None,
    };
    let limit = args.limit.map_or(u64::MAX, |n| n as u64);
    let mut stages = Stages::default();
    let (mut pictures, mut people_sum, mut with_wrist) = (0_u64, 0, 0_u64);
    let mut progress = Progress::new("drawing", total.map(|t| t.min(limit)));
    while pictures < limit {
        let Some(frame) = source.next_frame()? else { break };
        let mut image = (*frame.image).clone();
        let (width, height) = image.dimensions();
        let view = ImageView::new(width as usize, height as usize, frame.image.as_raw())?;
        let people = stages.estimate(&mut estimator, view)?;
        let arm = gate.update(frame.captured, worker.update(frame.captured, &people).person(&people));
        people.iter().for_each(|p| paint::person(&mut image, p));
        paint::arm(&mut image, &arm);
        sink.put(&image, frame.sequence, frame.captured)?;
        if let Some((path, file)) = &mut json {
            let line = serde_json::json!({ "time_s": frame.captured.as_secs_f64(), "people": people, "arm": arm });
            writeln!(file, "{line}").map_err(unwritable(path))?;
        }
        pictures += 1;
        people_sum += people.len();
        with_wrist += u64::from(arm.wrist.is_measured());
        progress.set(pictures);
    }
    sink.finish()?;
    if let Some((path, mut file)) = json {
        file.flush().map_err(unwritable(path))?;
    }
    progress.finish(&format!("{pictures} pictures"));
    say(format_args!("{} on {}", estimator.card().name, estimator.runtime_info()));
    say(format_args!(
        "{pictures} pictures, {:.2} people per picture, wrist of the worker measured in {:.1} % of them",
        people_sum as f64 / pictures.max(1) as f64,
        100.0 * with_wrist as f64 / pictures.max(1) as f64,
    ));
    say("stage             p50 ms    p99 ms  1/p50 (Hz)  pictures");
    stages.summary().iter().for_each(say);
    say(format_args!("{}", args.out.display()));
    Ok(())
}
