//! `telltale init`: writes a first configuration of a running system.

#[cfg(test)]
mod tests;
pub mod unconfigured;
mod update;

use std::collections::BTreeSet;
use std::fs::OpenOptions;
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, anyhow, bail};
use tokio::sync::{mpsc, watch};

use crate::cli::print::{self, note};
use crate::cli::process::shutdown_signal::ShutdownSignal;
use crate::cli::process::{dds, log};
use crate::cli::{EXIT_NO, fields};
use crate::clock::Clock;
use crate::config;
use crate::config::describe::words::counted;
use crate::engine::discovery::Discovery;
use crate::engine::model::monitors::{DiagnosticsTopic, FieldKind, FieldSpec, TopicSpec, Watched};
use crate::engine::model::{Model, Parts, StageModel};
use crate::engine::time::Timestamp;
use crate::msg::fields::Definitions;
use crate::msg::received::Stamped;
use crate::onboarding::init::{self, Draft, Observations, TOPICS_MAX};
use crate::onboarding::live::Heard;
use crate::ros::{self, Bridge, BridgeOptions, DIAGNOSTICS, Transport};

/// Its name in the graph of ROS 2.
const NODE: &str = "telltale_init";
/// What discovery needs to find everybody.
const DISCOVERY: Duration = Duration::from_secs(4);
/// Inputs that may wait; then the library keeps the newest messages.
const QUEUE: usize = 4096;

/// Look at a running ROS 2 system and write a first configuration.
///
/// It listens for a while and changes nothing. The file has a group for each namespace or node, the statuses that were
/// heard, and monitors of the rates and ages that were measured, of batteries, emergency stops and actions, each with its
/// evidence as a comment. Which part depends on which is a guess from the graph of publishers and subscribers, and a
/// comment too.
///
/// Every topic is read meanwhile, large ones too: over a slow network that takes its share of it. Let the robot do
/// what it usually does; what rests is not measured.
///
/// The exit code is 1 if nothing was heard; a file to begin with is written all the same.
///
/// `--update` adds to an existing configuration the statuses, topics and nodes that were heard and that nothing in it
/// watches, each addition below a line that says when it was heard. The text of the file stays as it is. A name in the
/// file that was not heard is told, and the exit code is 1.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  telltale init -o robot.yaml && telltale serve --config robot.yaml\n  \
    telltale init --domain 7 --interface loopback --for 30s > robot.yaml\n  \
    telltale init --update robot.yaml | diff robot.yaml -\n  \
    telltale init --update robot.yaml -o robot.yaml")]
pub struct Args {
    /// How long to listen once everybody had time to be found
    #[arg(long = "for", value_name = "TIME", default_value = "10s", value_parser = listening)]
    length: Duration,
    /// The file to write, which must not exist, or is the one of `--update` [default: standard output]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// The configuration to which new modules and groups are added
    #[arg(long, value_name = "FILE")]
    update: Option<PathBuf>,
    /// Put the dependencies in force that the graph suggests
    #[arg(long, conflicts_with = "update")]
    accept_guesses: bool,
    #[command(flatten)]
    dds: dds::DdsFlags,
}

pub(super) fn listening(text: &str) -> Result<Duration, String> {
    let length = humantime::parse_duration(text).map_err(|error| format!("{error}; write it as `10s`"))?;
    let (least, most) = (Duration::from_secs(1), Duration::from_secs(3600));
    if (least..=most).contains(&length) { Ok(length) } else { Err("choose from 1s to 1h".to_owned()) }
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    log::start("warn");
    if let Some(file) = &args.update {
        return update::run(args, file);
    }
    if let Some(file) = args.output.as_deref().filter(|file| file.exists()) {
        return Err(refusal(file));
    }
    let options = args.dds.resolve()?;
    let (listens_to, transport) = (dds::describe(&options), options.transport);
    let definitions = options.definitions.clone();
    let heard = listen(options, args.length, None)?;
    let (mut draft, empty) = (heard.draft, heard.seen.is_empty());
    draft.message_folders = message_folders(&draft, &definitions);
    let text = init::text(&draft, args.accept_guesses);
    let mut is_wrong = false;
    // As `check` and `serve` read the file, which know nothing of the flags here.
    let known = Definitions::default();
    let examined = config::examine_from("the draft", text.as_bytes());
    if let Err(problems) = fields::whole(examined, |loaded| known.with(&loaded.message_folders)) {
        is_wrong = true;
        print::problems(&problems);
        note!(
            "telltale: this is a fault of `telltale init`; please report it. The draft is written all the same."
        );
    }
    match &args.output {
        Some(file) => write(file, &text)?,
        None => drop(print::text(&text)),
    }
    tell(&draft, empty, (&listens_to, transport), args.output.as_deref());
    Ok(ExitCode::from(if empty || is_wrong { EXIT_NO } else { 0 }))
}

