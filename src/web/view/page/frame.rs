//! The frame of every page.

use super::{Palette, Part};
use crate::web::assets;
use crate::web::view::Lang;
use crate::web::view::words::Words;

/// What every page is framed by.
pub struct Frame {
    pub lang: &'static str,
    pub palette: &'static str,
    pub part: Part,
    pub words: &'static Words,
    /// Both languages, for words that change their language, or must show, without a server.
    pub both: [(&'static str, &'static Words); 2],
}

impl Frame {
    pub fn new(lang: Lang, palette: Palette) -> Frame {
        let both = Lang::ALL.map(|lang| (lang.as_str(), lang.words()));
        let (lang, words) = (lang.as_str(), lang.words());
        Frame { lang, palette: palette.as_str(), part: Part::Whole, words, both }
    }

    /// The keys of the pad for a PIN, but the last row, and for a name.
    pub fn digits(&self) -> std::str::Chars<'static> {
        "123456789".chars()
    }

    pub fn letters(&self) -> std::str::Chars<'static> {
        "abcdefghijklmnopqrstuvwxyz0123456789.-_".chars()
    }

    /// Where a file of `static/` is found.
    pub fn asset(&self, name: &str) -> String {
        assets::url(name)
    }
}
