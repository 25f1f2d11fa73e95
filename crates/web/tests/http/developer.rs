//! The developer's pages: reasons of states, and reloading the configuration.

use axum::http::{Method, StatusCode};
use telltale_engine::model::countermeasure::{Request, Rule};
use telltale_engine::model::{GroupId, NodeId, Stage};
use telltale_engine::snapshot::Reason;
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_runtime::{ConfigurationText, Reread, Rereading};

use crate::fixture::{Fixture, as_program, form_request, request};

#[tokio::test]
async fn a_page_says_why_a_node_shows_what_it_shows() {
    let fixture = Fixture::new().await;
    let operator = fixture.cookie_of("operator").await;
    let developer = fixture.cookie_of("developer").await;
    fixture.status("lidar", 2, "<b>broken</b>").await;
    let masked = |reason: Option<&Reason>| matches!(reason, Some(Reason::Masked { .. }));
    fixture
        .until(|snapshot| snapshot.node("localization").is_some_and(|node| masked(snapshot.shown(node).1)))
        .await;
    let why = async |node: &str, cookie: &str| {
        fixture.get(&format!("/developer/why?node={node}"), Some(cookie)).await
    };

    let module = why("sensors/lidar", &developer).await.body;
    assert!(module.contains("It reports: Error") && module.contains("It shows: Error"), "{module}");
    assert!(!module.contains("<b>broken"), "{module}");
    let group = why("localization", &developer).await.body;
    assert!(group.contains("It is put aside because of") && group.contains("sensors/lidar"), "{group}");
    assert_eq!(why("nothing", &developer).await.status, StatusCode::NOT_FOUND);
    assert_eq!(why("sensors", &operator).await.status, StatusCode::FORBIDDEN);
}

#[tokio::test]
async fn what_is_never_shelved_is_not_offered_to_be() {
    let stop = Rule {
        request: Request::ManeuverStop,
        nodes: vec![NodeId::Group(GroupId(2))],
        state: State::Error,
        stages: vec![Stage::Active],
        confirmation: None,
    };
    let fixture = Fixture::changed(|parts| parts.driving.countermeasures.push(stop)).await;
    fixture.cookie_of("operator").await;
    let developer = fixture.cookie_of("developer").await;
    let authority = fixture.cookie_of("authority").await;
    let offer = r#"action="/developer/shelving""#;
    let rests = "A request to slow down or to stop rests on";
    for (node, why) in [
        ("planning/planner", None),
        ("localization/tf", Some(rests)),
        ("sensors/lidar", Some(rests)),
        ("telltale/storage", Some("is one of Telltale&#39;s own modules")),
    ] {
        let page = fixture.get(&format!("/developer/why?node={node}"), Some(&developer)).await.body;
        assert_eq!(page.contains(offer), why.is_none(), "{node}: {page}");
        assert!(why.is_none_or(|why| page.contains(why)), "{node}: {page}");
        // What the node does stands first.
        let place = |id: &str| page.find(&format!("id=\"{id}\""));
        assert!(why.is_none() || place("never-shelved") > place("around"), "{node}: {page}");
        let form = format!("module={node}&minutes=30");
        let answer = fixture.send(form_request("/developer/shelving", Some(&developer), &form)).await;
        // The vehicle is not known to stand, so the answer has another reason as well.
        assert!(answer.status == StatusCode::CONFLICT, "{node}: {}", answer.body);
        assert!(why.is_none_or(|why| answer.body.contains(why)), "{node}: {}", answer.body);
        let read_only = fixture.get(&format!("/developer/why?node={node}"), Some(&authority)).await.body;
        assert!(!read_only.contains(offer) && !read_only.contains("never shelved"), "{node}: {read_only}");
    }
}

#[tokio::test]
async fn a_page_is_answered_in_the_part_that_its_script_asks_for() {
    let fixture = Fixture::new().await;
    let developer = fixture.cookie_of("developer").await;
    let ask = async |part: &str, cookie: Option<&str>| {
        let mut request = request(Method::GET, "/developer/coverage", cookie);
        request.headers_mut().insert("telltale-part", part.parse().unwrap());
        fixture.send(request).await
    };
    for (part, begins) in [
        ("main", "<main "),
        ("content", "<div id=\"dev\""),
        ("", "<!doctype html>"),
        ("x", "<!doctype html>"),
    ] {
        let answer = ask(part, Some(&developer)).await;
        assert!(answer.status == StatusCode::OK && answer.body.trim().starts_with(begins), "{}", answer.body);
        assert_eq!(answer.header("cache-control"), Some("no-store"));
    }
    assert_eq!(ask("main", None).await.leads_to(), Some("/login"));
}

