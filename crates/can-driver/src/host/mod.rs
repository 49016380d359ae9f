//! The host's end of the protocol.
//!
//! A pure state machine beside [`crate::Controller`]: time, received frames and the wish of the
//! application go in; frames, the measured joints and the state of the link come out.
//!
//! | state | what is sent | leaves to |
//! |---|---|---|
//! | Searching | idle sets | Configuring when STATUS arrives |
//! | Configuring | idle sets and CONFIG: session, limits, seal; each is read back | Ready; Stopped if the controller is latched or stores something else |
//! | Ready | idle sets | Enabling when the application wants to follow |
//! | Enabling | sets that equal the measured angles | Active when the controller follows |
//! | Active | the application's setpoints | Disabling, Stopped |
//! | Disabling | the last setpoints without enable | Ready when the arm is braked |
//! | Stopped | STOP twice, then idle sets with quick stop | Resetting by [`HostSession::reset`] alone |
//! | Resetting | idle sets with reset edges | Searching |

mod link;
mod params;
mod session;

pub use link::LinkReport;
pub use params::HostParams;
pub use session::{Command, Feedback, HostOutput, HostSession, HostState};
