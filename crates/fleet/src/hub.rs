//! The hub as its people set it up: the configuration of nats-server, who may use it, and its streams.
//!
//! nats-server reads `nats-server.conf`, which includes `accounts.conf`. That is written anew with each vehicle that is
//! enrolled or revoked, from `users.json`; nats-server takes it with a SIGHUP and closes the lines of the revoked.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use async_nats::Client;
use serde::{Deserialize, Serialize};

use crate::connection;
use crate::fetching::PIECES_STREAM;
use crate::gate::Pace;
use crate::identity::Identity;
use crate::line::{Hub, LOG_STREAM, Subjects, inbox};
use crate::message::{BATCH_BYTES_MAX, VehicleId};
use crate::reading::HEAD_STREAM;

/// The configuration of nats-server.
pub const CONFIG_FILE: &str = "nats-server.conf";
/// The accounts in it.
const ACCOUNTS_FILE: &str = "accounts.conf";
/// The private key of consoles.
pub const CONSOLE_KEY_FILE: &str = "console.nk";
/// The number of the process of nats-server, while it runs.
const PID_FILE: &str = "nats-server.pid";
/// Who is enrolled.
const LIST_FILE: &str = "users.json";

/// nats-server takes a signal off its queue within this time, and then works on it.
const SIGNALS_APART: Duration = Duration::from_millis(200);

/// Vehicles of one hub.
pub const VEHICLES_MAX: usize = 10_000;

/// Bytes on the hub's disk: the 14 days of eighty vehicles in their logs, and a quarter for pieces of recordings.
pub const DISK_BYTES: u64 = 10_000_000_000;

/// Bytes of the list that are read.
const LIST_BYTES_MAX: u64 = 4 << 20;

/// Bytes of a message on any subject, with its headers.
const PAYLOAD_BYTES_MAX: usize = BATCH_BYTES_MAX + 16 * 1024;

#[derive(Debug, thiserror::Error)]
pub enum HubError {
    #[error("{}: {reason}", .path.display())]
    File { path: PathBuf, reason: io::Error },
    #[error("{} cannot be read: {reason}", .path.display())]
    List { path: PathBuf, reason: serde_json::Error },
    #[error("{} is no folder of a hub: `telltale fleet hub-config` makes one", .0.display())]
    NoHub(PathBuf),
    #[error("{0} is enrolled already: revoke it first")]
    Enrolled(VehicleId),
    #[error("{0} is not enrolled")]
    NotEnrolled(VehicleId),
    #[error("{VEHICLES_MAX} vehicles are enrolled, which is the most")]
    Full,
    #[error("the hub: {0}")]
    Line(String),
}

/// The folder of a hub.
#[derive(Debug)]
pub struct HubFolder {
    path: PathBuf,
    users: Users,
}

#[derive(Debug, Serialize, Deserialize)]
struct Users {
    /// The public key of consoles.
    console: String,
    /// The public keys of vehicles.
    vehicles: BTreeMap<String, String>,
}

/// Where nats-server listens, and its certificate.
#[derive(Debug, Clone, Copy)]
pub struct Server<'a> {
    /// `0.0.0.0:4222`
    pub listen: &'a str,
    pub certificate: &'a Path,
    pub key: &'a Path,
    /// What logs and pieces of recordings take on its disk.
    pub disk_bytes: u64,
}

impl HubFolder {
    /// Writes a configuration into a folder, with a key for consoles.
    ///
    /// # Errors
    /// There is one already, or the disk does not take it.
    pub fn make(path: &Path, server: Server<'_>) -> Result<HubFolder, HubError> {
        let key_file = path.join(CONSOLE_KEY_FILE);
        let key = Identity::make(&key_file).map_err(|reason| HubError::File { path: key_file, reason })?;
        let users = Users { console: key.public().to_owned(), vehicles: BTreeMap::new() };
        let folder = HubFolder { path: path.to_owned(), users };
        folder.write(CONFIG_FILE, &config(server))?;
        folder.write_users()?;
        Ok(folder)
    }

