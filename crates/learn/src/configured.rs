//! What the configuration says already, and what of it the past does not support.

use telltale_engine::model::{DependsOn, Model, ModuleId, NodeId};

use super::pairs::Learned;
use super::{Doubt, Edge, SHARE_DOUBTED, SHARE_LEAST};

/// The modules of a node: its own, and for a group all below it.
pub fn modules_of(model: &Model, node: NodeId) -> Vec<usize> {
    match node {
        NodeId::Module(id) => vec![id.0 as usize],
        NodeId::Group(id) => {
            let is_below =
                |index: &usize| model.around(NodeId::Module(ModuleId(*index as u32))).any(|it| it == id);
            (0..model.modules.len()).filter(is_below).collect()
        }
    }
}

/// Each dependency: its node, its position there, and the nodes that it names.
fn dependencies(model: &Model) -> impl Iterator<Item = (NodeId, usize, &DependsOn)> {
    model.nodes().flat_map(|node| {
        model.depends_on(node).iter().enumerate().map(move |(index, it)| (node, index, &it.on))
    })
}

/// By cause and dependent: whether the configuration lets a module wait for another one, directly or by way of others.
pub fn closure(model: &Model) -> Vec<Vec<bool>> {
    closure_without(model, &[])
}

/// The same if the doubted dependencies are only what remains of them.
fn closure_without(model: &Model, doubted: &[Doubt]) -> Vec<Vec<bool>> {
    let count = model.modules.len();
    let mut waits = vec![vec![false; count]; count];
    for (node, index, on) in dependencies(model) {
        let doubt = doubted.iter().find(|it| it.node == node && it.index == index);
        let causes: Vec<usize> = match doubt {
            Some(doubt) => doubt.remains.iter().map(|it| it.0 as usize).collect(),
            None => on.nodes().iter().flat_map(|it| modules_of(model, *it)).collect(),
        };
        for cause in causes {
            modules_of(model, node).into_iter().for_each(|dependent| waits[cause][dependent] = true);
        }
    }
    close(&mut waits);
    waits
}

/// The same with learned edges that close no circle.
pub fn closure_with(model: &Model, learned: &[Edge]) -> Vec<Vec<bool>> {
    with(closure(model), learned).0
}

fn close(waits: &mut [Vec<bool>]) {
    for middle in 0..waits.len() {
        let from_middle = waits[middle].clone();
        for row in waits.iter_mut().filter(|row| row[middle]) {
            row.iter_mut().zip(&from_middle).for_each(|(it, further)| *it |= further);
        }
    }
}

/// Positions of the learned edges that the configuration lacks once the doubted dependencies are gone. If several edges
/// close a circle, those with the fewest examples are left out.
pub(crate) fn missing(model: &Model, doubted: &[Doubt], learned: &[Edge]) -> Vec<usize> {
    with(closure_without(model, doubted), learned).1
}

fn with(mut waits: Vec<Vec<bool>>, learned: &[Edge]) -> (Vec<Vec<bool>>, Vec<usize>) {
    let mut order: Vec<usize> = (0..learned.len()).collect();
    order.sort_by_key(|index| std::cmp::Reverse(learned[*index].evidence.examples.len()));
    let mut missing = Vec::new();
    for index in order {
        let (cause, dependent) = (learned[index].cause.0 as usize, learned[index].dependent.0 as usize);
        if !waits[cause][dependent] && !waits[dependent][cause] {
            waits[cause][dependent] = true;
            close(&mut waits);
            missing.push(index);
        }
    }
    missing.sort_unstable();
    (waits, missing)
}

/// Configured dependencies without effect: the module, or some modules of the group, failed, and nothing failed with
/// them. A set of redundant nodes (`any_of`) is not judged, because a single failure there has no effect by design.
pub(crate) fn doubted(model: &Model, learned: &Learned) -> Vec<Doubt> {
    let mut all = Vec::new();
    for (node, index, on) in dependencies(model) {
        let DependsOn::Node(on) = on else { continue };
        let dependents = modules_of(model, node);
        let mut doubt = Doubt { node, index, remains: Vec::new(), edges: Vec::new() };
        for cause in modules_of(model, *on) {
            match without_effect(learned, cause, &dependents) {
                Some(edge) => doubt.edges.push(edge),
                None => doubt.remains.push(ModuleId(cause as u32)),
            }
        }
        if !doubt.edges.is_empty() {
            all.push(doubt);
        }
    }
    all
}

/// The strongest evidence that a cause has no effect on any of these modules.
fn without_effect(learned: &Learned, cause: usize, dependents: &[usize]) -> Option<Edge> {
    let others = dependents.iter().filter(|it| **it != cause);
    let evidence = |dependent: &usize| learned.evidence.get(cause)?.get(*dependent);
    let shares =
        others.filter_map(|it| evidence(it).filter(|it| it.failures() > 0).map(|found| (*it, found)));
    let shares: Vec<_> = shares.collect();
    // One that may well fail with the cause keeps the edge of its group.
    if shares.iter().any(|(_, it)| it.share().2 >= SHARE_LEAST) {
        return None;
    }
    let strongest = shares
        .into_iter()
        .filter(|(_, it)| it.share().2 < SHARE_DOUBTED)
        .max_by(|one, other| one.1.failures().cmp(&other.1.failures()).then(other.0.cmp(&one.0)))?;
    Some(Edge {
        cause: ModuleId(cause as u32),
        dependent: ModuleId(strongest.0 as u32),
        evidence: strongest.1.clone(),
        direction: None,
    })
}
