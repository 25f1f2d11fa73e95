//! What the pages say of a vehicle's states: snapshot in, attributes and words out.

use super::sample::{Sample, group, module, on_group, parts, text};
use super::*;
use crate::engine::input::TroubleKind;
use crate::engine::model::{GroupId, Parts as ModelParts, StageModel, Text, When};

fn context(lang: Lang, palette: Palette) -> PageContext {
    PageContext { lang, palette, user: "operator".to_owned(), role: Role::Operator, demo: false }
}

fn fragment(published: &Published, lang: Lang, id: &str) -> String {
    let all = fragments(published, lang);
    let found = all.into_iter().find(|fragment| fragment.id == id);
    found.unwrap_or_else(|| panic!("no fragment {id}")).html
}

/// The fragment `id` contains every part of `expect`, and none of `not`.
#[track_caller]
fn check(published: &Published, lang: Lang, id: &str, expect: &[&str], not: &[&str]) {
    let html = fragment(published, lang, id);
    for part in expect {
        assert!(html.contains(part), "{id} lacks {part:?}:\n{html}");
    }
    for part in not {
        assert!(!html.contains(part), "{id} has {part:?}:\n{html}");
    }
}

fn jump() -> Sample {
    Sample::shuttle(true).report(
        "localization/tf_quality",
        2,
        "Position jumped by 1.2 m",
        &[("jump_m", "1.20"), ("limit_m", "0.30")],
    )
}

mod states {
    use super::*;

