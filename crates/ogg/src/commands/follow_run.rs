//! `ogg follow run`: a recording once. Look at every picture, learn, then follow in the time of the recording.
//!
//! The second half knows no clock: the same samples give the same setpoints, bit for bit. The robot gets
//! [`LEAD`] before the recording starts, to align itself with the first pose; all times in the recording are after it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use can_driver::LocalBus;
use follow::{ArmSample, JointPlan, MotionModel, Phase};

use super::{options, say};
use crate::brain::{Action, Follower};
use crate::cell::Cell;
use crate::cli::FollowArgs;
use crate::compare::Comparator;
use crate::config::{Bus, Source};
use crate::error::Error;
use crate::journal::Journal;
use crate::link::{Link, Wish};
use crate::plant::Plant;
use crate::progress::Progress;
use crate::record::{Level, Recorder};
use crate::reference::Reference as ReferenceTrack;
use crate::summary::{Latencies, Reference, Summary};

/// Time for the robot to align with the first pose before the recording starts.
const LEAD: Duration = Duration::from_secs(6);
/// How long a synthetic worker is recorded where `--duration` does not say.
const WORKER_LENGTH: Duration = Duration::from_secs(12);
/// Time between two plans while the robot aligns.
const LEAD_PLAN: Duration = Duration::from_millis(30);
/// Every how many ticks the links' poses are recorded.
const TICKS_PER_FRAMES: u32 = 4;
/// Frames that an end of the bus holds.
const BUS_FRAMES: usize = 256;

pub(super) fn run(args: &FollowArgs) -> Result<(), Error> {
    let config = options::resolve(args)?;
    if matches!(config.bus, Bus::Socketcan { .. }) {
        return Err(Error::Usage(
            "follow run works in the time of the recording, with the simulated arm; a real bus needs follow daemon"
                .into(),
        ));
    }
    let cell = Cell::open(config)?;
    let reference =
        args.reference.as_deref().map(|path| ReferenceTrack::read(path, cell.config.worker.side)).transpose()?;
    let known = args.motion_model.as_deref().map(read_model).transpose()?;
    let length = match args.duration {
        Some(seconds) => options::duration("--duration", seconds)?,
        None => WORKER_LENGTH,
    };
    let mut pictures = cell.pictures(Some(length), None)?;
    let mut vision = cell.vision()?;

    let start_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos() as u64);
    let path = recording_path(&cell.config.record.folder, "run")?;
    let recorder = Recorder::create(&path, cell.recorder_options(start_ns), &cell.run_info(&vision.describe()))?;
    let journal = Journal::new(recorder.sink(), &cell);
    journal.cameras(Duration::ZERO, cell.lift.cameras());

    let mut latencies = Latencies::default();
    let mut samples: Vec<ArmSample> = Vec::new();
    let mut progress = Progress::new("looking at the recording", pictures.expected_sets());
    let limit = (args.duration.is_some() || matches!(cell.config.source, Source::Worker { .. })).then_some(length);
    loop {
        let started = Instant::now();
        let Some(set) = pictures.next_set()? else { break };
        latencies.add("capture", started.elapsed());
        if limit.is_some_and(|limit| set.captured > limit) {
            break;
        }
        let seen = vision.see(&set, &mut latencies)?;
        journal.seen(LEAD + set.captured, &set, &seen);
        samples.push(seen.sample);
        progress.set(samples.len() as u64);
        recorder.sink().wait_for_room();
    }
    let complete = samples.iter().filter(|sample| sample.is_complete()).count();
    progress.finish(&format!("{} frames, the whole arm in {complete}", samples.len()));
    if let Some(mismatch) = pictures.mismatch() {
        say(format_args!("views       {mismatch}"));
    }

    let mut action = match known {
        Some(model) => Action::known(model, &cell),
        None => Action::learn(&samples, &cell)?,
    };
    let model_path = args.save_motion_model.clone().unwrap_or_else(|| path.with_extension("model.json"));
    if args.motion_model.is_none() {
        write(&model_path, &action.model.to_json(), "a place to write the motion model")?;
    }

    let mut follower = Follower::new(&cell, action.model.clone())?;
    let replay = replay(&cell, &samples, &mut follower, &journal, &mut latencies)?;
    action.learned.matched_share = follower.matched_share();
    let distances = reference.as_ref().map_or_else(Vec::new, |track| track.distances_m(&samples));
    if let (Some(track), true) = (&reference, distances.is_empty()) {
        return Err(Error::Content {
            path: track.path().to_path_buf(),
            message: "no row falls into the time of the recording while the wrist was seen".into(),
        });
    }
    let status = recorder.finish()?;
    if status.dropped_images + status.dropped_samples > 0 {
        say(format_args!(
            "recording   {} pictures and {} samples given up",
            status.dropped_images, status.dropped_samples
        ));
    }
    let summary = Summary {
        frames: samples.len() as u64,
        dropped: pictures.counts().iter().map(|count| count.skipped).sum(),
        complete_samples: complete as u64,
        latency_ms: latencies.spread(),
        tracking: replay.comparator.sums().figures(),
        reference: Reference::of(&distances),
        learned: Some(action.learned),
        stops: replay.stops,
        pose: vision.describe(),
        recording: Some(path),
    };
    finish(&summary, args.summary.as_deref())
}

