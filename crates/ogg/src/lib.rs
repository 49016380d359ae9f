//! The `ogg` command as a library, so that its parts can be tested.
//!
//! This is the only crate with threads, devices, environment, sockets and signals; everything it decides with is a pure
//! function in a crate below it. `docs/ARCHITECTURE.md` shows the way of a picture through it.

pub mod brain;
pub mod can_tools;
pub mod capture;
pub mod cell;
mod civil;
pub mod cli;
pub mod commands;
pub mod compare;
pub mod config;
mod error;
pub mod journal;
pub mod link;
pub mod live;
pub mod plant;
pub mod progress;
pub mod record;
pub mod reference;
pub mod summary;
pub mod vision;
pub mod worker_source;

pub use error::Error;
