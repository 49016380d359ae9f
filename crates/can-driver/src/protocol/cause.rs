//! Why a side has stopped: one code each.

macro_rules! causes {
    ($($(#[$doc:meta])* $name:ident = $code:literal, $text:literal;)*) => {
        /// Why the arm is stopped. The numbers are those on the wire: 1 to 63 are found by the
        /// controller, 64 to 127 by the host, 128 to 255 are the application's own.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum StopCause {
            $($(#[$doc])* $name,)*
            /// A cause of the application above this crate, 128 to 255.
            Application(u8),
        }

        impl StopCause {
            /// Every cause that this crate names, with code and text.
            pub const NAMED: &'static [(Self, u8, &'static str)] = &[$((Self::$name, $code, $text),)*];
        }
    };
}

causes! {
    /// A person pressed stop, or the host asked for a quick stop.
    OperatorStop = 1, "stop asked for by the operator";
    /// No set of setpoints arrived for the latch time.
    HostSilent = 2, "no setpoints from the host";
    /// Sets arrived, but older than allowed.
    StaleSetpoints = 3, "setpoints too old";
    /// Sets arrived, but with angles further away than the velocity limit allows.
    StepTooLarge = 4, "setpoint further away than the velocity limit allows";
    /// Sets arrived, but damaged.
    CorruptFrames = 5, "frames damaged";
    /// Sets arrived, but with missing frames.
    IncompleteSets = 6, "sets with missing frames";
    /// Sets arrived, but out of sequence.
    WrongSequence = 7, "sets out of sequence";
    /// Sets arrived without an angle for a joint that exists.
    MissingValue = 8, "setpoint without a value";
    /// Setpoint and measured angle lie too far apart.
    TrackingError = 9, "arm does not follow its setpoint";
    /// A measured angle is not a number or outside the wire's range.
    MeasurementInvalid = 10, "measured angle invalid";
    /// A new host session began, or limits were written, while the arm was enabled.
    HostRestarted = 11, "host began a new session while the arm was enabled";
    /// Enable was asked for without sealed limits.
    LimitsNotSealed = 12, "limits not written and sealed";
    /// Enable was asked for with a setpoint away from the measured angle.
    NotAtMeasured = 13, "first setpoint away from the measured angle";
    /// A measured angle lies outside the limits, so that motion cannot begin.
    OutsideLimits = 14, "measured angle outside the limits";
    /// The controller's bus is disturbed.
    ControllerBusFault = 15, "bus fault at the controller";
    /// The controller's own loop has not run for too long.
    ControllerStalled = 16, "controller loop stalled";

    /// No STATUS arrived while enabled.
    ControllerSilent = 64, "no status from the controller";
    /// STATUS arrives, but does not echo the sent sets.
    EchoMismatch = 65, "controller does not echo the sent sets";
    /// The controller stores other limits than those written.
    LimitsMismatch = 66, "controller stores other limits";
    /// The controller does not answer configuration.
    ConfigTimeout = 67, "controller does not answer configuration";
    /// The controller does not become active.
    EnableTimeout = 68, "controller does not become active";
    /// The controller left the active states without saying why.
    ControllerDisabled = 69, "controller is no longer enabled";
    /// The command is not a number, outside the wire's range, or of the wrong length.
    CommandInvalid = 70, "command not a valid set of angles";
    /// The command is outside the limits or steps further than they allow.
    CommandOutsideLimits = 71, "command outside the limits";
    /// The host's bus is disturbed.
    HostBusFault = 72, "bus fault at the host";
    /// The host's own loop has not run for too long.
    HostStalled = 73, "host loop stalled";
    /// The transmit queue stayed full.
    TransmitFull = 74, "transmit queue full";
    /// The round trip takes too long.
    RoundTripTooLong = 75, "round trip too long";
    /// The controller does not leave its latched stop.
    ResetRefused = 76, "controller refused the reset";
    /// Somebody else sends under the host's identifiers.
    SecondHost = 77, "another sender uses the host's identifiers";
}

impl StopCause {
    /// The code on the wire.
    pub fn code(self) -> u8 {
        match self {
            Self::Application(code) => code,
            named => Self::NAMED.iter().find(|(cause, ..)| *cause == named).map_or(0, |(_, code, _)| *code),
        }
    }

    /// The cause of a code; `None` for 0 (no cause) and for codes that nobody has.
    pub fn from_code(code: u8) -> Option<Self> {
        if code >= 128 {
            return Some(Self::Application(code));
        }
        Self::NAMED.iter().find(|(_, c, _)| *c == code).map(|(cause, ..)| *cause)
    }
}

impl std::fmt::Display for StopCause {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Application(code) => write!(f, "cause {code} of the application"),
            named => f.write_str(Self::NAMED.iter().find(|(cause, ..)| cause == named).map_or("", |(.., text)| text)),
        }
    }
}
