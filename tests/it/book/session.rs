//! A reader's terminals: commands in a folder and a network of their own, where the ports and the DDS domain of the
//! pages are free and nothing leaves the machine.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{BufRead as _, BufReader};
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process_group};

use super::root;
use super::transcript::{How, Step, expected};
use crate::folder::TestFolder;
use crate::peer::Limit;

/// Between two looks at what a command has printed.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

pub struct Session {
    folder: TestFolder,
    /// Holds the network namespace.
    network: Child,
    /// Settings that hold for all later commands, as in terminals where they were typed.
    settings: String,
    background: Vec<Running>,
    /// So many commands were started in the background.
    started: usize,
}

struct Running {
    terminal: Option<String>,
    child: Child,
    output: PathBuf,
}

impl Session {
    pub fn open(name: &str) -> Session {
        let folder = TestFolder::new(name);
        fs::create_dir_all(folder.join("bin")).expect("the temporary folder can be written");
        symlink(env!("CARGO_BIN_EXE_telltale"), folder.join("bin/telltale")).expect("a link");
        symlink(root().join("config"), folder.join("config")).expect("a link");
        let python = std::env::var("TELLTALE_PEER_PYTHON")
            .expect("TELLTALE_PEER_PYTHON names the Python of the peers");
        let script =
            format!("#!/bin/sh\nexec '{python}' '{}' \"$@\"\n", root().join("tests/dds/ros2.py").display());
        let ros2 = folder.join("bin/ros2");
        fs::write(&ros2, script).expect("the temporary folder can be written");
        fs::set_permissions(&ros2, fs::Permissions::from_mode(0o755)).expect("it is ours");
        let mut network = Command::new("unshare")
            .args(["--user", "--map-root-user", "--net", "sh", "-c"])
            // It ends with its input, so with this process.
            .arg("ip link set lo up multicast on && echo ready && exec cat")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("unshare is installed");
        let mut ready = String::new();
        let output = network.stdout.take().expect("it is piped");
        BufReader::new(output).read_line(&mut ready).expect("it can be read");
        assert_eq!(ready, "ready\n", "a network namespace with the loopback interface");
        Session { folder, network, settings: String::new(), background: Vec::new(), started: 0 }
    }

    pub fn take(&mut self, step: &Step) -> Result<(), String> {
        match step {
            Step::File { name, text } => {
                let file = self.folder.join(name);
                let folder = file.parent().expect("a file lies in a folder");
                fs::create_dir_all(folder)
                    .and_then(|()| fs::write(&file, text))
                    .map_err(|error| error.to_string())
            }
            Step::Interrupt { line, terminal } => {
                let meant = |it: &Running| terminal.is_none() || it.terminal == *terminal;
                match self.background.iter().rposition(meant) {
                    Some(index) => self.background.remove(index).end(),
                    None => Err(format!("line {line}: nothing runs that could be ended")),
                }
            }
            Step::Command { line, command, printed, how, terminal } => {
                let result = match how {
                    How::Background => {
                        self.start(terminal.clone(), command, printed.as_deref().unwrap_or("..."))
                    }
                    How::Until => self.repeat(command, printed.as_deref().unwrap_or("...")),
                    How::Once | How::Fails => self.run(command, printed.as_deref(), *how == How::Fails),
                };
                result.map_err(|why| format!("line {line}: $ {command}\n{why}{}", self.what_runs()))?;
                if command.starts_with("export ") {
                    let _ = writeln!(self.settings, "{command}");
                }
                Ok(())
            }
        }
    }

    fn run(&self, command: &str, printed: Option<&str>, fails: bool) -> Result<(), String> {
        let (status, output) = self.output(command)?;
        let right =
            status.success() != fails && printed.is_none_or(|it| expected(it, false).is_match(&output));
        if right { Ok(()) } else { Err(format!("{status}, printed:\n{output}")) }
    }

    fn repeat(&self, command: &str, printed: &str) -> Result<(), String> {
        let (pattern, limit) = (expected(printed, false), Limit::start());
        loop {
            let (status, output) = self.output(command)?;
            if status.success() && pattern.is_match(&output) {
                return Ok(());
            }
            if limit.is_over() {
                return Err(format!("at last {status}, printed:\n{output}"));
            }
            std::thread::sleep(LOOK_AGAIN);
        }
    }

    fn start(&mut self, terminal: Option<String>, command: &str, printed: &str) -> Result<(), String> {
        self.started += 1;
        let output = self.folder.join(format!("bin/output-{}", self.started));
        let child = self.shell(command, &output)?;
        self.background.push(Running { terminal, child, output: output.clone() });
        let (pattern, limit) = (expected(printed, true), Limit::start());
        loop {
            let text = fs::read_to_string(&output).unwrap_or_default();
            if pattern.is_match(&text) {
                return Ok(());
            }
            let running = self.background.last_mut().expect("it was just started");
            let ended = running.child.try_wait().map_err(|error| error.to_string())?;
            if ended.is_some() || limit.is_over() {
                return Err(format!("{ended:?}, printed:\n{text}"));
            }
            std::thread::sleep(LOOK_AGAIN);
        }
    }

    fn output(&self, command: &str) -> Result<(ExitStatus, String), String> {
        let file = self.folder.join("bin/output");
        let mut running = Running { terminal: None, child: self.shell(command, &file)?, output: file };
        let limit = Limit::start();
        let status = loop {
            if let Some(status) = running.child.try_wait().map_err(|error| error.to_string())? {
                break status;
            }
            if limit.is_over() {
                return Err(format!("does not end, printed:\n{}", running.printed()));
            }
            std::thread::sleep(LOOK_AGAIN);
        };
        Ok((status, running.printed()))
    }

    fn shell(&self, command: &str, output: &PathBuf) -> Result<Child, String> {
        let file = File::create(output).map_err(|error| error.to_string())?;
        let errors = file.try_clone().map_err(|error| error.to_string())?;
        let path = std::env::var("PATH").unwrap_or_default();
        Command::new("nsenter")
            .args(["--user", "--net", "--preserve-credentials", "--target"])
            .arg(self.network.id().to_string())
            .args(["bash", "-c", &format!("{}{command}", self.settings)])
            .current_dir(&*self.folder)
            .env_clear()
            .env("PATH", format!("{}:{path}", self.folder.join("bin").display()))
            .env("HOME", &*self.folder)
            .env("LANG", "C.UTF-8")
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(Stdio::null())
            .stdout(file)
            .stderr(errors)
            .process_group(0)
            .spawn()
            .map_err(|error| format!("nsenter: {error}"))
    }

    /// What the commands in the background have printed, for a failure.
    fn what_runs(&self) -> String {
        self.background.iter().map(|it| format!("\nin the background:\n{}", it.printed())).collect()
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.background.clear();
        drop(self.network.stdin.take());
        let _ = self.network.wait();
    }
}

impl Running {
    fn printed(&self) -> String {
        fs::read_to_string(&self.output).unwrap_or_default()
    }

    fn signal(&self, signal: Signal) {
        let group = Pid::from_child(&self.child);
        // It may have ended.
        let _ = kill_process_group(group, signal);
    }

    /// Ctrl-C.
    fn end(mut self) -> Result<(), String> {
        self.signal(Signal::INT);
        let limit = Limit::start();
        while self.child.try_wait().map_err(|error| error.to_string())?.is_none() {
            if limit.is_over() {
                return Err(format!("does not end on Ctrl-C:\n{}", self.printed()));
            }
            std::thread::sleep(LOOK_AGAIN);
        }
        Ok(())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.signal(Signal::KILL);
        let _ = self.child.wait();
    }
}
