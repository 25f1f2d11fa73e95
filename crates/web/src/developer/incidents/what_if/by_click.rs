//! The values that a click may change in the texts of a what-if, with their places as a browser counts them in a text
//! area.

use crate::texts::{NAME, VALUE, clean};
use telltale_replay::{Changeable, WhatChanges, changeable};
use telltale_runtime::ConfigurationText;

/// Nodes that are listed.
const NODES: usize = 300;

/// A node with what may be changed of it.
pub struct NodeChanges {
    pub node: String,
    pub lists: Vec<List>,
    pub limits: Vec<Limit>,
}

/// A place in one of the files.
pub struct Place {
    pub file: usize,
    pub start: usize,
    /// Exactly as it is written.
    pub text: String,
}

pub struct List {
    pub place: Place,
    pub before: &'static str,
    /// Each exactly as it is written, and for people.
    pub entries: Vec<(String, String)>,
}

pub struct Limit {
    pub place: Place,
    pub name: String,
}

/// In the order of the files, and how many nodes are left out.
pub fn by_click(texts: &[ConfigurationText]) -> (Vec<NodeChanges>, usize) {
    let mut nodes: Vec<(usize, String, NodeChanges)> = Vec::new();
    for (file, ConfigurationText { text, .. }) in texts.iter().enumerate() {
        let first = nodes.len();
        let mut places = Places::of(text);
        for Changeable { node, range, what } in changeable(text) {
            let place =
                Place { file, start: places.to(range.start), text: places.rest[..range.len()].to_owned() };
            let known = nodes[first..].iter().position(|(_, name, _)| *name == node);
            let index = known.map_or(nodes.len(), |index| first + index);
            if known.is_none() {
                let (lists, limits) = (Vec::new(), Vec::new());
                let changes = NodeChanges { node: clean(&node, 2 * NAME), lists, limits };
                nodes.push((file, node, changes));
            }
            let changes = &mut nodes[index].2;
            match what {
                WhatChanges::Dependencies { before, entries } => {
                    let entry = |text: String| (clean(&text, VALUE), text);
                    let entries = entries.into_iter().map(entry).map(|(shown, text)| (text, shown)).collect();
                    changes.lists.push(List { place, before, entries });
                }
                WhatChanges::Limit { name } => changes.limits.push(Limit { place, name: clean(&name, NAME) }),
            }
        }
    }
    let more = nodes.len().saturating_sub(NODES);
    (nodes.into_iter().take(NODES).map(|(_, _, changes)| changes).collect(), more)
}

/// Counts places in a text, forwards, as a text area does: in units of UTF-16, each end of a line one.
struct Places<'t> {
    rest: &'t str,
    bytes: usize,
    units: usize,
}

impl Places<'_> {
    /// Bytes are counted behind the mark of UTF-8, as where it is parsed.
    fn of(text: &str) -> Places<'_> {
        match text.strip_prefix('\u{feff}') {
            Some(rest) => Places { rest, bytes: 0, units: 1 },
            None => Places { rest: text, bytes: 0, units: 0 },
        }
    }

    fn to(&mut self, byte: usize) -> usize {
        let (passed, rest) = self.rest.split_at(byte - self.bytes);
        let ends = passed.matches("\r\n").count();
        self.units += passed.encode_utf16().count() - ends;
        (self.rest, self.bytes) = (rest, byte);
        self.units
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_those_of_the_text_in_a_browser() {
        let text = "\u{feff}# ä 🙂\r\ngroups:\r\n- { id: a, depends_on: [b, c], monitor: { frequency: { topic: /t, error_below: 5 } } }\r\n";
        let texts = [ConfigurationText { name: "c".to_owned(), text: text.to_owned() }];
        let (nodes, more) = by_click(&texts);
        assert_eq!((nodes.len(), more), (1, 0));
        let shown: Vec<u16> = text.replace("\r\n", "\n").encode_utf16().collect();
        for place in [&nodes[0].lists[0].place, &nodes[0].limits[0].place] {
            let units: Vec<u16> = place.text.encode_utf16().collect();
            assert_eq!(shown[place.start..][..units.len()], units, "{}", place.text);
        }
        assert_eq!(nodes[0].lists[0].entries[1], ("c".to_owned(), "c".to_owned()));
        assert_eq!((&*nodes[0].limits[0].name, &*nodes[0].limits[0].place.text), ("error_below", "5"));
    }
}
