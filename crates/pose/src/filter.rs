//! Causal filters of one coordinate, each with its lag.
//!
//! | filter | removes | lag on a ramp |
//! |---|---|---|
//! | [`OneEuro`] | jitter, less so when moving | `1 / (2 pi f_c)` with `f_c = f_min + beta * speed` |
//! | [`Kalman`] | jitter, and predicts | none at constant speed |
//! | [`Hampel`] | single outliers | the chosen number of samples; 0 is possible |
//!
//! Units: whatever the coordinate has, and seconds. Steps of time are arguments and must be positive.

mod hampel;
mod kalman;
mod one_euro;

pub use hampel::Hampel;
pub use kalman::Kalman;
pub use one_euro::{OneEuro, OneEuroParams};
