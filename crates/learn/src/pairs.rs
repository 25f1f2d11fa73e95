//! Which failures follow which others, without those that something else explains.

use telltale_engine::model::{Model, ModuleId};

use super::lateness::{feeds, lateness, latest};
use super::past::{self, Failure, History, Module};
use super::statistics::at_least;
use super::{CHANCE, Direction, Edge, Evidence, JITTER_MS, SHARE_LEAST, SUPPORT, WITHIN_MS};

/// So many counterexamples of the other direction tell which of two is the cause.
const COUNTEREXAMPLES: usize = 3;
/// The order of two beginnings is known if so many of them agree, and if they are this far apart.
const SAME_ORDER: f64 = 0.8;
const APART_MS: i64 = 50;
/// Each round explains more failures. It needs one for each level of causes behind causes.
const ROUNDS: usize = 16;

pub(crate) struct Learned {
    /// Edges that do not follow from others.
    pub direct: Vec<Edge>,
    pub undecided: Vec<(ModuleId, ModuleId)>,
    /// By cause and dependent, of failures that nothing else explains.
    pub evidence: Vec<Vec<Evidence>>,
}

struct Pairs<'m> {
    model: &'m Model,
    modules: Vec<Module>,
    /// By cause and dependent.
    explains: Vec<Vec<bool>>,
    /// No failure is noticed later.
    latest_ms: i64,
}

/// Which of two is the cause, and why.
enum Order {
    First(Direction),
    Second,
    Unknown,
}

/// `None` where `go_on` ends it: see [`super::learn_within`].
pub(crate) fn learn(history: &History, model: &Model, go_on: &dyn Fn(usize) -> bool) -> Option<Learned> {
    let modules = past::modules(history);
    let count = modules.len().min(model.modules.len());
    let latest_ms = model.modules.iter().map(|it| latest(model, it)).max().unwrap_or(0);
    let mut pairs = Pairs { model, modules, explains: vec![vec![false; count]; count], latest_ms };
    let mut round = 0;
    loop {
        let evidence = pairs.all_evidence(count, go_on)?;
        let orders = pairs.orders(&evidence);
        let is_edge = |cause: usize, dependent: usize| {
            matches!(orders[cause][dependent], Some(Order::First(_)))
                && is_supported(&evidence[cause][dependent])
        };
        let mut is_new = false;
        for cause in 0..count {
            for dependent in 0..count {
                if is_edge(cause, dependent) && !pairs.explains[cause][dependent] {
                    pairs.explains[cause][dependent] = true;
                    is_new = true;
                }
            }
        }
        round += 1;
        if is_new && round < ROUNDS {
            continue;
        }
        let edges: Vec<Vec<bool>> =
            (0..count).map(|cause| (0..count).map(|it| is_edge(cause, it)).collect()).collect();
        let all = (0..count).flat_map(|one| (0..count).map(move |other| (one, other)));
        let is_undecided = |(one, other): &(usize, usize)| {
            one < other
                && matches!(orders[*one][*other], Some(Order::Unknown))
                && (is_supported(&evidence[*one][*other]) || is_supported(&evidence[*other][*one]))
        };
        let undecided = all.clone().filter(is_undecided).map(|(one, other)| (id(one), id(other))).collect();
        let direct = all.filter(|(cause, dependent)| is_direct(&edges, *cause, *dependent));
        let direct = direct.map(|(cause, dependent)| Edge {
            cause: id(cause),
            dependent: id(dependent),
            evidence: evidence[cause][dependent].clone(),
            direction: match orders[cause][dependent] {
                Some(Order::First(why)) => Some(why),
                _ => None,
            },
        });
        return Some(Learned { direct: direct.collect(), undecided, evidence });
    }
}

fn id(index: usize) -> ModuleId {
    ModuleId(index as u32)
}

fn is_supported(evidence: &Evidence) -> bool {
    evidence.examples.len() as u64 >= SUPPORT && evidence.share().1 >= SHARE_LEAST && evidence.p <= CHANCE
}

/// An edge that no way of two or more edges replaces.
fn is_direct(edges: &[Vec<bool>], cause: usize, dependent: usize) -> bool {
    let is_between = |it: usize| it != cause && it != dependent && edges[cause][it] && edges[it][dependent];
    edges[cause][dependent] && !(0..edges.len()).any(is_between)
}