#[tokio::test]
async fn what_happened_is_on_the_timeline() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("operator").await;
    let developer = fixture.cookie_of("developer").await;
    fixture.status("lidar", 0, "fine").await;
    fixture.status("lidar", 2, "broken").await;
    fixture.until(|snapshot| !snapshot.roots.is_empty()).await;
    let timeline = async || {
        let path = "/developer/timeline?span=30&node=sensors&node=sensors%2Flidar";
        fixture.get(path, Some(&developer)).await.body
    };
    // Records are written in batches, after what happened is shown.
    let deadline = fixture.clock.now() + Span::from_secs(5);
    let mut page = timeline().await;
    while !page.contains("bar-error") || !page.contains("alarm raised") {
        assert!(fixture.clock.now() < deadline, "{page}");
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
        page = timeline().await;
    }
    assert_eq!(page.matches("class=\"lane\"").count(), 2);
    fixture.post("/logout", Some(&cookie), "").await;
    fixture.until(|snapshot| snapshot.operator.is_none()).await;
    assert!(!timeline().await.contains("bar-error"), "a locked vehicle has no past either");
}

#[tokio::test]
async fn an_address_that_asks_for_nonsense_is_answered_all_the_same() {
    let fixture = Fixture::new().await;
    fixture.cookie_of("operator").await;
    let developer = fixture.cookie_of("developer").await;
    for page in ["", "/graph", "/timeline", "/masking", "/coverage", "/topics"] {
        for query in [
            "page=0&sort=x&desc=9&level=none&group=nowhere&pin=%00&q=%ff",
            "span=0&until=-1&at=99999999999999999999",
            "span=99999999999999&until=9223372036854775807&at=1&node=%e2%80%ae",
            "cell=9%20sensors&cell=&open=none&open=%22%3E",
            "%%%&&=&=1&q",
        ] {
            let answer = fixture.get(&format!("/developer{page}?{query}"), Some(&developer)).await;
            assert_eq!(answer.status, StatusCode::OK, "{page}?{query}");
        }
    }
}

