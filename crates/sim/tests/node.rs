//! Host session against controller and plant, in virtual time.

#![expect(clippy::unwrap_used, reason = "tests")]

use std::time::Duration;

use can_driver::{
    Command, Controller, ControllerParams, ControllerState, Event, HostParams, HostSession, HostState, JointLimits,
    Stamped,
};
use sim::{Arm, ArmParams, ControllerNode, Error};

const HOME: [f64; 6] = [0.0, 0.6, -1.2, 0.3, 0.0, 0.0];
const CYCLE: Duration = Duration::from_millis(5);

fn limits() -> Vec<JointLimits> {
    vec![JointLimits { min_rad: -3.0, max_rad: 3.0, velocity_rad_s: 1.5, acceleration_rad_s2: 8.0 }; 6]
}

fn node() -> ControllerNode {
    let controller = Controller::new(ControllerParams::standard(0, limits())).unwrap();
    let arm = Arm::new(&kin::Robot::builtin(), ArmParams::new(HOME.to_vec())).unwrap();
    ControllerNode::new(controller, arm).unwrap()
}

/// What a run left behind: the host's frames, the node's frames, and the largest tracking error.
struct Run {
    host_tx: Vec<Stamped>,
    node_tx: Vec<Stamped>,
    state: HostState,
    worst_rad: f64,
}

/// Runs a host that swings the arm, for `cycles` cycles after it has become active.
fn follow(cycles: u64) -> Run {
    let mut host = HostSession::new(HostParams::standard(0, limits(), CYCLE)).unwrap();
    let mut node = node();
    let mut run = Run { host_tx: Vec::new(), node_tx: Vec::new(), state: HostState::Searching, worst_rad: 0.0 };
    let (mut to_host, mut to_node): (Vec<Event>, Vec<Event>) = (Vec::new(), Vec::new());
    let mut active: Option<(u64, Vec<f64>)> = None;
    for k in 0..cycles + 400 {
        let now = CYCLE * u32::try_from(k).unwrap();
        let mut tx = Vec::new();
        node.advance_to(now, &to_node, &mut tx).unwrap();
        to_host.clear();
        to_host.extend(tx.iter().map(|s| Event::frame(now, s.frame)));
        run.node_tx.extend(tx);
        let goal: Vec<f64> = match &active {
            Some((since, from)) => {
                let t = (k - since) as f64 * CYCLE.as_secs_f64();
                from.iter().map(|q| q + 0.1 * (1.0 - (2.0 * t).cos())).collect()
            }
            None => HOME.to_vec(),
        };
        let out = host.tick(now, &to_host, Command::Follow { position_rad: &goal, speed_scale: 1.0 });
        if let (Some(_), Some(output)) = (&active, node.last_output()) {
            for (joint, setpoint) in node.arm().measured().iter().zip(output.setpoints.iter()) {
                run.worst_rad = run.worst_rad.max((joint.position_rad - setpoint.position_rad).abs());
            }
        }
        if active.is_none() && out.state == HostState::Active {
            active = Some((k, out.commanded_rad.to_vec()));
        }
        to_node.clear();
        for frame in &out.tx {
            to_node.push(Event::frame(now, *frame));
            run.host_tx.push(Stamped { at: now, frame: *frame });
        }
        run.state = out.state;
    }
    run
}

#[test]
fn a_host_enables_the_plant_and_it_follows() {
    let run = follow(800);
    assert_eq!(run.state, HostState::Active);
    assert!(run.worst_rad < 5e-3, "{} rad between setpoint and plant", run.worst_rad);
}

#[test]
fn equal_inputs_give_equal_frames() {
    let (a, b) = (follow(300), follow(300));
    assert_eq!(a.host_tx, b.host_tx);
    assert_eq!(a.node_tx, b.node_tx);
}

#[test]
fn what_the_node_sends_does_not_depend_on_how_often_it_is_asked() {
    let heard: Vec<Event> = follow(200).host_tx.iter().map(|s| Event::frame(s.at, s.frame)).collect();
    let replay = |step_ms: u32| {
        let mut node = node();
        let mut tx = Vec::new();
        let mut rest = heard.as_slice();
        let mut now = Duration::ZERO;
        while now <= Duration::from_millis(2800) {
            let due = rest.partition_point(|e| matches!(e, Event::Frame(s) if s.at <= now));
            node.advance_to(now, &rest[..due], &mut tx).unwrap();
            rest = &rest[due..];
            now += Duration::from_millis(u64::from(step_ms));
        }
        tx.retain(|s: &Stamped| s.at <= Duration::from_millis(2750));
        (tx, node.arm().positions().len())
    };
    assert_eq!(replay(1), replay(7));
}

#[test]
fn the_plant_stops_when_the_host_falls_silent() {
    let run = follow(300);
    let heard: Vec<Event> = run.host_tx.iter().map(|s| Event::frame(s.at, s.frame)).collect();
    let last = run.host_tx.last().unwrap().at;
    let mut node = node();
    let mut tx = Vec::new();
    node.advance_to(last + Duration::from_secs(1), &heard, &mut tx).unwrap();
    assert_eq!(node.last_output().unwrap().state, ControllerState::Latched);
    for joint in node.arm().measured() {
        assert!(joint.velocity_rad_s.abs() < 1e-3, "{}", joint.velocity_rad_s);
    }
}

#[test]
fn controller_and_arm_must_have_as_many_joints() {
    let controller = Controller::new(ControllerParams::standard(0, limits()[..3].to_vec())).unwrap();
    let arm = Arm::new(&kin::Robot::builtin(), ArmParams::new(HOME.to_vec())).unwrap();
    let refused = ControllerNode::new(controller, arm);
    assert!(matches!(refused, Err(Error::JointCount { expected: 3, got: 6 })));
}
