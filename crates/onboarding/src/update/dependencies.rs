//! Changes of `depends_on` in the text of a configuration. Everything else stays byte for byte.

use std::collections::BTreeMap;
use std::ops::Range;

use super::insert::{Form, behind_keys, last_token};
use super::patch::patch;
use super::{Insertion, behind, find, id, items};
use telltale_config::{Change, Loaded, difference};
use telltale_yaml::{Log, Node, tree};

/// A change of one node's dependencies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Edit {
    /// The node waits for this one, too.
    Add { node: String, on: String },
    /// These take the place of one dependency.
    Replace { node: String, index: usize, on: Vec<String> },
}

impl Edit {
    fn node(&self) -> &str {
        let (Edit::Add { node, .. } | Edit::Replace { node, .. }) = self;
        node
    }
}

/// The new text of the main file, and the nodes whose dependencies have to be changed by hand.
#[derive(Debug, PartialEq, Eq)]
pub struct Edited {
    pub text: String,
    pub left: Vec<String>,
}

impl Edited {
    /// How the text differs from that of the main file, as `patch` reads it.
    pub fn patch(&self, loaded: &Loaded) -> String {
        let sources = loaded.sources();
        patch(sources.name(0), sources.text(0), &self.text)
    }

    /// All files with the new text, by their names, the main one first.
    pub fn texts(&self, loaded: &Loaded) -> Vec<(String, String)> {
        texts(loaded, &self.text)
    }
}

/// Changes the dependencies of nodes, each by its whole name. A node is left as it is if it is not in the main file, or if
/// its list is written in another way than in brackets.
pub fn edit(loaded: &Loaded, edits: &[Edit]) -> Edited {
    let mut edited = Edited { text: loaded.sources().text(0).to_owned(), left: Vec::new() };
    let mut of_nodes: BTreeMap<&str, Vec<&Edit>> = BTreeMap::new();
    edits.iter().for_each(|edit| of_nodes.entry(edit.node()).or_default().push(edit));
    for (node, edits) in of_nodes {
        match with(loaded, &edited.text, node, &edits) {
            Some(text) => edited.text = text,
            None => edited.left.push(node.to_owned()),
        }
    }
    edited
}

/// The text with these changes of one node, if it means that and nothing else.
fn with(loaded: &Loaded, text: &str, node: &str, edits: &[&Edit]) -> Option<String> {
    let before = read(loaded, text)?;
    let tree = tree::parse(before.sources(), 0, &mut Log::default())?;
    let found = place(tree.get("groups")?, node)?;
    let new = match found.get("depends_on") {
        Some(list) => {
            let (range, written) = brackets(text, list)?;
            let mut all = written;
            for edit in edits {
                match edit {
                    Edit::Add { on, .. } => all.push(vec![on]),
                    Edit::Replace { index, on, .. } => {
                        *all.get_mut(*index)? = on.iter().map(|it| &**it).collect()
                    }
                }
            }
            let list = format!("[{}]", all.concat().join(", "));
            format!("{}{list}{}", &text[..range.start], &text[range.end..])
        }
        None => {
            let on = edits.iter().map(|edit| match edit {
                Edit::Add { on, .. } => Some(&**on),
                Edit::Replace { .. } => None,
            });
            let on = on.collect::<Option<Vec<&str>>>()?.join(", ");
            let (at, form) = behind_keys(text, found)?;
            let Insertion { at, text: new } = match form {
                Form::Block(column) => {
                    let newline = if text.contains("\r\n") { "\r\n" } else { "\n" };
                    behind(text, at, &format!("{}depends_on: [{on}]{newline}", " ".repeat(column)))
                }
                Form::Brackets(_) => Insertion { at, text: format!(", depends_on: [{on}]") },
            };
            format!("{}{new}{}", &text[..at], &text[at..])
        }
    };
    let after = read(loaded, &new)?;
    let subjects = ["module", "group"].map(|kind| format!("{kind} `{node}`"));
    let changes = difference(&before, &after);
    let is_meant = changes.iter().all(|it| it.change == Change::Changed && subjects.contains(&it.subject));
    (is_meant && !changes.is_empty()).then_some(new)
}

