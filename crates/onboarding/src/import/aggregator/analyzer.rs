//! Analyzers as groups.

use super::TIMEOUT_S;
use super::parameters::{Entry, Parameters, Value};
use crate::import::Findings;
use crate::import::write::{Ids, OutGroup, duration, list, quoted};
use telltale_engine::model::filter::Filter;
use telltale_yaml::{Problem, Span};

/// The parameters that an AnalyzerGroup reads, beside those of its analyzers.
const GROUP: [&str; 3] = ["type", "path", "analyzers"];

/// The parameters of a GenericAnalyzer.
const GENERIC: [&str; 12] = [
    "type",
    "path",
    "startswith",
    "contains",
    "name",
    "expected",
    "regex",
    "remove_prefix",
    "find_and_remove_prefix",
    "timeout",
    "num_items",
    "discard_stale",
];

/// A silence that never ends, for statuses that are never stale.
const NEVER_S: f64 = 3650.0 * 86_400.0;

pub(super) struct Import<'f> {
    pub findings: &'f mut Findings,
    /// Filters whose statuses no group shows, each the inside of a map in one line.
    pub dropped: Vec<String>,
}

impl Import<'_> {
    /// The groups for the analyzers in a map. What is neither an analyzer nor one of the `known` keys is named.
    /// `path` is that of the group around them, as diagnostic_aggregator has it.
    pub fn children(&mut self, map: &Parameters, known: &[&str], path: &str, ids: &mut Ids) -> Vec<OutGroup> {
        let mut groups = Vec::new();
        for entry in &map.entries {
            match &entry.value {
                Value::Map(inner) if inner.has_type() => {
                    groups.extend(self.analyzer(entry, inner, path, ids));
                }
                Value::Map(inner) if entry.key == "analyzers" => {
                    groups.extend(self.children(inner, &[], path, ids))
                }
                Value::Map(_) if known.contains(&entry.key.as_str()) => {}
                Value::Map(_) => {
                    let problem =
                        Problem::at(entry.span, format!("`{}` has no `type`: it is no analyzer", entry.key));
                    self.findings.lost(
                        problem.help("add `type: diagnostic_aggregator/GenericAnalyzer`, or remove it"),
                    );
                }
                Value::Leaf(_) if known.contains(&entry.key.as_str()) => {}
                Value::Leaf(_) => {
                    let problem = Problem::at(
                        entry.span,
                        format!("diagnostic_aggregator reads no `{}` here", entry.key),
                    );
                    self.findings.differs(problem.help("it has no effect, here as there"));
                }
            }
        }
        groups
    }

    fn analyzer(&mut self, entry: &Entry, map: &Parameters, path: &str, ids: &mut Ids) -> Option<OutGroup> {
        let (written, span) = map.text("type")?;
        let kind = written.rsplit(['/', ':']).next().unwrap_or(&written);
        match kind {
            "AnalyzerGroup" => self.group(entry, map, path, ids),
            "GenericAnalyzer" => self.generic(entry, map, path, ids),
            "DiscardAnalyzer" => {
                let generic = self.matches(entry, map)?;
                self.dropped.extend(generic.filters.into_iter().map(|(filter, _)| filter));
                let names = generic.expected.iter().map(|name| format!("name: {}", quoted(name)));
                self.dropped.extend(names);
                None
            }
            // It matches nothing, so its statuses are with the others.
            "IgnoreAnalyzer" => None,
            _ => self.unknown(entry, map, path, ids, (&written, span)),
        }
    }

    fn unknown(
        &mut self,
        entry: &Entry,
        map: &Parameters,
        path: &str,
        ids: &mut Ids,
        (kind, span): (&str, Span),
    ) -> Option<OutGroup> {
        let text = format!("`{kind}` is no analyzer of ros/diagnostics");
        let matches = ["startswith", "contains", "name", "expected", "regex", "find_and_remove_prefix"];
        if kind.ends_with("Group") {
            let help = "it is a plain group here: what else the plugin does, make with `combine`, `depends_on` or a monitor";
            self.findings.lost(Problem::at(span, text).help(help));
            return self.group(entry, map, path, ids);
        }
        if matches.into_iter().any(|key| map.get(key).is_some()) {
            let help = "it is imported as a GenericAnalyzer: what else the plugin does, make with a monitor in this group";
            self.findings.lost(Problem::at(span, text).help(help));
            return self.generic(entry, map, path, ids);
        }
        let help = "it is left out: name its statuses with `match` in a group of your own; until then they are in `other`";
        self.findings.lost(Problem::at(span, text).help(help));
        None
    }

    fn named(&mut self, entry: &Entry, map: &Parameters, ids: &mut Ids) -> (String, String) {
        let name = map.text("path").map(|(path, _)| path).unwrap_or_else(|| {
            let problem = Problem::at(
                entry.span,
                format!("`{}` has no `path`: diagnostic_aggregator does not load it", entry.key),
            );
            self.findings.differs(problem.help("it is a group with that name here"));
            entry.key.clone()
        });
        (ids.of(&entry.key), name)
    }

    fn group(&mut self, entry: &Entry, map: &Parameters, path: &str, ids: &mut Ids) -> Option<OutGroup> {
        if !map.has_analyzers() {
            let problem = Problem::at(entry.span, format!("the group `{}` has no analyzers", entry.key));
            self.findings.lost(problem.help("it is left out, as diagnostic_aggregator does not load it"));
            return None;
        }
        let (id, name) = self.named(entry, map, ids);
        let groups = self.children(map, &GROUP, &format!("{path}/{name}"), &mut Ids::default());
        // Analyzers that only drop statuses have no header, so nothing in the group can be stale.
        let may_be_empty = groups.is_empty();
        Some(OutGroup { id, name, groups, may_be_empty, ..OutGroup::default() })
    }

    fn generic(&mut self, entry: &Entry, map: &Parameters, path: &str, ids: &mut Ids) -> Option<OutGroup> {
        let mut generic = self.matches(entry, map)?;
        let (id, name) = self.named(entry, map, ids);
        self.prefixes_in(&format!("{path}/{name}"), entry, &mut generic);
        let beside = generic.beside();
        let mut matches: Vec<String> =
            generic.filters.iter().map(|(filter, _)| format!("{filter}{beside}")).collect();
        if !generic.expected.is_empty() {
            matches.push(format!("expected: {}{beside}", list(&generic.expected)));
        }
        let items = map.number("num_items", self.findings).map(|(items, _)| items);
        let count = items.filter(|&items| items >= 1.0).map(|items| items as u64);
        let may_be_empty = generic.discards || items == Some(0.0);
        Some(OutGroup { id, name, matches, count, may_be_empty, ..OutGroup::default() })
    }

    /// The aggregator looks for a prefix in the whole path of a status, and takes it off only where it finds it first
    /// in the name. It does the same with the path of the analyzer.
    fn prefixes_in(&mut self, path: &str, entry: &Entry, generic: &mut Generic) {
        let name_at = path.rfind('/').map_or(0, |at| at + 1);
        let in_path = |prefix: &str| path.find(&prefix.replace('/', " "));
        let inside: Vec<String> =
            generic.prefixes.iter().filter(|prefix| in_path(prefix).is_some()).cloned().collect();
        for prefix in &inside {
            let text =
                format!("`{prefix}` stays in the names of the statuses: the path `{path}` has it already");
            let help = "diagnostic_aggregator does so, and it is imported so; to leave it out, write it under `prefix`";
            self.findings.differs(Problem::at(entry.span, text).help(help));
            if in_path(prefix) == Some(name_at) {
                let text = format!(
                    "diagnostic_aggregator takes `{prefix}` off the path `{path}`, too, and then does not count the analyzer for the level above it"
                );
                let help = "here it has its whole path, and counts";
                self.findings.differs(Problem::at(entry.span, text).help(help));
            }
        }
        // Whatever the prefix, a `:` and spaces at the beginning of a name go in its turn.
        for prefix in generic.prefixes.iter_mut().filter(|prefix| inside.contains(prefix)) {
            *prefix = ":".into();
        }
    }

    /// `None` if it takes nothing; the findings say so.
    fn matches(&mut self, entry: &Entry, map: &Parameters) -> Option<Generic> {
        for entry in map.entries.iter().filter(|entry| !GENERIC.contains(&entry.key.as_str())) {
            let problem = Problem::at(entry.span, format!("a GenericAnalyzer has no `{}`", entry.key));
            self.findings.lost(problem.help("it is left out"));
        }
        let mut texts = |key| map.texts(key, self.findings);
        let (both, remove, starts) =
            (texts("find_and_remove_prefix"), texts("remove_prefix"), texts("startswith"));
        let (contains, names) = (texts("contains").unwrap_or_default(), texts("name").unwrap_or_default());
        let (expected, regexes) = (texts("expected").unwrap_or_default(), texts("regex").unwrap_or_default());
        self.overridden(map, both.is_some(), [starts.is_some(), remove.is_some()]);
        let prefixes = remove.or_else(|| both.clone()).unwrap_or_default();
        let starts = starts.or(both).unwrap_or_default();
        let mut generic = Generic {
            prefixes: prefixes
                .into_iter()
                .map(|(prefix, _)| prefix)
                .filter(|prefix| !prefix.is_empty())
                .collect(),
            discards: map.flag("discard_stale", self.findings).unwrap_or(false),
            ..Generic::default()
        };
        self.silence(map, &mut generic);
        for (pattern, span) in regexes {
            self.regex(&pattern, span, &mut generic);
        }
        if let Some((_, span)) = expected.first().filter(|_| generic.discards) {
            let text = "`discard_stale` lets go what is under `expected`";
            let help = "it is not missed, as with diagnostic_aggregator, which shows it as STALE for the first `timeout` alone; to miss it, write it under `expected`";
            self.findings.differs(Problem::at(*span, text).help(help));
        }
        for (name, _) in expected.into_iter().filter(|(name, _)| !name.is_empty()) {
            if generic.discards {
                generic.take(format!("name: {}", quoted(&name)), Filter::Name(name.into()));
            } else if !generic.expected.contains(&name) {
                generic.expected.push(name);
            }
        }
        for (name, _) in names.into_iter().filter(|(name, _)| !name.is_empty()) {
            generic.take(format!("name: {}", quoted(&name)), Filter::Name(name.into()));
        }
        for (start, span) in starts {
            self.regex(&format!("{}.*", regex_syntax::escape(&start)), span, &mut generic);
        }
        for (part, span) in contains {
            match part.trim().is_empty() {
                true => self.regex(&format!(".*{}.*", regex_syntax::escape(&part)), span, &mut generic),
                false => generic.take(format!("contains: {}", quoted(&part)), Filter::Contains(part.into())),
            }
        }
        if generic.filters.is_empty() && generic.expected.is_empty() {
            let problem = Problem::at(entry.span, format!("`{}` takes no status", entry.key));
            self.findings.lost(
                problem
                    .help("it is left out: give it `startswith`, `contains`, `name`, `expected` or `regex`"),
            );
            return None;
        }
        Some(generic)
    }

    /// The aggregator reads its parameters by the alphabet, and later ones replace `find_and_remove_prefix`.
    fn overridden(&mut self, map: &Parameters, is_there: bool, [starts, remove]: [bool; 2]) {
        let Some(entry) = map.get("find_and_remove_prefix").filter(|_| is_there) else { return };
        let text = match (starts, remove) {
            (true, true) => "`startswith` and `remove_prefix` replace `find_and_remove_prefix`",
            (true, false) => {
                "`startswith` replaces the names of `find_and_remove_prefix`, which only shortens"
            }
            (false, true) => {
                "`remove_prefix` replaces the prefixes of `find_and_remove_prefix`, which only finds"
            }
            (false, false) => return,
        };
        let help = "diagnostic_aggregator does so, and it is imported so";
        self.findings.differs(Problem::at(entry.span, text).help(help));
    }

    fn silence(&mut self, map: &Parameters, generic: &mut Generic) {
        let timeout = map.number("timeout", self.findings);
        generic.timeout_s = match timeout {
            None => TIMEOUT_S,
            Some((timeout, _)) if timeout > 0.0 && timeout < NEVER_S => timeout,
            Some((timeout, span)) => {
                let text = format!("with `timeout: {timeout}` a status is never stale");
                let help = "here it is after ten years: better give it a time after which silence is a fault";
                self.findings.differs(Problem::at(span, text).help(help));
                // Without a timeout the aggregator discards nothing.
                generic.discards = false;
                NEVER_S
            }
        };
    }

    fn regex(&mut self, pattern: &str, span: Span, generic: &mut Generic) {
        let plain = trial(pattern);
        let grouped = format!("(?:{pattern})");
        let (pattern, said) = match plain {
            Ok(()) => (pattern, None),
            Err(said) if trial(&grouped).is_ok() => (&*grouped, Some(said)),
            Err(said) => {
                let text = format!("this regular expression cannot be used here: {said}");
                let help = "Telltale's have no look-around and no references back; write it in another way, or use `except`";
                self.findings.lost(Problem::at(span, text).help(help));
                return;
            }
        };
        if let Some(said) = said {
            let help = "it is imported as it is; if it is meant as a pattern of names, use `.*`";
            self.findings.differs(Problem::at(span, said).help(help));
        }
        if let Ok(filter) = Filter::regex(pattern) {
            generic.take(format!("regex: {}", quoted(pattern)), filter);
        }
    }
}

