use super::*;

#[test]
fn behind_a_masked_tile_stand_its_own_errors_and_the_way_to_the_cause() {
    let fault = jump()
        .report("perception/costmap_delay", 2, "350 ms", &[("delay_ms", "350")])
        .report("perception/object_tracking", 2, "0 tracks", &[])
        .pass(4)
        .published();
    let expect = [
        "waits for Localization",
        "2 errors behind this",
        "Localization",
        "Position jumped",
        "350 ms",
        "itself: Error",
        "delay_ms",
    ];
    check(&fault, Lang::En, "detail-perception", &expect, &[]);
    check(&fault, Lang::De, "detail-perception", &["2 Fehler dahinter", "selbst: Fehler"], &[]);
}

#[test]
fn the_name_of_a_fault_never_stands_beside_okay() {
    let calm = Sample::shuttle(true).published();
    check(&calm, Lang::En, "detail-execution", &["steering", "brake"], &["does not follow"]);
}

#[test]
fn the_worst_stands_first_and_the_list_is_bounded() {
    let mut parts = parts();
    parts.modules.extend((0..100).map(|index| module("can", 4, &format!("extra_{index}"))));
    let many = Sample::of(parts).login().report("can/extra_99", 2, "broken", &[]).pass(3).published();
    let html = fragment(&many, Lang::En, "detail-can");
    let first = html.split("data-module=\"").nth(1).unwrap_or_default();
    assert!(first.starts_with("can/extra_99"), "{first}");
    assert_eq!(html.matches("data-module").count(), 40);
    assert!(html.contains("and 62 more"));
}
