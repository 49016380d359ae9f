//! The native half of the Python package ogg_rs.
