//! The host's end of the protocol.
//!
//! A pure state machine beside [`crate::Controller`]: time, received frames and the wish of the
//! application go in; frames, the measured joints and the state of the link come out.
//!
//! | state | what is sent | leaves to |
//! |---|---|---|
//! | Searching | nothing | Configuring when STATUS arrives |
//! | Configuring | CONFIG: session, limits, seal; each is read back. Idle sets once the session has begun | Ready; Stopped if the controller is latched or stores something else |
//! | Ready | idle sets | Enabling when the application wants to follow |
//! | Enabling | sets that equal the measured angles | Active when the controller follows |
//! | Active | the application's setpoints | Disabling, Stopped |
//! | Disabling | the last setpoints without enable | Ready when the arm is braked |
//! | Stopped | STOP twice, then idle sets with quick stop | Resetting by [`HostSession::reset`] alone |
//! | Resetting | idle sets with reset edges | Searching |
//!
//! A new session says nothing before its BEGIN: a controller that is still enabled by an earlier
//! session, whose process died, answers BEGIN with a latched stop, and no set of the new session
//! can be taken for one of the old.

mod link;
mod output;
mod params;
mod session;

pub use link::LinkReport;
pub use output::{Command, Feedback, HostOutput, HostState};
pub use params::HostParams;
pub use session::HostSession;
