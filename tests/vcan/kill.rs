//! `kill -9` of a host in mid-motion. `VCAN_KILLS` says how often (10).

use std::io::BufRead as _;
use std::process::Stdio;
use std::time::{Duration, Instant};

use can_driver::{
    Bus as _, Controller, ControllerOutput, ControllerParams, ControllerState, Event, Filter, JointLimits, JointState,
    Protocol, SocketCan, StopCause,
};

use crate::{Process, interface, peer, setting};

const LIMITS: JointLimits = JointLimits { min_rad: -2.0, max_rad: 2.0, velocity_rad_s: 1.0, acceleration_rad_s2: 4.0 };
const TICK: Duration = Duration::from_millis(1);

/// A controller with an ideal arm, in this thread, on the wall clock.
struct Arm {
    bus: SocketCan,
    controller: Controller,
    joints: Vec<JointState>,
    rx: Vec<Event>,
    start: Instant,
    out: Option<ControllerOutput>,
}

impl Arm {
    fn tick(&mut self) {
        self.bus.wait(TICK).unwrap();
        let now = self.start.elapsed();
        self.bus.drain(now, &mut self.rx).unwrap();
        let out = self.controller.tick(now, &self.rx, &self.joints);
        let _ = self.bus.transmit(now, &out.tx).unwrap();
        for (joint, s) in self.joints.iter_mut().zip(&out.setpoints) {
            *joint = JointState { position_rad: s.position_rad, velocity_rad_s: s.velocity_rad_s };
        }
        self.out = Some(out);
    }

    fn run(&mut self, time: Duration) {
        let end = self.start.elapsed() + time;
        while self.start.elapsed() < end {
            self.tick();
        }
    }

    fn speed_rad_s(&self) -> f64 {
        self.joints.iter().map(|j| j.velocity_rad_s.abs()).fold(0.0, f64::max)
    }

    fn state(&self) -> (ControllerState, Option<StopCause>) {
        self.out.as_ref().map_or((ControllerState::Unconfigured, None), |o| (o.state, o.cause))
    }
}

/// A host process that has made the arm move.
fn moving_host(arm: &mut Arm, name: &str, reset: bool) -> Process {
    let mut command = peer(&["host", name, "200", "60"]);
    if reset {
        command.arg("reset");
    }
    let mut host = Process::start(command.stdout(Stdio::piped()));
    let stdout = host.0.stdout.take().unwrap();
    let reader = std::thread::spawn(move || std::io::BufReader::new(stdout).lines().next());
    let give_up = Instant::now() + Duration::from_secs(15);
    while !reader.is_finished() {
        arm.tick();
        assert!(Instant::now() < give_up, "the host does not get active: {:?}", arm.state());
    }
    assert_eq!(reader.join().unwrap().unwrap().unwrap(), "active");
    host
}

#[test]
fn a_killed_host_leaves_an_arm_at_rest_in_time_that_nobody_but_an_operator_wakes() {
    let Some(name) = interface(5) else { return };
    let kills = setting("VCAN_KILLS", 10.0) as usize;
    let mut arm = Arm {
        bus: SocketCan::open(&name, Filter::Only(&Protocol::IDS), 65_536).unwrap(),
        controller: Controller::new(ControllerParams::standard(0, vec![LIMITS; 6])).unwrap(),
        joints: vec![JointState { position_rad: 0.25, velocity_rad_s: 0.0 }; 6],
        rx: Vec::with_capacity(256),
        start: Instant::now(),
        out: None,
    };
    let mut random = 0x2545_F491_4F6C_DD1D_u64;
    let (mut worst_margin_ms, mut moving) = (f64::INFINITY, 0);
    let (mut kill, mut self_stopped) = (0, 0);
    while kill < kills {
        let mut host = moving_host(&mut arm, &name, kill + self_stopped > 0);
        // xorshift (Marsaglia, 2003): a moment in the first 700 ms of motion.
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        arm.run(Duration::from_micros(20_000 + random % 700_000));
        if arm.state().0 != ControllerState::Active {
            // The machine held one of the processes up, and the link stopped by its own rules.
            self_stopped += 1;
            assert!(self_stopped <= 3 + kills / 2, "{:?}", arm.state());
            host.kill();
            arm.run(Duration::from_millis(500));
            continue;
        }
        let speed_rad_s = arm.speed_rad_s();
        moving += usize::from(speed_rad_s > 0.05);
        host.0.kill().unwrap();
        let killed = Instant::now();
        // Ramp time, braking time, a cycle of the host before it died, and two ticks.
        let allowed_s = 0.025 + speed_rad_s / LIMITS.acceleration_rad_s2 + 0.005 + 0.002;
        let (mut longest_tick_s, mut last) = (0.0_f64, Instant::now());
        while arm.speed_rad_s() > 2e-5 {
            arm.tick();
            longest_tick_s = longest_tick_s.max(last.elapsed().as_secs_f64());
            last = Instant::now();
            assert!(killed.elapsed() < Duration::from_secs(3), "never at rest");
        }
        let took_s = killed.elapsed().as_secs_f64();
        // A controller that the scheduler keeps waiting stops later by as much.
        let margin_s = allowed_s + (longest_tick_s - 0.002).max(0.0) - took_s;
        assert!(margin_s >= 0.0, "kill {kill}: {took_s} s, allowed {allowed_s} s, longest tick {longest_tick_s} s");
        worst_margin_ms = worst_margin_ms.min(margin_s * 1e3);
        host.kill();
        arm.run(Duration::from_millis(110));
        let (state, cause) = arm.state();
        assert_eq!(state, ControllerState::Latched);
        // No sets, or none that could act: on a machine that stood still the last ones have aged, or come after a gap.
        let expected = [
            StopCause::HostSilent,
            StopCause::StaleSetpoints,
            StopCause::WrongSequence,
            StopCause::IncompleteSets,
            StopCause::ControllerStalled,
        ];
        assert!(cause.is_some_and(|cause| expected.contains(&cause)), "{cause:?}");

        // A new process without an operator moves nothing.
        let rest = arm.joints.clone();
        let mut willing = Process::start(peer(&["host", &name, "200", "60"]).stdout(Stdio::null()));
        let end = Instant::now() + Duration::from_millis(if kill < 3 { 1500 } else { 150 });
        while Instant::now() < end && willing.0.try_wait().unwrap().is_none() {
            arm.tick();
        }
        willing.kill();
        arm.run(Duration::from_millis(20));
        assert_eq!(arm.joints, rest);
        assert_eq!(arm.state().0, ControllerState::Latched);
        kill += 1;
        if kill.is_multiple_of(100) {
            eprintln!("{kill} kills, least margin {worst_margin_ms:.2} ms, {self_stopped} runs had stopped before");
        }
    }
    eprintln!(
        "{kills} kills, {moving} of a moving arm, none restarted; least margin {worst_margin_ms:.2} ms; {self_stopped} \
         runs had stopped before"
    );
    assert!(moving * 2 >= kills, "{moving} of {kills}");
}
