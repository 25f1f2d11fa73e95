//! The places of a configuration's text that a what-if changes by a click: dependencies of a node, and limits of its
//! monitor. They are found in any YAML, also where the configuration is wrong elsewhere.

use std::collections::BTreeMap;
use std::ops::Range;

use super::file::monitors::bands::KEYS;
use telltale_yaml::{Kind, Log, Node, Sources, tree};

/// A place that may be changed, as a range of bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Changeable {
    pub node: String,
    pub range: Range<usize>,
    pub what: WhatChanges,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum WhatChanges {
    /// A list in brackets, behind `before`; its entries as they are written.
    Dependencies { before: &'static str, entries: Vec<String> },
    /// A limit by its name, with the names of the maps around it: `translation.error_above`.
    Limit { name: String },
}

/// All of them in the order of the text; none if it is no YAML.
pub fn changeable(text: &str) -> Vec<Changeable> {
    let mut sources = Sources::default();
    let file = sources.add("", text);
    // Places are counted in the text as it is parsed.
    let text = sources.text(file);
    let Some(node) = tree::parse(&sources, file, &mut Log::default()) else { return Vec::new() };
    let mut found = Found { text, all: BTreeMap::new() };
    found.walk(&node, "");
    found.all.into_values().collect()
}

struct Found<'t> {
    text: &'t str,
    /// By their beginnings: an alias stands where its anchor does.
    all: BTreeMap<usize, Changeable>,
}

impl Found<'_> {
    fn walk(&mut self, node: &Node, path: &str) {
        match &node.kind {
            Kind::Scalar { .. } => {}
            Kind::Sequence(items) => items.iter().for_each(|item| self.walk(item, path)),
            Kind::Mapping(entries) => {
                let id = entries.iter().find_map(|(key, value)| match &value.kind {
                    Kind::Scalar { text, .. } if key.text == "id" => Some(&**text),
                    _ => None,
                });
                let path = match id {
                    Some(id) if path.is_empty() => id.to_owned(),
                    Some(id) => format!("{path}/{id}"),
                    None => path.to_owned(),
                };
                for (key, value) in entries {
                    match &*key.text {
                        "groups" | "modules" => self.walk(value, &path),
                        "depends_on" => self.dependencies(key.span.end as usize, value, &path),
                        "monitor" => self.limits(value, &path, &mut Vec::new()),
                        _ => {}
                    }
                }
            }
        }
    }

    fn add(&mut self, node: &str, range: Range<usize>, what: WhatChanges) {
        let found = Changeable { node: node.to_owned(), range, what };
        self.all.entry(found.range.start).or_insert(found);
    }

    fn dependencies(&mut self, key_end: usize, value: &Node, node: &str) {
        let Kind::Sequence(items) = &value.kind else { return };
        let start = value.span.start as usize;
        if self.text[start..].starts_with('[') {
            let Some((end, entries)) = in_brackets(self.text, start) else { return };
            if !items.is_empty() && entries.len() == items.len() {
                self.add(node, start..end, WhatChanges::Dependencies { before: "", entries });
            }
            return;
        }
        // Entries on lines of their own, each in one line. A list in brackets can take their place if no comment would go.
        let Some(colon) = self.text[key_end..].find(':').map(|at| key_end + at + 1) else { return };
        let ends: Option<Vec<(usize, usize)>> = items.iter().map(|item| self.entry(item)).collect();
        let Some(ends) = ends else { return };
        let Some(&(_, end)) = ends.last() else { return };
        let is_of_lines = self.text[start..].starts_with('-');
        if !is_of_lines || colon > start || self.text[colon..end].contains('#') {
            return;
        }
        let entries = ends.into_iter().map(|(start, end)| self.text[start..end].to_owned()).collect();
        self.add(node, colon..end, WhatChanges::Dependencies { before: " ", entries });
    }

    /// Where an entry begins and ends, if it can stand in brackets as it is.
    fn entry(&self, item: &Node) -> Option<(usize, usize)> {
        let start = item.span.start as usize;
        let end = match &item.kind {
            Kind::Scalar { .. } => start + self.text[start..item.span.end as usize].trim_end().len(),
            _ if self.text[start..].starts_with(['{', '[']) => in_brackets(self.text, start)?.0,
            _ => return None,
        };
        (!self.text[start..end].contains('\n')).then_some((start, end))
    }

    fn limits(&mut self, node: &Node, path: &str, within: &mut Vec<String>) {
        let Kind::Mapping(entries) = &node.kind else { return };
        for (key, value) in entries {
            if KEYS.contains(&&*key.text) && matches!(value.kind, Kind::Scalar { .. }) && !value.is_null() {
                let start = value.span.start as usize;
                let end = start + self.text[start..value.span.end as usize].trim_end().len();
                // The first map is the monitor's kind.
                let names = within.iter().skip(1).chain([&key.text]).map(String::as_str);
                let name = names.collect::<Vec<_>>().join(".");
                self.add(path, start..end, WhatChanges::Limit { name });
            }
            within.push(key.text.clone());
            self.limits(value, path, within);
            within.pop();
        }
    }
}