/// The folders, as whole paths, that define the types of the measured topics that are not built in.
fn message_folders(draft: &Draft, definitions: &Definitions) -> Vec<String> {
    let built_in = Definitions::default();
    let types = draft.types().into_iter().filter(|(type_name, stamp)| !built_in.knows(type_name, *stamp));
    let folders: BTreeSet<&Path> =
        types.flat_map(|(type_name, _)| definitions.folders_of(type_name)).collect();
    let whole = |folder: &Path| std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    folders.into_iter().map(|folder| whole(folder).display().to_string()).collect()
}

/// Listens to a system for a while: on the topics of diagnostics of a configuration, or else on all that are found.
///
/// # Errors
/// DDS cannot be started, or a signal ended it.
pub(super) fn listen(
    options: BridgeOptions,
    length: Duration,
    diagnostics: Option<Vec<DiagnosticsTopic>>,
) -> anyhow::Result<Heard> {
    note!("Listens to {} for {} s.", dds::describe(&options), (DISCOVERY + length).as_secs());
    let runtime = tokio::runtime::Runtime::new().context("the async runtime cannot be started")?;
    runtime.block_on(async {
        let mut signal = ShutdownSignal::listen()?;
        let look = async {
            let mut lookout = Lookout::open(options, true, diagnostics).await?;
            lookout.listen(DISCOVERY + length).await?;
            anyhow::Ok(lookout.close().await)
        };
        tokio::select! {
            looked = look => looked,
            _ = signal.requested() => bail!("interrupted before the end"),
        }
    })
}

/// Listens to a system and remembers what it heard.
pub(super) struct Lookout {
    bridge: Bridge,
    inputs: mpsc::Receiver<Stamped>,
    discovery: watch::Receiver<Arc<Discovery>>,
    seen: Observations,
    watched: Watched,
    /// Topics are read, too.
    measures: bool,
    /// The topics of diagnostics that a configuration names: no others are read. `None`: all that are found.
    given: Option<Vec<DiagnosticsTopic>>,
    definitions: Definitions,
    clock: Clock,
    start: Timestamp,
}

impl Lookout {
    /// # Errors
    /// DDS cannot be started.
    pub async fn open(
        options: BridgeOptions,
        measures: bool,
        given: Option<Vec<DiagnosticsTopic>>,
    ) -> anyhow::Result<Lookout> {
        let options = BridgeOptions { node: NODE, ..options };
        let clock = Clock::start();
        let definitions = options.definitions.clone();
        let (sender, inputs) = mpsc::channel(QUEUE);
        let watched = Watched { diagnostics: given.clone().unwrap_or_default(), ..Watched::default() };
        let bridge = ros::start(options, &model(watched.clone()), sender, clock).await?;
        let (discovery, start) = (bridge.discovery(), clock.now());
        let seen = Observations::default();
        Ok(Lookout { bridge, inputs, discovery, seen, watched, measures, given, definitions, clock, start })
    }

    /// # Errors
    /// A topic cannot be read.
    pub async fn listen(&mut self, length: Duration) -> anyhow::Result<()> {
        let mut over = std::pin::pin!(tokio::time::sleep(length));
        loop {
            tokio::select! {
                () = &mut over => return Ok(()),
                Some(stamped) = self.inputs.recv() => self.seen.take(&stamped.input, stamped.received),
                Ok(()) = self.discovery.changed() => {
                    self.seen.see(self.discovery.borrow_and_update().clone());
                    let wanted = self.wanted();
                    if wanted != self.watched {
                        self.bridge.follow(&model(wanted.clone()))?;
                        self.watched = wanted;
                    }
                }
            }
        }
    }

