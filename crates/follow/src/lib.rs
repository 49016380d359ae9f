//! The pipeline and one control tick as pure functions: teach, learn, predict, retarget, guard.
