#![doc = include_str!("../README.md")]

mod brake;
mod error;
mod guard;
mod law;
mod limits;
mod params;
mod reference;
mod state;
mod target;
mod tracker;

pub use error::{Error, Result};
pub use limits::JointLimits;
pub use params::{EngageParams, Synchronisation, TrackerParams, TrackerPlan};
pub use reference::Freshness;
pub use state::State;
pub use target::{AccelerationSource, AgePolicy, Sample, Target};
pub use tracker::{Phase, Report, Tracker};
