//! Motion elements learned one by one and joined into one smooth motion.
//!
//! Each element has a mixture over `(t - start, h)`. Around the boundary between two elements, in a
//! window of length `blend_s`, the answer moves from one to the next with the weight
//! `w(s) = 6 s^5 - 15 s^4 + 10 s^3`, `s` in `[0, 1]`, whose first and second derivative vanish at
//! both ends. Position, velocity and acceleration of the joined mean are therefore continuous:
//! `m = (1 - w) m_0 + w m_1`, `m' = (1 - w) m_0' + w m_1' + w' (m_1 - m_0)`, and the covariance is that
//! of a mixture of the two, `(1 - w) V_0 + w V_1 + w (1 - w) (m_1 - m_0)(m_1 - m_0)'`.

mod learn;
mod model;
mod prediction;
mod regressor;

pub use model::{ElementModel, ElementSequence, ElementSequenceParts};
pub use prediction::{Phase, SequencePrediction};
pub use regressor::SequenceRegressor;
