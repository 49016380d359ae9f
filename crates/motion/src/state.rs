//! The state of one joint and its motion under constant jerk.

/// Position, velocity and acceleration of one joint. A prismatic joint reads metres for radians.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct State {
    /// Position.
    pub position_rad: f64,
    /// Velocity.
    pub velocity_rad_s: f64,
    /// Acceleration.
    pub acceleration_rad_s2: f64,
}

impl State {
    /// A joint at rest.
    ///
    /// ```
    /// assert_eq!(motion::State::at_rest(0.3).velocity_rad_s, 0.0);
    /// ```
    pub const fn at_rest(position_rad: f64) -> Self {
        Self { position_rad, velocity_rad_s: 0.0, acceleration_rad_s2: 0.0 }
    }

    /// The state after `span_s` seconds of constant jerk.
    ///
    /// ```
    /// let moved = motion::State::at_rest(0.0).after(6.0, 1.0);
    /// assert_eq!((moved.position_rad, moved.velocity_rad_s), (1.0, 3.0));
    /// ```
    #[must_use]
    pub fn after(self, jerk_rad_s3: f64, span_s: f64) -> Self {
        let (a, j, t) = (self.acceleration_rad_s2, jerk_rad_s3, span_s);
        Self {
            position_rad: self.position_rad + t * (self.velocity_rad_s + t * (a / 2.0 + t * j / 6.0)),
            velocity_rad_s: self.velocity_rad_s + t * (a + t * j / 2.0),
            acceleration_rad_s2: a + t * j,
        }
    }

    pub(crate) fn is_finite(self) -> bool {
        self.position_rad.is_finite() && self.velocity_rad_s.is_finite() && self.acceleration_rad_s2.is_finite()
    }
}
