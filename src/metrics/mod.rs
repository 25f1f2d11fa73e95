//! Metrics for Prometheus: what of the vehicle and of this program it may count, and the listener of its own
//! from which it reads them. `docs/metrics.md` lists all of them.

pub mod console;
mod families;
mod listener;
mod program;
mod vehicle;

pub use listener::{Reach, Text, serve};

use prometheus_client::collector::Collector;
use prometheus_client::encoding::DescriptorEncoder;
use prometheus_client::encoding::text::encode;
use prometheus_client::registry::Registry;

use crate::web::AppState;
use families::Families;

/// Everything is read at each request; nothing is kept between two.
#[derive(Debug)]
struct Metrics(AppState);

impl Collector for Metrics {
    fn encode(&self, encoder: DescriptorEncoder<'_>) -> std::fmt::Result {
        let mut families = Families::new(encoder);
        let published = self.0.published();
        // What an engine that hangs showed last is not the state of the vehicle.
        if self.0.is_source_alive() {
            vehicle::write(&mut families, &published.snapshot)?;
        }
        program::write(&mut families, &self.0, &published)
    }
}

/// All metrics in the text format of OpenMetrics 1.0.
///
/// # Errors
/// If a metric cannot be written as text.
pub fn text(app: &AppState) -> Result<String, std::fmt::Error> {
    text_of(Metrics(app.clone()))
}

fn text_of(metrics: impl Collector) -> Result<String, std::fmt::Error> {
    let mut registry = Registry::default();
    registry.register_collector(Box::new(metrics));
    let mut text = String::new();
    encode(&mut text, &registry)?;
    Ok(text)
}
