//! The page that switches faults of the simulated machine.

use std::collections::BTreeSet;

use askama::Template;

use super::PageContext;
use super::frame::PageFrame;
use crate::texts::{MESSAGE, NAME};
use crate::view::html;
use telltale_engine::text::Text;

/// A fault of the simulated machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DemoFault {
    /// As `POST /demo/fault` takes it: `sensor_outage`.
    pub name: &'static str,
    pub title: Text,
    /// Its effect.
    pub about: Text,
}

struct FaultHtml {
    name: &'static str,
    title: String,
    text: String,
    active: bool,
}

#[derive(Template)]
#[template(path = "demo.html")]
struct DemoHtml {
    frame: PageFrame,
    faults: Vec<FaultHtml>,
}

/// The switches of the simulated machine's faults; `active` names those that are on.
pub fn demo_page(faults: &[DemoFault], active: &BTreeSet<&'static str>, context: &PageContext) -> String {
    let lang = context.lang;
    let faults = faults.iter().map(|fault| FaultHtml {
        name: fault.name,
        title: lang.pick(&fault.title, NAME),
        text: lang.pick(&fault.about, MESSAGE),
        active: active.contains(fault.name),
    });
    let faults = faults.collect();
    html(&DemoHtml { frame: PageFrame::new(lang, context.palette), faults })
}
