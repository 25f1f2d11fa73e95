//! nats-server as a child process, and a console that reads what lies there.

use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::time::Duration;

use async_nats::{Client, ConnectOptions};
use serde_json::Value;
use telltale_fleet::history::History;
use telltale_fleet::hub::{CONFIG_FILE, CONSOLE_KEY_FILE, HubFolder, Server, make_streams};
use telltale_fleet::identity::Identity;
use telltale_fleet::line;
use telltale_fleet::message::{Batch, Content, Head, VehicleId};
use tempfile::TempDir;

#[path = "nats_server.rs"]
mod nats_server;

/// Nothing here takes longer, even on a busy machine.
const PATIENCE: Duration = Duration::from_secs(30);

/// The pause between two looks for a condition.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// The result of what must not take long.
pub async fn until<T>(what: &str, future: impl Future<Output = T>) -> T {
    let result = tokio::time::timeout(PATIENCE, future).await;
    result.unwrap_or_else(|_| panic!("{what} does not come"))
}

/// Of each hub, so that all fit beside one another.
const DISK_BYTES: u64 = 64 << 20;

/// A hub of its own for one test.
pub struct Hub {
    folder: TempDir,
    configured: HubFolder,
    port: u16,
    process: Option<Child>,
}

impl Hub {
    pub async fn start(name: &str) -> Hub {
        Hub::start_of(name, &[]).await
    }

    /// With these vehicles enrolled.
    pub async fn start_of(name: &str, ids: &[String]) -> Hub {
        let mut hub = Hub::configured(name);
        for id in ids {
            hub.configured.enrol(&VehicleId::new(id).unwrap(), &hub.key_file(id)).unwrap();
        }
        hub.start_again().await;
        let console = Identity::read(&hub.key_file("console")).unwrap();
        for _ in 0..2 {
            until("the streams", make_streams(&hub.address(), &console, DISK_BYTES)).await.unwrap();
        }
        hub
    }

    /// Three nodes of one hub, which all keep every log, and an enrolled vehicle `a`.
    pub async fn start_cluster(name: &str) -> [Hub; 3] {
        let mut first = Hub::configured(name);
        first.configured.enrol(&VehicleId::new("a").unwrap(), &first.key_file("a")).unwrap();
        let routes = [(); 3].map(|()| free_port());
        let others: Vec<String> = routes.iter().map(|port| format!("nats://127.0.0.1:{port}")).collect();
        let mut nodes = [(); 3].map(|()| {
            let folder = tempfile::Builder::new().prefix(&format!("hub-{name}-")).tempdir().unwrap();
            copy(first.folder.path(), folder.path());
            let configured = HubFolder::open(folder.path()).unwrap();
            Hub { folder, configured, port: free_port(), process: None }
        });
        for (node, route) in nodes.iter().zip(routes) {
            let file = node.folder.path().join(CONFIG_FILE);
            let config = fs::read_to_string(&file).unwrap();
            let config = config.replace(&first.port.to_string(), &node.port.to_string());
            let config =
                config.replace("server_name: telltale-hub", &format!("server_name: {}", node.node_name()));
            let cluster =
                format!("cluster {{ name: fleet, listen: \"127.0.0.1:{route}\", routes: {others:?} }}\n");
            fs::write(file, config + &cluster).unwrap();
        }
        for node in &mut nodes {
            node.start_again().await;
        }
        let console = Identity::read(&first.key_file("console")).unwrap();
        let made = async {
            // The nodes elect their first leader.
            while make_streams(&nodes[0].address(), &console, DISK_BYTES).await.is_err() {
                tokio::time::sleep(LOOK_EVERY).await;
            }
            nodes[0].console().await.replicate_logs().await;
        };
        until("the streams of the cluster", made).await;
        nodes
    }

    /// In a cluster.
    pub fn node_name(&self) -> String {
        format!("node-{}", self.port)
    }