impl Pairs<'_> {
    /// From the earliest notice to the latest that a failure of this cause explains.
    fn reach(&self, cause: usize, failure: &Failure) -> (i64, i64) {
        let (_, most) = lateness(self.model, &self.model.modules[cause], failure.first);
        (failure.from_ms - most - JITTER_MS, failure.from_ms + WITHIN_MS)
    }

    /// Whether another module's failure explains this one.
    fn is_explained(&self, module: usize, failure: &Failure) -> bool {
        let mut causes = (0..self.explains.len()).filter(|cause| self.explains[*cause][module]);
        causes.any(|cause| {
            let after = self.modules[cause].since(failure.from_ms - WITHIN_MS);
            let near =
                after.iter().take_while(|it| it.from_ms <= failure.from_ms + self.latest_ms + JITTER_MS);
            near.filter(|it| it.blocks).any(|it| self.reach(cause, it).0 <= failure.from_ms)
        })
    }

    fn all_evidence(&self, count: usize, go_on: &dyn Fn(usize) -> bool) -> Option<Vec<Vec<Evidence>>> {
        let mut all: Vec<Vec<Evidence>> = Vec::with_capacity(count);
        let mut bytes = count * count * size_of::<Evidence>();
        for cause in 0..count {
            if !go_on(bytes) {
                return None;
            }
            let evidence = self.evidence_of(cause, count);
            // Each failure has its instant, and an example has its delay too.
            let instants = evidence.iter().map(|it| it.failures() as usize + it.delays_ms.len());
            bytes += instants.sum::<usize>() * size_of::<i64>();
            all.push(evidence);
        }
        let tested = all.iter().flatten().filter(|it| it.failures() >= SUPPORT).count();
        for evidence in all.iter_mut().flatten() {
            evidence.p = (evidence.p * tested.max(1) as f64).min(1.0);
        }
        Some(all)
    }

    fn evidence_of(&self, cause: usize, count: usize) -> Vec<Evidence> {
        let mut all = vec![Evidence { p: 1.0, ..Evidence::default() }; count];
        let mut before_ms = 0;
        for failure in self.modules[cause].failures.iter().filter(|it| it.is_long()) {
            if self.is_explained(cause, failure) {
                continue;
            }
            let (from, to) = self.reach(cause, failure);
            before_ms = before_ms.max(failure.from_ms - from);
            for (dependent, evidence) in all.iter_mut().enumerate().filter(|(it, _)| *it != cause) {
                let module = &self.modules[dependent];
                if let Some(effect) = module.failure(from, to) {
                    evidence.examples.push(failure.from_ms);
                    evidence.delays_ms.push(effect.from_ms - failure.from_ms);
                } else if module.is_well(from, to) {
                    evidence.counterexamples.push(failure.from_ms);
                }
            }
        }
        for (evidence, module) in all.iter_mut().zip(&self.modules) {
            evidence.chance = module.chance(before_ms, WITHIN_MS);
            evidence.p = at_least(evidence.examples.len() as u64, evidence.failures(), evidence.chance);
        }
        all
    }

    /// The order of each pair of modules, if one of the two has enough failures.
    fn orders(&self, evidence: &[Vec<Evidence>]) -> Vec<Vec<Option<Order>>> {
        let count = evidence.len();
        let of = |one: usize, other: usize| {
            let (forth, back) = (&evidence[one][other], &evidence[other][one]);
            let is_tested = |it: &Evidence| it.examples.len() as u64 >= SUPPORT;
            (one != other && (is_tested(forth) || is_tested(back)))
                .then(|| self.order(one, other, forth, back))
        };
        (0..count).map(|one| (0..count).map(|other| of(one, other)).collect()).collect()
    }

    fn order(&self, one: usize, other: usize, forth: &Evidence, back: &Evidence) -> Order {
        let specs = (&self.model.modules[one], &self.model.modules[other]);
        if feeds(specs.0, specs.1) {
            return Order::First(Direction::Feeds);
        }
        if feeds(specs.1, specs.0) {
            return Order::Second;
        }
        let tells = |it: &Evidence, than: &Evidence| {
            it.counterexamples.len() >= COUNTEREXAMPLES && it.share().0 < than.share().0
        };
        if tells(back, forth) {
            return Order::First(Direction::Alone(back.counterexamples.len()));
        }
        if tells(forth, back) {
            return Order::Second;
        }
        let mut apart: Vec<i64> = self.apart(one, other);
        apart.sort_unstable();
        let Some(middle) = apart.get(apart.len() / 2) else { return Order::Unknown };
        let agree = apart.iter().filter(|it| it.signum() == middle.signum()).count() as f64;
        match middle.abs() >= APART_MS && agree >= SAME_ORDER * apart.len() as f64 {
            true if *middle > 0 => Order::First(Direction::Earlier(*middle)),
            true => Order::Second,
            false => Order::Unknown,
        }
    }

    /// From the beginning of one's fault to the other's, as the monitors' lateness lets it be estimated, each time that
    /// both failed.
    fn apart(&self, one: usize, other: usize) -> Vec<i64> {
        let begins = |module: usize, failure: &Failure| {
            let (least, most) = lateness(self.model, &self.model.modules[module], failure.first);
            failure.from_ms - (least + most) / 2
        };
        let failures = self.modules[one].failures.iter().filter(|it| it.is_long());
        let pairs = failures.filter_map(|failure| {
            let (from, to) = self.reach(one, failure);
            let effect = self.modules[other].failure(from, to)?;
            Some(begins(other, effect) - begins(one, failure))
        });
        pairs.collect()
    }
}
