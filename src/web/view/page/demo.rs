//! The page that switches faults of the simulated shuttle.

use askama::Template;

use super::PageContext;
use super::frame::PageFrame;
use crate::web::view::html;
use crate::web::view::text::{NAME, clean};

/// A fault of the simulated shuttle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DemoFault {
    /// As `POST /demo/fault` takes it: `sensor_outage`.
    pub name: String,
    pub active: bool,
}

struct FaultHtml {
    name: String,
    title: String,
    text: &'static str,
    active: bool,
}

#[derive(Template)]
#[template(path = "demo.html")]
struct DemoHtml {
    frame: PageFrame,
    faults: Vec<FaultHtml>,
}

/// The switches of the simulated shuttle's faults.
pub fn demo_page(faults: &[DemoFault], context: &PageContext) -> String {
    let words = context.lang.words();
    let faults = faults.iter().map(|fault| {
        let (title, text) = match &*fault.name {
            "sensor_outage" => (words.sensor_outage, words.sensor_outage_text),
            "localization_jump" => (words.localization_jump, words.localization_jump_text),
            "costmap_delay" => (words.costmap_delay, words.costmap_delay_text),
            "planner_stall" => (words.planner_stall, words.planner_stall_text),
            "can_loss" => (words.can_loss, words.can_loss_text),
            "low_battery" => (words.low_battery, words.low_battery_text),
            "camera_crash" => (words.camera_crash, words.camera_crash_text),
            _ => ("", ""),
        };
        let title = if title.is_empty() { clean(&fault.name, NAME) } else { title.to_owned() };
        FaultHtml { name: clean(&fault.name, NAME), title, text, active: fault.active }
    });
    let faults = faults.collect();
    html(&DemoHtml { frame: PageFrame::new(context.lang, context.palette), faults })
}
