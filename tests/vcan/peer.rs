//! The processes of the vcan tests: a host that follows a sine, a controller with an ideal arm, and
//! an echo.
//!
//! `vcan-peer host IFACE RATE_HZ SECONDS [reset | Q1,Q2,...]` prints `active` when the arm follows and
//! a JSON report at its end; it resets a latched controller first, or works within 0.3 rad of the angles given; `vcan-peer controller IFACE SECONDS` runs at 1 kHz; `vcan-peer echo IFACE
//! SECONDS` answers every frame with the next identifier.

use std::error::Error;
use std::io::Write as _;
use std::time::{Duration, Instant};

use can_driver::{
    Bus as _, Command, Controller, ControllerParams, Event, Filter, Frame, HostParams, HostSession, HostState, Id,
    JointLimits, JointState, Protocol, SendOutcome, SocketCan, StopCause,
};
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike as _;

const LIMITS: JointLimits = JointLimits { min_rad: -2.0, max_rad: 2.0, velocity_rad_s: 1.0, acceleration_rad_s2: 4.0 };

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["host", interface, rate_hz, seconds] => host(interface, rate_hz.parse()?, seconds.parse()?, false, &wide()),
        ["host", interface, rate_hz, seconds, "reset"] => {
            host(interface, rate_hz.parse()?, seconds.parse()?, true, &wide())
        }
        ["host", interface, rate_hz, seconds, centre] => {
            let centre = centre.split(',').map(str::parse).collect::<Result<Vec<f64>, _>>()?;
            let limits: Vec<JointLimits> = centre
                .iter()
                .map(|q| JointLimits {
                    min_rad: q - 0.3,
                    max_rad: q + 0.3,
                    velocity_rad_s: 0.5,
                    acceleration_rad_s2: 2.0,
                })
                .collect();
            host(interface, rate_hz.parse()?, seconds.parse()?, false, &limits)
        }
        ["controller", interface, seconds] => controller(interface, seconds.parse()?),
        ["echo", interface, seconds] => echo(interface, seconds.parse()?),
        _ => Err("usage: vcan-peer host IFACE RATE_HZ SECONDS [reset] | controller IFACE SECONDS | echo IFACE SECONDS"
            .into()),
    }
}

/// A line of the report. A reader that has gone away is no failure.
fn report(line: impl std::fmt::Display) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// Processor time of this thread, and how often the scheduler took the processor away from it.
fn usage() -> Result<(Duration, i64), nix::Error> {
    let usage = getrusage(UsageWho::RUSAGE_THREAD)?;
    let time = |t: nix::sys::time::TimeVal| Duration::from_micros(t.num_microseconds().unsigned_abs());
    Ok((time(usage.user_time()) + time(usage.system_time()), usage.involuntary_context_switches()))
}

/// Lateness of wake-ups of an active host, in steps of 50 us up to 5 ms.
struct Histogram {
    counts: [u64; 101],
    /// Before it was active, too.
    worst: Duration,
}

impl Histogram {
    fn add(&mut self, late: Duration) {
        let step = usize::try_from(late.as_micros() / 50).unwrap_or(100).min(100);
        self.counts[step] += 1;
    }

    fn quantile_us(&self, share: f64) -> u64 {
        let total: u64 = self.counts.iter().sum();
        let mut seen = 0;
        for (step, count) in self.counts.iter().enumerate() {
            seen += count;
            if seen as f64 >= share * total as f64 {
                return 50 * (step as u64 + 1);
            }
        }
        5050
    }
}

fn wide() -> Vec<JointLimits> {
    vec![LIMITS; 6]
}

