//! CAN buses, the joint protocol and both of its ends.
