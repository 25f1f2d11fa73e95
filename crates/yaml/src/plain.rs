//! Makes text of a file safe for a terminal: characters that move the cursor, change colours or turn the
//! reading direction are replaced by their number.

use std::borrow::Cow;

/// `text` with such characters as `\u{1b}`. Line feeds and tabs stay.
pub fn escaped(text: &str) -> Cow<'_, str> {
    if !text.contains(acts) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        if acts(letter) { out.extend(letter.escape_unicode()) } else { out.push(letter) }
    }
    Cow::Owned(out)
}

/// `text` as a part of one line: line feeds and tabs too are replaced, as `\n` and `\t`.
pub fn line(text: &str) -> Cow<'_, str> {
    if !text.contains(|letter| matches!(letter, '\n' | '\t') || acts(letter)) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 8);
    for letter in text.chars() {
        match letter {
            '\n' | '\r' | '\t' => out.extend(letter.escape_default()),
            letter if acts(letter) => out.extend(letter.escape_unicode()),
            letter => out.push(letter),
        }
    }
    Cow::Owned(out)
}

/// A document of JSON in one line: such characters, which stand in its texts alone, are escaped as JSON has it.
pub fn json(document: &str) -> Cow<'_, str> {
    if !document.contains(|letter| matches!(letter, '\n' | '\t') || acts(letter)) {
        return Cow::Borrowed(document);
    }
    let mut out = String::with_capacity(document.len() + 8);
    for letter in document.chars() {
        match letter {
            // Between the parts of a document.
            '\n' | '\r' | '\t' => out.push(' '),
            letter if acts(letter) => {
                let mut units = [0; 2];
                out.extend(letter.encode_utf16(&mut units).iter().map(|unit| format!("\\u{unit:04x}")));
            }
            letter => out.push(letter),
        }
    }
    Cow::Owned(out)
}

/// `text` with a mark of the same number of bytes for each such character, so that places in it stay the
/// same.
pub fn masked(text: &str) -> String {
    let mark = |letter: char| match letter.len_utf8() {
        1 => '?',
        2 => '¿',
        3 => '\u{fffd}',
        _ => '𝪋',
    };
    text.chars().map(|letter| if acts(letter) { mark(letter) } else { letter }).collect()
}

/// Control characters, and those of the bidirectional algorithm.
pub fn acts(letter: char) -> bool {
    let control = letter.is_control() && !matches!(letter, '\n' | '\t');
    control
        || matches!(letter,
            '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
            | '\u{feff}' | '\u{e0000}'..='\u{e007f}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_acts_on_a_terminal_is_shown_by_its_number() {
        assert_eq!(escaped("a\u{1b}[2Jb\u{202e}c\td\n"), "a\\u{1b}[2Jb\\u{202e}c\td\n");
        assert_eq!(escaped("Übersicht – 日本\n"), "Übersicht – 日本\n");
    }

    #[test]
    fn a_text_cannot_begin_another_line() {
        assert_eq!(line("a\nb\r\tc\u{1b}[1Fd\u{2028}\u{85}e"), r"a\nb\r\tc\u{1b}[1Fd\u{2028}\u{85}e");
        assert_eq!(line("Übersicht – 日本"), "Übersicht – 日本");
    }

    #[test]
    fn a_line_of_json_means_the_same_and_does_not_act() {
        let line = json("{\"a\":\n\"x\u{9b}31m\u{7f}\u{202e}\u{e0041}\"}\n");
        assert_eq!(line, r#"{"a": "x\u009b31m\u007f\u202e\udb40\udc41"} "#);
        let read: serde_json::Value = serde_json::from_str(&line).unwrap();
        assert_eq!(read["a"], "x\u{9b}31m\u{7f}\u{202e}\u{e0041}");
    }

    #[test]
    fn marks_are_as_long_as_what_they_stand_for() {
        for text in ["a\u{1b}b", "a\u{9b}b", "a\u{202e}b", "a\u{e0041}b", "\r\n"] {
            let masked = masked(text);
            assert_eq!(masked.len(), text.len(), "{text:?}");
            assert_eq!(escaped(&masked), masked, "{text:?}");
        }
    }
}
