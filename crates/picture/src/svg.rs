//! Text and attributes in SVG.

use std::fmt::Write as _;

use telltale_yaml::plain;

/// Attributes of an element; one with an empty value is written as its name alone.
pub type Attributes = Vec<(&'static str, String)>;

/// `text` as content of an element or value of an attribute. Characters that would change the reading
/// direction are shown by their number, as on a terminal.
pub fn escaped(text: &str) -> String {
    let text = plain::escaped(text);
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            // Characters that XML cannot contain in any form.
            letter if letter.is_control() => escaped.push(' '),
            letter => escaped.push(letter),
        }
    }
    escaped
}

/// Attributes as they stand in a tag, each after a space.
pub(super) fn attributes(attributes: &[(&'static str, String)]) -> String {
    let mut out = String::new();
    for (name, value) in attributes {
        // Writing to a string cannot fail.
        let _ = match value.is_empty() {
            true => write!(out, " {name}"),
            false => write!(out, " {name}=\"{}\"", escaped(value)),
        };
    }
    out
}

/// The beginning of a text that fits into a width, if a letter is as wide as this at most.
pub(super) fn beginning(text: &str, width: f64, letter: f64) -> String {
    let letters_max = (width / letter).max(4.0) as usize;
    if text.chars().count() <= letters_max {
        return text.to_owned();
    }
    let kept: String = text.chars().take(letters_max - 1).collect();
    format!("{kept}\u{2026}")
}

/// The end of a text, in so many letters.
pub(super) fn end(text: &str, letters: usize) -> String {
    let count = text.chars().count();
    if count <= letters {
        return text.to_owned();
    }
    let kept: String = text.chars().skip(count + 1 - letters).collect();
    format!("\u{2026}{kept}")
}