/// Whether Telltale's configuration takes a regular expression; the reason why not.
fn trial(pattern: &str) -> Result<(), String> {
    let text = format!("groups: [{{ id: a, match: [{{ regex: {} }}] }}]\n", quoted(pattern));
    match telltale_config::parse("regex", &text) {
        Ok(_) => Ok(()),
        Err(problems) => {
            Err(problems.list().first().map_or_else(String::new, |problem| problem.message.clone()))
        }
    }
}

/// The rules of a GenericAnalyzer.
#[derive(Debug, Default)]
struct Generic {
    /// Each the inside of a map in one line.
    filters: Vec<(String, Filter)>,
    expected: Vec<String>,
    prefixes: Vec<String>,
    timeout_s: f64,
    discards: bool,
}

impl Generic {
    /// Adds a filter, unless an earlier one takes all that it takes.
    fn take(&mut self, text: String, filter: Filter) {
        let covers = |first: &Filter| match (first, &filter) {
            (Filter::Contains(part), Filter::Contains(text)) => text.contains(&**part),
            (_, Filter::Name(name)) => first.matches(name),
            _ => *first == filter,
        };
        if !self.filters.iter().any(|(_, first)| covers(first)) {
            self.filters.push((text, filter));
        }
    }

    /// The keys that each entry has beside its filter.
    fn beside(&self) -> String {
        let mut text = String::new();
        if self.timeout_s != TIMEOUT_S {
            text.push_str(&format!(", timeout: {}", duration(self.timeout_s)));
        }
        if self.discards {
            text.push_str(&format!(", forget_after: {}", duration(self.timeout_s)));
        }
        if !self.prefixes.is_empty() {
            text.push_str(&format!(", prefix: {}", list(&self.prefixes)));
        }
        text
    }
}