fn host(
    interface: &str,
    rate_hz: u32,
    seconds: f64,
    reset: bool,
    limits: &[JointLimits],
) -> Result<(), Box<dyn Error>> {
    // Half the way to a limit, at 0.6 of the velocity.
    let reach_rad = limits.iter().map(|l| (l.max_rad - l.min_rad) / 4.0).fold(0.6, f64::min);
    let rate_rad_s = limits.iter().map(|l| l.velocity_rad_s).fold(1.0, f64::min) * 0.6 / (reach_rad / 2.0);
    let cycle = Duration::from_secs(1) / rate_hz;
    let mut bus = SocketCan::open(interface, Filter::Only(&Protocol::IDS), 4096)?;
    // A hypervisor may hold the whole guest up for tens of milliseconds, which would end a session on its standard 25 ms.
    let params =
        HostParams { silent_after: Duration::from_millis(100), ..HostParams::standard(0, limits.to_vec(), cycle) };
    let mut session = HostSession::new(params)?;
    let mut rx: Vec<Event> = Vec::with_capacity(256);
    let mut histogram = Histogram { counts: [0; 101], worst: Duration::ZERO };
    let (mut longest_work, mut whole_work) = (Duration::ZERO, Duration::ZERO);
    let (mut late_wakes, mut slow_cycles, mut held_up, mut cycles) = (0_u64, 0_u64, 0_u64, 0_u64);
    let mut wanted: Vec<f64> = Vec::with_capacity(6);
    let mut active: Option<Duration> = None;
    let mut before_active: Option<Vec<f64>> = None;
    // A machine that stands still can end a session that has only begun: the operator presses again.
    let mut resets_left = if reset { 5 } else { 0 };
    let mut switches = usage()?.1;
    let start = Instant::now();
    let mut due = cycle;
    let last_out = loop {
        let wait = due.saturating_sub(start.elapsed());
        if wait > Duration::ZERO {
            std::thread::sleep(wait);
        }
        let now = start.elapsed();
        let late = now.saturating_sub(due);
        histogram.worst = histogram.worst.max(late);
        // A cycle that was slept through is left out, never caught up with.
        let skipped = late.as_nanos() / cycle.as_nanos();
        due += cycle * (u32::try_from(skipped).unwrap_or(u32::MAX - 1) + 1);

        bus.drain(now, &mut rx)?;
        if let Some(since) = active {
            let t = now.saturating_sub(since).as_secs_f64();
            for (w, from) in wanted.iter_mut().zip(before_active.iter().flatten()) {
                // Towards zero and back, so that runs in a row stay inside the limits.
                *w = from - from.signum() * reach_rad / 2.0 * (1.0 - (rate_rad_s * t).cos());
            }
        }
        let out = session.tick(now, &rx, Command::Follow { position_rad: &wanted, speed_scale: 1.0 });
        session.sent(bus.transmit(now, &out.tx)?);
        match out.state {
            HostState::Active if active.is_none() => {
                active = Some(now);
                wanted = out.commanded_rad.to_vec();
                before_active = Some(wanted.clone());
                report("active");
            }
            HostState::Stopped if active.is_none() && resets_left > 0 => {
                resets_left -= 1;
                session.reset()?;
            }
            HostState::Stopped if !reset || active.is_some() => {
                break out;
            }
            _ => {}
        }
        if let Some(since) = active {
            cycles += 1;
            histogram.add(late);
            late_wakes += u64::from(late >= cycle);
            let work = start.elapsed().saturating_sub(now);
            whole_work += work;
            let before = std::mem::replace(&mut switches, usage()?.1);
            let undisturbed = switches == before;
            slow_cycles += u64::from(work >= cycle && undisturbed);
            held_up += u64::from(work >= cycle && !undisturbed);
            if undisturbed {
                longest_work = longest_work.max(work);
            }
            if now.saturating_sub(since).as_secs_f64() >= seconds {
                break out;
            }
        } else if now > Duration::from_secs(8) {
            break out;
        }
    };
    // An orderly end: brakes on, not latched.
    let end = start.elapsed() + Duration::from_millis(800);
    while active.is_some() && start.elapsed() < end {
        std::thread::sleep(cycle);
        let now = start.elapsed();
        bus.drain(now, &mut rx)?;
        let out = session.tick(now, &rx, Command::Standby);
        let _ = bus.transmit(now, &out.tx)?;
        if matches!(out.state, HostState::Ready | HostState::Stopped) {
            break;
        }
    }
    let link = session.link();
    let (state, cause) = (last_out.state, last_out.cause);
    report(serde_json::json!({
        "state": format!("{state:?}"), "cause": cause.map(StopCause::code), "cause_text": cause.map(|c| c.to_string()),
        "cycles": cycles, "late_wakes": late_wakes, "slow_cycles": slow_cycles, "held_up": held_up,
        "processor_us_per_cycle": usage()?.0.as_secs_f64() * 1e6 / (link.sets_sent.max(1) as f64),
        "work_us_per_cycle": whole_work.as_secs_f64() * 1e6 / (cycles.max(1) as f64),
        "longest_work_us": longest_work.as_micros() as u64,
        "wake_late_us": {"p50": histogram.quantile_us(0.5), "p99": histogram.quantile_us(0.99),
            "p999": histogram.quantile_us(0.999), "max": histogram.worst.as_micros() as u64},
        "histogram_50us": histogram.counts.to_vec(),
        "sets_sent": link.sets_sent, "sets_echoed": link.sets_echoed, "sets_unechoed": link.sets_unechoed,
        "status_received": link.status_received, "status_lost": link.status_lost,
        "feedback_incomplete": link.feedback_incomplete, "corrupt_frames": link.corrupt_frames,
        "transmit_full": link.transmit_full,
        "round_trip_us": {"min": link.round_trip_min.map(|d| d.as_micros() as u64),
            "mean": link.round_trip_mean().map(|d| d.as_micros() as u64),
            "max": link.round_trip_max.map(|d| d.as_micros() as u64)},
        "implausible_stamps": bus.counts().implausible_stamps,
    }));
    Ok(())
}

