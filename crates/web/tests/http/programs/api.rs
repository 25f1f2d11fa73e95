//! The interface for programs: its description, its tables, and what it says to a wrong request.

use std::collections::HashSet;
use std::time::Duration;

use axum::http::header::{ACCEPT, UPGRADE};
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};
use telltale_engine::snapshot::Snapshot;
use telltale_engine::time::Span;
use telltale_store::MinuteSums;
use telltale_web::{openapi, routes};

use crate::fixture::{Fixture, request};
use crate::schemas::Strict;

/// A fixture with some history, and the cookie of a developer.
async fn fixture() -> (Fixture, String) {
    let fixture = Fixture::new().await;
    fixture.cookie_of("operator").await;
    let cookie = fixture.cookie_of("developer").await;
    for (name, level, message) in
        [("lidar", 0, "fine"), ("imu", 0, "=1+1"), ("lidar", 2, "no \"packets\", none")]
    {
        fixture.status(name, level, message).await;
    }
    fixture.until(|snapshot| !snapshot.roots.is_empty()).await;
    (fixture, cookie)
}

#[test]
fn every_route_of_the_interface_is_described() {
    let document = openapi(true);
    let mut ids = HashSet::new();
    for route in routes(true) {
        let Some(operation) = route.operation else {
            assert!(!route.path.starts_with("/api/"), "{route:?} is not described");
            continue;
        };
        let path = operation.path.unwrap_or(route.path);
        let told = &document["paths"][path][route.method.as_str().to_lowercase()];
        assert_eq!(told["operationId"], operation.id, "{route:?}");
        assert!(ids.insert(operation.id), "{} is there twice", operation.id);
        let parameters = told["parameters"].as_array().unwrap();
        assert_eq!(path.contains("{id}"), parameters.iter().any(|it| it["in"] == "path"), "{path}");
        assert!(!operation.summary.is_empty() && !path.contains('*'), "{route:?}");
    }
    assert_eq!(
        document["paths"]
            .as_object()
            .unwrap()
            .values()
            .map(|it| it.as_object().unwrap().len())
            .sum::<usize>(),
        ids.len()
    );
}

#[test]
fn the_page_of_the_interface_has_every_example() {
    let page = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/api.md")).unwrap();
    let document = openapi(true);
    let methods =
        document["paths"].as_object().unwrap().values().flat_map(|it| it.as_object().unwrap().values());
    let missing: Vec<&str> = methods
        .map(|operation| operation["x-curl"].as_str().unwrap())
        .filter(|example| !page.lines().any(|line| line.split("  # ").next() == Some(*example)))
        .collect();
    assert!(
        missing.is_empty(),
        "docs/api.md lacks these lines, each with `  # ` and the status behind it: {missing:#?}"
    );
}

#[tokio::test]
async fn answers_are_as_they_are_described() {
    let (fixture, cookie) = fixture().await;
    let answer = fixture.get("/api/v1/openapi.json", Some(&cookie)).await;
    let document: Value = serde_json::from_str(&answer.body).unwrap();
    assert_eq!(document["components"]["securitySchemes"]["session"]["name"], "telltale");
    let mut tried = 0;
    for (path, methods) in document["paths"].as_object().unwrap() {
        let described = methods["get"]["responses"]["200"]["content"].as_object();
        let media = described.and_then(|it| it.keys().find(|media| media.contains("json")));
        let Some(media) = media.filter(|_| !path.contains('{')) else { continue };
        let needed = if path == "/api/v1/values" { "?node=sensors/lidar" } else { "" };
        let answer = fixture.get(&format!("{path}{needed}"), Some(&cookie)).await;
        assert_eq!(answer.status, StatusCode::OK, "{path}: {}", answer.body);
        assert_eq!(answer.headers["content-type"], **media, "{path}");
        let value = serde_json::from_str(&answer.body).unwrap();
        let [pointer, media] = [path, media].map(|it| it.replace('/', "~1"));
        let pointer = format!("/paths/{pointer}/get/responses/200/content/{media}/schema");
        assert_eq!(Strict::at(&document, &pointer).fault(&value), None, "{path}");
        tried += 1;
    }
    assert!(tried > 7, "{tried}");
}

