//! The instruction is never weaker than without masking, and holds what it asked for.

use std::sync::Arc;

use super::*;
use telltale_engine::Engine;
use telltale_engine::model::Model;
use telltale_engine::model::wording::{Advice, Urgency, Wording};
use telltale_engine::time::Timestamp;

/// A jump of the position asks to be ready; a path that cannot be driven and a dead brake ask to take over.
fn urgent() -> ModelParts {
    let mut parts = parts();
    for (id, urgency, advice) in [
        ("localization/tf_quality", Urgency::BeReady, "Be ready to take over."),
        ("planning/trajectory", Urgency::TakeOver, "Take over now. Use the kerb."),
        ("execution/brake", Urgency::TakeOver, "Take over. Use the emergency brake."),
    ] {
        let module = parts.modules.iter_mut().find(|module| &*module.id == id).expect("it is there");
        module.help = Some(Wording::help(Advice { text: advice.into(), urgency: Some(urgency) }).into());
    }
    parts
}

fn driving() -> Sample {
    let standing = Sample::of(urgent()).login().signal("active", false).pass(5).localize("depot").pass(5);
    standing.signal("active", true).pass(20)
}

fn jumped() -> Sample {
    driving().report("localization/tf_quality", 2, "1.2 m", &[]).pass(1)
}

fn behind(sample: Sample) -> Sample {
    sample.report("planning/trajectory", 2, "curvature", &[]).pass(1)
}

fn acknowledge(sample: Sample) -> Sample {
    sample.act(OperatorAction::Acknowledge { alarm: AlarmRef::Number(1) })
}

const READY: &str = r#"data-urgency="be_ready""#;
const TAKE_OVER: &str = r#"data-urgency="take_over""#;

#[test]
fn what_waits_for_its_cause_asks_for_as_much_as_ever() {
    check(&jumped().published(), Lang::En, "instruction", &[READY, "Be ready", "Position jumped."], &[]);
    let both = behind(jumped()).published();
    // The words of the cause in sight, the advice of the most urgent; no other part says less beside it.
    let expect = [TAKE_OVER, "Take over now. Use the kerb.", "Position jumped."];
    check(&both, Lang::En, "instruction", &expect, &["Be ready"]);
    let expect = [r#"data-node="localization/tf_quality""#, "4 parts wait."];
    check(&both, Lang::En, "causes", &expect, &["Be ready", "planning/trajectory", "data-second"]);
    check(&both, Lang::En, "tile-planning", &[r#"data-reason="masked""#], &[]);
}

#[test]
fn urgency_does_not_fall_while_nothing_got_better() {
    // The symptom recovers because its cause leaves it nothing to do.
    let symptom = || behind(jumped()).report("planning/trajectory", 0, "idle", &[]).pass(3);
    let expect = [TAKE_OVER, "Take over. Stop.", "Position jumped."];
    check(&symptom().published(), Lang::En, "instruction", &expect, &["Be ready"]);
    check(&symptom().published(), Lang::De, "instruction", &["Übernehmen. Anhalten."], &[]);
    let known = acknowledge(symptom());
    check(&known.published(), Lang::En, "instruction", &[READY, "Be ready"], &["Take over now"]);
    // It is over, and asks for nothing any more.
    let over = symptom().report("localization/tf_quality", 0, "fine", &[]).pass(3);
    check(&over.published(), Lang::En, "instruction", &["hidden", r#"data-urgency="none""#], &[]);
}

#[test]
fn it_is_remembered_over_a_restart() {
    let mut symptom = behind(jumped()).report("planning/trajectory", 0, "idle", &[]).pass(3);
    let restored = symptom.snapshot().to_restore();
    let model = Arc::new(Model::new(urgent()).expect("it has no cycle"));
    let asked = Engine::resume(model, &restored, Timestamp::ZERO).snapshot().asked;
    assert_eq!(asked.map(|asked| asked.urgency), Some(Urgency::TakeOver));
}

#[test]
fn a_rise_calls_again_though_all_is_acknowledged() {
    let mut known = acknowledge(jumped());
    assert!(known.snapshot().audible().is_empty());
    let mut risen = behind(known);
    assert_eq!(risen.snapshot().audible(), [1]);
    check(&risen.published(), Lang::En, "causes", &[r#"data-alarms="1""#, r#"name="acknowledge""#], &[]);
    let known = acknowledge(behind(jumped())).report("planning/trajectory", 0, "idle", &[]).pass(1);
    let mut again = behind(known);
    assert!(again.snapshot().audible().is_empty(), "that much is known");
}

#[test]
fn a_component_that_waits_says_how_many_faults_it_has_itself() {
    let both = behind(jumped()).published();
    let expect = [r#"data-own="1""#, r#"aria-label="1 fault of its own""#, ">+1</b>"];
    check(&both, Lang::En, "tile-planning", &expect, &[]);
    check(&both, Lang::De, "tile-planning", &["1 eigene Störung"], &[]);
    check(&both, Lang::En, "detail-planning", &["1 fault of its own"], &[]);
    check(&both, Lang::En, "tile-perception", &[], &["own"]);
    check(&both, Lang::En, "tile-localization", &[], &["own"]);
    check(&both, Lang::En, "detail-perception", &[], &["of its own"]);
}

#[test]
fn the_most_urgent_fault_stands_first_and_a_second_one_is_marked() {
    let both = jumped().pass(15).report("execution/brake", 2, "no pressure", &[]).pass(1).published();
    let html = fragment(&both, Lang::En, "causes");
    let order: Vec<_> =
        html.split("data-node=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    assert_eq!(order, ["execution/brake", "localization/tf_quality"], "{html}");
    let roots: Vec<_> =
        both.snapshot.roots.iter().map(|root| &**both.snapshot.node_name(root.node)).collect();
    assert_eq!(roots, ["localization/tf_quality", "execution/brake"], "as the engine ranks them");
    assert_eq!(html.matches("data-second").count(), 1);
    let brake = html.split("data-node=").nth(1).unwrap_or_default();
    assert!(brake.contains("data-second") && brake.contains("second fault"), "{brake}");
    check(&both, Lang::De, "causes", &["weitere Störung"], &[]);
    check(&both, Lang::En, "tile-execution", &[r#"data-state="error""#], &["masked"]);
    check(&both, Lang::En, "instruction", &[TAKE_OVER, "Brake does not follow."], &[]);
}
