//! A page of one sentence.

use askama::Template;

use super::Palette;
use super::frame::PageFrame;
use crate::texts::console::ConsoleWords;
use crate::texts::{Lang, MESSAGE, Words, clean};
use crate::view::html;

/// Where the way back from a message leads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Home {
    #[default]
    Vehicle,
    /// The console of a fleet.
    Fleet,
}

impl Home {
    fn back(self, lang: Lang) -> &'static str {
        match self {
            Home::Vehicle => Words::of(lang).back,
            Home::Fleet => ConsoleWords::of(lang).back,
        }
    }
}

#[derive(Template)]
#[template(path = "message.html")]
struct MessageHtml {
    frame: PageFrame,
    status: u16,
    title: String,
    text: String,
    back: &'static str,
}

/// A page that says one thing; `title` and `text` are in the reader's language and not yet escaped.
pub fn message_page(
    status: u16,
    title: &str,
    text: &str,
    home: Home,
    lang: Lang,
    palette: Palette,
) -> String {
    html(&MessageHtml {
        frame: PageFrame::new(lang, palette),
        status,
        title: clean(title, MESSAGE),
        text: clean(text, 2 * MESSAGE),
        back: home.back(lang),
    })
}