#[tokio::test]
async fn a_plain_request_for_the_stream_is_told_how_to_use_it() {
    let (fixture, cookie) = fixture().await;
    let answer = fixture.get("/api/v1/stream", Some(&cookie)).await;
    assert_eq!(
        (answer.status, answer.header(UPGRADE.as_str())),
        (StatusCode::UPGRADE_REQUIRED, Some("websocket"))
    );
    assert!(answer.body.contains("connect(\"ws://127.0.0.1:8080/api/v1/stream\""), "{}", answer.body);
    assert_eq!(fixture.get("/api/v1/stream", None).await.status, StatusCode::UNAUTHORIZED);
}

#[tokio::test]
async fn the_history_comes_in_pages_each_record_once() {
    let (fixture, cookie) = fixture().await;
    let all = async || fixture.get_json("/api/v1/history", &cookie).await;
    crate::fixture::until(async || all().await["records"].to_string().contains("packets")).await;
    let all = all().await["records"].as_array().unwrap().clone();
    let (mut paged, mut after) = (Vec::new(), json!(0));
    while !after.is_null() {
        let page = fixture.get_json(&format!("/api/v1/history?count=3&after={after}"), &cookie).await;
        assert!(page["records"].as_array().unwrap().len() <= 3);
        paged.extend(page["records"].as_array().unwrap().clone());
        after = page["next"].clone();
    }
    assert_eq!(paged[..all.len()], all[..]);
    let of = async |query: &str| {
        fixture.get_json(&format!("/api/v1/history?{query}"), &cookie).await["records"]
            .as_array()
            .unwrap()
            .clone()
    };
    for record in of("node=sensors").await {
        let node = record["node"].as_str().unwrap();
        assert!(node == "sensors" || node.starts_with("sensors/"), "{node}");
    }
    assert!(of("node=sensors").await.len() > of("node=sensors/lidar").await.len());
    assert!(of("node=sensor").await.is_empty());
    assert_eq!(of("kind=alarm_raised").await[0]["node"], "sensors/lidar");
    assert!(of("kind=stage").await.iter().any(|record| record["value"] == "localizing"));
    let (first, last) = (all[0]["at"].as_str().unwrap(), all[all.len() - 1]["at"].as_str().unwrap());
    assert!(of(&format!("since={first}&until={last}")).await.len() >= all.len());
    assert!(of("until=1999-01-01T00:00:00Z").await.is_empty());
}

#[tokio::test]
async fn a_table_comes_as_csv_to_who_asks_for_it() {
    let (fixture, cookie) = fixture().await;
    let by_address = fixture.get("/api/v1/statuses?format=csv&group=sensors&count=2", Some(&cookie)).await;
    let mut by_header = request(Method::GET, "/api/v1/statuses?group=sensors&count=2", Some(&cookie));
    by_header.headers_mut().insert(ACCEPT, "text/csv".parse().unwrap());
    for answer in [by_address, fixture.send(by_header).await] {
        assert_eq!(answer.header("content-type"), Some("text/csv; charset=utf-8; header=present"));
        let lines: Vec<&str> = answer.body.split("\r\n").collect();
        assert_eq!(
            lines[0],
            "id,state,own,since,age_ms,silent_s,message,hardware_id,reason,class,values,cut,began"
        );
        assert!(lines[1].starts_with("sensors/lidar,error,error,"), "{lines:?}");
        assert!(lines[1].contains(",\"no \"\"packets\"\", none\","), "{lines:?}");
        // A message that a spreadsheet would run is a text.
        assert!(lines[2].contains(",'=1+1,"), "{lines:?}");
        assert_eq!(answer.header("telltale-next"), None);
    }
    let first = fixture.get("/api/v1/statuses?format=csv&count=1", Some(&cookie)).await;
    assert_eq!(first.header("telltale-next"), Some("1"));
    for path in ["history", "topics", "audit", "incidents"] {
        let answer = fixture.get(&format!("/api/v1/{path}?format=csv"), Some(&cookie)).await;
        assert_eq!(
            (answer.status, answer.header("content-type")),
            (StatusCode::OK, Some("text/csv; charset=utf-8; header=present"))
        );
    }
}

