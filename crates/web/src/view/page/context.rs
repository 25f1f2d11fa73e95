//! The request for a page: its reader, language, colours, and the part that is asked for.

use crate::texts::Lang;
use telltale_store::Role;

telltale_engine::words! {
    /// The colours of the pages, with the word of the `data-palette` attribute and cookie.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub enum Palette {
        Day = "day",
        #[default]
        Night = "night",
    }
}

telltale_engine::words! {
    /// The state of the recorder, with the word of the page's `data-recorder` attribute.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum RecorderState {
        /// Nothing can be recorded.
        Off = "off",
        /// The last seconds are held, and no incident is being recorded.
        Ready = "ready",
        /// An incident is being recorded.
        Recording = "recording",
    }
}

/// The part of a developer page that is rendered: the page's script asks for no more than it needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PagePart {
    #[default]
    Whole,
    /// `<main>`, without the frame of the page.
    Main,
    /// `#dev`, the content that changes while the page is open.
    Content,
}

impl PagePart {
    pub fn from_word(word: &str) -> Option<PagePart> {
        match word {
            "main" => Some(PagePart::Main),
            "content" => Some(PagePart::Content),
            _ => None,
        }
    }

    pub fn is_whole(self) -> bool {
        self == PagePart::Whole
    }

    pub fn is_content(self) -> bool {
        self == PagePart::Content
    }
}

/// The reader of a page, and what the page may link to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageContext {
    pub lang: Lang,
    pub palette: Palette,
    pub user: String,
    pub role: Role,
    /// A simulated machine runs in this process: pages may link to `/demo`.
    pub demo: bool,
    /// The configuration comes from a file: pages may link to its page.
    pub configuration: bool,
    /// The state of the recorder; `None` without one.
    pub recorder: Option<RecorderState>,
    /// A recording is shown: nothing can be done, and pages that a recording does not have are not linked.
    pub replay: bool,
    /// The part that is rendered.
    pub part: PagePart,
}
