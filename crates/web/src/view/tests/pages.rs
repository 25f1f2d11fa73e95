//! Tests of whole pages: every page, in every form.

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
                for (page, html) in crate::developer::tests::pages(published, &context, "") {
                    pages.push((format!("developer-{page}-{file}"), html));
                }
            }
        }
    }
    for tiles in 1..=12 {
        let published = Sample::of(chain(tiles)).pass(5).report("g0/m", 2, "broken", &[]).pass(5).published();
        pages.push((format!("tiles-{tiles}"), operator_page(&published, &context(Lang::De, Palette::Night))));
    }
    pages.extend(small());
    pages
}

fn faults() -> [DemoFault; 2] {
    let fault = |name, title| DemoFault { name, title, about: text("It stops.", "Es steht.") };
    [
        fault("sensor_outage", text("Sensor outage", "Sensorausfall")),
        fault("can_loss", text("CAN loss", "CAN-Ausfall")),
    ]
}

fn small() -> Vec<(String, String)> {
    let mut pages = Vec::new();
    for lang in Lang::ALL {
        for palette in [Palette::Day, Palette::Night] {
            let file = |name: &str| format!("{name}-{}-{}", lang.as_str(), palette.as_str());
            let login = LoginContext::new(lang, palette, DISPLAY_DPI, true);
            pages.push((file("login"), login_page(&login)));
            let failed =
                LoginContext { name: "operator".to_owned(), failure: Some(LoginFailure::Wrong), ..login };
            pages.push((file("login-failed"), login_page(&failed)));
            pages.push((
                file("demo"),
                demo_page(&faults(), &BTreeSet::from(["can_loss"]), &context(lang, palette)),
            ));
            let message = message_page(
                404,
                "Nicht gefunden",
                "Unter dieser Adresse gibt es nichts.",
                Home::Vehicle,
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
        for forbidden in [" style=", "<style", "javascript:", " onclick=", " onload=", "hx-on", "<script>"] {
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
    let mut ids: Vec<&str> = page.split(" id=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
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
fn the_demo_switches_each_fault_to_the_other_side() {
    let page = demo_page(&faults(), &BTreeSet::from(["can_loss"]), &context(Lang::De, Palette::Night));
    for part in
        ["CAN-Ausfall", "Sensorausfall", r#"name="active" value="false""#, r#"name="active" value="true""#]
    {
        assert!(page.contains(part), "{part}");
    }
}

#[test]
fn a_login_that_failed_says_why_and_keeps_the_name() {
    let login = |failure| {
        let new = LoginContext::new(Lang::De, Palette::Day, DISPLAY_DPI, false);
        login_page(&LoginContext { name: "anna".to_owned(), failure, ..new })
    };
    assert!(login(Some(LoginFailure::Wrong)).contains("Name oder PIN ist falsch."));
    assert!(login(Some(LoginFailure::Wait { seconds: 30 })).contains("30 s warten"));
    for (data, expected) in [(None, "operator<"), (Some("/var/lib/tell"), "operator --data /var/lib/tell<")] {
        let page = login(Some(LoginFailure::NoUsers { data: data.map(str::to_owned) }));
        assert!(page.contains(&format!("telltale user add NAME --role {expected}")), "{page}");
    }
    assert!(login(None).contains(r#"value="anna""#) && !login(None).contains("246810"));
}

#[test]
fn tiles_fill_any_board() {
    for tiles in 1..=40 {
        let published = Sample::of(chain(tiles)).pass(5).published();
        let page = operator_page(&published, &context(Lang::En, Palette::Night));
        assert_eq!(page.matches("class=\"tile column-").count(), tiles as usize);
    }
    let board = Board::of(&Sample::of(parts()).published().snapshot.layout);
    assert_eq!((board.columns, board.rows), (4, 2));
    assert_eq!(board.tile_of(telltale_engine::model::NodeId::Group(GroupId(8))), None);
}

#[test]
fn vendored_files_are_those_that_are_recorded() {
    use sha2::{Digest, Sha256};
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../static/vendor/");
    let readme = std::fs::read_to_string(format!("{folder}README.md")).expect("the record is there");
    for file in [
        "htmx.min.js",
        "hx-ws.min.js",
        "idiomorph.min.js",
        "uplot.min.js",
        "uplot.min.css",
        "inter-latin-wght-normal.woff2",
    ] {
        let bytes = std::fs::read(format!("{folder}{file}")).expect("the file is there");
        let hash: String = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        let row = readme.lines().find(|line| line.starts_with(&format!("| `{file}`")));
        assert!(row.is_some_and(|row| row.contains(&hash)), "{file}: {hash}");
    }
}
