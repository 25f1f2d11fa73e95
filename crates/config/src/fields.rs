//! Reads a map of given keys, and describes it for the schema.

use super::decode::FromNode;
use telltale_yaml::decode::{did_you_mean, mapping, suggest, word};
use telltale_yaml::tree::Key;
use telltale_yaml::{KeyDoc, Log, MapDoc, Members, Node, Problem, Schema, Span, schema};

/// Keys that are often written a level too far out: the map, the keys, and where they belong.
const MISPLACED: [(&str, &[&str], &str); 4] = [
    ("a configuration", &["stages", "id", "name"], "the vehicle: indent it below `vehicle:`"),
    (
        "a configuration",
        &["timeout", "stale", "raise_after", "clear_after", "forget_after", "explains_within"],
        "`defaults`, for all modules: indent it below `defaults:`",
    ),
    (
        "a configuration",
        &["match", "depends_on", "when"],
        "a group: indent it as the `id` of one in `groups`",
    ),
    (
        "a group",
        &["status", "monitor", "help", "latch", "writers", "timeout", "stale", "raise_after", "clear_after"],
        "a module: indent it as the `id` of one in `modules`",
    ),
];

/// A map with given keys. Keys that the decoder has not asked for when this is dropped are unknown keys.
#[derive(Debug)]
pub struct Fields<'n, 'l> {
    map: MapDoc,
    span: Span,
    entries: &'n [(Key, Node)],
    asked: Vec<&'static str>,
    pub log: &'l mut Log,
}

impl<'n, 'l> Fields<'n, 'l> {
    /// `None`: it is no map, or its schema is known already.
    pub fn of(node: &'n Node, map: impl Into<MapDoc>, log: &'l mut Log) -> Option<Self> {
        let map = map.into();
        let entries = mapping(node, map.title(), log)?;
        if log.schema.as_mut().is_some_and(|schema| !schema.open(map)) {
            return None;
        }
        Some(Fields { map, span: node.span, entries, asked: Vec::new(), log })
    }

    /// Notes that a key may be there; the first note of a key goes into the schema.
    fn ask(&mut self, key: KeyDoc, form: impl FnOnce(&mut Schema) -> Members, is_required: bool) {
        if self.asked.contains(&key.name()) {
            return;
        }
        self.asked.push(key.name());
        if let Some(schema) = &mut self.log.schema {
            let form = match key.own_form() {
                Some(form) => form(schema),
                None => form(schema),
            };
            schema.property(self.map, &key, form, is_required);
        }
    }

    fn find(&self, key: &str) -> Option<&'n (Key, Node)> {
        self.entries.iter().find(|(found, _)| found.text == key)
    }

    /// Notes a key that is read later, and only where other keys ask for it.
    pub fn may_have<T: FromNode>(&mut self, key: impl Into<KeyDoc>) {
        self.ask(key.into(), T::form, false);
    }

    /// The value of a key, as a tree.
    pub fn node(&mut self, key: impl Into<KeyDoc>) -> Option<&'n Node> {
        let key = key.into();
        self.ask(key, |_| Members::new(), false);
        self.find(key.name()).map(|(_, value)| value)
    }

    pub fn optional<T: FromNode>(&mut self, key: impl Into<KeyDoc>) -> Option<T> {
        self.optional_by(key, T::form, T::from_node)
    }

    /// The value of a key by a decoder of its own.
    pub fn optional_by<T>(
        &mut self,
        key: impl Into<KeyDoc>,
        form: impl FnOnce(&mut Schema) -> Members,
        read: impl FnOnce(&Node, &mut Log) -> Option<T>,
    ) -> Option<T> {
        let key = key.into();
        self.ask(key, form, false);
        let (_, node) = self.find(key.name())?;
        read(node, self.log)
    }

    /// One of a few given words; `what` names them in messages.
    pub fn choice<T: Copy>(&mut self, key: KeyDoc, what: &str, choices: &[(&str, T)]) -> Option<T> {
        let form = |_: &mut Schema| schema::words(choices.iter().map(|(word, _)| *word));
        self.optional_by(key, form, |node, log| word(node, log, what, choices))
    }

    pub fn or_default<T: FromNode + Default>(&mut self, key: impl Into<KeyDoc>) -> T {
        self.optional(key).unwrap_or_default()
    }

    pub fn required<T: FromNode>(&mut self, key: impl Into<KeyDoc>) -> Option<T> {
        let key = key.into();
        self.ask(key, T::form, true);
        self.needs(key.name(), &format!("`{}: ...`", key.name()));
        let (_, node) = self.find(key.name())?;
        T::from_node(node, self.log)
    }

    /// Logs it if a key is missing; `example` is what to add.
    pub fn needs(&mut self, key: &str, example: &str) {
        if self.find(key).is_none() {
            let problem = Problem::at(self.span, format!("{} needs `{key}`", self.map.title()));
            self.log.push(problem.help(format!("add {example}")));
        }
    }

    /// Notes for the schema which keys are needed together or exclude each other.
    pub fn rule(&mut self, rule: impl FnOnce() -> (&'static str, schema::Json)) {
        if let Some(schema) = &mut self.log.schema {
            schema.rule(self.map, rule());
        }
    }

    /// The place of a key, if it is there.
    pub fn key_span(&self, key: &str) -> Option<Span> {
        self.find(key).map(|(found, _)| found.span)
    }

    pub fn span(&self) -> Span {
        self.span
    }

    /// Logs a problem of the map as a whole, in place of its unknown keys.
    pub fn refuse(mut self, problem: Problem) {
        self.log.push(problem);
        self.entries = &[];
    }

    /// Whether the decoder asked for this key.
    pub fn knows(&self, key: &str) -> bool {
        self.asked.contains(&key)
    }
}

impl Drop for Fields<'_, '_> {
    /// Logs every key that the decoder did not ask for: no decoder can forget to.
    fn drop(&mut self) {
        for (key, _) in self.entries.iter().filter(|(key, _)| !self.asked.contains(&key.text.as_str())) {
            let problem =
                Problem::at(key.span, format!("unknown key `{}` in {}", key.text, self.map.title()));
            let is_here = |(map, keys, _): &&(&str, &[&str], &str)| {
                *map == self.map.title() && keys.contains(&key.text.as_str())
            };
            let known = || format!("known here: {}", self.asked.join(", "));
            let help = match MISPLACED.iter().find(is_here) {
                Some((.., place)) => format!("`{}` belongs to {place}", key.text),
                None => suggest(&key.text, self.asked.iter().copied()).map_or_else(known, did_you_mean),
            };
            self.log.push(problem.help(help));
        }
    }
}
