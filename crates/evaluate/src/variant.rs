//! Configurations of a campaign: drawn delays and mistakes, and the rules of masking that are compared.

use std::sync::Arc;

use telltale_engine::model::{Dependency, DependsOn, Model, NodeId, Parts, Within};
use telltale_engine::time::Span;

use super::random::Random;

/// Drawn configurations beside the shipped one.
const DRAWN: u64 = 24;

/// A mistake in the dependencies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mistake {
    None,
    /// A dependency is missing.
    Missing,
    /// One names the whole group in place of a module.
    TooWide,
}

/// Which configuration a trial has: 0 is the shipped one, for each fourth seed.
pub fn of_seed(seed: u64) -> u64 {
    if seed.is_multiple_of(4) { 0 } else { 1 + Random::new(seed, 2).below(DRAWN as usize) as u64 }
}

pub fn count() -> u64 {
    DRAWN + 1
}

/// The configuration of this number: each module notices its faults later by a drawn time, and every second one has a
/// mistake in its dependencies.
pub fn draw(shipped: &Arc<Model>, number: u64) -> (Arc<Model>, Mistake) {
    if number == 0 {
        return (shipped.clone(), Mistake::None);
    }
    let mut random = Random::new(number, 3);
    let mut parts = Parts::clone(shipped);
    for module in &mut parts.modules {
        // Half of them notice as fast as the shipped configuration.
        if random.chance(50) {
            let drawn = Span::from_millis(random.between(0, 1_200));
            module.policy.raise_after =
                Span::from_nanos(module.policy.raise_after.as_nanos() + drawn.as_nanos());
        }
    }
    let wanted = [Mistake::None, Mistake::Missing, Mistake::None, Mistake::TooWide][(number % 4) as usize];
    let places = places(&parts);
    for _ in 0..places.len() {
        let (node, index) = places[random.below(places.len())];
        let mut changed = parts.clone();
        let dependencies = dependencies_of(&mut changed, node);
        match wanted {
            Mistake::None => break,
            Mistake::Missing => {
                dependencies.remove(index);
            }
            Mistake::TooWide => {
                let DependsOn::Node(NodeId::Module(on)) = dependencies[index].on else { continue };
                dependencies[index].on = DependsOn::Node(NodeId::Group(parts.modules[on.0 as usize].group));
            }
        }
        // One that closes a circle is no configuration.
        if let Ok(model) = Model::new(changed) {
            return (Arc::new(model), wanted);
        }
    }
    (Arc::new(Model::new(parts).expect("its dependencies are the shipped ones")), Mistake::None)
}

/// Every dependency: the node that has it, and its index there.
fn places(parts: &Parts) -> Vec<(NodeId, usize)> {
    let of = |node: NodeId| (0..parts.depends_on(node).len()).map(move |index| (node, index));
    parts.nodes().flat_map(of).collect()
}

/// The model without each of its dependencies in turn.
pub fn without_each(model: &Model) -> Vec<Model> {
    let without = |(node, index): (NodeId, usize)| {
        let mut parts = Parts::clone(model);
        dependencies_of(&mut parts, node).remove(index);
        Model::new(parts).expect("fewer dependencies close no circle")
    };
    places(model).into_iter().map(without).collect()
}

fn dependencies_of(parts: &mut Parts, node: NodeId) -> &mut Vec<Dependency> {
    match node {
        NodeId::Group(id) => &mut parts.groups[id.0 as usize].depends_on,
        NodeId::Module(id) => &mut parts.modules[id.0 as usize].depends_on,
    }
}

pub fn off(model: &Model) -> Arc<Model> {
    Arc::new(model.with_dependencies(Vec::clear))
}

pub fn always(model: &Model) -> Arc<Model> {
    Arc::new(model.with_dependencies(|all| all.iter_mut().for_each(|it| it.within = Within::Always)))
}

/// Each dependency without a `within` of its own explains what began within this time.
pub fn within(model: &Model, span: Span) -> Arc<Model> {
    let is_default = |it: &&mut Dependency| it.within == Within::default();
    let change = |all: &mut Vec<Dependency>| {
        all.iter_mut().filter(is_default).for_each(|it| it.within = Within::Limit(span));
    };
    Arc::new(model.with_dependencies(change))
}
