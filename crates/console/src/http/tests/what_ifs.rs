//! What-ifs over a group: the roles that start them and see the result, and the requests that the console refuses.

use super::*;
use crate::state::recordings::Step;
use telltale_fleet::message::{Pieces, Recording};

#[tokio::test]
async fn an_engineer_has_a_group_judged_again_and_each_role_sees_what_came_out() {
    let folder = tempfile::tempdir().unwrap();
    let (router, shared, store) = console_in(folder.path()).await;
    let pieces = Pieces::of(&"ab".repeat(32), 1_500_000).unwrap();
    tell_of_incident(&shared, 7, Some("ab".repeat(32)));
    tell_of_incident(&shared, 8, None);
    let engineer = cookie(&router, "engineer").await;
    let of = "group=version&of=0.1.0";
    let post = async |cookie: &str, body: &str| {
        ask(&router, Method::POST, "/incidents/what-if", cookie, body).await.status()
    };
    let page = async |path: &str, cookie: &str| {
        let answer = ask(&router, Method::GET, path, cookie, "").await;
        let body = to_bytes(answer.into_body(), 1 << 20).await.unwrap();
        String::from_utf8(body.to_vec()).unwrap()
    };
    let form = format!("/incidents/what-if?{of}");
    assert!(page(&form, &engineer).await.contains("2 of 2 are not fetched."));
    assert_eq!(post(&engineer, &format!("{of}&name=a.yaml&text=x")).await, StatusCode::CONFLICT);
    let (id, at) = (VehicleId::new("a").unwrap(), 1_780_000_000_000);
    let said = Recording { incident: 7, pieces: Some(pieces.clone()), refused: None };
    let messages =
        vec![Message { epoch: Epoch { start: 1, nonce: 0 }, n: 30, at, content: Content::Recording(said) }];
    let batch = Ok(Batch { id: id.clone(), key: "UA".into(), sent: at, messages });
    let arrived = Arrived { stream: Stream::Log, id: id.clone(), batch, stored_ms: at, age: Span::ZERO };
    shared.fleet().take(arrived, shared.clock.now());
    shared.fleet().recording_is(&id, 7, &pieces, Step::Here(pieces.clone()));
    let shown = page(&form, &engineer).await;
    assert!(shown.contains("1 of 2 is not fetched.") && shown.contains("/vehicles/a#incident-8"), "{shown}");
    for (body, status) in [
        ("group=colour&of=a&name=a.yaml&text=x".to_owned(), StatusCode::UNPROCESSABLE_ENTITY),
        (of.to_owned(), StatusCode::UNPROCESSABLE_ENTITY),
        ("group=version&of=9&name=a.yaml&text=x".to_owned(), StatusCode::NOT_FOUND),
        (format!("{of}&name=a.yaml&text={}", "x".repeat(256 * 1024)), StatusCode::PAYLOAD_TOO_LARGE),
        (format!("{of}&name=a.yaml&text={}", "x".repeat(1024 * 1024)), StatusCode::PAYLOAD_TOO_LARGE),
    ] {
        assert_eq!(post(&engineer, &body).await, status, "{}", &body[..30]);
    }
    let body = format!("{of}&name=a.yaml&text=%3Cscript%3E");
    assert_eq!(post("", &body).await, StatusCode::UNAUTHORIZED);
    for role in [Role::ControlRoom, Role::Authority, Role::Engineer] {
        let (session, may) = (cookie(&router, role.as_str()).await, role == Role::Engineer);
        assert_eq!(page("/incidents", &session).await.contains("/incidents/what-if?group=cause"), may);
        let expected = if may { StatusCode::OK } else { StatusCode::FORBIDDEN };
        assert_eq!(ask(&router, Method::GET, &form, &session, "").await.status(), expected);
        assert_eq!(post(&session, &body).await, if may { StatusCode::ACCEPTED } else { expected });
    }
    // Its file is not there.
    let document = json(&router, "/api/v1/openapi.json", &engineer).await;
    for role in Role::OF_CONSOLE {
        let session = cookie(&router, role.as_str()).await;
        let told = loop {
            let told = json(&router, "/api/v1/what-ifs/1", &session).await;
            if told["progress"] == "done" {
                break told;
            }
            tokio::task::yield_now().await;
        };
        let row = &told["rows"][0];
        assert_eq!(
            (&row["vehicle"], &row["incident"], &row["result"]),
            (&"a".into(), &7.into(), &"unread".into())
        );
        assert_eq!(
            (&told["incidents"], &told["fetched"], &told["judged"]),
            (&2.into(), &1.into(), &1.into())
        );
        let schema = |path: &str| {
            let pointer = format!(
                "/paths/{}/get/responses/200/content/application~1json/schema",
                path.replace('/', "~1")
            );
            Strict::at(&document, &pointer)
        };
        assert_eq!(schema("/api/v1/what-ifs/{number}").fault(&told), None);
        let all = json(&router, "/api/v1/what-ifs", &session).await;
        assert_eq!(schema("/api/v1/what-ifs").fault(&all), None);
        let csv = page("/api/v1/what-ifs/1?format=csv", &session).await;
        assert!(csv.lines().nth(1).unwrap().starts_with("a,7,2026-05-28T20:26:40.000Z,unread,"), "{csv}");
        let shown = page("/what-ifs/1", &session).await;
        assert!(shown.contains("1 could not be judged") && !shown.contains("<script>"), "{shown}");
        assert_eq!(shown.contains("from=1"), role == Role::Engineer, "{shown}");
        let status = ask(&router, Method::POST, "/what-ifs/1/cancel", &session, "").await.status();
        let expected = if role == Role::Engineer { StatusCode::ACCEPTED } else { StatusCode::FORBIDDEN };
        assert_eq!(status, expected, "{role:?}");
    }
    for path in
        ["/what-ifs/2", "/what-ifs/x", "/what-ifs/2/state", "/api/v1/what-ifs/2", "/incidents/what-if?of=9"]
    {
        assert_eq!(
            ask(&router, Method::GET, path, &engineer, "").await.status(),
            StatusCode::NOT_FOUND,
            "{path}"
        );
    }
    let said = store.audit_entries(None, 100).await.unwrap();
    let count = |action: &str| {
        let all = said.iter().filter(|it| it.action == action);
        (all.clone().count(), all.filter(|it| it.was_refused()).count())
    };
    assert_eq!((count("what-if started"), count("what-if cancelled")), ((3, 2), (2, 2)));
}