    #[test]
    fn a_tile_that_is_okay_says_so_with_its_count() {
        let calm = Sample::shuttle(true).published();
        check(
            &calm,
            Lang::En,
            "tile-sensors",
            &[r#"data-state="ok""#, "Sensors", "#i-ok", "4 of 4 okay"],
            &["data-reason"],
        );
        check(&calm, Lang::De, "tile-localization", &["Lokalisierung", "Okay", "4 von 4 okay"], &[]);
    }

    #[test]
    fn a_root_cause_is_an_error_and_what_waits_for_it_says_for_whom() {
        let fault = jump().pass(4).published();
        check(
            &fault,
            Lang::En,
            "tile-localization",
            &[r#"data-state="error""#, "#i-error", "Error", "3 of 4 okay"],
            &[],
        );
        for tile in ["tile-perception", "tile-prediction", "tile-planning", "tile-execution"] {
            let expect = [
                r#"data-state="ignore" data-reason="masked""#,
                "#i-masked",
                "Ignored",
                "waits for Localization",
            ];
            check(&fault, Lang::En, tile, &expect, &["okay", "#i-idle"]);
        }
        check(&fault, Lang::De, "tile-planning", &["Ignoriert", "wartet auf Lokalisierung"], &[]);
    }

    #[test]
    fn what_the_stage_puts_aside_looks_and_reads_otherwise() {
        let standby = Sample::shuttle(false).published();
        let expect = [r#"data-state="ignore" data-reason="not_relevant""#, "#i-idle", "not driving"];
        check(&standby, Lang::En, "tile-planning", &expect, &["#i-masked", "waits for"]);
        check(&standby, Lang::De, "tile-execution", &["Ignoriert", "fährt nicht"], &[]);
    }

    #[test]
    fn a_silent_component_is_unknown_and_never_okay() {
        let silent = Sample::shuttle(false).silence("mission/server").pass(5).published();
        let expect = [r#"data-state="unknown""#, "#i-unknown", "Unknown", "no news"];
        check(&silent, Lang::En, "tile-mission", &expect, &["#i-ok", "okay"]);
        check(&silent, Lang::En, "causes", &[r#"data-node="mission/server""#, "No news: Mission"], &["All"]);
    }

    #[test]
    fn a_warning_keeps_its_count() {
        let low = Sample::shuttle(false).report("can/battery", 1, "18 %", &[]).pass(2).published();
        check(&low, Lang::En, "tile-can", &[r#"data-state="warning""#, "Warning", "1 of 2 okay"], &[]);
        check(&low, Lang::De, "tile-can", &["Warnung", "Fahrzeugbus (CAN)"], &[]);
    }

    #[test]
    fn every_tile_carries_its_cover_in_its_language() {
        let calm = Sample::shuttle(true).published();
        for (lang, word) in [(Lang::En, "Unknown"), (Lang::De, "Unbekannt")] {
            for tile in ["tile-sensors", "tile-execution"] {
                check(&calm, lang, tile, &[r#"class="cover""#, word], &[]);
            }
        }
    }
}

mod causes {
    use super::*;

    #[test]
    fn a_root_cause_stands_with_what_to_do_and_how_many_wait() {
        let fault = jump().pass(4).published();
        let expect = [
            r#"data-node="localization/tf_quality""#,
            r#"data-state="error""#,
            "Position jumped",
            "Localization, ",
            "Position jumped by 1.2 m",
            "Four others wait",
            "Watch the road. Be ready to stop.",
            r#"<time datetime="2026-11-20T12:01:01Z""#,
        ];
        check(&fault, Lang::En, "causes", &expect, &["All ", "costmap"]);
        let expect =
            ["Position ist gesprungen", "Vier andere warten", "Straße beobachten. Bremsbereit sein."];
        check(&fault, Lang::De, "causes", &expect, &[]);
    }

    #[test]
    fn roots_come_first_and_the_rest_is_counted() {
        let many = jump()
            .report("can/battery", 1, "18 %", &[])
            .report("sensors/gnss", 1, "4 satellites", &[])
            .silence("mission/server")
            .pass(5)
            .published();
        let html = fragment(&many, Lang::En, "causes");
        let order: Vec<_> =
            html.split("data-node=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
        assert_eq!(order, ["localization/tf_quality", "mission/server"]);
        assert!(html.contains("and 2 more"), "{html}");
    }

    #[test]
    fn all_okay_is_said_only_when_it_is_true() {
        let calm = Sample::shuttle(true).published();
        check(
            &calm,
            Lang::En,
            "causes",
            &["All 8 active components okay", r#"data-good="true""#],
            &["data-node"],
        );
        let standby = Sample::shuttle(false).published();
        check(&standby, Lang::De, "causes", &["Alle 6 aktiven Komponenten okay"], &[]);
        let start = Sample::of(parts()).login().published();
        check(&start, Lang::En, "causes", &["data-node"], &["okay"]);
    }

    #[test]
    fn many_of_one_kind_in_one_component_are_one_entry() {
        let start = Sample::of(parts()).login().published();
        check(&start, Lang::En, "causes", &[r#"data-node="sensors""#, "4 × Unknown"], &["gnss"]);
    }

    #[test]
    fn an_empty_component_is_named_because_nothing_inside_explains_it() {
        let parts = ModelParts {
            groups: vec![group("a", Text::plain("Alpha")), group("b", Text::plain("Beta"))],
            modules: vec![module("a", 0, "x")],
            signals: Vec::new(),
            stages: StageModel::None,
            ..parts()
        };
        let empty = Sample::of(parts).pass(3).published();
        check(&empty, Lang::En, "causes", &[r#"data-node="b""#, "Beta"], &["All", "The one"]);
        check(&empty, Lang::En, "tile-b", &[r#"data-state="unknown""#, "nothing to watch"], &[]);
    }
}

mod arrows {
    use super::*;

    fn hot(published: &Published) -> Vec<(String, String)> {
        let html = fragment(published, Lang::En, "arrows");
        let arrows = html.split("<g ").filter(|arrow| arrow.contains("data-hot"));
        let attribute = |arrow: &str, name: &str| {
            let rest = arrow.split_once(&format!("{name}=\"")).expect("the attribute").1;
            rest.split('"').next().unwrap_or_default().to_owned()
        };
        let mut hot: Vec<_> =
            arrows.map(|arrow| (attribute(arrow, "data-from"), attribute(arrow, "data-to"))).collect();
        hot.sort();
        hot
    }

    #[test]
    fn implied_dependencies_are_not_drawn() {
        let calm = Sample::shuttle(true).published();
        let html = fragment(&calm, Lang::En, "arrows");
        assert_eq!(html.matches("<g ").count(), 7, "{html}");
        assert!(!html.contains(r#"data-from="localization" data-to="planning""#));
        assert!(hot(&calm).is_empty());
    }

    #[test]
    fn the_way_from_the_root_cause_is_drawn_as_one_path() {
        let fault = jump().pass(4).published();
        let expect = [
            ("localization", "perception"),
            ("perception", "prediction"),
            ("planning", "execution"),
            ("prediction", "planning"),
        ];
        assert_eq!(hot(&fault), expect.map(|(from, to)| (from.to_owned(), to.to_owned())));
    }
}

mod stages {
    use super::*;

    #[test]
    fn a_locked_vehicle_shows_nothing_of_itself() {
        let locked = Sample::of(parts()).report("can/bus", 2, "bus off", &[]).pass(5).published();
        let fragments = fragments(&locked, Lang::En);
        assert_eq!(fragments.len(), 1);
        let page = operator_page(&locked, &context(Lang::En, Palette::Night));
        let developer = developer_page(&locked, &context(Lang::En, Palette::Night));
        for html in [&fragments[0].html, &page, &developer] {
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
        check(
            &ready,
            Lang::En,
            "actions",
            &["Ready. Waits for the mission", r#"name="logout""#, "/logout"],
            &[],
        );
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
        parts.groups[3].when = Some(When { stages: vec![Stage::Localizing], signals: Vec::new() });
        parts.groups[5].when = Some(When { stages: vec![Stage::Active], signals: Vec::new() });
        let standby = Sample::of(parts).login().signal("active", false).pass(5).published();
        check(&standby, Lang::En, "tile-prediction", &["not driving"], &["Standby", "standby"]);
        check(&standby, Lang::De, "tile-mission", &["fährt nicht"], &[]);
    }
}

mod details {
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
}

mod hostile {
    use super::*;

    #[test]
    fn text_from_outside_is_text_and_nothing_else() {
        let evil = "<script>alert(1)</script>\"' onload=x\u{202e}\0&";
        let sample = Sample::shuttle(true)
            .report("localization/tf_map", 2, evil, &[(evil, evil)])
            .report(&format!("/can/{evil}"), 1, evil, &[(evil, evil)])
            .report(&format!("nobody {evil}"), 2, evil, &[])
            .trouble(evil, TroubleKind::Malformed, 3, evil)
            .pass(3);
        let published = sample.published();
        let mut pages: Vec<String> =
            fragments(&published, Lang::En).into_iter().map(|fragment| fragment.html).collect();
        pages.push(operator_page(&published, &context(Lang::De, Palette::Day)));
        pages.push(developer_page(
            &published,
            &PageContext { user: evil.to_owned(), ..context(Lang::En, Palette::Day) },
        ));
        pages.push(demo_page(
            &[DemoFault { name: evil.to_owned(), active: true }],
            &context(Lang::En, Palette::Day),
        ));
        pages.push(message_page(404, evil, evil, Lang::En, Palette::Day));
        pages.push(login_page(&LoginContext {
            lang: Lang::En,
            palette: Palette::Day,
            name: evil.to_owned(),
            failure: Some(LoginFailure::Wrong),
            demo: false,
        }));
        for html in &pages {
            assert!(!html.contains("<script>") && !html.contains("\"' onload"), "{html}");
        }
        assert!(pages.iter().any(|html| html.contains("&#60;script&#62;alert(1)")));
        assert!(!pages.iter().any(|html| html.contains('\u{202e}') || html.contains('\0')));
    }

    #[test]
    fn endless_text_is_cut() {
        let long = "w".repeat(4000);
        let published = Sample::shuttle(true)
            .report("localization/tf_map", 2, &long, &[(&long, &long)])
            .pass(3)
            .published();
        for fragment in fragments(&published, Lang::En) {
            assert!(!fragment.html.contains(&"w".repeat(300)), "{}", fragment.id);
        }
    }
}

mod pages {
    use super::*;

    /// Every kind of page in every state that people meet. `TELLTALE_PAGES=DIR cargo test
    /// every_page` also writes them there, to be looked at in a browser.
    fn all() -> Vec<(String, String)> {
        let states = [
            ("calm", Sample::shuttle(true).published()),
            ("standby", Sample::shuttle(false).published()),
            (
                "standby-warning",
                Sample::shuttle(false)
                    .report(
                        "perception/costmap_delay",
                        1,
                        "Costmap is late, 180 ms",
                        &[("delay_ms", "180"), ("limit_ms", "150")],
                    )
                    .silence("mission/server")
                    .pass(12)
                    .published(),
            ),
            (
                "fault",
                jump()
                    .report("perception/costmap_delay", 2, "350 ms", &[("delay_ms", "350")])
                    .pass(4)
                    .published(),
            ),
            (
                "worst",
                jump()
                    .report("can/bus", 2, "bus off", &[])
                    .report("sensors/velodyne_packet_alive", 2, "0.0 Hz in the last 2 s, expected 10 Hz", &[])
                    .report("sensors/gnss", 1, "4 satellites", &[])
                    .silence("mission/server")
                    .pass(75)
                    .published(),
            ),
            ("start", Sample::of(parts()).login().published()),
        ];
        let mut pages = Vec::new();
        for (name, published) in &states {
            for lang in Lang::ALL {
                for palette in [Palette::Day, Palette::Night] {
                    let context = PageContext { demo: *name == "calm", ..context(lang, palette) };
                    let file = format!("{name}-{}-{}", lang.as_str(), palette.as_str());
                    pages.push((file.clone(), operator_page(published, &context)));
                    pages.push((format!("developer-{file}"), developer_page(published, &context)));
                }
            }
        }
        for tiles in 1..=12 {
            let published =
                Sample::of(chain(tiles)).pass(5).report("g0/m", 2, "broken", &[]).pass(5).published();
            pages.push((
                format!("tiles-{tiles}"),
                operator_page(&published, &context(Lang::De, Palette::Night)),
            ));
        }
        pages.extend(small());
        pages
    }

    fn small() -> Vec<(String, String)> {
        let mut pages = Vec::new();
        let names = [
            "sensor_outage",
            "localization_jump",
            "costmap_delay",
            "planner_stall",
            "can_loss",
            "low_battery",
        ];
        let faults =
            names.map(|name| DemoFault { name: name.to_owned(), active: name == "localization_jump" });
        for lang in Lang::ALL {
            for palette in [Palette::Day, Palette::Night] {
                let file = |name: &str| format!("{name}-{}-{}", lang.as_str(), palette.as_str());
                let login = LoginContext { lang, palette, name: String::new(), failure: None, demo: true };
                pages.push((file("login"), login_page(&login)));
                let failed =
                    LoginContext { name: "operator".to_owned(), failure: Some(LoginFailure::Wrong), ..login };
                pages.push((file("login-failed"), login_page(&failed)));
                pages.push((file("demo"), demo_page(&faults, &context(lang, palette))));
                let message = message_page(
                    404,
                    "Nicht gefunden",
                    "Unter dieser Adresse gibt es nichts.",
                    lang,
                    palette,
                );
                pages.push((file("message"), message));
            }
        }
        pages
    }

    /// Components that depend on one another in a row, with one that rests on all.
    fn chain(tiles: u32) -> ModelParts {
        const NAMES: [&str; 4] = ["Lokalisierung", "Wahrnehmung", "Ausführung", "Leitstelle"];
        let groups = (0..tiles).map(|index| {
            let mut spec = group(&format!("g{index}"), text("Component", NAMES[index as usize % 4]));
            spec.depends_on = match index {
                0 => vec![],
                1 | 2 => vec![on_group(0)],
                _ => vec![on_group(index / 2), on_group(index - 2)],
            };
            spec
        });
        ModelParts {
            groups: groups.collect(),
            modules: (0..tiles).map(|index| module(&format!("g{index}"), index, "m")).collect(),
            signals: Vec::new(),
            stages: StageModel::None,
            ..parts()
        }
    }

    #[test]
    fn every_page_keeps_the_content_security_policy() {
        let folder = std::env::var_os("TELLTALE_PAGES").map(std::path::PathBuf::from);
        for (name, html) in all() {
            for forbidden in
                [" style=", "<style", "javascript:", " onclick=", " onload=", "hx-on", "<script>"]
            {
                assert!(!html.contains(forbidden), "{name} has {forbidden}");
            }
            assert!(html.starts_with("<!doctype html>") && html.trim_end().ends_with("</html>"), "{name}");
            if let Some(folder) = &folder {
                std::fs::write(folder.join(format!("{name}.html")), html).expect("the folder can be written");
            }
        }
    }

    #[test]
    fn ids_are_single_and_fragments_are_elements_of_the_page() {
        let published = jump().pass(4).published();
        let page = operator_page(&published, &context(Lang::En, Palette::Night));
        let mut ids: Vec<&str> =
            page.split(" id=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
        let count = ids.len();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), count, "ids: {ids:?}");
        for fragment in fragments(&published, Lang::En) {
            let marked = format!("id=\"{}\" hx-swap-oob=\"outerMorph\"", fragment.id);
            assert!(fragment.html.contains(&marked), "{}", fragment.html);
            let same = fragment.html.replace(" hx-swap-oob=\"outerMorph\"", "");
            assert!(page.contains(same.trim()), "{} differs in the page", fragment.id);
        }
    }

    #[test]
    fn fragments_change_only_with_what_they_show() {
        let before = fragments(&Sample::shuttle(true).published(), Lang::En);
        let after = fragments(&Sample::shuttle(true).pass(30).published(), Lang::En);
        assert_eq!(before, after);
    }

    #[test]
    fn every_popover_has_a_panel() {
        let published = jump().pass(4).published();
        let page = operator_page(&published, &context(Lang::En, Palette::Night));
        for target in page.split("popovertarget=\"").skip(1).filter_map(|rest| rest.split('"').next()) {
            assert!(page.contains(&format!("id=\"{target}\" popover")), "{target}");
        }
    }

    #[test]
    fn the_developer_sees_all_that_was_received() {
        let published = Sample::shuttle(false)
            .report("nobody: knows", 2, "mine alone", &[("key", "value")])
            .trouble("/diagnostics", TroubleKind::Malformed, 7, "string runs past the end")
            .pass(3)
            .published();
        let page = developer_page(&published, &context(Lang::En, Palette::Night));
        for part in [
            "nobody: knows",
            "mine alone",
            "string runs past the end",
            "malformed",
            ">7<",
            "can/battery",
            "isolated",
        ] {
            assert!(page.contains(part), "{part}");
        }
        let operator = operator_page(&published, &context(Lang::En, Palette::Night));
        assert!(!operator.contains("mine alone"));
    }

    #[test]
    fn the_demo_switches_each_fault_to_the_other_side() {
        let faults = [("can_loss", true), ("low_battery", false)];
        let faults = faults.map(|(name, active)| DemoFault { name: name.to_owned(), active });
        let page = demo_page(&faults, &context(Lang::De, Palette::Night));
        for part in [
            "CAN-Ausfall",
            "Batterie schwach",
            r#"name="active" value="false""#,
            r#"name="active" value="true""#,
        ] {
            assert!(page.contains(part), "{part}");
        }
    }

    #[test]
    fn a_login_that_failed_says_why_and_keeps_the_name() {
        let login = |failure| {
            let name = "anna".to_owned();
            login_page(&LoginContext { lang: Lang::De, palette: Palette::Day, name, failure, demo: false })
        };
        assert!(login(Some(LoginFailure::Wrong)).contains("Name oder PIN ist falsch."));
        assert!(login(Some(LoginFailure::Wait { seconds: 30 })).contains("30 s warten"));
        assert!(login(Some(LoginFailure::NoUsers)).contains("telltale user add"));
        assert!(login(None).contains(r#"value="anna""#) && !login(None).contains("246810"));
    }

    #[test]
    fn tiles_fill_any_board() {
        for tiles in 1..=30 {
            let published = Sample::of(chain(tiles)).pass(5).published();
            let page = operator_page(&published, &context(Lang::En, Palette::Night));
            assert_eq!(page.matches("class=\"tile at-").count(), tiles as usize);
        }
        let board = Board::of(&Sample::of(parts()).published().snapshot.layout);
        assert_eq!((board.columns, board.rows), (4, 2));
        assert_eq!(board.tile_of(crate::engine::model::NodeId::Group(GroupId(8))), None);
    }
}
