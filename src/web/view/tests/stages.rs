use super::*;

#[test]
fn a_locked_vehicle_shows_nothing_of_itself() {
    let locked = Sample::of(parts()).report("can/bus", 2, "bus off", &[]).pass(5).published();
    let fragments = fragments(&locked, Lang::En);
    assert_eq!(fragments.len(), 1);
    let page = operator_page(&locked, &context(Lang::En, Palette::Night));
    let developer = developer::pages(&locked, &context(Lang::En, Palette::Night), "");
    // What the file of the configuration would change is no diagnosis.
    let developer = developer.iter().filter(|(page, _)| *page != "configuration").map(|(_, html)| html);
    for html in [&fragments[0].html, &page].into_iter().chain(developer) {
        assert!(html.contains(r#"data-stage="locked""#));
        for secret in ["can", "bus", "Sensors", "sensors", "tile", "error"] {
            assert!(!words_of(html).contains(secret), "{secret}: {html}");
        }
    }
    assert!(page.contains(r#"name="name""#) && page.contains(r#"name="secret""#));
}

/// The page without the names of icons and files, which say nothing of the vehicle.
fn words_of(html: &str) -> String {
    let body = html.split("</symbol>").last().unwrap_or_default();
    body.replace("data-overall", "")
}

#[test]
fn the_stage_is_said_in_words_and_only_what_works_has_a_button() {
    let ready = Sample::shuttle(false).published();
    check(&ready, Lang::En, "top", &[r#"data-stage="standby""#, "Ready", "Shuttle 1", "operator"], &[]);
    check(&ready, Lang::En, "actions", &["Ready. Waits for the mission", r#"name="logout""#, "/logout"], &[]);
    let driving = Sample::shuttle(true).published();
    check(&driving, Lang::De, "top", &[r#"data-stage="active""#, "Fährt"], &[]);
    check(&driving, Lang::En, "actions", &["Drives by itself"], &["<button", "<form"]);
    let broken = Sample::shuttle(false).report("can/bus", 2, "bus off", &[]).pass(1).published();
    check(&broken, Lang::En, "top", &["Not ready"], &[]);
    check(&broken, Lang::En, "actions", &["Not ready to drive"], &["Ready."]);
}

#[test]
fn other_reasons_have_words_of_their_own() {
    let mut parts = parts();
    parts.groups[3].when = Some(When { stages: vec![Stage::Localizing], signals: Vec::new(), posed: None });
    parts.groups[5].when = Some(When { stages: vec![Stage::Active], signals: Vec::new(), posed: None });
    let standby = Sample::of(parts).login().signal("active", false).pass(5).published();
    check(&standby, Lang::En, "tile-prediction", &["not driving"], &["Standby", "standby"]);
    check(&standby, Lang::De, "tile-mission", &["fährt nicht"], &[]);
}
