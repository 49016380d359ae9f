//! What a host session is set to.

use std::time::Duration;

use crate::{Error, JointLimits, Protocol, limits};

/// Settings of a [`crate::HostSession`]. [`HostParams::standard`] has the protocol's times.
#[derive(Clone, Debug, PartialEq)]
pub struct HostParams {
    /// Number of the robot, 0 to 15.
    pub robot: u8,
    /// Limits to write to the controller; commands outside them stop the session.
    pub limits: Vec<JointLimits>,
    /// Period of the ticks, 1 to 20 ms.
    pub cycle: Duration,
    /// How long the controller may go on without a new set, whole milliseconds.
    pub horizon: Duration,
    /// Time without STATUS, or without a new echo, from which the controller counts as silent.
    pub silent_after: Duration,
    /// Pause of the host's own loop that ends motion.
    pub stalled_after: Duration,
    /// Time for the whole configuration.
    pub configure_within: Duration,
    /// Time from the wish to follow until the controller follows.
    pub enable_within: Duration,
    /// Round trip that is too long if five in a row exceed it.
    pub round_trip_limit: Duration,
}

impl HostParams {
    /// The protocol's times for a robot with these limits, ticked once per `cycle`. The horizon is
    /// two cycles, at least 10 ms, so that one lost set leaves no trace in the motion.
    pub fn standard(robot: u8, limits: Vec<JointLimits>, cycle: Duration) -> Self {
        Self {
            robot,
            limits,
            cycle,
            horizon: (cycle * 2).max(Duration::from_millis(10)),
            silent_after: Duration::from_millis(25).max(cycle * 2),
            stalled_after: Duration::from_millis(100),
            configure_within: Duration::from_secs(3),
            enable_within: Duration::from_millis(500),
            round_trip_limit: Duration::from_millis(20),
        }
    }

    pub(super) fn validate(&self) -> Result<Protocol, Error> {
        limits::validate(&self.limits)?;
        let ms = Duration::from_millis;
        let times = [
            ("cycle", self.cycle, "1 to 20 ms", ms(1), ms(20)),
            ("horizon", self.horizon, "1 to 255 ms", ms(1), ms(255)),
            ("silent_after", self.silent_after, "one cycle to 100 ms", self.cycle, ms(100)),
            ("stalled_after", self.stalled_after, "one cycle to 200 ms", self.cycle, ms(200)),
            ("configure_within", self.configure_within, "0.2 to 30 s", ms(200), ms(30_000)),
            ("enable_within", self.enable_within, "0.1 to 10 s", ms(100), ms(10_000)),
            ("round_trip_limit", self.round_trip_limit, "1 to 100 ms", ms(1), ms(100)),
        ];
        for (field, value, allowed, low, high) in times {
            if value < low || value > high {
                return Err(Error::InvalidParameter { field: field.to_owned(), allowed, value: value.as_secs_f64() });
            }
        }
        Protocol::new(self.robot)
    }
}
