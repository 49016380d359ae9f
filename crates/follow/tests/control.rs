//! The control loop, tick by tick, with a plant that is where it is told to be.

use std::time::Duration;

use follow::{ControlLoop, ControlParams, JointPlan, Phase, RestCause, StopCause, TickInput, Verdict};
use motion::{AccelerationSource, AgePolicy, EngageParams, JointLimits, Sample, Synchronisation, TrackerParams};

const DT: Duration = Duration::from_millis(5);

fn params() -> ControlParams {
    let limits = JointLimits {
        lower_rad: -2.0,
        upper_rad: 2.0,
        velocity_rad_s: 2.0,
        acceleration_rad_s2: 15.0,
        jerk_rad_s3: 300.0,
    };
    ControlParams {
        tracker: TrackerParams {
            limits: vec![limits; 2],
            bandwidth_rad_s: 30.0,
            synchronisation: Synchronisation::None,
            acceleration: AccelerationSource::Estimated,
            age: AgePolicy { coast: Duration::from_millis(150), fade: Duration::from_millis(150) },
            max_step: Duration::from_millis(20),
            horizon_capacity: 32,
            engage: EngageParams {
                velocity_rad_s: 0.5,
                tolerance_rad: 0.02,
                gap_rad: 0.05,
                ramp: Duration::from_millis(300),
            },
        },
        frame_hard: Duration::from_millis(400),
        tracking_error_rad: 0.1,
        tracking_error_for: Duration::from_millis(50),
        reengage_automatically: false,
    }
}

/// A loop, the joints it moves, and the time.
struct Bench {
    control: ControlLoop,
    joints: Vec<f64>,
    now: Duration,
    stuck: bool,
}

impl Bench {
    fn new() -> Self {
        let control = ControlLoop::new(params()).expect("valid");
        Self { control, joints: vec![0.3, -0.2], now: Duration::ZERO, stuck: false }
    }

    fn tick(&mut self, plan: Option<&JointPlan>, reset: bool) -> Verdict {
        let verdict = self.control.tick(&TickInput {
            now: self.now,
            dt: DT,
            enabled: true,
            measured_rad: Some(&self.joints),
            plan,
            rest: false,
            reset,
        });
        if let (Some(states), false) = (self.control.command(), self.stuck) {
            self.joints = states.iter().map(|s| s.position_rad).collect();
        }
        self.now += DT;
        verdict
    }

    /// A plan that rests at a place, as known at this instant.
    fn plan(&self, place: [f64; 2]) -> JointPlan {
        let rows = place.map(|q| Sample::new(q, 0.0)).to_vec();
        JointPlan { captured: self.now, step: Duration::from_millis(20), joints: 2, rows }
    }

    fn follow(&mut self, place: [f64; 2], seconds: f64) {
        let mut plan = self.plan(place);
        for i in 0..(seconds / DT.as_secs_f64()) as usize {
            if i % 6 == 0 {
                plan = self.plan(place);
            }
            self.tick(Some(&plan), false);
        }
    }
}

#[test]
fn the_first_command_is_what_was_measured() {
    let mut bench = Bench::new();
    assert_eq!(bench.tick(None, false), Verdict::Hold);
    let command: Vec<f64> = bench.control.command().expect("begun").iter().map(|s| s.position_rad).collect();
    assert_eq!(command, [0.3, -0.2]);
    assert_eq!(bench.control.phase(), Phase::Ready);
}

#[test]
fn it_aligns_slowly_and_then_follows() {
    let mut bench = Bench::new();
    let mut fastest = 0.0_f64;
    for _ in 0..400 {
        let plan = bench.plan([0.8, 0.4]);
        bench.tick(Some(&plan), false);
        if bench.control.phase() == Phase::Aligning {
            let speeds = bench.control.command().expect("begun").iter().map(|s| s.velocity_rad_s.abs());
            fastest = speeds.fold(fastest, f64::max);
        }
    }
    assert_eq!(bench.control.phase(), Phase::Following);
    assert!(fastest <= 0.5 + 1e-9, "{fastest}");
    assert!((bench.joints[0] - 0.8).abs() < 0.01 && (bench.joints[1] - 0.4).abs() < 0.01);
}

#[test]
fn lost_vision_brings_it_to_rest_until_an_operator_lets_it_go_on() {
    let mut bench = Bench::new();
    bench.follow([0.8, 0.4], 3.0);
    let stale = bench.plan([0.9, 0.5]);
    for _ in 0..300 {
        bench.tick(Some(&stale), false);
    }
    assert_eq!(bench.control.phase(), Phase::Resting(RestCause::VisionLost));
    let fresh = bench.plan([0.9, 0.5]);
    bench.tick(Some(&fresh), false);
    assert_eq!(bench.control.phase(), Phase::Resting(RestCause::VisionLost));
    let fresh = bench.plan([0.9, 0.5]);
    bench.tick(Some(&fresh), true);
    assert_eq!(bench.control.phase(), Phase::Ready);
}

#[test]
fn an_arm_that_does_not_follow_is_stopped_for_good() {
    let mut bench = Bench::new();
    bench.follow([0.3, -0.2], 1.0);
    bench.stuck = true;
    let mut verdict = Verdict::Hold;
    for _ in 0..400 {
        let plan = bench.plan([1.2, -0.2]);
        verdict = bench.tick(Some(&plan), false);
    }
    assert_eq!(verdict, Verdict::Stop(StopCause::TrackingError));
    // Latched: the arm moving freely again changes nothing; a reset starts from what is measured.
    bench.stuck = false;
    assert_eq!(bench.tick(None, false), Verdict::Stop(StopCause::TrackingError));
    assert_eq!(bench.tick(None, true), Verdict::Hold);
}
