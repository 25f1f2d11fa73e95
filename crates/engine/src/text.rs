//! A text in each language of the display, and bytes as text.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

/// A text in the languages of the HMI.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Text {
    pub en: Arc<str>,
    pub de: Arc<str>,
}

impl Default for Text {
    fn default() -> Text {
        Text::plain("")
    }
}

/// Names, numbers and quotations are the same in every language.
impl<T: fmt::Display> From<T> for Text {
    fn from(text: T) -> Text {
        Text::plain(&text.to_string())
    }
}

impl Text {
    /// The same text in every language.
    pub fn plain(text: &str) -> Text {
        let text: Arc<str> = Arc::from(text);
        Text { en: text.clone(), de: text }
    }
}

/// Bytes as hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// One sentence in both languages. Each argument is inserted by its name, in its own language if it is a
/// [`Text`]: `say!("no message for {time}", "keine Nachricht seit {time}", time = span(age))`. A variable stands for
/// itself.
macro_rules! say {
    (@of $name:ident) => { $name };
    (@of $name:ident $value:expr) => { $value };
    ($en:literal, $de:literal $(, $name:ident $(= $value:expr)?)*) => {{
        $(let $name = $crate::text::Text::from($crate::text::say!(@of $name $($value)?));)*
        let en = { $(let $name = &*$name.en;)* std::fmt::format(format_args!($en)) };
        let de = { $(let $name = &*$name.de;)* std::fmt::format(format_args!($de)) };
        $crate::text::Text { en: en.into(), de: de.into() }
    }};
}

/// An enum whose variants have words: for files, for the wire, or for people. `ALL` has them in order.
#[macro_export]
macro_rules! words {
    ($(#[$about:meta])* pub enum $name:ident { $($(#[$of:meta])* $variant:ident = $word:literal,)* }) => {
        $(#[$about])*
        pub enum $name {
            $($(#[$of])* $variant,)*
        }

        impl $name {
            pub const ALL: [$name; [$($word),*].len()] = [$($name::$variant),*];

            pub const fn as_str(self) -> &'static str {
                match self {
                    $($name::$variant => $word),*
                }
            }

            pub fn from_word(word: &str) -> Option<$name> {
                $name::ALL.into_iter().find(|it| it.as_str() == word)
            }
        }
    };
}

pub(super) use say;
pub use words;