    /// # Errors
    /// There is none, or it cannot be read.
    pub fn open(path: &Path) -> Result<HubFolder, HubError> {
        let list = path.join(LIST_FILE);
        let file = match File::open(&list) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Err(HubError::NoHub(path.to_owned()));
            }
            Err(reason) => return Err(HubError::File { path: list, reason }),
        };
        let users = serde_json::from_reader(io::Read::take(file, LIST_BYTES_MAX))
            .map_err(|reason| HubError::List { path: list, reason })?;
        Ok(HubFolder { path: path.to_owned(), users })
    }

    /// Admits a vehicle, and makes the file with its private key.
    ///
    /// # Errors
    /// It is enrolled already, or the disk does not take it.
    pub fn enrol(&mut self, id: &VehicleId, key_file: &Path) -> Result<(), HubError> {
        if self.users.vehicles.contains_key(id.as_str()) {
            return Err(HubError::Enrolled(id.clone()));
        }
        if self.users.vehicles.len() >= VEHICLES_MAX {
            return Err(HubError::Full);
        }
        let made = Identity::make(key_file);
        let key = made.map_err(|reason| HubError::File { path: key_file.to_owned(), reason })?;
        self.users.vehicles.insert(id.as_str().to_owned(), key.public().to_owned());
        self.write_users()
    }

    /// Admits a vehicle no more.
    ///
    /// # Errors
    /// It is not enrolled, or the disk does not take it.
    pub fn revoke(&mut self, id: &VehicleId) -> Result<(), HubError> {
        if self.users.vehicles.remove(id.as_str()).is_none() {
            return Err(HubError::NotEnrolled(id.clone()));
        }
        self.write_users()
    }

    /// Lets nats-server take the users, if it runs in this folder. `false`: it does not.
    ///
    /// # Errors
    /// It may not be told.
    pub fn reload(&self) -> io::Result<bool> {
        let Ok(text) = fs::read_to_string(self.path.join(PID_FILE)) else { return Ok(false) };
        let pid = text.trim().parse().ok().and_then(rustix::process::Pid::from_raw);
        // After a crash the number may be that of any other program.
        let name =
            |pid: &rustix::process::Pid| fs::read_to_string(format!("/proc/{}/comm", pid.as_raw_nonzero()));
        let Some(pid) = pid.filter(|pid| name(pid).is_ok_and(|it| it.trim() == "nats-server")) else {
            return Ok(false);
        };
        // nats-server 2.15 gives a new account its imports with the second reload. Signals that wait are one.
        rustix::process::kill_process(pid, rustix::process::Signal::HUP)?;
        std::thread::sleep(SIGNALS_APART);
        rustix::process::kill_process(pid, rustix::process::Signal::HUP)?;
        Ok(true)
    }

    /// The enrolled vehicles with their public keys.
    pub fn vehicles(&self) -> impl Iterator<Item = (&str, &str)> {
        self.users.vehicles.iter().map(|(id, key)| (id.as_str(), key.as_str()))
    }

    fn write_users(&self) -> Result<(), HubError> {
        let list = serde_json::to_string_pretty(&self.users).expect("texts are JSON");
        self.write(LIST_FILE, &list)?;
        self.write(ACCOUNTS_FILE, &accounts(&self.users))
    }

    /// Writes a file whole or not at all.
    fn write(&self, name: &str, text: &str) -> Result<(), HubError> {
        let path = self.path.join(name);
        let new = path.with_added_extension("new");
        let written = File::create(&new)
            .and_then(|mut file| {
                file.write_all(text.as_bytes())?;
                file.sync_all()
            })
            .and_then(|()| fs::rename(&new, &path));
        written.map_err(|reason| HubError::File { path, reason })
    }
}

/// Makes the streams of a running hub, with the identity of consoles. Streams that are there stay as they are.
///
/// # Errors
/// The hub is not reached, or does not make them.
pub async fn make_streams(hub: &Hub, console: &Identity, disk_bytes: u64) -> Result<(), HubError> {
    let line = |error: &dyn std::fmt::Display| HubError::Line(error.to_string());
    let options = connection::options(console, "console");
    let (client, _gate) = connection::open(hub, Pace::Any, options).await.map_err(|error| line(&error))?;
    for (name, stream) in streams(disk_bytes) {
        make(&client, name, &stream).await?;
    }
    Ok(())
}

/// Makes the stream of heads if it is not there: it is in the hub's memory, and gone after a restart.
pub(crate) async fn make_heads(client: &Client) -> Result<(), HubError> {
    let [(name, stream), ..] = streams(DISK_BYTES);
    make(client, name, &stream).await
}

/// Makes a stream. One that is there stays as it is.
async fn make(client: &Client, name: &str, stream: &serde_json::Value) -> Result<(), HubError> {
    if has(client, name).await? {
        return Ok(());
    }
    match ask(client, format!("$JS.API.STREAM.CREATE.{name}"), stream.to_string()).await? {
        Some(fault) => Err(HubError::Line(format!("the stream {name}: {}", fault.description))),
        None => Ok(()),
    }
}

/// Whether a stream is there.
pub(crate) async fn has(client: &Client, name: &str) -> Result<bool, HubError> {
    Ok(ask(client, format!("$JS.API.STREAM.INFO.{name}"), String::new()).await?.is_none())
}

/// Asks JetStream, and returns its error.
async fn ask(client: &Client, subject: String, body: String) -> Result<Option<Fault>, HubError> {
    let line = |error: &dyn std::fmt::Display| HubError::Line(error.to_string());
    let answer = client.request(subject, body.into()).await.map_err(|error| line(&error))?;
    let answer: Answer = serde_json::from_slice(&answer.payload).map_err(|error| line(&error))?;
    Ok(answer.error)
}

/// An answer of JetStream.
#[derive(Debug, Deserialize)]
struct Answer {
    error: Option<Fault>,
}

