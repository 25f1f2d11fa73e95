//! A configuration of Telltale as text, made of groups and modules.

use std::collections::HashSet;

use crate::init::names::scalar;

/// A group of the result.
#[derive(Debug, Default)]
pub(super) struct OutGroup {
    pub comments: Vec<String>,
    pub id: String,
    pub name: String,
    pub any: bool,
    pub may_be_empty: bool,
    pub count: Option<u64>,
    /// Names of nodes.
    pub depends_on: Vec<String>,
    /// The unit that it is, in an import of a graph.
    pub unit: Option<usize>,
    /// Entries of `match`, each the inside of a map in one line.
    pub matches: Vec<String>,
    pub modules: Vec<OutModule>,
    pub groups: Vec<OutGroup>,
}

#[derive(Debug, Default)]
pub(super) struct OutModule {
    pub comments: Vec<String>,
    pub id: String,
    /// The text behind the id, the inside of a map in one line.
    pub keys: String,
    pub depends_on: Vec<String>,
    /// The unit that it is, in an import of a graph.
    pub unit: Option<usize>,
}

/// The whole file: comments, keys at the top, groups.
pub(super) fn file(comments: &[String], keys: &[String], groups: &[OutGroup]) -> String {
    let mut out = String::new();
    comment(comments, "", &mut out);
    out.push('\n');
    for key in keys {
        out.push_str(key);
        out.push('\n');
    }
    out.push_str("groups:\n");
    groups.iter().for_each(|group| write_group(group, "  ", &mut out));
    out
}

/// The file with more lines at the end of the comment with which it begins.
pub(super) fn with_list(text: &str, lines: &[String]) -> String {
    let head = text.find("\n\n").map_or(0, |end| end + 1);
    let mut list = String::new();
    comment(lines, "", &mut list);
    format!("{}{list}{}", &text[..head], &text[head..])
}

fn write_group(group: &OutGroup, indent: &str, out: &mut String) {
    comment(&group.comments, indent, out);
    let mut line = |text: String| {
        out.push_str(indent);
        out.push_str(&text);
        out.push('\n');
    };
    line(format!("- id: {}", quoted(&group.id)));
    line(format!("  name: {}", quoted(&group.name)));
    if group.any {
        line("  combine: any".into());
    }
    if group.may_be_empty {
        line("  empty: ok".into());
    }
    if let Some(count) = group.count {
        line(format!("  count: {count}"));
    }
    if !group.depends_on.is_empty() {
        line(format!("  depends_on: {}", dependencies(&group.depends_on)));
    }
    if !group.matches.is_empty() {
        line("  match:".into());
        group.matches.iter().for_each(|entry| line(format!("    - {{ {entry} }}")));
    }
    if !group.modules.is_empty() {
        line("  modules:".into());
    }
    let inner = format!("{indent}    ");
    for module in &group.modules {
        comment(&module.comments, &inner, out);
        let depends_on = match &module.depends_on[..] {
            [] => String::new(),
            names => format!(", depends_on: {}", dependencies(names)),
        };
        out.push_str(&format!("{inner}- {{ id: {}, {}{depends_on} }}\n", quoted(&module.id), module.keys));
    }
    if !group.groups.is_empty() {
        out.push_str(&format!("{indent}  groups:\n"));
        group.groups.iter().for_each(|inside| write_group(inside, &inner, out));
    }
}

/// Whatever is not known to be well masks: only a level of OK lets a dependent count.
fn dependencies(names: &[String]) -> String {
    let one = |name: &String| format!("{{ on: {}, masks_when: [error, unknown] }}", quoted(name));
    format!("[{}]", names.iter().map(one).collect::<Vec<_>>().join(", "))
}

fn comment(lines: &[String], indent: &str, out: &mut String) {
    for text in lines {
        let plain: String = text.chars().map(|it| if it.is_control() { ' ' } else { it }).collect();
        out.push_str(format!("{indent}# {plain}").trim_end());
        out.push('\n');
    }
}

/// A text in YAML, in quotes unless it is a plain word.
pub(super) fn quoted(text: &str) -> String {
    let is_word = text.starts_with(|it: char| it.is_ascii_alphabetic())
        && text.chars().all(|it| it.is_ascii_alphanumeric() || "_-.".contains(it))
        && !["true", "false", "null", "yes", "no", "on", "off", "y", "n"]
            .contains(&text.to_ascii_lowercase().as_str());
    if is_word { text.to_owned() } else { scalar(text) }
}

pub(super) fn list(texts: &[String]) -> String {
    format!("[{}]", texts.iter().map(|text| quoted(text)).collect::<Vec<_>>().join(", "))
}

/// Seconds in one unit, as a configuration takes them: `5s`, `1500ms`.
pub(super) fn duration(seconds: f64) -> String {
    let us = (seconds * 1e6).round() as u64;
    match us {
        _ if us > 0 && us.is_multiple_of(86_400_000_000) => format!("{}d", us / 86_400_000_000),
        _ if us.is_multiple_of(1_000_000) => format!("{}s", us / 1_000_000),
        _ if us.is_multiple_of(1_000) => format!("{}ms", us / 1_000),
        _ => format!("{us}us"),
    }
}

/// Ids of siblings: made of what people call them, each once.
#[derive(Debug, Default)]
pub(super) struct Ids(HashSet<String>);

impl Ids {
    /// At the top some ids are taken.
    pub fn at_the_top() -> Ids {
        Ids(["other", "telltale"].map(str::to_owned).into())
    }

    pub fn of(&mut self, name: &str) -> String {
        let letter = |it: char| if it.is_ascii_alphanumeric() || "_.-".contains(it) { it } else { '_' };
        let plain: String = name.chars().map(letter).collect();
        let plain = plain.trim_matches('_');
        let plain = if plain.is_empty() { "group" } else { plain };
        let second = (2..).map(|number| format!("{plain}-{number}"));
        let mut free = std::iter::once(plain.to_owned()).chain(second);
        let id = free.find(|id| !self.0.contains(id)).unwrap_or_default();
        self.0.insert(id.clone());
        id
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_quoted_where_yaml_would_read_another_thing() {
        for (text, expected) in [
            ("arms", "arms"),
            ("on", "'on'"),
            ("5", "'5'"),
            ("it's: x", "'it''s: x'"),
            ("a\tb", "\"a\\U00000009b\""),
            ("", "''"),
        ] {
            assert_eq!(quoted(text), expected);
        }
        for (seconds, expected) in [
            (5.0, "5s"),
            (0.25, "250ms"),
            (1.5, "1500ms"),
            (90.0, "90s"),
            (3600.5, "3600500ms"),
            (1e-5, "10us"),
        ] {
            assert_eq!(duration(seconds), expected);
        }
    }

    #[test]
    fn ids_are_safe_and_unique() {
        let mut ids = Ids::at_the_top();
        let made = ["Left Arm", "Left/Arm", "Other", "other", "ä"].map(|name| ids.of(name));
        assert_eq!(made, ["Left_Arm", "Left_Arm-2", "Other", "other-2", "group"]);
    }
}
