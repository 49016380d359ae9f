//! Online jerk-limited tracking of a moving target.