/// The configuration with another text of its main file.
fn read(loaded: &Loaded, text: &str) -> Option<Loaded> {
    telltale_config::of_texts(texts(loaded, text)).ok()
}

/// Its files with another text of the main one.
fn texts(loaded: &Loaded, text: &str) -> Vec<(String, String)> {
    let of_file = |(index, (name, old)): (usize, (&str, &str))| {
        (name.to_owned(), if index == 0 { text.to_owned() } else { old.to_owned() })
    };
    loaded.sources().texts().enumerate().map(of_file).collect()
}

/// A group by its path, or a module by its group's path and its own id.
fn place<'n>(groups: &'n Node, name: &str) -> Option<&'n Node> {
    find(groups, name).or_else(|| {
        let (path, module) = name.rsplit_once('/')?;
        items(find(groups, path)?.get("modules")?).iter().find(|it| id(it) == Some(module))
    })
}

/// A list in brackets: where it stands, and each item as it is written.
fn brackets<'t>(text: &'t str, list: &Node) -> Option<(Range<usize>, Vec<Vec<&'t str>>)> {
    let start = list.span.start as usize;
    text[start..].starts_with('[').then_some(())?;
    let last = last_token(text, start)?;
    let end = last + text[last..].find(']')? + 1;
    let starts: Vec<usize> = items(list).iter().map(|it| it.span.start as usize).collect();
    // An alias stands elsewhere, and a comment would be lost.
    let is_plain = starts.iter().all(|it| (start..end).contains(it)) && !text[start..end].contains('#');
    let ends: Vec<usize> = starts.iter().skip(1).copied().chain([last]).collect();
    let written =
        |(from, to): (&usize, &usize)| vec![text[*from..*to].trim_end().trim_end_matches(',').trim_end()];
    is_plain.then(|| (start..end, starts.iter().zip(&ends).map(written).collect()))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    const TEXT: &str = "\
vehicle: { id: v, name: V, stages: none }
groups:
  - id: a
    depends_on: [b] # the whole of it
    modules:
      - { id: one, status: one }
      - id: two
        status: two # a comment
        depends_on: [{ on: a/one, within: 40s }, b/three]
  - id: b
    modules:
      - id: three
        status: three
        # Of its own.
      - id: four
        status: four
        depends_on:
          - b/three
";

    fn edited(edits: &[Edit]) -> Edited {
        let loaded = telltale_config::parse("f", TEXT).unwrap_or_else(|problems| panic!("{problems}"));
        edit(&loaded, edits)
    }

    fn add(node: &str, on: &str) -> Edit {
        Edit::Add { node: node.into(), on: on.into() }
    }

    fn replace(node: &str, index: usize, on: &[&str]) -> Edit {
        Edit::Replace { node: node.into(), index, on: on.iter().map(|it| (*it).to_owned()).collect() }
    }

    #[test]
    fn lists_in_brackets_change_and_everything_else_stays() {
        let all = [
            replace("a", 0, &["b/three", "b/four"]),
            add("a/two", "b/four"),
            replace("a/two", 1, &[]),
            add("a/one", "b/three"),
            add("b/three", "a/one"),
        ];
        let without = &all[..4];
        let Edited { text, left } = edited(without);
        assert!(left.is_empty(), "{left:?}");
        let changed: BTreeSet<&str> = text.lines().filter(|line| !TEXT.contains(line)).collect();
        let expected = [
            "    depends_on: [b/three, b/four] # the whole of it",
            "        depends_on: [{ on: a/one, within: 40s }, b/four]",
            "      - { id: one, status: one, depends_on: [b/three] }",
        ];
        assert_eq!(changed, BTreeSet::from(expected), "{text}");
        // One that closes a circle is left: `a` waits for all of `b`.
        assert_eq!(edited(&all[4..]).left, ["b/three"]);
    }

    #[test]
    fn a_module_without_dependencies_gets_its_first_and_a_list_in_lines_is_left() {
        let Edited { text, left } =
            edited(&[replace("a", 0, &[]), add("b/three", "a/one"), add("b/four", "a/one")]);
        assert_eq!(left, ["b/four"]);
        assert!(
            text.contains("        # Of its own.\n        depends_on: [a/one]\n      - id: four"),
            "{text}"
        );
        assert!(text.contains("    depends_on: [] #"), "{text}");
    }
}
