//! The program itself in a process of its own: its words, what it reads, what it says.

use std::ffi::OsStr;
use std::io::Write as _;
use std::process::{Command, Output, Stdio};

/// Settings of the tester's own shell that would change what the program does.
const OWN_SETTINGS: [&str; 5] =
    ["AMENT_PREFIX_PATH", "ROS_DOMAIN_ID", "ROS_LOCALHOST_ONLY", "ROS_AUTOMATIC_DISCOVERY_RANGE", "RUST_LOG"];

/// The program with these words and without an input, not started yet.
pub fn telltale(words: impl IntoIterator<Item: AsRef<OsStr>>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_telltale"));
    for setting in OWN_SETTINGS {
        command.env_remove(setting);
    }
    command.args(words).stdin(Stdio::null());
    command
}

/// Runs it to its end.
pub fn run(words: impl IntoIterator<Item: AsRef<OsStr>>) -> Output {
    telltale(words).output().expect("the program can be run")
}

/// The same, with this on its standard input.
pub fn run_with(words: impl IntoIterator<Item: AsRef<OsStr>>, input: &str) -> Output {
    let mut command = telltale(words);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the program can be run");
    // It may end before it reads.
    let _ = child.stdin.take().expect("it is piped").write_all(input.as_bytes());
    child.wait_with_output().expect("it ends")
}

/// What it wrote on standard output and on standard error, and its exit code.
pub fn said(output: &Output) -> (String, String, Option<i32>) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (text(&output.stdout), text(&output.stderr), output.status.code())
}
