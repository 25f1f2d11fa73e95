//! Tests of the shipped configuration of the shuttle: its parts, and what it tells the operator.

use std::collections::BTreeSet;

use super::*;
use telltale_engine::model::ModuleSpec;
use telltale_engine::model::wording::{Advice, Urgency};

/// What the operator reads of a module of the shipped configuration: other words at each level, for
/// what is unknown too, and nothing to take over where the vehicle stands.
fn check_words(module: &ModuleSpec) {
    let id = &module.id;
    let (name, help) = (module.name.as_ref().unwrap(), module.help.as_ref().unwrap());
    for stage in [Stage::Localizing, Stage::Standby, Stage::Cleared, Stage::Active] {
        let names = [State::Error, State::Unknown].map(|state| name.of(state, stage));
        assert!(names.iter().all(Option::is_some) && names[0] != names[1], "{id}: {names:?}");
        assert!(!names.contains(&name.of(State::Warning, stage)), "{id}: {names:?}");
        let drives = matches!(stage, Stage::Cleared | Stage::Active);
        let is_for_driving = ["planning/", "execution/"].iter().any(|group| id.starts_with(group));
        let matters = drives || !is_for_driving;
        for state in [State::Warning, State::Error, State::Unknown] {
            let said = help.of(state, stage);
            assert!(said.is_some() || !matters || state == State::Warning, "{id} {state:?} {stage:?}");
            let Some(Advice { text: Text { en, de }, urgency }) = said else { continue };
            assert!(state != State::Warning || (urgency.is_none() && said != help.of(State::Error, stage)));
            if drives {
                assert_eq!(*urgency, urgency_of(en), "{id} {state:?} {stage:?}: {en}");
                assert_eq!(*urgency, urgency_of(de), "{id} {state:?} {stage:?}: {de}");
                if stage == Stage::Cleared && state == State::Error && !is_for_driving {
                    assert!(en.starts_with("Withdraw the clearance."), "{id}: {en}");
                }
                continue;
            }
            for driving in ["Take over", "Watch the road", "take over", "Be ready"] {
                assert!(!en.contains(driving), "{id} {state:?} {stage:?}: {en}");
            }
            for driving in ["bernehmen", "Straße beobachten", "bereithalten", "Bremsbereit"] {
                assert!(!de.contains(driving), "{id} {state:?} {stage:?}: {de}");
            }
        }
    }
}

/// The urgency of an advice for the operator of a driving vehicle, by its first words.
fn urgency_of(advice: &str) -> Option<Urgency> {
    const READY: [&str; 10] = [
        "Be ready",
        "Watch the road",
        "Stop",
        "Withdraw",
        "Zum Übernehmen bereithalten",
        "Straße",
        "Anhalten",
        "Am nächsten",
        "An der nächsten Haltestelle anhalten",
        "Freigabe widerrufen",
    ];
    let begins = |words: &[&str]| words.iter().any(|words| advice.starts_with(words));
    match begins(&["Take over", "Übernehmen"]) {
        true => Some(Urgency::TakeOver),
        false => begins(&READY).then_some(Urgency::BeReady),
    }
}

#[test]
fn the_shuttle_is_valid() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/shuttle.yaml");
    let loaded = load(&path).unwrap_or_else(|problems| panic!("{problems}"));
    let tiles = loaded.model.groups.iter().filter(|group| group.tile.is_some());
    assert_eq!(tiles.count(), 8);
    loaded.model.modules.iter().for_each(check_words);
    // It is the example of what can be diagnosed: every kind is in it but the one that diagnoses nothing, and those that
    // depend on the content of real sensors and on the computer.
    let kinds: BTreeSet<_> = loaded.model.modules.iter().map(|it| it.monitor.kind()).collect();
    let all = file::monitors::KINDS.map(|(name, _)| name);
    let missing: Vec<_> = all.into_iter().filter(|name| !kinds.contains(name)).collect();
    assert_eq!(missing, ["frozen", "system", "tf", "constant"]);
}

/// The arrows between the tiles: modules depend on modules, and the components on one another as in the paper (Fig. 4,
/// Sec. V).
#[test]
fn the_eight_components_depend_on_one_another_as_in_the_paper() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/shuttle.yaml");
    let model = load(&path).unwrap_or_else(|problems| panic!("{problems}")).model;
    let component = |node: NodeId| model.node_name(node).split('/').next().unwrap().to_owned();
    let mut arrows = BTreeSet::new();
    for holder in model.nodes() {
        let from = model.depends_on(holder).iter().flat_map(|it| it.on.nodes()).map(|&on| component(on));
        arrows.extend(from.map(|from| [from, component(holder)]).filter(|[from, to]| from != to));
    }
    let expected = [
        ["sensors", "localization"],
        ["can", "localization"],
        ["sensors", "perception"],
        ["localization", "perception"],
        ["perception", "prediction"],
        ["localization", "planning"],
        ["prediction", "planning"],
        ["mission", "planning"],
        ["planning", "execution"],
        ["can", "execution"],
    ];
    assert_eq!(arrows, BTreeSet::from(expected.map(|way| way.map(str::to_owned))));
}
