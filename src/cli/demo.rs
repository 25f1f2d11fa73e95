//! `telltale demo`.

use crate::config::{self, Loaded};
use crate::yaml::Problems;

/// The configuration of the demo lies in the binary, so that this alone is enough.
const CONFIG: &str = include_str!("../../config/shuttle.yaml");

fn load_config() -> Result<Loaded, Problems> {
    config::parse("config/shuttle.yaml", CONFIG)
}

#[cfg(test)]
mod tests;
