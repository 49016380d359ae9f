//! `ogg follow daemon`: live. Teach, learn, follow, and keep following until stopped.
//!
//! One thread each for capture, vision, control, plant and recording; this one talks to the terminal and takes signals.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use can_driver::{Filter, LocalBus, Protocol, SocketCan};

use super::follow_run::{finish, read_model, recording_path, write};
use super::{options, say};
use crate::brain::Action;
use crate::capture::{Capture, Pace};
use crate::cell::Cell;
use crate::cli::FollowArgs;
use crate::config::Bus;
use crate::error::Error;
use crate::journal::Journal;
use crate::link::Link;
use crate::live::{self, ControlReport, Shared, VisionReport};
use crate::plant::Plant;
use crate::record::Recorder;
use crate::summary::{Reference, Summary};

/// Time between two lines of the terminal.
const LINE: Duration = Duration::from_secs(1);
/// Longest time for the arm to come to rest after a signal.
const REST_WITHIN: Duration = Duration::from_secs(3);
/// One cycle of four frames may wait for sending; an older one is worth less than none.
const HOST_BUFFER_BYTES: u32 = 4096;
/// Frames that an end of the in-process bus holds.
const BUS_FRAMES: usize = 1024;

pub(super) fn run(args: &FollowArgs) -> Result<(), Error> {
    let config = options::resolve(args)?;
    if args.reference.is_some() {
        return Err(Error::Usage("--reference compares a recording; use follow run".into()));
    }
    let limit = args.duration.map(|seconds| options::duration("--duration", seconds)).transpose()?;
    let cell = Cell::open(config)?;
    let known = args.motion_model.as_deref().map(read_model).transpose()?.map(|model| Action::known(model, &cell));
    let epoch = Instant::now();
    let pictures = cell.pictures(None, Some(epoch))?;
    let vision = cell.vision()?;
    cell.retargeter([0.0; follow::DIMENSION], 0.0)?;
    let describe = vision.describe();
    let names: Vec<String> = pictures.infos().map(|info| info.name.clone()).collect();

    let stopping = Arc::new(live::Stopping::default());
    let handler = Arc::clone(&stopping);
    ctrlc::set_handler(move || handler.signal())
        .map_err(|e| Error::Usage(format!("signals cannot be handled: {e}")))?;

    let cell = Arc::new(cell);
    let shared = Arc::new(Shared::new(known.is_some()));
    signal_hook::flag::register(signal_hook::consts::SIGUSR1, Arc::clone(&shared.reset))
        .map_err(|e| Error::Usage(format!("signals cannot be handled: {e}")))?;

    let start_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos() as u64);
    let path = recording_path(&cell.config.record.folder, "daemon")?;
    let recorder = Recorder::create(&path, cell.recorder_options(start_ns), &cell.run_info(&describe))?;
    let journal = Journal::new(recorder.sink(), &cell);
    journal.cameras(Duration::ZERO, cell.lift.cameras());

    say(format_args!("source      {}", names.join(", ")));
    say(format_args!("pose        {describe}"));
    let arm = match &cell.config.bus {
        Bus::InProcess {} => "simulated, on an in-process bus".to_owned(),
        Bus::Socketcan { interface } => format!("on {interface}"),
    };
    say(format_args!("robot       {}, {arm}, {} setpoints a second", cell.robot.name(), cell.config.control.rate_hz));
    say(format_args!("recording   {}", path.display()));
    say("Ctrl-C stops. No safety rating is claimed.");

    let (measured_tx, measured_rx) = crossbeam_channel::bounded(4096);
    let capture = Capture::spawn(pictures, epoch, Pace::AsRecorded { speed: 1.0 })?;

    let result = std::thread::scope(|scope| -> Result<(ControlReport, VisionReport), Error> {
        let control = match &cell.config.bus {
            Bus::InProcess {} => {
                let bus = LocalBus::new(BUS_FRAMES);
                let plant = Plant::new(&cell, bus.endpoint())?;
                let link = Link::new(bus.endpoint(), cell.host(), cell.control(), cell.feedback_limit())?;
                let for_plant = Arc::clone(&shared);
                spawn(scope, "plant", move || live::plant(plant, &for_plant, epoch))?;
                let (cell, shared, journal) = (Arc::clone(&cell), Arc::clone(&shared), journal.clone());
                spawn(scope, "control", move || live::control(link, &cell, &shared, &journal, &measured_tx, epoch))?
            }
            Bus::Socketcan { interface } => {
                let bus = SocketCan::open(interface, Filter::Only(&Protocol::IDS), HOST_BUFFER_BYTES)?;
                let link = Link::new(bus, cell.host(), cell.control(), cell.feedback_limit())?;
                let (cell, shared, journal) = (Arc::clone(&cell), Arc::clone(&shared), journal.clone());
                spawn(scope, "control", move || live::control(link, &cell, &shared, &journal, &measured_tx, epoch))?
            }
        };
        let seeing = {
            let (cell, shared, journal) = (Arc::clone(&cell), Arc::clone(&shared), journal.clone());
            let latest = capture.latest();
            spawn(scope, "vision", move || {
                live::vision(vision, latest, known, &cell, &shared, &journal, &measured_rx, epoch)
            })?
        };

        let mut next_line = epoch + LINE;
        let mut asked_to_rest = None;
        loop {
            std::thread::sleep(Duration::from_millis(20));
            let over = stopping.asked()
                || limit.is_some_and(|limit| epoch.elapsed() >= limit)
                || seeing.is_finished()
                || control.is_finished();
            if over && asked_to_rest.is_none() {
                say("stopping    the arm comes to rest");
                shared.follow.store(false, Relaxed);
                asked_to_rest = Some(Instant::now());
            }
            let rested = |since: Instant| shared.parked.load(Relaxed) || since.elapsed() > REST_WITHIN;
            if asked_to_rest.is_some_and(rested) || stopping.twice() || control.is_finished() {
                break;
            }
            for line in shared.take_lines() {
                say(line);
            }
            if Instant::now() >= next_line && asked_to_rest.is_none() {
                say(shared.line(epoch.elapsed()));
                next_line += LINE;
            }
        }
        shared.stop.store(true, Relaxed);
        capture.stop();
        let seen = joined(seeing, "vision")?;
        let controlled = joined(control, "control")?;
        Ok((controlled?, seen?))
    });
    shared.stop.store(true, Relaxed);
    let stats = capture.stats();
    let status = recorder.finish();
    let (controlled, seen) = result?;
    let status = status?;
    if status.dropped_images + status.dropped_samples > 0 {
        say(format_args!(
            "recording   {} pictures and {} samples given up",
            status.dropped_images, status.dropped_samples
        ));
    }
    if let Some(action) = seen.action.as_ref().filter(|_| args.motion_model.is_none()) {
        let model_path = args.save_motion_model.clone().unwrap_or_else(|| path.with_extension("model.json"));
        write(&model_path, &action.model.to_json(), "a place to write the motion model")?;
    }
    let mut latencies = seen.latencies;
    latencies.merge(&controlled.latencies);
    let summary = Summary {
        frames: seen.frames,
        dropped: stats.dropped,
        complete_samples: seen.complete,
        latency_ms: latencies.spread(),
        tracking: seen.tracking,
        reference: Reference::of(&[]),
        learned: seen.action.map(|action| action.learned),
        stops: controlled.stops,
        pose: describe,
        recording: Some(path),
    };
    finish(&summary, args.summary.as_deref().map(Path::new))
}

fn spawn<'scope, T: Send + 'scope>(
    scope: &'scope std::thread::Scope<'scope, '_>,
    name: &'static str,
    work: impl FnOnce() -> T + Send + 'scope,
) -> Result<std::thread::ScopedJoinHandle<'scope, T>, Error> {
    std::thread::Builder::new()
        .name(name.to_owned())
        .spawn_scoped(scope, work)
        .map_err(|e| Error::Thread { thread: name, message: e.to_string() })
}

fn joined<T>(handle: std::thread::ScopedJoinHandle<'_, T>, thread: &'static str) -> Result<T, Error> {
    handle.join().map_err(|_| Error::Thread { thread, message: "it panicked; this is a bug".to_owned() })
}
