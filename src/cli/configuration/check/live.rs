//! `telltale check --live`: the configuration beside the running system.

use std::time::Duration;

use crate::cli::configuration::init::{self, listening};
use crate::cli::process::{dds, log};
use crate::config::Loaded;
use crate::onboarding::live::{self, Comparison};
use crate::yaml::Problems;

/// How long, and where, to listen.
#[derive(Debug, clap::Args)]
#[command(mut_args(|arg| match arg.get_id().as_str() {
    "length" | "domain" | "interface" | "peers" | "dds_memory" => arg.requires("live"),
    _ => arg,
}))]
pub struct LiveArgs {
    /// Listen to the running ROS 2 system too, and list the names in the configuration that are not there and the
    /// parts of the robot that nothing watches
    #[arg(long, conflicts_with_all = ["dot", "svg", "schema"])]
    pub live: bool,
    /// With `--live`: how long to listen once everybody had time to be found
    #[arg(long = "for", value_name = "TIME", default_value = "10s", value_parser = listening)]
    length: Duration,
    #[command(flatten)]
    pub dds: dds::DdsFlags,
}

/// The comparison of a configuration with the running system.
pub struct Beside {
    pub comparison: Comparison,
    pub problems: Option<Problems>,
    listened_s: u64,
    listens_to: String,
}

/// Listens, and compares.
///
/// # Errors
/// DDS cannot be started, or a signal ended it.
pub fn look(args: &LiveArgs, loaded: &Loaded) -> anyhow::Result<Beside> {
    log::start("warn");
    let mut options = args.dds.resolve()?;
    options.definitions = options.definitions.with(&loaded.message_folders);
    let listens_to = dds::describe(&options);
    let heard = init::listen(options, args.length, Some(loaded.model.watched.diagnostics.clone()))?;
    let mut comparison = live::compare(loaded, &heard);
    let problems = std::mem::take(&mut comparison.problems);
    let problems = (!problems.is_empty()).then(|| Problems::new(loaded.sources().clone(), problems));
    Ok(Beside { comparison, problems, listened_s: heard.length_s(), listens_to })
}

impl Beside {
    /// Whether all is there that the configuration names.
    pub fn is_whole(&self) -> bool {
        self.comparison.absent == 0
    }

    /// For people, one line each.
    pub fn lines(&self) -> Vec<String> {
        let Comparison { absent, undecided, unwatched, .. } = &self.comparison;
        let heard = format!("Listened to {} for {} s", self.listens_to, self.listened_s);
        let found = match (self.comparison.nobody, absent) {
            (true, _) => "nobody was found".to_owned(),
            (false, 0) => "all is there that the file names".to_owned(),
            (false, 1) => "1 name of the file is not there or stands for something else".to_owned(),
            (false, many) => format!("{many} names of the file are not there or stand for something else"),
        };
        let mut lines = vec![format!("{heard}: {found}.")];
        lines.extend(unwatched.sentences());
        if !undecided.is_empty() {
            let names = live::listed(undecided.iter().map(|name| &**name));
            lines.push(format!(
                "Not heard, and not judged, because that takes a longer listening (`--for`): {names}"
            ));
        }
        lines
    }

    /// For programs.
    pub fn json(&self) -> serde_json::Value {
        let Comparison { absent, undecided, unwatched, nobody, .. } = &self.comparison;
        serde_json::json!({
            "listened_s": self.listened_s,
            "nobody": nobody,
            "absent": absent,
            "not_judged": undecided,
            "unwatched": {
                "statuses": unwatched.statuses,
                "forgotten_statuses": unwatched.forgotten,
                "topics": unwatched.topics,
                "unsteady_topics": unwatched.unsteady,
                "nodes": unwatched.nodes,
                "diagnostics": unwatched.diagnostics,
            },
        })
    }
}
