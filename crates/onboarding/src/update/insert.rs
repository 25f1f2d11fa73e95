//! Where something is added to a list of a YAML file, so that everything that people wrote stays byte for byte. Lists come
//! in blocks, with a line for each item, or in brackets. Places follow from the tree; ends of blocks follow from the
//! indentation, because the tree knows where a block begins and not where it ends.

use telltale_yaml::{Kind, Node};

/// A text, and where it goes in.
#[derive(Debug, PartialEq, Eq)]
pub struct Insertion {
    pub at: usize,
    pub text: String,
}

/// How the items of a list are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// With a `-` in this column.
    Block(usize),
    /// In brackets, on lines of their own from this column on.
    Brackets(usize),
}

/// The place behind the last item of a list. `None`: it is written in a way that nothing can be added to.
pub fn behind_last(text: &str, list: &Node) -> Option<(usize, Form)> {
    let Kind::Sequence(items) = &list.kind else { return None };
    let start = list.span.start as usize;
    if text[start..].starts_with('[') {
        let column = indentation(text, start) + 2;
        return Some((last_token(text, start)?, Form::Brackets(column)));
    }
    let last = items.last()?.span.start as usize;
    let dash = indentation(text, last);
    let line = line_start(text, last);
    text[line + dash..].starts_with('-').then(|| (block_end(text, last, dash), Form::Block(dash)))
}

/// The end of a group that is an item of a list, for a further key, and the column of its keys; in braces without one.
pub fn behind_keys(text: &str, item: &Node) -> Option<(usize, Form)> {
    let start = item.span.start as usize;
    if text[start..].starts_with('{') {
        return Some((last_token(text, start)?, Form::Brackets(indentation(text, start) + 2)));
    }
    let line = line_start(text, start);
    let dash = indentation(text, start);
    let is_item = text[line + dash..].starts_with('-') && matches!(item.kind, Kind::Mapping(_));
    is_item.then(|| (block_end(text, start, dash), Form::Block(start - line)))
}

/// Whether a list in brackets is empty.
pub fn is_empty(list: &Node) -> bool {
    matches!(&list.kind, Kind::Sequence(items) if items.is_empty())
}

pub fn line_start(text: &str, at: usize) -> usize {
    text[..at].rfind('\n').map_or(0, |newline| newline + 1)
}

/// Spaces at the beginning of the line of a place.
fn indentation(text: &str, at: usize) -> usize {
    let line = &text[line_start(text, at)..];
    line.len() - line.trim_start_matches(' ').len()
}

/// The end of the last line of an item whose `-` stands in this column, with the comments right below that are in line
/// with it.
fn block_end(text: &str, item: usize, dash: usize) -> usize {
    let next = |at: usize| text[at..].find('\n').map_or(text.len(), |newline| at + newline + 1);
    let mut end = next(item);
    let mut at = end;
    while at < text.len() {
        let line = &text[at..next(at)];
        let (indent, words) = (indentation(text, at), line.trim());
        let is_comment = words.starts_with('#');
        if !words.is_empty() && indent <= dash && !is_comment {
            break;
        }
        at = next(at);
        if !words.is_empty() && indent > dash {
            end = at;
        }
    }
    // Comments in line with the item are its own, unless something in line with them follows at once.
    let mut behind = end;
    while text[behind..next(behind)].trim_start().starts_with('#') && indentation(text, behind) >= dash {
        behind = next(behind);
    }
    let follows = behind < text.len()
        && !text[behind..next(behind)].trim().is_empty()
        && indentation(text, behind) >= dash;
    if follows { end } else { behind }
}

