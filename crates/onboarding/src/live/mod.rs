//! A configuration beside the running system that it is for: its names that are not there, types and measurements that
//! differ, and parts of the robot that nothing watches. Pure: `cli` listens and prints.

mod discovered_names;
mod measured;
mod unwatched;

use std::collections::BTreeSet;
use std::sync::Arc;

use self::discovered_names::There;
pub use self::unwatched::Unwatched;
use crate::init::names::comment;
use crate::init::{Draft, Observations, STATUSES_MAX, draft};
use telltale_config::{Loaded, Named, What};
use telltale_engine::model::same_topic;
use telltale_engine::time::{Span, Timestamp};
use telltale_yaml::{Problem, suggest};

/// Names that one sentence lists.
const NAMES_MAX: usize = 20;

/// The observations between two times, and the draft that `init` makes of them.
pub struct Heard {
    pub seen: Observations,
    pub draft: Draft,
    pub start: Timestamp,
    pub end: Timestamp,
}

impl Heard {
    pub fn of(seen: Observations, start: Timestamp, end: Timestamp) -> Heard {
        Heard { draft: draft(&seen, start, end), seen, start, end }
    }

    pub fn length(&self) -> Span {
        self.end.since(self.start)
    }

    pub fn length_s(&self) -> u64 {
        (self.length().as_millis() + 500) / 1000
    }
}

/// The comparison of a configuration with the observations.
#[derive(Debug, Default)]
pub struct Comparison {
    /// Nobody was found: nothing can be said of the configuration.
    pub nobody: bool,
    /// Names that are not there or differ, as errors, and measurements beyond their limits, as warnings.
    pub problems: Vec<Problem>,
    /// The number of errors among the problems.
    pub absent: usize,
    /// Statuses that were not heard, and whose modules allow a longer silence than it was listened.
    pub undecided: Vec<String>,
    pub unwatched: Unwatched,
}

/// Compares a configuration with the observations.
pub fn compare(loaded: &Loaded, heard: &Heard) -> Comparison {
    if heard.seen.is_empty() {
        let text = "nobody was found, so nothing was compared";
        let help = "does the robot run, with the same ROS_DOMAIN_ID (`--domain`), and is it reached over this interface \
                    (`--interface`, `--peer`)?";
        let problems = vec![of_file(loaded, text, help)];
        return Comparison { nobody: true, problems, absent: 1, ..Comparison::default() };
    }
    let mut found = Comparison { unwatched: Unwatched::of(&loaded.model, heard), ..Comparison::default() };
    let there = There::of(&heard.seen);
    let mut said = BTreeSet::new();
    for named in loaded.named() {
        found.look_for(loaded, heard, &there, &named, &mut said);
    }
    found.absent = found.problems.len();
    if found.unwatched.no_status && loaded.model.modules.iter().any(|it| it.monitor.status().is_some()) {
        let topics: Vec<&str> = unwatched::diagnostics(&loaded.model).collect();
        let text = format!("no status was heard on {}", topics.join(", "));
        let help =
            "does a driver publish diagnostics there? `diagnostics: { topics: [...] }` names other topics";
        found.problems.push(of_file(loaded, &text, help));
        found.absent += 1;
    }
    found.problems.extend(measured::beyond(loaded, heard));
    found
}

impl Comparison {
    /// Judges one name of the file, each once.
    fn look_for(
        &mut self,
        loaded: &Loaded,
        heard: &Heard,
        there: &There,
        named: &Named,
        said: &mut BTreeSet<(u8, Arc<str>)>,
    ) {
        let Named { what, place } = named;
        let mut push = |text: String, near: Option<&str>, otherwise: &str| {
            let near = near.map(|near| format!("`{}` is there: was it renamed?", comment(near)));
            let help = near.unwrap_or_else(|| otherwise.to_owned());
            self.problems.push(match place {
                Some(place) => Problem::at(*place, text).label("named here").help(help),
                None => of_file(loaded, &text, &help),
            });
        };
        match what {
            What::Topic { name, type_name, of_type } => {
                let own = loaded.model.watched.published.iter().any(|own| same_topic(own, name));
                let types = there.types_of(name);
                if !said.insert((0, (*name).into())) || own {
                } else if types.is_empty() && there.all_topics {
                    let is_alike = |it: &&str| type_name.is_empty() || there.types_of(it).contains(type_name);
                    let near = suggest(name, there.topics.iter().copied().filter(is_alike));
                    let help = "does its publisher run? Some publish only in other situations, or when a person acts";
                    push(format!("nobody publishes {name}"), near, help);
                } else if let Some(first) = types.iter().next()
                    && let Some(of_type) = of_type
                    && !type_name.is_empty()
                    && !types.contains(type_name)
                {
                    let text = format!("{name} is published as {}, and read as {type_name}", comment(first));
                    let problem = Problem::at(*of_type, text);
                    let help = "write the type that is published, or name the topic that is meant";
                    self.problems.push(problem.label("another type").help(help));
                }
            }
            What::Status { name, timeout } => {
                if self.unwatched.no_status
                    || heard.seen.statuses.contains_key(&**name)
                    || !said.insert((1, name.clone()))
                {
                } else if heard.length() <= *timeout || heard.seen.statuses.len() >= STATUSES_MAX {
                    self.undecided.push(name.to_string());
                } else {
                    let near = suggest(name, heard.seen.statuses.keys().map(|name| &**name));
                    let text = format!("no status `{name}` was heard");
                    push(text, near, "does its driver run, and is it called so in its diagnostics?");
                }
            }
            What::Node(name) => {
                if !there.nodes.contains(name) && said.insert((2, (*name).into())) {
                    let near = suggest(name, there.nodes.iter().copied());
                    push(
                        format!("there is no node {name}"),
                        near,
                        "does it run? `ros2 node list` names those that do",
                    );
                }
            }
            What::Service(name) => {
                if !there.services.contains(name) && there.all_topics && said.insert((3, (*name).into())) {
                    let near = suggest(name, there.services.iter().copied());
                    push(format!("no node offers the service {name}"), near, "does its node run?");
                }
            }
        }
    }
}

/// A problem of the file as a whole.
fn of_file(loaded: &Loaded, text: &str, help: &str) -> Problem {
    Problem { message: text.to_owned(), ..Problem::of_file(loaded.sources().name(0), "", help) }
}

/// A bounded list for a sentence: `a, b and 3 more`.
pub fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let names: Vec<String> = names.into_iter().map(comment).collect();
    let shown = names[..names.len().min(NAMES_MAX)].join(", ");
    match names.len().saturating_sub(NAMES_MAX) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

#[cfg(test)]
mod tests;
