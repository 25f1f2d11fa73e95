//! Adds to a configuration the statuses, topics and nodes that were heard and that nothing in it watches: as modules of
//! the groups to which they belong, and as new groups. Pure: the text that people wrote stays byte for byte, and each
//! addition says when it was heard.

pub mod dependencies;
mod home;
mod insert;
mod new;
mod patch;

use std::collections::BTreeSet;
use std::fmt;

use self::insert::{Form, Insertion, applied, behind_keys, behind_last, is_empty};
use self::new::New;
use crate::init::draft::{Draft, Group, Module};
use crate::init::yaml::{write_group, write_module};
use crate::live::Unwatched;
use telltale_config::{Change, Difference, Loaded, difference};
use telltale_yaml::decode::scalar;
use telltale_yaml::{Kind, Log, Node, tree};

/// The new text of a configuration.
#[derive(Debug, PartialEq, Eq)]
pub struct Updated {
    pub text: String,
    /// The whole names of the modules that were added.
    pub modules: Vec<String>,
    /// The ids of new groups.
    pub groups: Vec<String>,
    /// Additions that have no place in this file, one sentence each.
    pub left: Vec<String>,
}

/// The file is written in a way that nothing can be added to.
#[derive(Debug)]
pub struct NoPlace(String);

impl fmt::Display for NoPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for NoPlace {}

/// The text of the configuration's main file with an addition for each part of the robot that nothing in it watches.
/// `when` says when these parts were heard; a type is known if the configuration finds its definition.
///
/// # Errors
/// The file is written in a way that nothing can be added to without changing what it means.
pub fn update(
    loaded: &Loaded,
    draft: Draft,
    unwatched: &Unwatched,
    is_known: impl Fn(&str) -> bool,
    when: &str,
) -> Result<Updated, NoPlace> {
    let text = loaded.sources().text(0);
    let mut updated =
        Updated { text: text.to_owned(), modules: Vec::new(), groups: Vec::new(), left: Vec::new() };
    let Some(tree) = tree::parse(loaded.sources(), 0, &mut Log::default()) else { return Ok(updated) };
    let groups = tree.get("groups");
    let New { joining, groups: made, left, .. } = New::of(loaded, draft, unwatched, is_known, groups);
    updated.left = left;
    let mut insertions = Vec::new();
    for (home, modules) in joining {
        let Some(group) = groups.and_then(|groups| find(groups, &home)) else { continue };
        updated.modules.extend(modules.iter().map(|module| format!("{home}/{}", module.id)));
        insertions.push(into_group(text, group, modules, when).ok_or_else(|| no_place(loaded, group))?);
    }
    if !made.is_empty() {
        for group in &made {
            updated.groups.push(group.id.clone());
            updated.modules.extend(group.modules.iter().map(|it| format!("{}/{}", group.id, it.id)));
        }
        let place = new_groups(text, groups, &made, when);
        insertions.push(place.ok_or_else(|| no_place(loaded, groups.unwrap_or(&tree)))?);
    }
    if insertions.is_empty() {
        return Ok(updated);
    }
    let newline = if text.contains("\r\n") { "\r\n" } else { "\n" };
    for insertion in &mut insertions {
        insertion.text = insertion.text.replace('\n', newline);
    }
    updated.text = applied(text, insertions);
    is_only_more(loaded, &updated)?;
    Ok(updated)
}

/// A text that means something else than the old one with the additions is not offered.
fn is_only_more(loaded: &Loaded, updated: &Updated) -> Result<(), NoPlace> {
    let name = loaded.sources().name(0);
    let read = telltale_config::parse(name, &updated.text);
    let after = read.map_err(|problems| NoPlace(format!("what was heard cannot be added: {problems}")))?;
    let modules = updated.modules.iter().map(|name| format!("module `{name}`"));
    let groups = updated.groups.iter().map(|id| format!("group `{id}`"));
    let added: BTreeSet<String> = modules.chain(groups).collect();
    let is_meant = |it: &Difference| it.change == Change::Added && added.contains(&it.subject);
    match difference(loaded, &after).into_iter().find(|it| !is_meant(it)) {
        None => Ok(()),
        Some(change) => Err(NoPlace(format!(
            "what was heard cannot be added to {name} without a change of what is there ({change}); write its lists with \
             one item a line"
        ))),
    }
}

fn no_place(loaded: &Loaded, node: &Node) -> NoPlace {
    let place = loaded.sources().place(node.span);
    NoPlace(format!("{place}: nothing can be added to what stands here; write the list with one item a line"))
}

