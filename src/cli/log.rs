//! The log, on standard error.

use std::io::IsTerminal as _;

use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

use crate::ros;
use crate::ros::publish::log_lines::LogLines;

/// Starts the log of a program that runs on. `RUST_LOG` wins over `level`.
pub fn start(level: &str) {
    let words = std::env::var("RUST_LOG").ok().filter(|words| !words.trim().is_empty());
    let words = words.unwrap_or_else(|| level.to_owned());
    // Later directives win, so the library's flood is let through only where it is named.
    let filter = EnvFilter::new(format!("{},{words}", ros::LOG_FILTER));
    let colours = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let log = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
    let log = log.with_ansi(colours).with_target(false);
    tracing_subscriber::registry().with(filter).with(log).with(LogLines).init();
}
