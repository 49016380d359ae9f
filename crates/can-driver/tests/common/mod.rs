//! A host and a controller with an ideal arm on ideal wires, in virtual time.

#![allow(dead_code, unreachable_pub, reason = "each test file uses its part")]
#![allow(missing_debug_implementations, reason = "tests")]

use std::time::Duration;

use can_driver::{
    Command, Controller, ControllerOutput, ControllerParams, ControllerState, Event, HostOutput, HostParams,
    HostSession, HostState, JointLimits, JointState, Message, Protocol,
};

pub const CYCLE: Duration = Duration::from_millis(5);
pub const TICK: Duration = Duration::from_millis(1);
pub const LIMITS: JointLimits =
    JointLimits { min_rad: -2.0, max_rad: 2.0, velocity_rad_s: 1.0, acceleration_rad_s2: 4.0 };

/// Changes messages on their way, with a right checksum.
pub fn forge(rx: &mut [Event], change: impl Fn(&mut Message)) {
    let protocol = Protocol::new(0).unwrap();
    for event in rx {
        let Event::Frame(stamped) = event else { continue };
        let Ok(Some(mut counted)) = protocol.decode(&stamped.frame) else { continue };
        change(&mut counted.message);
        stamped.frame = protocol.encode(&counted);
    }
}

pub struct Rig {
    pub now: Duration,
    pub host: HostSession,
    pub controller: Controller,
    pub joints: Vec<JointState>,
    pub host_out: Option<HostOutput>,
    pub controller_out: Option<ControllerOutput>,
    to_host: Vec<Event>,
    to_controller: Vec<Event>,
    pub host_alive: bool,
    pub controller_alive: bool,
}

impl Rig {
    pub fn new(joints: usize) -> Self {
        Self::with(HostParams::standard(0, vec![LIMITS; joints], CYCLE), joints)
    }

    pub fn with(params: HostParams, joints: usize) -> Self {
        Self {
            now: Duration::from_millis(100),
            host: HostSession::new(params).unwrap(),
            controller: Controller::new(ControllerParams::standard(0, vec![LIMITS; joints])).unwrap(),
            joints: vec![JointState { position_rad: 0.25, velocity_rad_s: 0.0 }; joints],
            host_out: None,
            controller_out: None,
            to_host: Vec::new(),
            to_controller: Vec::new(),
            host_alive: true,
            controller_alive: true,
        }
    }

    /// One millisecond: the host every fifth, the controller every one. `wire` may change or
    /// take away what is on its way to the controller.
    pub fn step(&mut self, command: Command<'_>, wire: &mut dyn FnMut(&mut Vec<Event>)) {
        self.step_over(command, wire, &mut |_| {});
    }

    /// The same; `back` may change or take away what the controller sends.
    pub fn step_over(
        &mut self,
        command: Command<'_>,
        wire: &mut dyn FnMut(&mut Vec<Event>),
        back: &mut dyn FnMut(&mut Vec<Event>),
    ) {
        self.now += TICK;
        if self.host_alive && self.now.as_millis().is_multiple_of(CYCLE.as_millis()) {
            let rx = std::mem::take(&mut self.to_host);
            let out = self.host.tick(self.now, &rx, command);
            self.to_controller.extend(out.tx.iter().map(|f| Event::frame(self.now, *f)));
            self.host_out = Some(out);
        }
        if self.controller_alive {
            let mut rx = std::mem::take(&mut self.to_controller);
            wire(&mut rx);
            let out = self.controller.tick(self.now, &rx, &self.joints);
            let mut sent: Vec<Event> = out.tx.iter().map(|f| Event::frame(self.now, *f)).collect();
            back(&mut sent);
            self.to_host.extend(sent);
            for (joint, setpoint) in self.joints.iter_mut().zip(&out.setpoints) {
                *joint = JointState { position_rad: setpoint.position_rad, velocity_rad_s: setpoint.velocity_rad_s };
            }
            self.controller_out = Some(out);
        }
    }

    /// A new process takes the place of the old host.
    pub fn replace_host(&mut self) {
        let joints = self.joints.len();
        self.host = HostSession::new(HostParams::standard(0, vec![LIMITS; joints], CYCLE)).unwrap();
        self.host_out = None;
        self.host_alive = true;
    }

    pub fn inject_to_host(&mut self, frame: can_driver::Frame) {
        self.to_host.push(Event::frame(self.now, frame));
    }

    pub fn fault_to_host(&mut self, fault: can_driver::BusFault) {
        self.to_host.push(Event::Fault(fault));
    }

    pub fn run(&mut self, time: Duration, command: Command<'_>) {
        let end = self.now + time;
        while self.now < end {
            self.step(command, &mut |_| {});
        }
    }

    /// Runs until the host is in `state`, at most one second.
    pub fn until(&mut self, state: HostState, command: Command<'_>) {
        for _ in 0..1000 {
            self.step(command, &mut |_| {});
            if self.host_state() == state {
                return;
            }
        }
        panic!("{state:?} not reached: {:?} {:?}", self.host_out, self.controller_out);
    }

    /// Searching to Active.
    pub fn activate(&mut self) {
        self.until(HostState::Ready, Command::Standby);
        let here = self.positions();
        self.until(HostState::Active, Command::Follow { position_rad: &here, speed_scale: 1.0 });
    }

    /// Follows `start + amplitude * (1 - cos(w t))` on every joint.
    pub fn swing(&mut self, time: Duration, amplitude_rad: f64, rate_rad_s: f64) {
        let begin = self.now;
        let start = self.commanded();
        while self.now < begin + time {
            let t = (self.now + TICK).saturating_sub(begin).as_secs_f64();
            let offset = amplitude_rad * (1.0 - (rate_rad_s * t).cos());
            let wanted: Vec<f64> = start.iter().map(|q| q + offset).collect();
            self.step(Command::Follow { position_rad: &wanted, speed_scale: 1.0 }, &mut |_| {});
        }
    }

    pub fn positions(&self) -> Vec<f64> {
        self.joints.iter().map(|j| j.position_rad).collect()
    }

    pub fn commanded(&self) -> Vec<f64> {
        self.host_out.as_ref().map(|o| o.commanded_rad.to_vec()).unwrap_or_default()
    }

    pub fn host_state(&self) -> HostState {
        self.host_out.as_ref().map_or(HostState::Searching, |o| o.state)
    }

    pub fn controller_state(&self) -> ControllerState {
        self.controller_out.as_ref().map_or(ControllerState::Unconfigured, |o| o.state)
    }
}