#[tokio::test]
async fn the_columns_of_a_table_are_those_of_its_rows() {
    let (fixture, cookie) = fixture().await;
    let document = openapi(false);
    for (path, row) in [
        ("statuses", "Module"),
        ("history", "HistoryRecord"),
        ("topics", "Topic"),
        ("audit", "AuditRecord"),
        ("incidents", "ListedIncident"),
    ] {
        let answer = fixture.get(&format!("/api/v1/{path}?format=csv"), Some(&cookie)).await;
        let columns: HashSet<&str> = answer.body.lines().next().unwrap().split(',').collect();
        let members = document["components"]["schemas"][row]["properties"].as_object().unwrap();
        assert_eq!(columns, members.keys().map(String::as_str).collect(), "{path}");
    }
}

#[tokio::test]
async fn the_numbers_of_a_module_come_as_they_are_drawn() {
    let (fixture, cookie) = fixture().await;
    fixture.app.trends.sample(&fixture.app.published());
    let path = "/api/v1/values?node=sensors/lidar";
    let answer = fixture.get(path, Some(&cookie)).await;
    let value: Value = serde_json::from_str(&answer.body).unwrap();
    let row = &value["values"][0];
    assert_eq!((&row["key"], &row["value"]), (&json!("n"), &json!(1.0)), "{value}");
    assert!(humantime::parse_rfc3339(row["at"].as_str().unwrap()).is_ok());
    let csv = fixture.get(&format!("{path}&format=csv"), Some(&cookie)).await;
    assert!(csv.body.starts_with("at,key,value\r\n") && csv.body.contains(",n,1.0\r\n"), "{}", csv.body);
    for node in ["sensors", "nobody"] {
        let answer = fixture.get(&format!("/api/v1/values?node={node}"), Some(&cookie)).await;
        assert_eq!(answer.status, StatusCode::NOT_FOUND, "{node}");
    }
}

#[tokio::test]
async fn the_numbers_of_days_come_as_minutes_or_hours() {
    let (fixture, cookie) = fixture().await;
    let history = fixture.app.settings.history.clone().expect("there is one");
    let mut sums = MinuteSums::default();
    let snapshot = fixture.app.published().snapshot;
    // Three minutes at the end of an hour, and one of the next.
    for (second, minute) in [(0, 57), (1, 58), (2, 59), (3, 60), (4, 61)] {
        let now = snapshot.now + Span::from_secs(second);
        let wall =
            humantime::parse_rfc3339("2026-11-20T12:00:00Z").unwrap() + Duration::from_secs(60 * minute);
        let later = Snapshot { now, ..(*snapshot).clone() };
        if let Some(minute) = sums.take(&later, wall) {
            history.keep_minute(minute).await;
        }
    }
    let at = |from: &str| format!("/api/v1/values?node=sensors/lidar&since=2026-11-20T{from}:00Z");
    let value = fixture.get_json(&format!("{}&until=2026-11-20T13:00:00Z", at("12:58")), &cookie).await;
    let begins: Vec<&str> =
        value["values"].as_array().unwrap().iter().map(|row| row["at"].as_str().unwrap()).collect();
    assert_eq!(begins, ["2026-11-20T12:58:00.000Z", "2026-11-20T12:59:00.000Z", "2026-11-20T13:00:00.000Z"]);
    let row = &value["values"][0];
    assert_eq!(
        [&row["key"], &row["value"], &row["min"], &row["max"]],
        [&json!("n"), &json!(1.0), &json!(1.0), &json!(1.0)]
    );
    assert_eq!((&value["resolution"], &value["next"]), (&json!("minute"), &json!(null)));
    assert_eq!(value["minutes_since"], "2026-11-20T12:00:00.000Z", "{value}");
    // A longer time comes in hours, unless minutes are asked for.
    let week = format!("{}&until=2026-11-27T12:00:00Z", at("12:00"));
    let hours = fixture.get_json(&week, &cookie).await;
    assert_eq!((&hours["resolution"], hours["values"].as_array().unwrap().len()), (&json!("hour"), 2));
    let minutes = fixture.get_json(&format!("{week}&resolution=minute&count=3"), &cookie).await;
    assert_eq!((&minutes["next"], minutes["values"].as_array().unwrap().len()), (&json!(3), 3));
    let rest =
        fixture.get(&format!("{week}&resolution=minute&count=3&offset=3&format=csv"), Some(&cookie)).await;
    let lines: Vec<&str> = rest.body.lines().collect();
    assert_eq!((lines[0], lines.len()), ("at,key,value,min,max,known_s", 2), "{}", rest.body);
    assert!(lines[1].starts_with("2026-11-20T13:00:00.000Z,n,1.0,1.0,1.0,"), "{}", rest.body);
    let nobody = "/api/v1/values?node=nobody&resolution=hour";
    assert_eq!(fixture.get(nobody, Some(&cookie)).await.status, StatusCode::NOT_FOUND);
    // The page draws them, and leads to the same numbers.
    let until_ms = 1_795_183_200_000_i64;
    let page = format!("/developer/why?node=sensors/lidar&span=86400&until={until_ms}");
    let page = fixture.get(&page, Some(&cookie)).await.body;
    for holds in
        ["class=\"band\"", "data-least=\"[1,1,1,1,null]\"", "mean of each minute", "resolution=minute"]
    {
        assert!(page.contains(holds), "{holds}: {page}");
    }
    let week = format!("/developer/why?node=sensors/lidar&span=604800&until={until_ms}");
    let week = fixture.get(&week, Some(&cookie)).await.body;
    assert!(week.contains("mean of each hour") && week.contains("data-least=\"[1,1,null]\""), "{week}");
}

