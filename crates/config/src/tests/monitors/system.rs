//! Tests of monitors of the computer.

use super::{means, wrong};

#[test]
fn the_computer_is_measured_in_the_units_of_its_parts() {
    for (monitor, meaning) in [
        (
            "system: { cpu: used, warning_above: 80, error_above: 95 }",
            "what the processor of this computer is busy with every 2s: warning above 80 %, error above 95 %",
        ),
        (
            "system: { memory: used, every: 10s, error_above: 95 }",
            "the used memory of this computer every 10s: error above 95 %",
        ),
        (
            "system: { disk: /var, error_above: 90 }",
            "the used space of the disk at /var every 2s: error above 90 %",
        ),
        (
            "system: { temperature: x86_pkg_temp, error_above: 95, error_below: -20 }",
            "the temperature x86_pkg_temp every 2s: error below -20 °C, error above 95 °C",
        ),
        ("system: { process: amcl }", "the process amcl every 2s: error if there is none"),
        (
            "system: { process: amcl, measure: memory, warning_above: 500 }",
            "the memory of the process amcl every 2s: error if there is none, warning above 500 MB",
        ),
    ] {
        means(monitor, meaning);
    }
}

#[test]
fn what_cannot_be_measured_of_a_computer_is_refused() {
    let one = "one of `cpu`, `memory`, `disk`, `temperature`, `process` is measured (for example `cpu: used`, `disk: /var` or `process: planner_server`)";
    wrong("system: { error_above: 5 }", &[&format!("9: {one}")]);
    wrong("system: { cpu: used, memory: used, error_above: 5 }", &[&format!("9: {one}")]);
    wrong(
        "system: { cpu: idle, error_above: 5 }",
        &["16: `idle` cannot be measured by `cpu` (write `cpu: used`)"],
    );
    wrong(
        "system: { disk: var, error_above: 5 }",
        &["17: `var` cannot be measured by `disk` (write a path from the root: `/var/log`)"],
    );
    wrong(
        "system: { cpu: used }",
        &[
            "9: without a limit this would never be anything but OK (add at least one of warning_below, error_below, warning_above, error_above)",
        ],
    );
    wrong(
        "system: { process: amcl, error_above: 5 }",
        &[
            "9: it is not said what of the process has limits (add `measure: cpu` or `measure: memory`, or remove the limits)",
        ],
    );
    wrong(
        "system: { cpu: used, measure: memory, error_above: 5 }",
        &["22: only of a `process` one thing or another is measured (remove `measure`)"],
    );
    wrong(
        "system: { disk: /, error_above: 100 }",
        &["33: what is measured here is never above 100 (choose a limit between 0 and 100, or remove it)"],
    );
}
