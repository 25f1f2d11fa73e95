//! The frame of every page.

use super::{PagePart, Palette};
use crate::assets;
use crate::texts::{Lang, Words};
use telltale_engine::model::DISPLAY_DPI;

/// The frame that every page has.
pub struct PageFrame {
    pub lang: &'static str,
    pub palette: &'static str,
    /// The density of the vehicle's display, on the operator's pages, unless it is that of the reference display.
    pub dpi: Option<u32>,
    pub part: PagePart,
    pub words: &'static Words,
    /// Both languages, for words that must change their language without the server.
    pub both: [(&'static str, &'static Words); Lang::ALL.len()],
}

impl PageFrame {
    pub fn new(lang: Lang, palette: Palette) -> PageFrame {
        let both = Lang::ALL.map(|lang| (lang.as_str(), Words::of(lang)));
        let (lang, words) = (lang.as_str(), Words::of(lang));
        PageFrame { lang, palette: palette.as_str(), dpi: None, part: PagePart::Whole, words, both }
    }

    /// The frame of a page for a display of this density.
    pub fn of_display(self, dpi: u32) -> PageFrame {
        PageFrame { dpi: (dpi != DISPLAY_DPI).then_some(dpi), ..self }
    }

    /// The keys of the login's pad: for a PIN, without the last row, and for a name.
    pub fn digits(&self) -> std::str::Chars<'static> {
        "123456789".chars()
    }

    pub fn letters(&self) -> std::str::Chars<'static> {
        "abcdefghijklmnopqrstuvwxyz0123456789.-_".chars()
    }

    /// The address of a file below `static/`.
    pub fn asset(&self, name: &str) -> String {
        assets::url(name)
    }
}
