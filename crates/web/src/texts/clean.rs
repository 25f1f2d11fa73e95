//! Cleans text from outside for a page. The templates escape it; here goes what escaping leaves:
//! invisible characters, reversed direction, endless combining marks, endless length.

use std::fmt::Write as _;

/// Letters in a name on a tile or in a list.
pub const NAME: usize = 60;
/// Letters of a message.
pub const MESSAGE: usize = 200;
/// Letters of the name by which programs find a node.
pub const ID: usize = 300;
/// Letters of a key or a value.
pub const VALUE: usize = 60;
/// Invisible where the word does not break.
const SOFT_HYPHEN: char = '\u{ad}';
/// Marks that may stand on one letter; more grow over the lines above and below.
const MARKS: usize = 2;

/// `text` in one line of at most `letters` characters: no control, bidi or invisible characters,
/// runs of space as one space. What is cut off shows as `…`.
pub fn clean(text: &str, letters: usize) -> String {
    cleaned(text, letters, false)
}

/// The same for a text of the configuration: its soft hyphens stay, at which long words break.
pub fn clean_configured(text: &str, letters: usize) -> String {
    cleaned(text, letters, true)
}

fn cleaned(text: &str, letters: usize, keeps_hyphens: bool) -> String {
    let mut out = String::with_capacity(text.len().min(letters * 4));
    let (mut count, mut marks, mut space) = (0, 0, false);
    for letter in text.chars() {
        if letter.is_whitespace() || letter.is_control() {
            space = count > 0;
            continue;
        }
        if letter == SOFT_HYPHEN && keeps_hyphens && !space {
            out.push(letter);
            continue;
        }
        if is_invisible(letter) {
            continue;
        }
        marks = if is_mark(letter) { marks + 1 } else { 0 };
        if marks > MARKS {
            continue;
        }
        if count + usize::from(space) >= letters {
            out.push('…');
            return out;
        }
        if space {
            out.push(' ');
            count += 1;
            space = false;
        }
        out.push(letter);
        count += 1;
    }
    out
}

/// `text` with its lines and spaces, without invisible characters: for messages that draw with letters.
pub fn clean_lines(text: &str) -> String {
    let seen = |&letter: &char| letter == '\n' || !letter.is_control() && !is_invisible(letter);
    text.chars().filter(seen).collect()
}

/// A JSON text in which characters that act on a terminal or on the direction of reading stand by their numbers: a
/// program reads the same, and a person who looks at the file sees them.
pub fn plain_json(text: String) -> String {
    let acts = |letter: char| letter != '\n' && (letter.is_control() || is_invisible(letter));
    if !text.contains(acts) {
        return text;
    }
    let mut out = String::with_capacity(text.len() + 64);
    for letter in text.chars() {
        if acts(letter) {
            for unit in letter.encode_utf16(&mut [0; 2]) {
                // Writing to a string cannot fail.
                let _ = write!(out, "\\u{unit:04x}");
            }
        } else {
            out.push(letter);
        }
    }
    out
}

/// A node's name as a part of an address; slashes stay.
pub fn address(name: &str) -> String {
    let mut out = String::with_capacity(name.len());
    encode(&mut out, name, b"-_.~/");
    out
}

/// Writes a text into an address: letters, digits and these characters as they are.
pub fn encode(out: &mut String, text: &str, plain: &[u8]) {
    for byte in text.bytes() {
        if byte.is_ascii_alphanumeric() || plain.contains(&byte) {
            out.push(char::from(byte));
        } else {
            // Writing to a string cannot fail.
            let _ = write!(out, "%{byte:02X}");
        }
    }
}

/// Characters that change how others read and are not seen themselves.
const fn is_invisible(letter: char) -> bool {
    matches!(letter,
        '\u{ad}' | '\u{34f}' | '\u{61c}' | '\u{115f}' | '\u{1160}' | '\u{17b4}' | '\u{17b5}'
        | '\u{180b}'..='\u{180f}' | '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}'
        | '\u{2060}'..='\u{206f}' | '\u{3164}' | '\u{fe00}'..='\u{fe0f}' | '\u{feff}' | '\u{ffa0}'
        | '\u{fff0}'..='\u{fffb}' | '\u{e0000}'..='\u{e0fff}')
}

const fn is_mark(letter: char) -> bool {
    matches!(letter,
        '\u{300}'..='\u{36f}' | '\u{483}'..='\u{489}' | '\u{591}'..='\u{5bd}' | '\u{610}'..='\u{61a}'
        | '\u{64b}'..='\u{65f}' | '\u{e31}' | '\u{e34}'..='\u{e3a}' | '\u{e47}'..='\u{e4e}'
        | '\u{1ab0}'..='\u{1aff}' | '\u{1dc0}'..='\u{1dff}' | '\u{20d0}'..='\u{20ff}' | '\u{fe20}'..='\u{fe2f}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, letters: usize, expect: &str) {
        assert_eq!(clean(text, letters), expect, "{text:?}");
    }

    #[test]
    fn an_address_holds_any_name() {
        assert_eq!(address("can/a b?ä"), "can/a%20b%3F%C3%A4");
    }

    #[test]
    fn ordinary_words_stay() {
        check("Straße größer als 5 m/s² – \u{fffd} 日本", 60, "Straße größer als 5 m/s² – \u{fffd} 日本");
    }

    #[test]
    fn what_cannot_be_seen_goes() {
        check("a\u{202e}b\u{2066}c\u{200f}d\u{feff}e\u{e0041}f", 60, "abcdef");
        check("a\0b\u{1b}[31mc\u{85}d", 60, "a b [31mc d");
    }

    #[test]
    fn a_text_of_the_configuration_says_where_it_breaks() {
        assert_eq!(clean_configured("Hindernis\u{ad}karte", NAME), "Hindernis\u{ad}karte");
        assert_eq!(clean_configured("\u{ad}\u{202e}a\u{ad} b", 3), "\u{ad}a\u{ad} b");
    }

    #[test]
    fn space_of_every_kind_is_one_space() {
        check("  a \t\r\n b\u{2028}\u{2029}c  ", 60, "a b c");
    }

    #[test]
    fn marks_without_end_are_cut() {
        check(&format!("Z{}!", "\u{30d}".repeat(500)), 60, "Z\u{30d}\u{30d}!");
    }

    #[test]
    fn json_means_the_same_without_characters_that_act() {
        let said =
            serde_json::json!({ "note": "a\u{1b}[2J\u{7f}\u{9b}\u{202e}b\u{e0041}\n", "ok": "grün – 日本" });
        let plain = plain_json(said.to_string());
        let is_plain = |letter: char| !letter.is_control() && !is_invisible(letter);
        assert!(plain.chars().all(is_plain) && plain.contains("grün – 日本"), "{plain}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&plain).unwrap(), said);
    }

    #[test]
    fn length_is_bounded_and_shown() {
        check("abcdef", 6, "abcdef");
        check("abcdefg", 6, "abcdef…");
        check("abcdef   ", 6, "abcdef");
        check(&"ü".repeat(100_000), 3, "üüü…");
    }
}
