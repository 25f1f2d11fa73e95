//! Text from outside (statuses, names, messages) made fit for a page.

use std::borrow::Cow;

/// Stands where characters were left out at the end.
const ELLIPSIS: char = '…';

/// `text` without control characters and without those that steer the direction of what
/// follows, at most `chars_max` long. Line breaks and tabs become spaces. It is not escaped.
pub fn clean(text: &str, chars_max: usize) -> Cow<'_, str> {
    // Most texts are short and plain: one pass over bytes settles that.
    if text.len() <= chars_max && text.bytes().all(|byte| (b' '..0x7f).contains(&byte)) {
        return Cow::Borrowed(text);
    }
    let mut cleaned = String::with_capacity(text.len().min(chars_max * 4));
    let mut visible = text.chars().map(spaced).filter(|char| !steers(*char));
    cleaned.extend(visible.by_ref().take(chars_max));
    if visible.next().is_some() {
        cleaned.pop();
        cleaned.push(ELLIPSIS);
    }
    Cow::Owned(cleaned)
}

fn spaced(char: char) -> char {
    if matches!(char, '\t' | '\n' | '\r' | '\u{2028}' | '\u{2029}') { ' ' } else { char }
}

fn steers(char: char) -> bool {
    char.is_control()
        || matches!(char, '\u{61c}' | '\u{200b}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}'
            | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hostile_text_loses_what_steers_and_what_is_too_much() {
        let cases = [
            ("plain", 10, "plain"),
            ("", 10, ""),
            ("a\u{202e}b\u{2066}c\u{0}d\u{1b}[31me", 20, "abcd[31me"),
            ("two\nlines\there", 20, "two lines here"),
            ("0123456789", 10, "0123456789"),
            ("0123456789a", 10, "012345678…"),
            ("ääääää", 6, "ääääää"),
            ("äääääää", 6, "äääää…"),
            ("a\u{200e}\u{200e}\u{200e}", 1, "a"),
        ];
        for (text, chars_max, expected) in cases {
            assert_eq!(clean(text, chars_max), expected, "{text:?}");
        }
    }
}
