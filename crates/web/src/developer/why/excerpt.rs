//! The part of the configuration that describes a node.

use crate::developer::page_query::address;
use crate::texts::{NAME, clean, clean_lines};
use telltale_runtime::Written;

/// Lines that are shown, and lines of comments above them.
const LINES: usize = 24;
const COMMENTS: usize = 4;
/// Letters of one line.
const LETTERS: usize = 200;
/// Lines of one page of the configuration.
const PAGE_LINES: usize = super::super::configuration::LINES;

pub struct Excerpt {
    pub file: String,
    /// The line of the node's id, counted from 1.
    pub line: usize,
    /// The page of the configuration with this line.
    pub address: String,
    pub lines: Vec<(usize, String)>,
    /// Lines of the node that are left out.
    pub more: usize,
}

/// The text of a node in the files; `None` if it is not written there.
pub fn excerpt(written: &Written, node: &str) -> Option<Excerpt> {
    let &(file, line) = written.lines.get(node)?;
    let text = written.texts.get(usize::from(file))?;
    let lines: Vec<&str> = text.text.lines().collect();
    let (from, to) = block(&lines, line.checked_sub(1)?)?;
    let shown = lines[from..to].iter().take(LINES).zip(from + 1..);
    let page = from / PAGE_LINES + 1;
    let fields = [("file", file.to_string()), ("page", page.to_string())];
    Some(Excerpt {
        file: clean(&text.name, 2 * NAME),
        line,
        address: format!(
            "/developer/configuration{}",
            address(fields.iter().map(|(name, value)| (*name, &**value)))
        ),
        lines: shown.map(|(text, number)| (number, clean_lines(&cut(text)))).collect(),
        more: (to - from).saturating_sub(LINES),
    })
}

fn cut(text: &str) -> String {
    let mut letters = text.chars();
    let mut shown: String = letters.by_ref().take(LETTERS).collect();
    if letters.next().is_some() {
        shown.push('…');
    }
    shown
}

/// The lines of the item in which line `at` stands, with the comments directly above: by indentation, as YAML does.
fn block(lines: &[&str], at: usize) -> Option<(usize, usize)> {
    let margin = |line: &str| line.len() - line.trim_start_matches(' ').len();
    let is_blank = |line: &str| line.trim().is_empty();
    let key = margin(lines.get(at)?);
    let begins_item = |line: &str| line.trim_start().starts_with("- ");
    // Keys of an item stand right of its dash.
    let above = (0..at).rev().take_while(|_| !begins_item(lines[at]));
    let above =
        above.map(|index| (index, lines[index])).find(|(_, line)| !is_blank(line) && margin(line) < key);
    let first = match above {
        Some((index, line)) if begins_item(line) => index,
        _ => at,
    };
    let item = margin(lines[first]);
    let inside = lines[first + 1..].iter().take_while(|line| is_blank(line) || margin(line) > item).count();
    let mut end = first + 1 + inside;
    // Blank lines, and comments that belong to the next item, are no part of it.
    while end > first + 1 && (is_blank(lines[end - 1]) || lines[end - 1].trim_start().starts_with('#')) {
        end -= 1;
    }
    let is_comment = |line: &&str| line.trim_start().starts_with('#') && margin(line) == item;
    let comments = lines[..first].iter().rev().take(COMMENTS).take_while(|line| is_comment(line)).count();
    Some((first - comments, end))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "groups:\n  - id: a\n    modules:\n      # why b\n      - id: b\n        monitor: { x: 1 }\n\n      # why c\n      - name: C\n        id: c\n        help: {}\n  - { id: d }\n  - id: e\n";

    #[test]
    fn an_item_ends_where_the_next_one_begins() {
        let lines: Vec<&str> = FILE.lines().collect();
        for (at, shown) in [(1, (1, 11)), (4, (3, 6)), (9, (7, 11)), (11, (11, 12)), (12, (12, 13))] {
            assert_eq!(block(&lines, at), Some(shown), "{}", lines[at]);
        }
        assert_eq!(block(&lines, 99), None);
    }
}
