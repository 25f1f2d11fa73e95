//! Telltale: the operator HMI of an autonomous shuttle bus.

#![forbid(unsafe_code)]
// `expect` states why a call cannot fail.
#![cfg_attr(not(test), deny(clippy::unwrap_used))]

pub mod cli;
pub mod clock;
pub mod config;
pub mod engine;
pub mod import;
pub mod init;
pub mod input_file;
pub mod latency;
pub mod metrics;
pub mod msg;
pub mod picture;
pub mod record;
pub mod replay;
pub mod ros;
pub mod runtime;
pub mod sim;
pub mod store;
pub mod web;
pub mod yaml;
