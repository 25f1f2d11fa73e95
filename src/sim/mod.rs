//! The simulated shuttle: what the nodes of such a vehicle would publish, and its faults.

pub mod shuttle;
