//! How much room words take, estimated without a browser: so that what has none is counted, not cut.

/// Height of a line of large and of small type on the reference display, in pixels.
pub const LARGE: usize = 36;
pub const SMALL: usize = 29;
/// How many letters' heights a line of the list of causes is wide.
pub const LARGE_EM: f64 = 9.9;
pub const SMALL_EM: f64 = 13.2;
/// The same for the action bar's list.
pub const SMALL_EM_BAR: f64 = 19.0;
/// And with one more button beside it.
pub const SMALL_EM_BAR_NARROW: f64 = 13.0;
const SPACE_EM: f64 = 0.26;

/// How many lines a text takes where one is `em` wide: broken at words, in an average sans serif.
pub fn lines(text: &str, em: f64, most: usize) -> usize {
    let (mut lines, mut used) = (0, em);
    for word in text.split_whitespace() {
        let width: f64 = word.chars().map(width).sum();
        if lines == 0 || used + SPACE_EM + width > em {
            // A word longer than a line is broken wherever the line ends.
            lines += (width / em).ceil().max(1.0) as usize;
            used = width % em;
        } else {
            used += SPACE_EM + width;
        }
    }
    lines.min(most)
}

fn width(letter: char) -> f64 {
    match letter {
        'i' | 'j' | 'l' | 'I' | '.' | ',' | ':' | '\'' | '|' | '!' => 0.29,
        'f' | 'r' | 't' | '(' | ')' | '-' | '/' => 0.4,
        'm' | 'w' | 'M' | 'W' => 0.88,
        _ if letter.is_ascii_lowercase() || letter.is_ascii_digit() => 0.58,
        _ if letter.is_ascii() => 0.68,
        _ if letter.is_lowercase() => 0.6,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_estimated_as_a_browser_breaks_them() {
        for (text, expect) in [
            ("", 0),
            ("LiDAR data missing", 1),
            ("Position ist gesprungen", 2),
            ("Keine Verbindung zum Fahrzeug", 2),
            ("Am nächsten sicheren Ort anhalten. Leitstelle rufen.", 4),
        ] {
            assert_eq!(lines(text, LARGE_EM, 9), expect, "{text}");
        }
        assert_eq!(lines(&"w".repeat(500), LARGE_EM, 2), 2);
    }
}
