//! ROS 2 over Zenoh, as rmw_zenoh speaks it: the Zenoh library in its process.

mod attachment;
pub mod child;
mod config;
mod follower;
mod graph;
mod hashes;
mod heard;
mod names;
pub mod router;
mod session;