/// The end of what a bracket begins, and its entries as they are written; `None` if a comment stands in it.
fn in_brackets(text: &str, start: usize) -> Option<(usize, Vec<String>)> {
    let bytes = text.as_bytes();
    let (mut depth, mut entries, mut begin) = (0_usize, Vec::new(), start + 1);
    // What stands before, without blanks: a quote is one where a value may begin.
    let mut before = b'[';
    let mut at = start;
    while let Some(&byte) = bytes.get(at) {
        let may_begin = matches!(before, b'[' | b'{' | b',' | b':');
        match byte {
            b'\'' | b'"' if may_begin => at = quoted(bytes, at)?,
            b'#' if bytes[at - 1].is_ascii_whitespace() => return None,
            b'[' | b'{' => depth += 1,
            b']' | b'}' => depth = depth.checked_sub(1)?,
            _ => {}
        }
        if depth == 0 || depth == 1 && byte == b',' {
            entries.push(text.get(begin..at)?.trim());
            begin = at + 1;
        }
        if depth == 0 {
            let entries = entries.into_iter().filter(|entry| !entry.is_empty()).map(str::to_owned);
            return Some((at + 1, entries.collect()));
        }
        if !byte.is_ascii_whitespace() {
            before = byte;
        }
        at += 1;
    }
    None
}

/// The last byte of a quoted text.
fn quoted(bytes: &[u8], start: usize) -> Option<usize> {
    let quote = bytes[start];
    let mut at = start + 1;
    loop {
        match *bytes.get(at)? {
            b'\\' if quote == b'"' => at += 2,
            byte if byte == quote && quote == b'\'' && bytes.get(at + 1) == Some(&quote) => at += 2,
            byte if byte == quote => return Some(at),
            _ => at += 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The places with their texts, one a line.
    fn places(text: &str) -> String {
        let line = |found: &Changeable| {
            let what = match &found.what {
                WhatChanges::Dependencies { before, entries } => format!("{before}{}", entries.join(" | ")),
                WhatChanges::Limit { name } => name.clone(),
            };
            format!("{}: {what} = {}\n", found.node, text[found.range.clone()].replace('\n', "/"))
        };
        changeable(text).iter().map(line).collect()
    }

    #[test]
    fn dependencies_and_limits_are_found_with_their_nodes_however_they_are_written() {
        let text = "
limits: { error_above: 3 }
groups:
  - id: a
    depends_on: [b, { any_of: [c, 'd, # e'] }, { on: f, within: 5s } ]  # why
    modules:
      - { id: m, monitor: { frequency: { topic: /t, warning_below: 7 Hz, error_below: 4 } } }
    groups:
      - id: g
        depends_on:
          - b
          - { on: c, within: 5s }
        modules:
          - id: p
            monitor:
              agreement:
                translation: { error_above: 0.5 }
                rotation_deg:
                  error_above: 20   # degrees
";
        let expect = "\
a: b | { any_of: [c, 'd, # e'] } | { on: f, within: 5s } = [b, { any_of: [c, 'd, # e'] }, { on: f, within: 5s } ]
a/m: warning_below = 7 Hz
a/m: error_below = 4
a/g:  b | { on: c, within: 5s } = /          - b/          - { on: c, within: 5s }
a/g/p: translation.error_above = 0.5
a/g/p: rotation_deg.error_above = 20
";
        assert_eq!(places(text), expect);
    }

    #[test]
    fn what_a_click_would_spoil_is_left_out() {
        for text in [
            "groups: [{ id: a, depends_on: [] }]",
            "groups: [{ id: a, depends_on: b }]",
            "groups:\n  - id: a\n    depends_on: [b, # why\n      c]\n",
            "groups:\n  - id: a\n    depends_on:\n      - b  # why\n      - c\n",
            "groups:\n  - id: a\n    depends_on:\n      - any_of:\n        - b\n",
            "groups: [{ id: a, monitor: { frequency: { error_below: } } }]",
            "groups: [",
            "",
        ] {
            assert_eq!(places(text), "", "{text}");
        }
        let same = "groups:\n  - { id: a, depends_on: &x [b] }\n  - { id: c, depends_on: *x }\n";
        assert_eq!(places(same).lines().count(), 1, "{}", places(same));
    }

    #[test]
    fn a_list_without_some_entries_is_still_a_configuration() {
        let text = "a: [x, [y, \"z\\\"],\"], it's]";
        let (end, entries) = in_brackets(text, 3).expect("it ends");
        assert_eq!((end, entries.join(" | ").as_str()), (text.len(), "x | [y, \"z\\\"],\"] | it's"));
        assert_eq!(in_brackets("[a, 'b]", 0), None);
    }
}