    /// Its folder, and no process.
    fn configured(name: &str) -> Hub {
        let folder = tempfile::Builder::new().prefix(&format!("hub-{name}-")).tempdir().unwrap();
        let port = free_port();
        let key = rcgen::KeyPair::generate().unwrap();
        let names = vec!["localhost".to_owned(), "127.0.0.1".to_owned()];
        let certificate = rcgen::CertificateParams::new(names).unwrap().self_signed(&key).unwrap();
        fs::write(folder.path().join("hub.pem"), certificate.pem()).unwrap();
        fs::write(folder.path().join("hub-key.pem"), key.serialize_pem()).unwrap();
        let listen = format!("127.0.0.1:{port}");
        let server = Server {
            listen: &listen,
            certificate: Path::new("hub.pem"),
            key: Path::new("hub-key.pem"),
            disk_bytes: DISK_BYTES,
        };
        let configured = HubFolder::make(folder.path(), server).unwrap();
        Hub { folder, configured, port, process: None }
    }

    pub fn address(&self) -> line::Hub {
        line::Hub { url: format!("tls://127.0.0.1:{}", self.port), ca: self.folder.path().join("hub.pem") }
    }

    pub fn key_file(&self, id: &str) -> PathBuf {
        self.folder.path().join(format!("{id}.nk"))
    }

    pub async fn start_again(&mut self) {
        let log = self.folder.path().join("log");
        let process = nats_server::start(self.folder.path(), CONFIG_FILE, &log);
        self.process = Some(process);
        until("the start of nats-server", async {
            while !fs::read_to_string(&log).unwrap().contains("Server is ready") {
                let ended = self.process.as_mut().unwrap().try_wait().unwrap();
                assert!(ended.is_none(), "nats-server ended: {}", fs::read_to_string(&log).unwrap());
                tokio::time::sleep(LOOK_EVERY).await;
            }
        })
        .await;
    }

    pub fn kill(&mut self) {
        if let Some(mut process) = self.process.take() {
            process.kill().unwrap();
            process.wait().unwrap();
        }
    }

    pub fn enrol(&mut self, id: &str) {
        let file = self.key_file(id);
        let _ = fs::remove_file(&file);
        self.configured.enrol(&VehicleId::new(id).unwrap(), &file).unwrap();
        self.reload();
    }

    pub fn revoke(&mut self, id: &str) {
        self.configured.revoke(&VehicleId::new(id).unwrap()).unwrap();
        self.reload();
    }

    /// Returns when nats-server has taken it.
    fn reload(&self) {
        let log = || fs::read_to_string(self.folder.path().join("log")).unwrap();
        let taken = |log: &str| log.matches("Reloaded server configuration").count();
        let before = taken(&log());
        assert!(self.configured.reload().unwrap(), "it runs");
        let looks = PATIENCE.as_millis() / LOOK_EVERY.as_millis();
        for _ in 0..looks {
            if taken(&log()) > before + 1 {
                return;
            }
            std::thread::sleep(LOOK_EVERY);
        }
        panic!("nats-server does not take the users: {}", log());
    }

    fn store(&self) -> PathBuf {
        self.folder.path().join("store")
    }

    pub fn copy_store(&self) {
        copy(&self.store(), &self.folder.path().join("copy"));
    }

    pub fn restore_store(&self) {
        fs::remove_dir_all(self.store()).unwrap();
        copy(&self.folder.path().join("copy"), &self.store());
    }

    pub async fn console(&self) -> Console {
        let seed = fs::read_to_string(self.folder.path().join(CONSOLE_KEY_FILE)).unwrap();
        let client = ConnectOptions::with_nkey(seed.trim().to_owned())
            .add_root_certificates(self.address().ca)
            .require_tls(true)
            .custom_inbox_prefix("_INBOX.console")
            .connect(self.address().url)
            .await
            .unwrap();
        Console { client }
    }
}

impl Drop for Hub {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Nobody else takes a port that was free a moment ago.
fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

pub struct Console {
    client: Client,
}

impl Console {
    /// What JetStream answers about the stream of logs.
    async fn ask(&self, what: &str, body: String) -> Value {
        let subject = format!("$JS.API.STREAM.{what}.LOG");
        let answer = self.client.request(subject, body.into()).await;
        answer.ok().and_then(|it| serde_json::from_slice(&it.payload).ok()).unwrap_or_default()
    }