fn controller(interface: &str, seconds: f64) -> Result<(), Box<dyn Error>> {
    let tick = Duration::from_millis(1);
    let mut bus = SocketCan::open(interface, Filter::Only(&Protocol::IDS), 16_384)?;
    let mut controller = Controller::new(ControllerParams::standard(0, vec![LIMITS; 6]))?;
    let mut joints = vec![JointState { position_rad: 0.25, velocity_rad_s: 0.0 }; 6];
    let mut rx: Vec<Event> = Vec::with_capacity(256);
    let start = Instant::now();
    let mut due = tick;
    let mut now = Duration::ZERO;
    while now.as_secs_f64() < seconds {
        std::thread::sleep(due.saturating_sub(start.elapsed()));
        now = start.elapsed();
        due = now + tick;
        bus.drain(now, &mut rx)?;
        let out = controller.tick(now, &rx, &joints);
        let _ = bus.transmit(now, &out.tx)?;
        for (joint, s) in joints.iter_mut().zip(&out.setpoints) {
            *joint = JointState { position_rad: s.position_rad, velocity_rad_s: s.velocity_rad_s };
        }
    }
    let counts = controller.counts();
    report(serde_json::json!({"accepted": counts.accepted, "lost": counts.lost, "incomplete": counts.incomplete,
            "stale": counts.stale, "step_too_large": counts.step_too_large, "corrupt_frames": counts.corrupt_frames}));
    Ok(())
}

/// Answers identifier n with n + 1.
fn echo(interface: &str, seconds: f64) -> Result<(), Box<dyn Error>> {
    let mut bus = SocketCan::open(interface, Filter::Only(&[Id::new(0x500).ok_or("id")?]), 65_536)?;
    let reply = Id::new(0x501).ok_or("id")?;
    let start = Instant::now();
    report("ready");
    while start.elapsed().as_secs_f64() < seconds {
        bus.wait(Duration::from_millis(50))?;
        let now = start.elapsed();
        while let Some(event) = bus.receive(now)? {
            if let Event::Frame(stamped) = event {
                while bus.send(now, &Frame::new(reply, stamped.frame.data())?)? == SendOutcome::Full {}
            }
        }
    }
    Ok(())
}