    pub fn draft(&self) -> Draft {
        init::draft(&self.seen, self.start, self.clock.now())
    }

    async fn close(self) -> Heard {
        let end = self.clock.now();
        self.bridge.shutdown().await;
        Heard::of(self.seen, self.start, end)
    }

    /// What is to be read now: what was read before, and what was found since.
    fn wanted(&self) -> Watched {
        let mut topics = self.watched.topics.clone();
        let known: BTreeSet<Box<str>> = topics.iter().map(|spec| spec.topic.clone()).collect();
        let new = self.seen.measurable().filter(|(topic, _)| self.measures && !known.contains(*topic));
        topics.extend(new.filter_map(|(topic, type_name)| readable(topic, type_name, &self.definitions)));
        topics.truncate(TOPICS_MAX);
        let all = || std::iter::once(DIAGNOSTICS.to_owned()).chain(self.seen.more_diagnostics());
        let found = || all().map(|topic| DiagnosticsTopic { topic: topic.into(), prefix: Box::default() });
        let diagnostics = self.given.clone().unwrap_or_else(|| found().collect());
        Watched { topics, diagnostics, ..Watched::default() }
    }
}

/// A topic with its stamps and what tells its messages apart, if its type has them.
fn readable(topic: &str, type_name: &str, definitions: &Definitions) -> Option<Arc<TopicSpec>> {
    let whole = || FieldSpec::new("", FieldKind::Content);
    let spec = |(stamp, content): (bool, bool)| TopicSpec {
        topic: topic.into(),
        type_name: type_name.into(),
        stamp,
        fields: content
            .then(whole)
            .into_iter()
            .chain(init::more_fields(type_name).filter(|_| content))
            .collect(),
    };
    let ways = [(true, true), (false, true), (true, false), (false, false)];
    ways.map(spec).into_iter().find(|spec| definitions.check(spec).is_ok()).map(Arc::new)
}

/// The bridge reads what a model names.
fn model(watched: Watched) -> Arc<Model> {
    let parts = Parts { watched, ..Parts::empty("init", StageModel::None) };
    Arc::new(Model::new(parts).unwrap_or_else(|_| unreachable!("nothing in it depends on anything")))
}

fn refusal(file: &Path) -> anyhow::Error {
    anyhow!("{} exists and is not overwritten: name another file with -o", file.display())
}

fn write(file: &Path, text: &str) -> anyhow::Result<()> {
    let mut opened =
        OpenOptions::new().write(true).create_new(true).open(file).map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => refusal(file),
            _ => anyhow::Error::new(error).context(format!("{} cannot be written", file.display())),
        })?;
    opened.write_all(text.as_bytes()).with_context(|| format!("{} cannot be written", file.display()))
}

fn tell(draft: &Draft, empty: bool, (listens_to, transport): (&str, Transport), output: Option<&Path>) {
    if empty {
        let reached = match transport {
            Transport::Dds => {
                "Is it reached over this interface (--interface), or only without multicast (--peer)? Does a firewall \
                 drop UDP?"
            }
            Transport::Zenoh => "Does its router run, and does ZENOH_CONFIG_OVERRIDE name it?",
        };
        note!(
            "Nothing was heard: no other participant was found on {listens_to}. Does the robot run, with the same \
             ROS_DOMAIN_ID (--domain)? {reached} The file takes whatever comes."
        );
    } else {
        let modules: usize = draft.groups.iter().map(|group| group.modules.len()).sum();
        let modules_with = draft.groups.iter().flat_map(|group| &group.modules);
        let proposals = modules_with.flat_map(|it| &it.proposals).filter(|it| !it.circular).count();
        note!(
            "{} with {}. {} from the graph: see the comments at `depends_on`.",
            counted(draft.groups.len(), "group"),
            counted(modules, "module"),
            counted(proposals, "guessed dependency").replace("dependencys", "dependencies"),
        );
        draft.notes.iter().for_each(|note| note!("{note}"));
    }
    if let Some(file) = output.map(Path::display) {
        note!("Next: `telltale check {file}`, then `telltale serve --config {file}`.");
    }
}
