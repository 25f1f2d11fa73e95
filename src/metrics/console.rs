//! The metrics of a fleet's console: its line to the hub, how many vehicles there are of each kind, and each vehicle.

use prometheus_client::collector::Collector;
use prometheus_client::encoding::DescriptorEncoder;

use super::families::Families;
use super::text_of;
use crate::console::follow::Shared;
use crate::console::state::counts;

#[derive(Debug)]
struct Metrics(Shared);

impl Collector for Metrics {
    fn encode(&self, encoder: DescriptorEncoder<'_>) -> std::fmt::Result {
        let (rows, is_up, refused) = {
            let fleet = self.0.fleet();
            (fleet.rows(self.0.clock.now()), fleet.line().up_since.is_some(), fleet.refused)
        };
        let counts = counts(&rows);
        let mut families = Families::new(encoder);
        families.gauge(
            "telltale_console_hub_up",
            "Whether the hub is reached.",
            f64::from(u8::from(is_up)),
        )?;
        families.counter(
            "telltale_console_refused_messages",
            "Messages from the hub that were not as they should be.",
            refused,
        )?;
        let kinds = [
            ("error", counts.error),
            ("warning", counts.warning),
            ("ok", counts.ok),
            ("lost", counts.lost),
            ("never_heard", counts.never_heard),
            ("off", counts.off),
        ];
        families.gauges(
            "telltale_console_vehicles",
            "Vehicles of each kind; each is counted once.",
            kinds.map(|(kind, count)| ([("kind", kind.to_owned())], count as f64)),
        )?;
        let heard = rows.iter().filter_map(|row| {
            let labels = [
                ("vehicle", row.id.clone()),
                ("state", row.state.as_str().to_owned()),
                ("contact", row.contact.as_str().to_owned()),
            ];
            Some((labels, row.age_s?))
        });
        families.gauges(
            "telltale_console_vehicle_age_seconds",
            "Since the last head of a vehicle came, with the state in it.",
            heard,
        )
    }
}

/// All metrics in the text format of OpenMetrics 1.0.
///
/// # Errors
/// If a metric cannot be written as text.
pub fn text(shared: &Shared) -> Result<String, std::fmt::Error> {
    text_of(Metrics(shared.clone()))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::console::state::Fleet;
    use telltale_clock::Clock;
    use telltale_engine::time::{Since, Span};

    #[test]
    fn every_metric_is_documented_and_every_documented_one_is_served() {
        let (clock, _hand) = Clock::standing();
        let fleet = Fleet::new([], 0, Since::of_age(Span::ZERO, clock.now()));
        let text = text(&Shared::new(fleet, clock)).unwrap();
        let types = text.lines().filter_map(|line| line.strip_prefix("# TYPE "));
        let served: BTreeSet<String> = types
            .map(|it| match it.split_once(' ') {
                Some((name, "counter")) => format!("{name}_total"),
                _ => it.split(' ').next().unwrap().to_owned(),
            })
            .collect();
        let page = include_str!("../../docs/metrics.md").lines();
        let documented: BTreeSet<String> = page
            .filter_map(|line| line.strip_prefix("| `telltale_console_"))
            .map(|rest| format!("telltale_console_{}", rest.split('`').next().unwrap()))
            .collect();
        assert_eq!(served, documented);
    }
}