/// The end of the last token in brackets before the closing one, without a comma.
pub fn last_token(text: &str, open: usize) -> Option<usize> {
    let (mut depth, mut last, mut quote, mut before) = (0_usize, open, None, ' ');
    let mut letters = text[open..].char_indices().peekable();
    while let Some((offset, letter)) = letters.next() {
        let end = open + offset + letter.len_utf8();
        match (quote, letter) {
            (Some('"'), '\\') => drop(letters.next()),
            (Some(mark), _) if mark == letter => {
                // Two in a row stand for one.
                if mark == '\'' && letters.peek().is_some_and(|(_, next)| *next == '\'') {
                    letters.next();
                } else {
                    (quote, last, before) = (None, end, letter);
                }
            }
            (Some(_), _) => {}
            (None, '#') if text[..end - 1].ends_with(char::is_whitespace) => {
                while letters.peek().is_some_and(|(_, next)| *next != '\n') {
                    letters.next();
                }
            }
            (None, '\'' | '"') if "[{,:".contains(before) => quote = Some(letter),
            (None, '[' | '{') => (depth, last, before) = (depth + 1, end, letter),
            (None, ']' | '}') => {
                depth = depth.checked_sub(1)?;
                if depth == 0 {
                    return Some(last);
                }
                (last, before) = (end, letter);
            }
            (None, ',') => before = letter,
            (None, letter) if letter.is_whitespace() => {}
            (None, letter) => (last, before) = (end, letter),
        }
    }
    None
}

/// The text with all insertions, which may come in any order.
pub fn applied(text: &str, mut insertions: Vec<Insertion>) -> String {
    insertions.sort_by_key(|insertion| insertion.at);
    let mut out = String::with_capacity(text.len() + 4096);
    let mut from = 0;
    for Insertion { at, text: new } in insertions {
        out.push_str(&text[from..at]);
        out.push_str(&new);
        from = at;
    }
    out.push_str(&text[from..]);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_yaml::{Log, Sources, tree};

    /// The text with `@` where the key `list` of a map ends.
    fn marked(text: &str) -> String {
        let mut sources = Sources::default();
        let file = sources.add("c", text);
        let tree = tree::parse(&sources, file, &mut Log::default()).expect("it is YAML");
        let list = tree.get("list").expect("it has a list");
        let Some((at, form)) = behind_last(text, list) else { return "none".into() };
        let mark = match form {
            Form::Block(column) => format!("@{column}\n"),
            Form::Brackets(_) => "@".to_owned(),
        };
        applied(text, vec![Insertion { at, text: mark }])
    }

    #[test]
    fn an_item_goes_behind_the_last_one_and_what_belongs_to_it() {
        for (text, expected) in [
            ("list:\n  - a\n  - b\nc: 1\n", "list:\n  - a\n  - b\n@2\nc: 1\n"),
            ("list:\n- a\n- b\nc: 1\n", "list:\n- a\n- b\n@0\nc: 1\n"),
            // Its own lines, with blank ones between them, and a text that looks like a comment.
            (
                "list:\n  - a: |\n      x\n\n      # y\n\n# z\n",
                "list:\n  - a: |\n      x\n\n      # y\n@2\n\n# z\n",
            ),
            ("list:\n  - a: 1\n# odd\n    b: 2\n", "list:\n  - a: 1\n# odd\n    b: 2\n@2\n"),
            // Comments in line with it, which no line follows.
            ("list:\n  - a\n  # of a\n\nc: 1\n", "list:\n  - a\n  # of a\n@2\n\nc: 1\n"),
            ("list:\n  - a # of a\n# of c\nc: 1\n", "list:\n  - a # of a\n@2\n# of c\nc: 1\n"),
            ("list:\n- a\n# of c\nc: 1\n", "list:\n- a\n@0\n# of c\nc: 1\n"),
            ("list: [a, 'b]' , \"c\\\"]\" ] # ]\n", "list: [a, 'b]' , \"c\\\"]\"@ ] # ]\n"),
            ("list: [it's, { b: 'it''s' },\n  # no ]\n]\n", "list: [it's, { b: 'it''s' }@,\n  # no ]\n]\n"),
            ("list: []\n", "list: [@]\n"),
            ("list: a\n", "none"),
        ] {
            assert_eq!(marked(text), expected, "{text}");
        }
    }
}