fn items(list: &Node) -> &[Node] {
    match &list.kind {
        Kind::Sequence(items) => items,
        _ => &[],
    }
}

fn id(node: &Node) -> Option<&str> {
    node.get("id").and_then(scalar)
}

/// The group with this path, in its file.
fn find<'n>(groups: &'n Node, path: &str) -> Option<&'n Node> {
    let (first, rest) = path.split_once('/').map_or((path, None), |(first, rest)| (first, Some(rest)));
    let group = items(groups).iter().find(|group| id(group) == Some(first))?;
    match rest {
        None => Some(group),
        Some(rest) => find(group.get("groups")?, rest),
    }
}

fn ids_of(list: &Node) -> BTreeSet<String> {
    items(list).iter().filter_map(id).map(str::to_owned).collect()
}

/// The ids that are taken in a group.
fn modules_of(group: &Node) -> BTreeSet<String> {
    ["modules", "groups"].iter().filter_map(|key| group.get(key)).flat_map(ids_of).collect()
}

/// The modules as lines whose `-` is in this column, below a line that says when they were added.
fn lines(modules: &[Module], column: usize, when: &str) -> String {
    let mut out = format!("      # Added by `telltale init --update`, {when}:\n");
    modules.iter().for_each(|module| write_module(&mut out, module, false));
    moved(&out, 6, column)
}

/// Lines with this indentation, moved to another one.
fn moved(text: &str, from: usize, to: usize) -> String {
    let moved = |line: &str| match line.trim().is_empty() {
        true => "\n".to_owned(),
        false => format!("{}{}\n", " ".repeat(to), &line[from..]),
    };
    text.lines().map(moved).collect()
}

/// Block lines behind a place that may be the end of a file without a line feed.
fn behind(text: &str, at: usize, lines: &str) -> Insertion {
    let ends = at == 0 || text[..at].ends_with('\n');
    Insertion { at, text: if ends { lines.to_owned() } else { format!("\n{}", lines.trim_end()) } }
}

fn into_group(text: &str, group: &Node, mut modules: Vec<Module>, when: &str) -> Option<Insertion> {
    let modules = &mut modules;
    match group.get("modules") {
        Some(list) => {
            let (at, form) = behind_last(text, list)?;
            Some(match form {
                Form::Block(column) => behind(text, at, &lines(modules, column, when)),
                Form::Brackets(column) => {
                    Insertion { at, text: bracketed(modules, column, when, !is_empty(list)) }
                }
            })
        }
        None => {
            let (at, form) = behind_keys(text, group)?;
            Some(match form {
                Form::Block(column) => {
                    let pad = " ".repeat(column);
                    behind(text, at, &format!("{pad}modules:\n{}", lines(modules, column + 2, when)))
                }
                Form::Brackets(column) => {
                    let inner = bracketed(modules, column + 2, when, false);
                    let pad = " ".repeat(column);
                    Insertion { at, text: format!(",\n{pad}modules: [{inner}]") }
                }
            })
        }
    }
}

/// The modules as further items in brackets, without guesses: those need lines of their own.
fn bracketed(modules: &mut [Module], column: usize, when: &str, comma: bool) -> String {
    let mut out = String::from(if comma { ",\n" } else { "\n" });
    modules.iter_mut().for_each(|module| module.proposals.clear());
    let block = lines(modules, column, when);
    let count = modules.len();
    let mut done = 0;
    for line in block.lines() {
        let item = line.trim_start().strip_prefix("- ");
        done += usize::from(item.is_some());
        match item {
            Some(item) if done == count => out += &format!("{}{item}", " ".repeat(column)),
            Some(item) => out += &format!("{}{item},\n", " ".repeat(column)),
            None if done == count => {}
            None => out += &format!("{line}\n"),
        }
    }
    out
}

fn new_groups(text: &str, groups: Option<&Node>, new: &[Group], when: &str) -> Option<Insertion> {
    let mut out = format!("  # Added by `telltale init --update`, {when}:\n");
    new.iter().for_each(|group| write_group(&mut out, group, false));
    let out = out.trim_end();
    let Some(groups) = groups else {
        let at = text.len();
        return Some(behind(text, at, &format!("\ngroups:\n{}", moved(out, 2, 2))));
    };
    match behind_last(text, groups)? {
        (at, Form::Block(column)) => Some(behind(text, at, &format!("\n{}", moved(out, 2, column)))),
        // A group has lines of its own.
        (_, Form::Brackets(_)) => None,
    }
}

#[cfg(test)]
mod tests;
