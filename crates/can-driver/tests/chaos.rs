//! Both sessions on a bus that loses, doubles, garbles, delays and destroys frames, and a host
//! that dies at any moment: under everything the arm keeps its limits and stops in time.

#![expect(clippy::unwrap_used, reason = "tests")]

mod common;

use std::time::Duration;

use can_driver::{
    Bus as _, Command, Controller, ControllerOutput, ControllerParams, ControllerState, Event, Faults, HostOutput,
    HostParams, HostSession, HostState, JointLimits, JointState, SimBus, SimBusParams, SimNode,
};
use common::{CYCLE, LIMITS, TICK};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Room for rounding in the checks of velocity and acceleration.
const EPSILON: f64 = 1e-9;

struct Cell {
    now: Duration,
    bus: SimBus,
    host_node: SimNode,
    controller_node: SimNode,
    host: HostSession,
    controller: Controller,
    joints: Vec<JointState>,
    velocities_rad_s: Vec<f64>,
    /// When the host sent the set of each counter.
    sent_at: [Option<Duration>; 256],
    acted: u64,
    oldest: Duration,
    host_out: Option<HostOutput>,
    out: Option<ControllerOutput>,
    rx: Vec<Event>,
}

impl Cell {
    fn new(faults: Faults, seed: u64, queue: usize) -> Self {
        let bus = SimBus::new(SimBusParams { faults, seed, ..Default::default() }).unwrap();
        let (host_node, controller_node) = (bus.node(queue), bus.node(12));
        Self {
            now: Duration::from_millis(50),
            host_node,
            controller_node,
            bus,
            host: HostSession::new(HostParams::standard(0, vec![LIMITS; 6], CYCLE)).unwrap(),
            controller: Controller::new(ControllerParams::standard(0, vec![LIMITS; 6])).unwrap(),
            joints: vec![JointState { position_rad: 0.25, velocity_rad_s: 0.0 }; 6],
            velocities_rad_s: vec![0.0; 6],
            sent_at: [None; 256],
            acted: 0,
            oldest: Duration::ZERO,
            host_out: None,
            out: None,
            rx: Vec::with_capacity(256),
        }
    }

    fn state(&self) -> ControllerState {
        self.out.as_ref().map_or(ControllerState::Unconfigured, |o| o.state)
    }

    fn host_tick(&mut self, command: Command<'_>) {
        self.host_node.drain(self.now, &mut self.rx).unwrap();
        let out = self.host.tick(self.now, &self.rx, command);
        let outcome = self.host_node.transmit(self.now, &out.tx).unwrap();
        self.host.sent(outcome);
        if let Some(commit) = out.tx.iter().find(|f| f.id().raw() == 0x103) {
            self.sent_at[usize::from(commit.data()[5])] = Some(self.now);
        }
        self.host_out = Some(out);
    }

    /// One millisecond of the controller with every check.
    fn controller_tick(&mut self) {
        self.now += TICK;
        self.controller_node.drain(self.now, &mut self.rx).unwrap();
        let out = self.controller.tick(self.now, &self.rx, &self.joints);
        let _ = self.controller_node.transmit(self.now, &out.tx).unwrap();
        if let Some(acted) = out.acted {
            let age = self.sent_at[usize::from(acted.counter)].map(|sent| self.now.saturating_sub(sent)).unwrap();
            // One tick of 1 ms passes between arrival and use.
            assert!(age <= Duration::from_millis(12), "a set {age:?} old acts");
            self.oldest = self.oldest.max(age);
            self.acted += 1;
        }
        for ((joint, before), s) in self.joints.iter_mut().zip(&mut self.velocities_rad_s).zip(&out.setpoints) {
            let JointLimits { min_rad, max_rad, velocity_rad_s, acceleration_rad_s2 } = LIMITS;
            assert!(s.position_rad >= min_rad - EPSILON && s.position_rad <= max_rad + EPSILON, "{s:?}");
            assert!(s.velocity_rad_s.abs() <= velocity_rad_s + EPSILON, "{s:?}");
            let change = (s.velocity_rad_s - *before).abs();
            assert!(change <= acceleration_rad_s2 * TICK.as_secs_f64() + EPSILON + 2e-5, "{s:?} after {before}");
            assert!((s.position_rad - joint.position_rad).abs() <= velocity_rad_s * 1e-3 + EPSILON);
            *before = s.velocity_rad_s;
            *joint = JointState { position_rad: s.position_rad, velocity_rad_s: s.velocity_rad_s };
        }
        self.out = Some(out);
    }

    fn at_rest(&self) -> bool {
        self.joints.iter().all(|j| j.velocity_rad_s.abs() < 2e-5)
    }

    fn run(&mut self, time: Duration, mut command: impl FnMut(&Self) -> Option<Vec<f64>>) {
        let end = self.now + time;
        while self.now < end {
            if self.now.as_millis().is_multiple_of(CYCLE.as_millis()) {
                match command(self) {
                    Some(q) => self.host_tick(Command::Follow { position_rad: &q, speed_scale: 1.0 }),
                    None => self.host_tick(Command::Standby),
                }
            }
            self.controller_tick();
        }
    }

    /// A cell whose arm is active.
    fn active(seed: u64, queue: usize) -> Self {
        let mut cell = Self::new(Faults::default(), seed, queue);
        while cell.host_out.as_ref().is_none_or(|out| out.state != HostState::Active) {
            cell.run(CYCLE, |_| Some(vec![0.0; 6]));
            assert!(cell.now < Duration::from_secs(2), "{:?}", cell.host_out);
        }
        cell
    }

