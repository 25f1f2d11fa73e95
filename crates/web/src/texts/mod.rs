//! Every text of the pages in each language: a row for each text, a column for each language. A text that lacks a
//! language does not compile. Another language is a column in the macros here and in each row.

/// Rows of texts. `words Name { key: "en", "de"; }` makes a struct of fixed words, whose `of` gives those of a language.
/// Each row after that is a method of [`Lang`]:
///
/// * `text parts(count: usize) { "{count} parts", "{count} Teile" }` inserts its arguments by their names.
/// * `text parts(count: usize; of: &str) { 1 => "one {of}", "ein {of}"; _ => "{count} {of}", "{count} {of}"; }` chooses by
///   the arguments before the semicolon first.
/// * `word` chooses likewise among texts that insert nothing. `known` is `None` for what it does not list.
macro_rules! texts {
    (words $table:ident { $($key:ident: $en:literal, $de:literal;)* } $($rest:tt)*) => {
        /// Fixed words of one language.
        #[derive(Debug)]
        pub struct $table { $(pub $key: &'static str,)* }

        impl $table {
            pub fn of(lang: $crate::texts::Lang) -> &'static $table {
                static EN: $table = $table { $($key: $en,)* };
                static DE: $table = $table { $($key: $de,)* };
                lang.choose(&EN, &DE)
            }
        }

        #[cfg(test)]
        pub const WORDS: &[$crate::texts::tests::Row] = &[$((stringify!($key), $en, $de),)*];

        texts! { $($rest)* }
    };
    ($($(#[$doc:meta])* $kind:ident $name:ident($($by:ident: $of:ty),* $(; $($with:ident: $of_with:ty),*)?) { $($row:tt)* })*) => {
        impl $crate::texts::Lang {
            $($(#[$doc])*
            pub fn $name(self, $($by: $of,)* $($($with: $of_with),*)?) -> returned!($kind) {
                chosen!($kind self ($($by,)*) $($row)*)
            })*
        }

        #[cfg(test)]
        pub const ROWS: &[&[$crate::texts::tests::Row]] = &[$(rows!($name $($row)*),)*];
    };
}

macro_rules! returned {
    (text) => { String };
    (word) => { &'static str };
    (known) => { Option<&'static str> };
}

macro_rules! chosen {
    ($kind:ident $lang:tt $by:tt $en:literal, $de:literal) => { said!($kind $lang $en, $de) };
    (known $lang:tt $by:tt $($is:pat => $en:literal, $de:literal;)*) => {
        match $by { $(($is,) => Some(said!(word $lang $en, $de)),)* _ => None }
    };
    ($kind:ident $lang:tt $by:tt $($($is:pat),+ $(if $so:expr)? => $en:literal, $de:literal;)*) => {
        match $by { $(($($is,)+) $(if $so)? => said!($kind $lang $en, $de),)* }
    };
}

macro_rules! said {
    (text $lang:tt $en:literal, $de:literal) => {
        match $lang {
            $crate::texts::Lang::En => format!($en),
            $crate::texts::Lang::De => format!($de),
        }
    };
    (word $lang:tt $en:literal, $de:literal) => {
        $lang.choose($en, $de)
    };
}

#[cfg(test)]
macro_rules! rows {
    ($name:ident $en:literal, $de:literal) => { &[(stringify!($name), $en, $de)] };
    ($name:ident $($($is:pat),+ $(if $so:expr)? => $en:literal, $de:literal;)*) => { &[$((stringify!($name), $en, $de),)*] };
}

mod clean;
pub mod console;
pub mod developer;
mod errors;
pub mod incidents;
pub mod learn;
pub mod operator;
mod refusals;
mod states;

pub use clean::{
    ID, MESSAGE, NAME, VALUE, address, clean, clean_configured, clean_lines, encode, plain_json,
};
pub use developer::DevWords;
pub use errors::HttpError;
pub use incidents::IncidentWords;
pub use learn::LearnWords;
pub use operator::{SessionEnd, Words};
pub use refusals::InvalidTap;

use telltale_engine::model::quantity::number;
use telltale_engine::snapshot::Report;
use telltale_engine::text::Text;
use telltale_record::retention::size;

telltale_engine::words! {
    /// A language of the pages, with the tag of the `lang` attribute and cookie.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
    pub enum Lang {
        #[default]
        En = "en",
        De = "de",
    }
}

impl Lang {
    /// The text of this language.
    pub fn choose<T>(self, en: T, de: T) -> T {
        match self {
            Lang::En => en,
            Lang::De => de,
        }
    }

    /// A text of the configuration in this language. It comes from outside: cleaned.
    pub fn pick(self, text: &Text, letters: usize) -> String {
        clean_configured(self.choose(&text.en, &text.de), letters)
    }

    /// The message of a report. A publisher has one language; the engine's own messages have each.
    pub fn message(self, report: &Report) -> &str {
        self.choose(&report.message, report.german.as_ref().unwrap_or(&report.message))
    }

    /// A number, perhaps with a unit, with the decimal separator of the language.
    pub fn decimals(self, number: &str) -> String {
        number.replace('.', self.choose(".", ","))
    }

    /// A number of bytes for people.
    pub fn size(self, bytes: u64) -> String {
        self.decimals(&size(bytes))
    }

    /// A number as people read it: times `factor`, with few digits, with the decimal separator of the language
    /// and with its unit. A number that is followed by a unit keeps that, and any other text stays.
    pub fn quantity(self, text: &str, factor: f64, unit: &str) -> String {
        let (first, rest) = text.split_once(' ').unwrap_or((text, unit));
        let decimal = |it: char| it.is_ascii_digit() || matches!(it, '.' | '-');
        let value = first.parse::<f64>().ok().filter(|_| first.chars().all(decimal));
        let Some(value) = value.filter(|_| !rest.contains(|it: char| it.is_ascii_digit())) else {
            return text.to_owned();
        };
        let digits = first.trim_start_matches(['-', '0', '.']).chars().filter(char::is_ascii_digit).count();
        // A whole number, as a count, is exact.
        let exact = factor == 1.0 && (digits <= 3 || !first.contains('.'));
        let number = if exact { first.to_owned() } else { number(value * factor) };
        let number = self.decimals(&number);
        if rest.is_empty() { number } else { format!("{number} {rest}") }
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// The name of a text, and the text in each language.
    pub type Row = (&'static str, &'static str, &'static str);

    /// Words of the operator's page that are the same in each language, on purpose.
    const SAME: &[&str] = &["ok", "name", "demo", "live", "position", "stop", "recording_short"];

    /// The insertions into a text.
    fn inserted(text: &str) -> BTreeSet<&str> {
        text.split('{').skip(1).filter_map(|rest| rest.split('}').next()).collect()
    }

    #[test]
    fn every_text_is_said_in_each_language_and_inserts_the_same() {
        let words = [console::WORDS, developer::WORDS, incidents::WORDS, learn::WORDS, operator::WORDS];
        let rows = [
            console::ROWS,
            developer::ROWS,
            errors::ROWS,
            incidents::ROWS,
            learn::ROWS,
            operator::ROWS,
            refusals::ROWS,
        ];
        let all = words.into_iter().chain(rows.into_iter().flatten().copied()).flatten();
        for (name, en, de) in all {
            assert_eq!(en.trim().is_empty(), de.trim().is_empty(), "{name}");
            assert_eq!(inserted(en), inserted(de), "{name}");
        }
        for (name, en, de) in operator::WORDS {
            assert!(!en.is_empty() && (en != de || SAME.contains(name)), "{name}: {en}");
        }
    }

    #[test]
    fn numbers_are_short_and_have_their_units() {
        for (text, factor, unit, en, de) in [
            ("0.17", 100.0, "%", "17 %", "17 %"),
            ("0.1746", 100.0, "%", "17.5 %", "17,5 %"),
            ("4.9", 1.0, "m/s", "4.9 m/s", "4,9 m/s"),
            ("25.6342 V", 1.0, "", "25.6 V", "25,6 V"),
            ("0.123456", 1.0, "", "0.123", "0,123"),
            ("-12.3456", 1.0, "", "-12.3", "-12,3"),
            ("1234567", 1.0, "", "1234567", "1234567"),
            ("10.77.0.1", 1.0, "", "10.77.0.1", "10.77.0.1"),
            ("2.5 of 3.5", 1.0, "", "2.5 of 3.5", "2.5 of 3.5"),
            ("not a number", 1.0, "m/s", "not a number", "not a number"),
            ("high", 1.0, "", "high", "high"),
        ] {
            assert_eq!(Lang::En.quantity(text, factor, unit), en);
            assert_eq!(Lang::De.quantity(text, factor, unit), de);
        }
    }
}
