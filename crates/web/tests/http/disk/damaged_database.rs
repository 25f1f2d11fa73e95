//! A database that is damaged when the server starts: the display, a login and a stop, and no clearance.

use std::os::unix::fs::FileExt as _;

use axum::http::StatusCode;
use rusqlite::Connection;
use telltale_engine::model::Stage;
use telltale_engine::state::State;

use crate::fixture::{Fixture, as_program, form_request};
use crate::folder::TestFolder;

/// A data folder whose index of users is overwritten with zeroes, with an operator at the depot.
async fn damaged(name: &str) -> TestFolder {
    let folder = TestFolder::new(&format!("broken-{name}"));
    let fixture = Fixture::in_folder(&folder).await;
    let cookie = fixture.cookie_of("operator").await;
    let seq = fixture.get_json("/api/v1/snapshot", &cookie).await["seq"].as_u64().unwrap();
    let localize = form_request("/vehicle/localize", Some(&cookie), &format!("version={seq}&stop=depot"));
    assert_eq!(fixture.send(as_program(localize)).await.status, StatusCode::OK);
    fixture.store.clone().close().await;
    let database = Connection::open(folder.join("telltale.db")).unwrap();
    database.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(())).unwrap();
    let root = "SELECT rootpage FROM sqlite_schema WHERE name = 'sqlite_autoindex_users_1'";
    let page: u64 = database.query_row(root, [], |row| row.get::<_, u32>(0)).unwrap().into();
    drop(database);
    zero(&folder, page - 1);
    folder
}

fn zero(folder: &std::path::Path, page: u64) {
    let file = std::fs::File::options().write(true).open(folder.join("telltale.db")).unwrap();
    file.write_all_at(&[0; 4096], page * 4096).unwrap();
}

#[tokio::test]
async fn with_a_damaged_database_people_log_in_and_stop_and_nothing_is_cleared() {
    let folder = damaged("login").await;
    let fixture = Fixture::serving(&folder).await;
    let said = fixture.store.fault().borrow().clone().expect("it is damaged");
    assert!(said.contains("telltale data repair"), "{said}");
    let wrong = fixture.log_in("operator", "135792").await;
    assert_eq!(wrong.status, StatusCode::UNAUTHORIZED);
    let cookie = fixture.cookie_of("operator").await;
    for status in ["lidar", "imu", "tf", "planner"] {
        fixture.status(status, 0, "fine").await;
    }
    let shown = fixture.until(|snapshot| snapshot.stage == Stage::Standby).await;
    assert!(shown.overall >= State::Warning, "{:?}", shown.overall);
    let page = fixture.get("/", Some(&cookie)).await;
    assert!(page.status == StatusCode::OK && page.body.contains("Nothing can be recorded"), "{}", page.body);

    let tap = async |path| {
        let seq = fixture.get_json("/api/v1/snapshot", &cookie).await["seq"].as_u64().unwrap();
        let form = format!("version={seq}&stop=depot");
        fixture.send(as_program(form_request(path, Some(&cookie), &form))).await
    };
    let cleared = tap("/vehicle/clearance").await;
    assert_eq!(cleared.status, StatusCode::CONFLICT, "{}", cleared.body);
    assert!(cleared.body.contains("record"), "{}", cleared.body);
    let posed = tap("/vehicle/localize").await;
    assert_eq!(posed.status, StatusCode::SERVICE_UNAVAILABLE, "what cannot be kept is not done");

    fixture.drive(true).await;
    let stopped = tap("/vehicle/stop").await;
    assert!(
        stopped.body.contains("is asked to stop") && stopped.body.contains("not recorded"),
        "{}",
        stopped.body
    );
    fixture.until(|snapshot| !snapshot.countermeasures.is_empty()).await;
    let developer = fixture.cookie_of("developer").await;
    assert_eq!(fixture.get("/developer", Some(&developer)).await.status, StatusCode::OK);
    fixture.drive(false).await;
    let left = fixture.post("/logout", Some(&cookie), "").await;
    assert!(left.status.is_redirection(), "{}", left.body);
}

#[tokio::test]
async fn where_no_user_can_be_read_nobody_is_told_to_add_one() {
    let folder = damaged("nobody").await;
    zero(&folder, 0);
    let fixture = Fixture::serving(&folder).await;
    let page = fixture.get("/login", None).await;
    assert_eq!(page.status, StatusCode::OK);
    assert!(!page.body.contains("telltale user add") && page.body.contains("broken"), "{}", page.body);
}
