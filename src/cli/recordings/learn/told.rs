//! The proposals as text, each with its evidence.

use crate::cli::print::Lines;
use crate::engine::model::{Model, ModuleId, NodeId};
use crate::learn::{Direction, EPISODES, Edge, Evidence, History, Proposals, modules_of};
use crate::store::Incident;
use crate::web::common::wall_time;

/// Times that are printed of each proposal.
const TIMES: usize = 3;

pub fn told(model: &Model, history: &History, proposals: &Proposals, incidents: &[Incident]) -> Lines {
    let mut lines = Lines::default();
    let name = |id: ModuleId| model.node_name(NodeId::Module(id));
    let times = |of: &[i64]| {
        let all = of.iter().take(TIMES).map(|at_ms| time(*at_ms, incidents));
        let more = of.len().checked_sub(TIMES).filter(|more| *more > 0);
        all.chain(more.map(|more| format!("{more} more"))).collect::<Vec<_>>().join(", ")
    };
    let shown = |lines: &mut Lines, evidence: &Evidence| {
        let (examples, counterexamples) = (&evidence.examples, &evidence.counterexamples);
        for (what, of) in [("together", examples), ("counterexamples", counterexamples)] {
            if !of.is_empty() {
                lines.add(format_args!("    {what}: {}", times(of)));
            }
        }
    };
    let add = proposals.add.iter().map(|index| &proposals.learned[*index]);
    for Edge { cause, dependent, evidence, direction } in add {
        lines.add(format_args!("add: {} depends on {}", name(*dependent), name(*cause)));
        let (_, low, high) = evidence.share();
        lines.add(format_args!(
            "    it failed in {} of {} failures ({:.0} % to {:.0} %), {:.0} times as often as by chance (p {:.0e})",
            evidence.examples.len(),
            evidence.failures(),
            low * 100.0,
            high * 100.0,
            evidence.lift(),
            evidence.p
        ));
        let mut delays = evidence.delays_ms.clone();
        delays.sort_unstable();
        if let [first, .., last] = &delays[..] {
            let seconds = |ms: &i64| *ms as f64 / 1000.0;
            lines.add(format_args!("    noticed {:.1} s to {:.1} s after it", seconds(first), seconds(last)));
        }
        if let Some(direction) = direction {
            lines.add(format_args!("    {}", why(name(*cause), name(*dependent), *direction)));
        }
        shown(&mut lines, evidence);
    }
    for doubt in &proposals.doubted {
        let on = model.depends_on(doubt.node).get(doubt.index).map_or(&[][..], |it| it.on.nodes());
        let on: Vec<&str> = on.iter().map(|it| model.node_name(*it)).collect();
        let (node, on) = (model.node_name(doubt.node), on.join(", "));
        match doubt.remains.iter().map(|it| name(*it)).collect::<Vec<_>>().join(", ") {
            remains if remains.is_empty() => lines.add(format_args!("remove: {node} depends on {on}")),
            remains => lines.add(format_args!("narrow: {node} depends on {on}, to {remains}")),
        }
        for Edge { cause, dependent, evidence, .. } in &doubt.edges {
            let others = modules_of(model, doubt.node).len() - 1;
            let others = if others > 0 { ", and no other module there failed more often" } else { "" };
            lines.add(format_args!(
                "    {} failed {} times, and {} in {} of them{others}",
                name(*cause),
                evidence.failures(),
                name(*dependent),
                evidence.examples.len()
            ));
            shown(&mut lines, evidence);
        }
    }
    for (one, other) in &proposals.undecided {
        lines.add(format_args!(
            "undecided: {} and {} fail together; the order is not known",
            name(*one),
            name(*other)
        ));
    }
    for silence in &proposals.silences {
        let module = name(silence.module);
        lines.add(format_args!(
            "when: {module} has nothing to say in some states: `when: {}`",
            silence.when(model)
        ));
        for (value, episodes) in silence.episodes.iter().enumerate().filter(|(_, it)| it.count() >= EPISODES)
        {
            let (low, high) = episodes.silent_share();
            lines.add(format_args!(
                "    {}: silent {} of {} times ({:.0} % to {:.0} %)",
                silence.value(model, value),
                episodes.silent.len(),
                episodes.count(),
                low * 100.0,
                high * 100.0
            ));
            let counterexamples = silence.against(value);
            if !counterexamples.is_empty() {
                lines.add(format_args!("    counterexamples: {}", times(counterexamples)));
            }
        }
    }
    lines.add(format_args!(
        "{} to add, {} to remove or narrow; {} of {} dependencies that the history shows are configured; {} of {} modules ever failed",
        proposals.add.len(),
        proposals.doubted.len(),
        proposals.learned.len() - proposals.add.len(),
        proposals.learned.len(),
        history.failed(),
        history.modules.len()
    ));
    lines
}

/// Why it is not the other way round.
fn why(cause: &str, dependent: &str, direction: Direction) -> String {
    match direction {
        Direction::Feeds => format!("{cause} counts the messages that {dependent} reads"),
        Direction::Alone(times) => format!("{dependent} failed {times} times while {cause} stayed well"),
        Direction::Earlier(ms) => {
            format!("{cause} began to fail earlier, by about {:.1} s", ms as f64 / 1000.0)
        }
    }
}

/// An instant in UTC, with the incident then.
fn time(at_ms: i64, incidents: &[Incident]) -> String {
    let at = wall_time(at_ms);
    match incidents.iter().find(|it| it.summary.lasts_at(at_ms)) {
        Some(incident) => format!("{at} (incident {})", incident.summary.id),
        None => at,
    }
}
