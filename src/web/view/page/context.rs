//! What a page is made for: its reader, language, colours, and the part that is asked for.

use crate::store::Role;
use crate::web::view::Lang;

/// The colours of the pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Palette {
    Day,
    #[default]
    Night,
}

impl Palette {
    /// The word of the `data-palette` attribute and cookie: `day`, `night`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Palette::Day => "day",
            Palette::Night => "night",
        }
    }

    pub fn from_word(word: &str) -> Option<Palette> {
        [Palette::Day, Palette::Night].into_iter().find(|palette| palette.as_str() == word)
    }
}

/// What of a developer's page is made: a script that has the rest asks for no more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Part {
    #[default]
    Whole,
    /// All but the frame that every page has: `<main>`.
    Main,
    /// What changes while the page stands: `#dev`.
    Content,
}

impl Part {
    pub fn from_word(word: &str) -> Option<Part> {
        match word {
            "main" => Some(Part::Main),
            "content" => Some(Part::Content),
            _ => None,
        }
    }

    pub fn is_whole(self) -> bool {
        self == Part::Whole
    }

    pub fn is_content(self) -> bool {
        self == Part::Content
    }
}

/// For whom a page is made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageContext {
    pub lang: Lang,
    pub palette: Palette,
    pub user: String,
    pub role: Role,
    /// The simulated shuttle runs in this process: pages may link to `/demo`.
    pub demo: bool,
    /// The configuration comes from a file: pages may link to its page.
    pub configuration: bool,
    /// What is made of it.
    pub part: Part,
}