    /// Moves the arm on all joints; each has its own rate.
    fn swing(&mut self, time: Duration) {
        let mut start: Option<(Duration, Vec<f64>)> = None;
        self.run(time, |cell| {
            let out = cell.host_out.as_ref()?;
            if out.state != HostState::Active {
                start = None;
                return Some(vec![0.0; 6]);
            }
            let (since, from) = start.get_or_insert_with(|| (cell.now, out.commanded_rad.to_vec()));
            let t = cell.now.saturating_sub(*since).as_secs_f64();
            Some(from.iter().zip(1..).map(|(q, k)| q + 0.3 * (1.0 - (t * (1.0 + 0.2 * f64::from(k))).cos())).collect())
        });
    }
}

#[test]
fn under_any_faults_the_limits_hold_and_nothing_old_acts() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut active_runs = 0;
    for seed in 0..200 {
        let mut strength = |most: f64| if rng.random_bool(0.5) { 0.0 } else { rng.random::<f64>() * most };
        let faults = Faults {
            loss: strength(0.1),
            duplicate: strength(0.3),
            corrupt: strength(0.1),
            delay: strength(0.1),
            delay_max: Duration::from_millis(30),
            wire_error: strength(0.05),
        };
        let mut cell = Cell::active(seed, 4);
        cell.swing(Duration::from_millis(300));
        assert_eq!(cell.state(), ControllerState::Active);
        cell.bus.set_faults(faults);
        cell.swing(Duration::from_millis(1500));
        active_runs += u32::from(cell.state() == ControllerState::Active);
    }
    // The faults are neither all harmless nor all fatal.
    assert!((20..190).contains(&active_runs), "{active_runs}");
}

#[test]
fn a_host_killed_at_a_thousand_random_moments_leaves_an_arm_at_rest_in_time() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut moving = 0;
    for _ in 0..1000 {
        let mut cell = Cell::active(1, 4);
        cell.swing(Duration::from_millis(300) + Duration::from_millis(rng.random_range(0..600)));
        // Some die between the frames of a set: what is in the queue leaves, what is not does not.
        let speed_rad_s = cell.joints.iter().map(|j| j.velocity_rad_s.abs()).fold(0.0, f64::max);
        moving += u32::from(speed_rad_s > 0.1);
        let dead_at = cell.now;
        let allowed_s = 0.025 + speed_rad_s / LIMITS.acceleration_rad_s2 + CYCLE.as_secs_f64() + 0.002;
        while !cell.at_rest() {
            cell.controller_tick();
            let took_s = cell.now.saturating_sub(dead_at).as_secs_f64();
            assert!(took_s <= allowed_s, "{took_s} s of {allowed_s} s");
        }
        // A new process with a will of its own does not move it.
        cell.host = HostSession::new(HostParams::standard(0, vec![LIMITS; 6], CYCLE)).unwrap();
        cell.host_out = None;
        let rest: Vec<f64> = cell.joints.iter().map(|j| j.position_rad).collect();
        cell.run(Duration::from_millis(400), |_| Some(vec![1.0; 6]));
        assert_eq!(cell.state(), ControllerState::Latched);
        let after: Vec<f64> = cell.joints.iter().map(|j| j.position_rad).collect();
        assert_eq!(rest, after);
    }
    assert!(moving > 500, "{moving}");
}

#[test]
fn nothing_older_than_10_ms_acts_after_a_bus_stall_however_deep_the_queue() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for queue in [4, 8, 64] {
        for _ in 0..60 {
            let mut cell = Cell::active(1, queue);
            cell.swing(Duration::from_millis(300) + Duration::from_millis(rng.random_range(0..300)));
            let stall = Duration::from_millis(rng.random_range(1..150));
            cell.bus.stall(cell.now, cell.now + stall);
            cell.swing(Duration::from_millis(400));
            assert!(cell.acted > 10);
            if stall > Duration::from_millis(105) {
                assert_eq!(cell.state(), ControllerState::Latched, "{stall:?}");
            }
        }
    }
}

#[test]
fn a_controller_that_loses_power_comes_back_to_an_idle_arm() {
    let mut cell = Cell::active(1, 4);
    cell.swing(Duration::from_millis(500));
    cell.controller_node.set_power(cell.now, false);
    for _ in 0..200 {
        cell.now += TICK;
        if cell.now.as_millis().is_multiple_of(CYCLE.as_millis()) {
            cell.host_tick(Command::Standby);
        }
    }
    assert_eq!(cell.host_out.as_ref().unwrap().state, HostState::Stopped);
    cell.controller_node.set_power(cell.now, true);
    cell.controller = Controller::new(ControllerParams::standard(0, vec![LIMITS; 6])).unwrap();
    for joint in &mut cell.joints {
        joint.velocity_rad_s = 0.0;
    }
    cell.velocities_rad_s.fill(0.0);
    let acted = cell.acted;
    cell.run(Duration::from_millis(500), |_| Some(vec![1.0; 6]));
    assert_eq!(cell.acted, acted);
}

#[test]
fn a_bus_off_host_is_stopped_by_both_sides() {
    let mut cell = Cell::active(1, 4);
    cell.swing(Duration::from_millis(500));
    cell.bus.set_faults(Faults { wire_error: 1.0, ..Faults::default() });
    cell.swing(Duration::from_millis(300));
    assert_eq!(cell.state(), ControllerState::Latched);
    assert_eq!(cell.host_out.as_ref().unwrap().state, HostState::Stopped);
    assert!(cell.at_rest());
    let fault_seen = cell.host_node.receive(cell.now).is_ok();
    assert!(fault_seen);
}