#[tokio::test]
async fn a_configuration_is_shown_as_a_difference_before_it_is_taken() {
    let mut fixture = Fixture::new().await;
    let developer = fixture.cookie_of("developer").await;
    let authority = fixture.cookie_of("authority").await;
    let router = fixture.router.clone();
    let mut rereads = std::mem::replace(&mut fixture.rereads, tokio::sync::mpsc::channel(1).1);
    let answering = tokio::spawn(async move {
        let mut asked = Vec::new();
        while let Some(reread) = rereads.recv().await {
            asked.push(reread.take);
            let differences = vec!["group <new> was added".to_owned()];
            let digest = "0123".to_owned();
            let text = "# a\ngroups: [] # <b>\u{202e}".to_owned();
            let read = Rereading {
                taken: reread.take && reread.shown.is_none_or(|shown| shown == digest),
                differences,
                problems: None,
                warnings: None,
                judged: false,
                running: [ConfigurationText { name: "v.yaml".to_owned(), text }].into(),
                digest,
            };
            reread.reply.send(read).unwrap();
            if asked.len() == 10 {
                break;
            }
        }
        asked
    });
    let shown = fixture.get("/developer/configuration", Some(&developer)).await;
    assert!(shown.body.contains("group &#60;new&#62; was added"), "{}", shown.body);
    assert!(shown.body.contains(r#"name="reload""#));
    assert!(shown.body.contains("groups: [] # &#60;b&#62;</code>"), "what runs: {}", shown.body);
    assert!(shown.body.contains("Every situation is being looked at"));
    let read_only = fixture.get("/developer/configuration", Some(&authority)).await;
    assert!(!read_only.body.contains(r#"name="reload""#), "{}", read_only.body);
    let reload = "/developer/configuration/reload";
    assert_eq!(fixture.post(reload, Some(&authority), "").await.status, StatusCode::FORBIDDEN);
    assert!(shown.body.contains(r#"name="shown" value="0123""#), "{}", shown.body);
    // What was shown is taken; a page that showed something else, or nothing, gets the difference.
    let form = |form: &str| as_program(form_request(reload, Some(&developer), form));
    let mut program = form("");
    program.headers_mut().remove("cookie");
    let token = developer.split_once('=').unwrap().1;
    program.headers_mut().insert("authorization", format!("Bearer {token}").parse().unwrap());
    for (request, status) in [
        (form("shown=4567"), StatusCode::CONFLICT),
        (form(""), StatusCode::CONFLICT),
        (form("shown=0123"), StatusCode::OK),
        (program, StatusCode::OK),
    ] {
        let answer = fixture.send(request).await;
        let body: serde_json::Value = serde_json::from_str(&answer.body).unwrap();
        assert_eq!((answer.status, &body["taken"]), (status, &(status == StatusCode::OK).into()), "{body}");
        assert_eq!((&body["shown"], &body["problems"]), (&"0123".into(), &serde_json::Value::Null));
    }
    let asked = answering.await.unwrap();
    // Each is looked at, recorded and then taken, if it is what was shown.
    assert_eq!(asked, [false, false, false, true, false, true, false, true, false, true]);
    let refused = fixture.store.audit_entries(None, 4).await.unwrap();
    let refused = refused.iter().filter(|it| it.outcome.contains("the file is not what was shown"));
    assert_eq!(refused.count(), 2);
    drop(router);
}

fn reread(digest: &str, taken: bool) -> Rereading {
    Rereading {
        taken,
        differences: vec!["group `new` is new".to_owned()],
        problems: None,
        warnings: None,
        judged: true,
        running: [].into(),
        digest: digest.to_owned(),
    }
}

#[tokio::test]
async fn who_had_a_configuration_taken_is_on_the_record_whatever_becomes_of_the_connection() {
    let mut fixture = Fixture::new().await;
    let developer = fixture.cookie_of("developer").await;
    let mut rereads = std::mem::replace(&mut fixture.rereads, tokio::sync::mpsc::channel(1).1);
    let reload =
        || as_program(form_request("/developer/configuration/reload", Some(&developer), "shown=0123"));
    // Whether the file is what it was when it is taken.
    for is_same in [true, false] {
        let asking = fixture.start(reload());
        let Reread { take, reply, .. } = rereads.recv().await.unwrap();
        assert!(!take, "it is looked at before");
        let second = fixture.send(reload()).await;
        assert_eq!(second.status, StatusCode::SERVICE_UNAVAILABLE, "one after the other: {}", second.body);
        asking.abort();
        assert!(asking.await.is_err(), "the browser has gone");
        reply.send(reread("0123", false)).unwrap();
        let Reread { take, shown, reply } = rereads.recv().await.unwrap();
        assert_eq!((take, shown.as_deref()), (true, Some("0123")));
        let log = fixture.store.audit_entries(None, 1).await.unwrap();
        assert_eq!((&*log[0].who, &*log[0].action, &*log[0].outcome), ("developer", "configuration", "done"));
        assert_eq!(log[0].target, "1 difference: group `new` is new");
        let is_first = log[0].number;
        reply.send(if is_same { reread("0123", true) } else { reread("4567", false) }).unwrap();
        // The next request finds it ended.
        let deadline = fixture.clock.now() + Span::from_secs(5);
        let again = loop {
            assert!(fixture.clock.now() < deadline);
            let mut again = fixture.start(reload());
            tokio::select! {
                asked = rereads.recv() => break (asked.unwrap(), again),
                refused = &mut again => assert_eq!(refused.unwrap().status, StatusCode::SERVICE_UNAVAILABLE),
            }
        };
        drop(again.0.reply);
        assert_eq!(again.1.await.unwrap().status, StatusCode::SERVICE_UNAVAILABLE);
        let log = fixture.store.audit_entries(None, 10).await.unwrap();
        let after: Vec<_> = log.iter().filter(|it| it.number > is_first).map(|it| &*it.outcome).collect();
        let expected: &[&str] = if is_same { &[] } else { &["refused: the file is not what was shown"] };
        assert_eq!(after, expected);
    }
}
