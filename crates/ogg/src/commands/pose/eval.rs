//! `ogg pose eval`: a network against labels.

use std::path::{Path, PathBuf};

use pose::{Estimator, ImageView, Person};
use serde::Serialize;

use super::labels::{LabelSet, Picture, Place};
use super::scores::{OksRow, PckRow, Scores};
use super::stages::{StageTimes, Stages};
use super::{EvalArgs, unwritable};
use crate::capture::{self, OpenOptions, Source};
use crate::commands::say;
use crate::error::Error;
use crate::progress::Progress;

#[derive(Debug, Serialize)]
struct Report {
    network: String,
    runtime: String,
    pictures: usize,
    people_labelled: usize,
    people_found: usize,
    oks: Vec<OksRow>,
    pck: Vec<PckRow>,
    stages: Vec<StageTimes>,
}

pub(super) fn run(args: &EvalArgs) -> Result<(), Error> {
    let beside = args.data.parent().unwrap_or(Path::new("")).to_owned();
    let images = args.images.clone().unwrap_or(beside);
    let mut set = LabelSet::read(&args.data, &images)?;
    set.pictures.truncate(args.limit.unwrap_or(usize::MAX));
    let mut estimator = args.network.open()?;
    let mut scores = Scores::new(set.skeleton, args.network_sigmas())?;
    let mut stages = Stages::default();
    let mut found = 0;
    let mut progress = Progress::new("scoring", Some(set.pictures.len() as u64));
    let mut video: Option<Video> = None;
    for (done, picture) in set.pictures.iter().enumerate() {
        let people = match &picture.place {
            Place::File(path) => {
                // Pictures of a set have nothing to do with each other.
                estimator.reset();
                let image = image::open(path)
                    .map_err(|source| capture::Error::Image { path: path.clone(), source })?
                    .into_rgb8();
                look(&mut estimator, &image, &mut stages)?
            }
            Place::Frame(frame) => {
                if video.as_ref().is_none_or(|v| v.group != picture.group) {
                    estimator.reset();
                    video = Some(Video::open(&images, picture, args.ffmpeg.clone())?);
                }
                let Some(video) = &mut video else { unreachable!("opened above") };
                let image = video.at(*frame)?;
                look(&mut estimator, &image, &mut stages)?
            }
        };
        found += people.len();
        scores.add(&picture.group, &picture.labels, &people);
        progress.set(done as u64 + 1);
    }
    progress.finish(&format!("{} pictures", set.pictures.len()));
    let report = Report {
        network: estimator.card().name.clone(),
        runtime: estimator.runtime_info().to_string(),
        pictures: set.pictures.len(),
        people_labelled: set.pictures.iter().map(|p| p.labels.iter().filter(|l| !l.is_crowd).count()).sum(),
        people_found: found,
        oks: scores.oks()?,
        pck: scores.pck()?,
        stages: stages.summary(),
    };
    print(&report);
    if let Some(file) = &args.json {
        let text = serde_json::to_string_pretty(&report).map_err(|e| Error::Usage(e.to_string()))?;
        std::fs::write(file, text).map_err(unwritable(file))?;
    }
    Ok(())
}

impl EvalArgs {
    fn network_sigmas(&self) -> Option<&[f64]> {
        self.sigmas.as_deref()
    }
}

fn look(estimator: &mut Estimator, image: &image::RgbImage, stages: &mut Stages) -> Result<Vec<Person>, Error> {
    let (width, height) = image.dimensions();
    stages.estimate(estimator, ImageView::new(width as usize, height as usize, image.as_raw())?)
}

fn print(report: &Report) {
    say(format_args!("{} on {}", report.network, report.runtime));
    say(format_args!(
        "{} pictures, {} people labelled, {} found",
        report.pictures, report.people_labelled, report.people_found
    ));
    if report.oks.is_empty() {
        say("OKS: the labels have no areas");
    } else {
        say("\nOKS (%)            AP   AP50   AP75    APm    APl     AR   AR50   AR75");
        report.oks.iter().for_each(say);
    }
    say("\ngroup      joints   joint             labels PCK@0.1  PCK@0.2   (% of torso lengths)");
    report.pck.iter().for_each(say);
    say("\nstage             p50 ms    p99 ms  1/p50 (Hz)  pictures");
    report.stages.iter().for_each(say);
}

/// The pictures of one camera of a table, in order.
struct Video {
    group: String,
    path: PathBuf,
    source: Box<dyn Source>,
    next: u64,
}

impl Video {
    /// `GROUP.mp4`, another video file of that name, or a folder `GROUP`.
    fn open(images: &Path, picture: &Picture, ffmpeg: Option<PathBuf>) -> Result<Self, Error> {
        let group = picture.group.clone();
        let names = ["mp4", "mov", "mkv", "avi", "webm"].map(|e| images.join(format!("{group}.{e}")));
        let folder = images.join(&group);
        let path =
            names.into_iter().find(|p| p.is_file()).or_else(|| folder.is_dir().then_some(folder)).ok_or_else(|| {
                Error::Usage(format!(
                    "--images: {} holds no video {group}.mp4 (or .mov, .mkv, .avi, .webm) and no folder {group}",
                    images.display()
                ))
            })?;
        let options = OpenOptions { ffmpeg, ..OpenOptions::default() };
        let source = capture::open(&path, &options)?;
        Ok(Self { group, path, source, next: 0 })
    }

    /// Frame number `wanted`; earlier frames are passed over.
    fn at(&mut self, wanted: u64) -> Result<std::sync::Arc<image::RgbImage>, Error> {
        loop {
            let frame = self.source.next_frame()?.ok_or_else(|| Error::Content {
                path: self.path.clone(),
                message: format!("{} frames, expected frame {wanted} that the labels name", self.next),
            })?;
            self.next += 1;
            if frame.sequence == wanted {
                return Ok(frame.image);
            }
        }
    }
}