/// Prints the summary, and writes it where asked.
pub(super) fn finish(summary: &Summary, file: Option<&Path>) -> Result<(), Error> {
    say(summary);
    match file {
        Some(path) => {
            let json = serde_json::to_string_pretty(summary)
                .map_err(|e| Error::Content { path: path.to_path_buf(), message: e.to_string() })?;
            write(path, &json, "a place to write the summary")
        }
        None => Ok(()),
    }
}

pub(super) fn write(path: &Path, text: &str, expected: &'static str) -> Result<(), Error> {
    std::fs::write(path, text).map_err(|source| Error::File { path: path.to_path_buf(), expected, source })
}

pub(super) fn read_model(path: &Path) -> Result<MotionModel, Error> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::File {
        path: path.to_path_buf(),
        expected: "a motion model written by this program",
        source,
    })?;
    MotionModel::from_json(&text).map_err(|e| Error::Content { path: path.to_path_buf(), message: e.to_string() })
}

/// `folder/kind-YYYYMMDD-HHMMSS.mcap`, in UTC; a number is added where that exists.
pub(super) fn recording_path(folder: &Path, kind: &str) -> Result<PathBuf, Error> {
    std::fs::create_dir_all(folder).map_err(|source| Error::File {
        path: folder.to_path_buf(),
        expected: "a folder for recordings",
        source,
    })?;
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let name = format!("{kind}-{}", crate::civil::utc(seconds));
    let mut path = folder.join(format!("{name}.mcap"));
    let mut number = 2;
    while path.exists() {
        path = folder.join(format!("{name}-{number}.mcap"));
        number += 1;
    }
    Ok(path)
}

struct Replay {
    comparator: Comparator,
    stops: BTreeMap<String, u64>,
}

/// The robot's half: bus, controller and plant in the time of the recording.
fn replay(
    cell: &Cell,
    samples: &[ArmSample],
    follower: &mut Follower,
    journal: &Journal,
    latencies: &mut Latencies,
) -> Result<Replay, Error> {
    let bus = LocalBus::new(BUS_FRAMES);
    let mut plant = Plant::new(cell, bus.endpoint())?;
    let mut link = Link::new(bus.endpoint(), cell.host(), cell.control(), cell.feedback_limit())?;
    let latency = Duration::from_nanos((cell.config.control.offline_latency_ms * 1e6) as u64);
    let period = cell.period();
    let home = &cell.config.robot.home_rad;
    let mut result = Replay { comparator: Comparator::new(home), stops: BTreeMap::new() };
    let first =
        samples.iter().find(|sample| sample.shoulder.is_some() && sample.elbow.is_some() && sample.wrist.is_some());
    let Some(first) = first.copied() else { return Ok(result) };
    let end = LEAD + samples.last().map_or(Duration::ZERO, |sample| sample.captured) + latency;

    let mut plan: Option<JointPlan> = None;
    let mut next_lead_plan = Duration::ZERO;
    let mut seen = 0;
    let mut compared = 0;
    let mut phase = Phase::Waiting;
    let mut now = Duration::ZERO;
    let mut ticks = 0u32;
    while now <= end {
        if now < LEAD && now >= next_lead_plan {
            let first = ArmSample { captured: Duration::ZERO, ..first };
            plan = follower.rest_at(&first, now)?;
            next_lead_plan += LEAD_PLAN;
        }
        while let Some(sample) = samples.get(seen).filter(|sample| LEAD + sample.captured + latency <= now) {
            let shifted = ArmSample { captured: LEAD + sample.captured, ..*sample };
            if let Some(next) = follower.follow(&shifted, latencies)? {
                journal.plan(now, &next);
                plan = Some(next);
            }
            seen += 1;
        }
        plant.advance_to(now)?;
        let started = Instant::now();
        let tick = link.tick(now, plan.as_ref(), Wish { follow: true, ..Wish::default() })?;
        latencies.add("control", started.elapsed());
        journal.tick(now, &tick, ticks.is_multiple_of(TICKS_PER_FRAMES));
        if tick.phase != phase {
            phase = tick.phase;
            journal.log(now, Level::Info, &format!("control: {phase:?}"));
            if let Phase::Braking(_) | Phase::Stopped(_) = phase {
                *result.stops.entry(format!("{phase:?}")).or_insert(0) += 1;
            }
        }
        if let Some((at, joints)) = tick.measured {
            result.comparator.measure(at, joints, tick.phase == Phase::Following);
        }
        // Pictures whose time the measurements have passed.
        while let Some(sample) = samples.get(compared).filter(|sample| LEAD + sample.captured + period * 4 <= now) {
            let shifted = ArmSample { captured: LEAD + sample.captured, ..*sample };
            result.comparator.compare(&shifted, follower.retargeter());
            compared += 1;
        }
        now += period;
        ticks += 1;
    }
    Ok(result)
}
