//! ARIMA(p, d, q) by exact maximum likelihood.
//!
//! `phi(B) (nabla^d y_t - mu) = theta(B) e_t`, `e_t ~ N(0, sigma^2)`, with
//! `phi(B) = 1 - phi_1 B - ..`, `theta(B) = 1 + theta_1 B + ..`. `mu` is the mean for `d = 0`, the drift per
//! step for `d = 1`. Sources: Box and Jenkins (1970); Harvey (1989), chapter 3, for the state space;
//! de Jong (1991) for the diffuse likelihood with missing values.

mod auto;
mod dense;
mod filter;
mod fit;
mod lanes;
mod model;
mod objective;
mod optimise;
mod params;
mod polynomial;
mod report;
mod starts;
mod state;

pub use auto::{ArimaCandidate, AutoArima, AutoArimaParams, AutoArimaPlan, kpss};
pub use model::{Arima, ArimaParts, ArimaRun};
pub use params::{ArimaOrder, ArimaParams, ArimaPlan};
pub use report::{ArimaReport, ArimaStart, ArimaStop};
pub use state::{ArimaState, Forecast, Innovation};
