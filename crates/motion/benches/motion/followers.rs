//! The generators under comparison, all with the same limits, the same targets and one joint.

use std::time::Duration;

use motion::{
    AccelerationSource, AgePolicy, EngageParams, JointLimits, Sample, State, Synchronisation, Target, Tracker,
    TrackerParams,
};
use rsruckig::prelude::{
    IgnoreErrorHandler, InputParameter, OutputParameter, Ruckig, Synchronization, TargetState, Trackig,
};

/// Control period of the comparison.
pub(crate) const TICK_S: f64 = 0.005;
const TICK: Duration = Duration::from_millis(5);

/// Limits of a light industrial arm's joint.
pub(crate) const LIMITS: JointLimits =
    JointLimits { lower_rad: -2.0, upper_rad: 2.0, velocity_rad_s: 3.0, acceleration_rad_s2: 20.0, jerk_rad_s3: 500.0 };

pub(crate) fn params(limits: Vec<JointLimits>, bandwidth_rad_s: f64) -> TrackerParams {
    TrackerParams {
        limits,
        bandwidth_rad_s,
        synchronisation: Synchronisation::None,
        acceleration: AccelerationSource::Estimated,
        age: AgePolicy { coast: Duration::from_millis(150), fade: Duration::from_millis(200) },
        max_step: Duration::from_millis(50),
        horizon_capacity: 0,
        engage: EngageParams { velocity_rad_s: 0.3, tolerance_rad: 0.02, gap_rad: 0.01, ramp: Duration::from_secs(1) },
    }
}

/// Something that follows targets `(position, velocity)` of one joint.
pub(crate) trait Follower {
    fn offer(&mut self, position: f64, velocity: f64);
    /// The command one period later.
    fn tick(&mut self) -> State;
}

pub(crate) struct Ours(Tracker);

impl Ours {
    pub(crate) fn new(start: f64, bandwidth_rad_s: f64) -> Self {
        let plan = params(vec![LIMITS], bandwidth_rad_s).validate().expect("valid parameters");
        Self(plan.take_over(&[State::at_rest(start)]).expect("one state"))
    }
}

impl Follower for Ours {
    fn offer(&mut self, position: f64, velocity: f64) {
        self.0.offer(&Target::new(0.0, &[Sample::new(position, velocity)])).expect("finite and newer");
    }

    fn tick(&mut self) -> State {
        self.0.update(TICK).expect("a time step above zero");
        self.0.states()[0]
    }
}

/// The last target with what the targets before it tell, shared by the peers.
#[derive(Default)]
struct Last {
    position: f64,
    velocity: f64,
    acceleration: f64,
    age_s: f64,
    seen: bool,
}

impl Last {
    fn offer(&mut self, position: f64, velocity: f64) {
        self.acceleration = if self.seen && self.age_s > 0.0 { (velocity - self.velocity) / self.age_s } else { 0.0 };
        self.seen = true;
        (self.position, self.velocity, self.age_s) = (position, velocity, 0.0);
    }

    /// Position, velocity and acceleration at the end of the coming tick.
    fn ahead(&self) -> [f64; 3] {
        let t = self.age_s + TICK_S;
        let velocity = self.velocity + self.acceleration * t;
        [
            self.position + t * (self.velocity + t * self.acceleration / 2.0),
            velocity.clamp(-LIMITS.velocity_rad_s, LIMITS.velocity_rad_s),
            self.acceleration.clamp(-LIMITS.acceleration_rad_s2, LIMITS.acceleration_rad_s2),
        ]
    }
}

fn input(start: f64) -> InputParameter<1> {
    let mut input = InputParameter::new(None);
    input.synchronization = Synchronization::None;
    input.current_position[0] = start;
    input.target_position[0] = start;
    input.max_velocity[0] = LIMITS.velocity_rad_s;
    input.max_acceleration[0] = LIMITS.acceleration_rad_s2;
    input.max_jerk[0] = LIMITS.jerk_rad_s3;
    input
}

fn state(output: &OutputParameter<1>) -> State {
    State {
        position_rad: output.new_position[0],
        velocity_rad_s: output.new_velocity[0],
        acceleration_rad_s2: output.new_acceleration[0],
    }
}

/// What a state-to-state generator is asked for in each cycle.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Ask {
    /// Rest at the newest target.
    Rest,
    /// The newest target, continued to the present, with its velocity.
    Moving,
}

/// State-to-state rsruckig, called anew in each cycle.
pub(crate) struct StateToState {
    generator: Ruckig<1, IgnoreErrorHandler>,
    input: InputParameter<1>,
    output: OutputParameter<1>,
    last: Last,
    ask: Ask,
}

impl StateToState {
    pub(crate) fn new(start: f64, ask: Ask) -> Self {
        Self {
            generator: Ruckig::new(None, TICK_S),
            input: input(start),
            output: OutputParameter::new(None),
            last: Last::default(),
            ask,
        }
    }
}

impl Follower for StateToState {
    fn offer(&mut self, position: f64, velocity: f64) {
        self.last.offer(position, velocity);
    }

    fn tick(&mut self) -> State {
        if self.last.seen {
            let [position, velocity, _] = self.last.ahead();
            match self.ask {
                Ask::Rest => self.input.target_position[0] = self.last.position,
                Ask::Moving => {
                    self.input.target_position[0] = position;
                    self.input.target_velocity[0] = velocity;
                }
            }
        }
        self.last.age_s += TICK_S;
        // A failed cycle keeps the previous output, as a user's loop would.
        if self.generator.update(&self.input, &mut self.output).is_ok() {
            self.output.pass_to_input(&mut self.input);
        }
        state(&self.output)
    }
}

/// rsruckig's own tracking interface.
pub(crate) struct Tracking {
    generator: Trackig<1, IgnoreErrorHandler>,
    input: InputParameter<1>,
    output: OutputParameter<1>,
    target: TargetState<1>,
    last: Last,
}

impl Tracking {
    pub(crate) fn new(start: f64) -> Self {
        let mut target = TargetState::new(None);
        target.position[0] = start;
        Self {
            generator: Trackig::new(None, TICK_S),
            input: input(start),
            output: OutputParameter::new(None),
            target,
            last: Last::default(),
        }
    }
}

impl Follower for Tracking {
    fn offer(&mut self, position: f64, velocity: f64) {
        self.last.offer(position, velocity);
    }

    fn tick(&mut self) -> State {
        if self.last.seen {
            let [position, velocity, acceleration] = self.last.ahead();
            self.target.position[0] = position;
            self.target.velocity[0] = velocity;
            self.target.acceleration[0] = acceleration;
        }
        self.last.age_s += TICK_S;
        if self.generator.update(&self.target, &self.input, &mut self.output).is_ok() {
            self.output.pass_to_input(&mut self.input);
        }
        state(&self.output)
    }
}