    async fn replicate_logs(&self) {
        let mut config = self.ask("INFO", String::new()).await["config"].take();
        config["num_replicas"] = 3.into();
        while self.ask("UPDATE", config.to_string()).await["config"]["num_replicas"] != 3 {
            tokio::time::sleep(LOOK_EVERY).await;
        }
        let is_there = |node: &Value| node["current"] == true;
        while self.replicas().await.iter().filter(|node| is_there(node)).count() != 2 {
            tokio::time::sleep(LOOK_EVERY).await;
        }
    }

    async fn replicas(&self) -> Vec<Value> {
        self.ask("INFO", String::new()).await["cluster"]["replicas"].as_array().cloned().unwrap_or_default()
    }

    /// The node that leads the stream of logs.
    pub async fn leader(&self) -> String {
        loop {
            if let Some(leader) = self.ask("INFO", String::new()).await["cluster"]["leader"].as_str() {
                return leader.to_owned();
            }
            tokio::time::sleep(LOOK_EVERY).await;
        }
    }

    /// The messages of a vehicle, when they are as `is_it` wants them. None is missing, and no place is not known.
    pub async fn history_with(&self, id: &str, is_it: impl Fn(&[Content]) -> bool) -> Vec<Content> {
        let mut seen = Vec::new();
        let wait = async {
            loop {
                seen = self.contents(id).await;
                if is_it(&seen) {
                    return;
                }
                tokio::time::sleep(LOOK_EVERY).await;
            }
        };
        if tokio::time::timeout(PATIENCE, wait).await.is_err() {
            panic!("the history of {id} stays {seen:?}");
        }
        seen
    }

    /// The messages of a vehicle. None is missing, and no place is not known.
    pub async fn contents(&self, id: &str) -> Vec<Content> {
        let history = self.history(id).await;
        assert_eq!(history.unknown(), []);
        history.messages().map(|message| message.content.clone()).collect()
    }

    async fn history(&self, id: &str) -> History {
        let vehicle = VehicleId::new(id).unwrap();
        let mut history = History::default();
        let mut next = 1;
        loop {
            let wanted = format!(r#"{{"seq":{next},"next_by_subj":"tt.1.{id}.log"}}"#);
            let Ok(found) = self.client.request("$JS.API.DIRECT.GET.LOG", wanted.into()).await else {
                return history;
            };
            let Some(number) = found.headers.as_ref().and_then(|it| it.get("Nats-Sequence")) else {
                return history;
            };
            next = number.as_str().parse::<u64>().unwrap() + 1;
            let taken = history.take(Batch::unpack(&found.payload, &vehicle).unwrap());
            assert_eq!((taken.again, taken.contradictions), (0, 0), "each message lies there once");
        }
    }

    pub async fn head(&self, id: &str) -> Head {
        self.told_head(id).await.unwrap().1
    }

    /// When the head was told that is as `is_it` wants it.
    pub async fn head_when(&self, id: &str, is_it: impl Fn(i64, &Head) -> bool) -> i64 {
        until("the head", async {
            loop {
                match self.told_head(id).await {
                    Some((at, head)) if is_it(at, &head) => return at,
                    _ => tokio::time::sleep(LOOK_EVERY).await,
                }
            }
        })
        .await
    }

    pub async fn has_head(&self, id: &str) -> bool {
        let subject = format!("$JS.API.DIRECT.GET.HEAD.tt.1.{id}.head");
        self.client.request(subject, "".into()).await.unwrap().status.is_none()
    }

    /// With when it was told; `None` if the hub has none.
    async fn told_head(&self, id: &str) -> Option<(i64, Head)> {
        let subject = format!("$JS.API.DIRECT.GET.HEAD.tt.1.{id}.head");
        let found = self.client.request(subject, "".into()).await.ok().filter(|it| it.status.is_none())?;
        let batch = Batch::unpack(&found.payload, &VehicleId::new(id).unwrap()).unwrap();
        match batch.messages.into_iter().next().map(|message| (message.at, message.content)) {
            Some((at, Content::Head(head))) => Some((at, head)),
            other => panic!("no head: {other:?}"),
        }
    }

    pub async fn want(&self, id: &str, wish: &str) {
        self.client.publish(format!("tt.1.{id}.want"), wish.to_owned().into()).await.unwrap();
        self.client.flush().await.unwrap();
    }
}
