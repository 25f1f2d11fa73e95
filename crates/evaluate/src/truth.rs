//! Which faults were there, and when: what the modules of a broken component report by themselves, with each fault alone
//! and with all together. The dependencies of the configuration play no part.

use telltale_engine::model::{ModuleId, NodeId};
use telltale_engine::snapshot::Snapshot;
use telltale_engine::state::State;

use super::plan::{Fault, Injection, Plan};
use super::track::Track;

/// A fault of a trial that the machine's modules could notice.
#[derive(Debug)]
pub struct Present {
    /// The modules that name it.
    pub modules: Vec<ModuleId>,
    pub begins_ms: u64,
    pub ends_ms: u64,
    /// When one of them reports it first.
    pub noticed_ms: u64,
    /// When it begins, and when each of them begins to report something worse than before, in the run of all faults.
    pub beginnings_ms: Vec<u64>,
    /// When they report it while it is there, and would not without it.
    pub distinct: Vec<(u64, u64)>,
}

/// Whether a state is a fault. UNKNOWN is none by itself.
pub fn is_bad(state: State) -> bool {
    matches!(state, State::Warning | State::Error)
}

impl Present {
    /// The faults of a trial. `off` is a run of all faults without masking, `alone` one with each. A module may notice a
    /// fault so much earlier or later in `off` than in `alone`.
    pub fn of(plan: &Plan, faults: &[Fault], off: &Track, alone: &[Track], apart_ms: u64) -> Vec<Present> {
        let one = |(index, injection): (usize, &Injection)| {
            let snapshot = &off.0.first()?.1;
            let truth = &faults[injection.fault].truth;
            let modules = truth.iter().filter_map(|name| match snapshot.node(name) {
                Some(NodeId::Module(id)) => Some(id),
                _ => None,
            });
            let modules: Vec<ModuleId> = modules.collect();
            let begins_ms = injection.begins_ms();
            let with = alone.get(index).unwrap_or(off);
            let noticed_ms = with.0.iter().find(|(at, it)| *at >= begins_ms && reported(it, &modules))?.0;
            let shorter_ms = if alone.is_empty() { 0 } else { apart_ms };
            let together = reports(off, &modules, plan.length_ms);
            let with: Spans = reports(with, &modules, plan.length_ms)
                .into_iter()
                .map(|(from, to)| (from + shorter_ms, to.saturating_sub(shorter_ms)))
                .collect();
            let others = alone.iter().enumerate().filter(|(other, _)| *other != index);
            let others: Spans = others
                .flat_map(|(_, it)| reports(it, &modules, plan.length_ms))
                .map(|(from, to)| (from.saturating_sub(apart_ms), to + apart_ms))
                .collect();
            let mut times: Vec<u64> = [&injection.spells, &together, &with, &others]
                .into_iter()
                .flatten()
                .flat_map(|(from, to)| [*from, *to])
                .collect();
            times.sort_unstable();
            times.dedup();
            let is_distinct = |ms: u64| {
                is_in(&injection.spells, ms)
                    && is_in(&together, ms)
                    && is_in(&with, ms)
                    && !is_in(&others, ms)
            };
            let spans = times.windows(2).filter(|span| is_distinct(span[0])).map(|span| (span[0], span[1]));
            let distinct = spans.collect();
            let reported = modules.iter().flat_map(|id| beginnings(off, *id));
            let beginnings_ms = injection.spells.iter().map(|(from, _)| *from).chain(reported).collect();
            let ends_ms = injection.ends_ms();
            Some(Present { modules, begins_ms, ends_ms, noticed_ms, beginnings_ms, distinct })
        };
        plan.injections.iter().enumerate().filter_map(one).collect()
    }

    /// Whether its modules report it at this instant, as nothing else would make them.
    pub fn is_distinct(&self, ms: u64) -> bool {
        is_in(&self.distinct, ms)
    }
}

/// From the first millisecond to the one after the last.
type Spans = Vec<(u64, u64)>;

fn is_in(spans: &Spans, ms: u64) -> bool {
    spans.iter().any(|(from, to)| (*from..*to).contains(&ms))
}

/// When one of the modules reports something.
fn reports(track: &Track, modules: &[ModuleId], length_ms: u64) -> Spans {
    let ends = track.0.iter().skip(1).map(|(at, _)| *at).chain([length_ms]);
    let shown = track.0.iter().zip(ends).filter(|((_, snapshot), _)| reported(snapshot, modules));
    let mut spans = Spans::new();
    for ((from, _), to) in shown {
        match spans.last_mut() {
            Some(last) if last.1 == *from => last.1 = to,
            _ => spans.push((*from, to)),
        }
    }
    spans
}

/// When a module becomes worse.
fn beginnings(track: &Track, id: ModuleId) -> Vec<u64> {
    let own = |snapshot: &Snapshot| snapshot.own(NodeId::Module(id));
    let pairs = track.0.windows(2);
    let worse = pairs.filter(|pair| own(&pair[1].1) > own(&pair[0].1) && is_bad(own(&pair[1].1)));
    worse.map(|pair| pair[1].0).collect()
}

fn reported(snapshot: &Snapshot, modules: &[ModuleId]) -> bool {
    modules.iter().any(|id| snapshot.modules.get(id.0 as usize).is_some_and(|module| is_bad(module.own)))
}