#[derive(Debug, Deserialize)]
struct Fault {
    description: String,
}

/// The streams: heads, logs and pieces of recordings.
fn streams(disk_bytes: u64) -> [(&'static str, serde_json::Value); 3] {
    let days_14_ns = 14_u64 * 24 * 3600 * 1_000_000_000;
    [
        (
            HEAD_STREAM,
            serde_json::json!({
                "name": HEAD_STREAM, "subjects": ["tt.1.*.head"], "storage": "memory", "retention": "limits",
                "max_msgs_per_subject": 1, "max_bytes": 256 << 20, "max_msg_size": PAYLOAD_BYTES_MAX,
                "discard": "old", "allow_direct": true,
            }),
        ),
        (
            LOG_STREAM,
            serde_json::json!({
                "name": LOG_STREAM, "subjects": ["tt.1.*.log"], "storage": "file", "retention": "limits",
                "max_age": days_14_ns, "max_bytes": disk_bytes / 4 * 3, "max_msgs_per_subject": 200_000,
                "max_msg_size": PAYLOAD_BYTES_MAX, "discard": "old", "allow_direct": true,
            }),
        ),
        (
            PIECES_STREAM,
            // A console removes pieces when it has read them. Those that none wants leave as logs do.
            serde_json::json!({
                "name": PIECES_STREAM, "subjects": ["tt.1.*.inc.*.*"], "storage": "file", "retention": "limits",
                "max_bytes": disk_bytes / 4, "max_msg_size": 80 * 1024, "discard": "new",
                "max_age": days_14_ns, "allow_direct": true,
            }),
        ),
    ]
}

fn config(Server { listen, certificate, key, disk_bytes }: Server<'_>) -> String {
    let (certificate, key) = (quoted(certificate), quoted(key));
    format!(
        "# The hub of a Telltale fleet, for nats-server 2.14 or later. Written by `telltale fleet hub-config`.
listen: \"{listen}\"
server_name: telltale-hub
pid_file: \"{PID_FILE}\"
max_payload: {PAYLOAD_BYTES_MAX}
max_connections: {}
tls {{ cert_file: {certificate}, key_file: {key}, timeout: 10 }}
jetstream {{
  store_dir: store
  max_memory_store: 512MB
  max_file_store: {}
  # What is acknowledged reaches the disk within two minutes; vehicles keep it for ten. `always` makes each
  # acknowledgement durable, and the hub several times slower.
  # sync_interval: always
}}
accounts {{
  include \"{ACCOUNTS_FILE}\"
}}
",
        VEHICLES_MAX + 100,
        disk_bytes + disk_bytes / 16,
    )
}

fn quoted(path: &Path) -> String {
    format!("\"{}\"", path.display().to_string().replace('\\', "\\\\").replace('"', "\\\""))
}

/// The accounts: that of the fleet, with the streams and the consoles, and one of each vehicle. A vehicle tells of itself and
/// hears the wishes to itself, and nothing else. Its account matters: within one account, JetStream sends its answers to any
/// subject that a request names, so a vehicle could have its own message sent on as another vehicle's, or as an order to
/// remove a stream. Between accounts an answer goes back to the account that asked.
fn accounts(users: &Users) -> String {
    let mut text = String::from("# Written by `telltale fleet enrol` and `telltale fleet revoke`.\n");
    let (last, console) = (Subjects::with("*").own_last(), inbox("console"));
    let Subjects { head, log, live, want, inc } = Subjects::with("*");
    let _ = writeln!(
        text,
        "FLEET {{
  jetstream: enabled
  users: [{{ nkey: {}, permissions: {{ publish: [\"$JS.API.>\", \"$JS.ACK.>\", \"{want}\"], \
         subscribe: [\"{console}.>\", \"tt.1.>\"] }} }}]
  exports: [{{ service: \"{head}\" }}, {{ service: \"{log}\" }}, {{ service: \"{inc}.>\" }}, \
         {{ service: \"{live}\" }}, {{ service: \"{last}\" }}, {{ stream: \"{want}\" }}]
}}",
        users.console
    );
    for (id, key) in &users.vehicles {
        let Some(id) = VehicleId::new(id) else { continue };
        let own = Subjects::of(&id);
        let tells =
            [own.head.clone(), own.log.clone(), format!("{}.>", own.inc), own.live.clone(), own.own_last()];
        let (want, inbox) = (own.want, inbox(id.as_str()));
        let publish = tells.each_ref().map(|it| format!("\"{it}\"")).join(", ");
        let imports =
            tells.map(|it| format!("{{ service: {{ account: FLEET, subject: \"{it}\" }} }}")).join(", ");
        let _ = writeln!(
            text,
            "\"vehicle-{id}\" {{
  users: [{{ nkey: {key}, permissions: {{ publish: [{publish}], subscribe: [\"{want}\", \"{inbox}.>\"] }} }}]
  imports: [{imports}, {{ stream: {{ account: FLEET, subject: \"{want}\" }} }}]
}}"
        );
    }
    text
}
