//! What a controller is set to.

use std::time::Duration;

use crate::{Error, JointLimits, Protocol, limits};

/// Settings of a [`crate::Controller`]. [`ControllerParams::standard`] has the protocol's times.
#[derive(Clone, Debug, PartialEq)]
pub struct ControllerParams {
    /// Number of the robot, 0 to 15.
    pub robot: u8,
    /// The controller's own limits, which no host can widen.
    pub limits: Vec<JointLimits>,
    /// Time without an accepted set until the stop is on record. At 1 rad/s an arm runs 0.025 rad
    /// in 25 ms; 100 ms would exceed the 0.04 rad that following is meant to keep.
    pub ramp_after: Duration,
    /// Time without an accepted set until the stop is latched.
    pub latch_after: Duration,
    /// Age from which a set is refused.
    pub stale_after: Duration,
    /// How often the controller reports when no COMMIT asks for it; at least one and a half of the
    /// host's cycles.
    pub report_period: Duration,
    /// Distance of setpoint and measured angle that counts as a tracking error,
    pub tracking_limit_rad: f64,
    /// if it lasts this long.
    pub tracking_time: Duration,
    /// How far the first setpoints may lie from the measured angles.
    pub engage_tolerance_rad: f64,
}

impl ControllerParams {
    /// The protocol's times for a robot with these limits.
    pub fn standard(robot: u8, limits: Vec<JointLimits>) -> Self {
        Self {
            robot,
            limits,
            ramp_after: Duration::from_millis(25),
            latch_after: Duration::from_millis(100),
            stale_after: Duration::from_millis(10),
            report_period: Duration::from_millis(5),
            tracking_limit_rad: 0.10,
            tracking_time: Duration::from_millis(50),
            engage_tolerance_rad: 0.01,
        }
    }

    pub(super) fn validate(&self) -> Result<Protocol, Error> {
        limits::validate(&self.limits)?;
        let times = [
            ("ramp_after", self.ramp_after, "1 ms to latch_after", Duration::from_millis(1), self.latch_after),
            ("latch_after", self.latch_after, "at most 200 ms", Duration::from_millis(1), Duration::from_millis(200)),
            ("stale_after", self.stale_after, "1 to 50 ms", Duration::from_millis(1), Duration::from_millis(50)),
            ("report_period", self.report_period, "1 to 25 ms", Duration::from_millis(1), Duration::from_millis(25)),
            ("tracking_time", self.tracking_time, "at most 1 s", Duration::ZERO, Duration::from_secs(1)),
        ];
        for (field, value, allowed, low, high) in times {
            if value < low || value > high {
                return Err(Error::InvalidParameter { field: field.to_owned(), allowed, value: value.as_secs_f64() });
            }
        }
        for (field, value) in
            [("tracking_limit_rad", self.tracking_limit_rad), ("engage_tolerance_rad", self.engage_tolerance_rad)]
        {
            if !(value > 0.0 && value <= 0.25) {
                return Err(Error::InvalidParameter {
                    field: field.to_owned(),
                    allowed: "above 0, at most 0.25",
                    value,
                });
            }
        }
        Protocol::new(self.robot)
    }
}
