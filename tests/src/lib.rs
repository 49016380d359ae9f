//! System, vcan and golden tests.