#[tokio::test]
async fn a_wrong_address_is_answered_with_what_to_write() {
    let (fixture, cookie) = fixture().await;
    let long = "x".repeat(3000);
    for (query, said) in [
        ("history?count=0", "count is a number from 1 to 10000"),
        ("history?count=99999999999999999999", "count is a number from 1 to 10000"),
        ("history?since=yesterday", "2026-11-20T12:00:00Z"),
        ("history?since=1899-01-01T00:00:00Z", "2026-11-20T12:00:00Z"),
        ("history?kind=x", "state, started, stage"),
        ("history?form=csv", "unknown field `form`"),
        ("history?after=-1", "after"),
        ("statuses?level=bad", "`abnormal`"),
        ("statuses?offset=1.5", "offset"),
        ("statuses?format=xml", "`csv`"),
        ("topics?count=201", "from 1 to 200"),
        ("audit?before=x", "before"),
        (&format!("audit?{long}=1"), "not understood"),
    ] {
        let answer = fixture.get(&format!("/api/v1/{query}"), Some(&cookie)).await;
        let value: Value = serde_json::from_str(&answer.body).unwrap();
        let error = value["error"].as_str().unwrap();
        assert_eq!(answer.status, StatusCode::BAD_REQUEST, "{query}");
        assert!(
            error.contains(said) && error.contains("openapi.json") && error.len() < 400,
            "{query}: {error}"
        );
    }
}

#[tokio::test]
async fn a_locked_vehicle_tells_no_table_of_itself() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("developer").await;
    fixture.status("lidar", 2, "broken").await;
    for path in ["statuses", "history", "topics", "values?node=sensors/lidar"] {
        let answer = fixture.get(&format!("/api/v1/{path}"), Some(&cookie)).await;
        assert_eq!(answer.status, StatusCode::CONFLICT, "{path}");
        assert!(answer.body.contains("locked") && !answer.body.contains("lidar"), "{}", answer.body);
    }
    assert_eq!(fixture.get("/api/v1/audit", Some(&cookie)).await.status, StatusCode::OK);
}

#[tokio::test]
async fn the_page_shows_each_route_with_its_example() {
    let (fixture, cookie) = fixture().await;
    let page = fixture.get("/developer/api", Some(&cookie)).await;
    assert_eq!(page.status, StatusCode::OK);
    for operation in routes(false).iter().filter_map(|route| route.operation) {
        assert!(page.body.contains(&format!("<article id=\"{}\"", operation.id)), "{}", operation.id);
    }
    assert!(page.body.contains("/api/v1/history?node=sensors"), "{}", page.body);
}
