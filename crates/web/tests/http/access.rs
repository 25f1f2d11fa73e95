//! Access to every route: without a session, by role, from foreign pages and under foreign host names.

use axum::body::Body;
use axum::http::header::{AUTHORIZATION, HOST, ORIGIN};
use axum::http::{Method, Request, StatusCode};
use telltale_store::{DemoSecrets, Role};
use telltale_web::{Access, BODY_BYTES_MAX, Route, assets, routes};

use crate::fixture::{ADDRESS, Answer, COMPONENTS, Fixture, OWN_ORIGIN, as_program, form_request, request};

fn concrete(route: &Route) -> String {
    let path = route.path.replace("{*path}", "vendor/htmx.min.js");
    path.replace("{file}", "1.mcap").replace("{id}", "1")
}

fn by_route(route: &Route, cookie: Option<&str>) -> Request<Body> {
    let mut request = request(route.method.clone(), &concrete(route), cookie);
    if route.method != Method::GET {
        request.headers_mut().insert(ORIGIN, OWN_ORIGIN.parse().unwrap());
    }
    request
}

/// The access to each route: operator, developer, authority, and a stranger without a session. A new route
/// needs a decision, and a line here.
const MATRIX: &[(&str, &str, [bool; 4])] = &[
    ("GET", "/", [true, true, true, false]),
    ("GET", "/login", [true, true, true, true]),
    ("POST", "/login", [true, true, true, true]),
    ("POST", "/logout", [true, true, true, false]),
    ("GET", "/ws", [true, true, true, false]),
    ("POST", "/vehicle/localize", [true, false, false, false]),
    ("POST", "/vehicle/clearance", [true, false, false, false]),
    ("POST", "/vehicle/clearance/confirm", [true, false, false, false]),
    ("POST", "/vehicle/clearance/withdraw", [true, false, false, false]),
    ("POST", "/vehicle/release", [true, false, false, false]),
    ("POST", "/vehicle/release/confirm", [true, false, false, false]),
    ("POST", "/vehicle/stop", [true, false, false, false]),
    ("POST", "/vehicle/shutdown", [true, false, false, false]),
    ("GET", "/alarms/last", [true, true, true, false]),
    ("POST", "/alarms/acknowledge-over", [true, false, false, false]),
    ("POST", "/alarms/{*path}", [true, false, false, false]),
    ("POST", "/modules/{*path}", [true, false, false, false]),
    ("GET", "/developer", [false, true, true, false]),
    ("GET", "/developer/why", [false, true, true, false]),
    ("GET", "/developer/search", [false, true, true, false]),
    ("GET", "/developer/graph", [false, true, true, false]),
    ("GET", "/developer/learn", [false, true, true, false]),
    ("GET", "/developer/timeline", [false, true, true, false]),
    ("GET", "/developer/masking", [false, true, true, false]),
    ("GET", "/developer/coverage", [false, true, true, false]),
    ("GET", "/developer/statistics", [false, true, true, false]),
    ("GET", "/developer/topics", [false, true, true, false]),
    ("GET", "/developer/live", [false, true, true, false]),
    ("GET", "/developer/audit", [false, true, true, false]),
    ("GET", "/developer/configuration", [false, true, true, false]),
    ("POST", "/developer/configuration/reload", [false, true, false, false]),
    ("GET", "/incidents", [false, true, true, false]),
    ("GET", "/incidents/{id}", [false, true, true, false]),
    ("POST", "/incidents/{id}/note", [false, true, false, false]),
    ("POST", "/incidents/{id}/keep", [false, true, false, false]),
    ("GET", "/incidents/{id}/what-if", [false, true, false, false]),
    ("POST", "/incidents/{id}/what-if", [false, true, false, false]),
    ("GET", "/developer/moment", [false, true, true, false]),
    ("GET", "/replay/{id}", [false, true, true, false]),
    ("GET", "/replay/{id}/state", [false, true, true, false]),
    ("POST", "/replay/{id}/state", [false, true, true, false]),
    ("GET", "/replay/{id}/differences", [false, true, true, false]),
    ("GET", "/replay/{id}/screen/", [false, true, true, false]),
    ("GET", "/replay/{id}/screen/{*path}", [false, true, true, false]),
    ("GET", "/api/v1/incidents", [false, true, true, false]),
    ("GET", "/api/v1/incidents/{id}", [false, true, true, false]),
    ("POST", "/api/v1/incidents/{id}/note", [false, true, false, false]),
    ("POST", "/api/v1/incidents/{id}/keep", [false, true, false, false]),
    ("POST", "/api/v1/mark", [true, true, false, false]),
    ("POST", "/developer/shelving", [false, true, false, false]),
    ("POST", "/developer/shelving/end", [false, true, false, false]),
    ("POST", "/incidents/mark", [false, true, false, false]),
    ("GET", "/api/v1/statuses", [false, true, true, false]),
    ("GET", "/api/v1/history", [false, true, true, false]),
    ("GET", "/api/v1/statistics", [false, true, true, false]),
    ("GET", "/api/v1/values", [false, true, true, false]),
    ("GET", "/api/v1/topics", [false, true, true, false]),
    ("GET", "/api/v1/audit", [false, true, true, false]),
    ("GET", "/api/v1/openapi.json", [true, true, true, false]),
    ("GET", "/api/v1/schema/snapshot.json", [true, true, true, false]),
    ("GET", "/api/v1/schema/stream.json", [true, true, true, false]),
    ("GET", "/developer/api", [false, true, true, false]),
    ("GET", "/api/v1/snapshot", [true, true, true, false]),
    ("GET", "/api/v1/stream", [true, true, true, false]),
    ("GET", "/healthz", [true, true, true, true]),
    ("GET", "/readyz", [true, true, true, true]),
    ("GET", "/static/{*path}", [true, true, true, false]),
    ("GET", "/demo", [true, true, true, false]),
    ("POST", "/demo/fault", [true, true, false, false]),
];

#[tokio::test]
async fn who_may_use_what_is_as_decided() {
    let fixture = Fixture::new().await;
    let routes = routes(true);
    assert_eq!(routes.len(), MATRIX.len(), "a line of the matrix for each route, and none without one");
    for route in &routes {
        let row =
            MATRIX.iter().find(|(method, path, _)| *method == route.method.as_str() && *path == route.path);
        let (_, _, may) = row.unwrap_or_else(|| panic!("nobody decided who may use {route:?}"));
        for (column, role) in Role::OF_VEHICLE.map(Some).into_iter().chain([None]).enumerate() {
            // Some routes end the session.
            let cookie = match role {
                Some(role) => Some(fixture.cookie_of(role.as_str()).await),
                None => None,
            };
            let status = fixture.send(as_program(by_route(route, cookie.as_deref()))).await.status;
            let refused = if role.is_some() { StatusCode::FORBIDDEN } else { StatusCode::UNAUTHORIZED };
            assert_eq!(status != refused, may[column], "{role:?} {route:?}: {status}");
        }
    }
}

#[tokio::test]
async fn without_a_session_every_route_is_closed_but_the_open_ones_and_those_tell_nothing() {
    let fixture = Fixture::new().await;
    fixture.cookie_of("operator").await;
    fixture.status("lidar", 2, "broken").await;
    fixture.until(|snapshot| !snapshot.roots.is_empty()).await;
    for route in routes(true) {
        for is_program in [false, true] {
            let request = by_route(&route, None);
            let answer = fixture.send(if is_program { as_program(request) } else { request }).await;
            let is_closed = match (is_program, answer.status) {
                (true, status) => status == StatusCode::UNAUTHORIZED,
                (false, StatusCode::SEE_OTHER) => answer.leads_to() == Some("/login") && route.path != "/ws",
                (false, status) => status == StatusCode::UNAUTHORIZED,
            };
            assert_eq!(is_closed, route.access != Access::Open, "{route:?}: {}", answer.status);
            for name in COMPONENTS {
                assert!(!answer.body.to_lowercase().contains(name), "{route:?} tells of {name}");
            }
        }
    }
}

#[tokio::test]
async fn without_a_session_what_is_no_route_looks_like_one() {
    let fixture = Fixture::new().await;
    let methods = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "PROPFIND"];
    for path in ["/nothing", "/ws/", "/api/v1/nothing", "/..%2fetc", "/developer/x", "//", "/login/x", "/"] {
        for method in methods {
            let method = Method::from_bytes(method.as_bytes()).unwrap();
            let answer = fixture.send(request(method.clone(), path, None)).await;
            let is_closed = matches!(answer.status, StatusCode::SEE_OTHER | StatusCode::UNAUTHORIZED);
            assert!(is_closed, "{method} {path}: {}", answer.status);
        }
    }
}

#[tokio::test]
async fn with_a_session_what_is_no_route_is_not_found() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("developer").await;
    assert_eq!(fixture.get("/nothing", Some(&cookie)).await.status, StatusCode::NOT_FOUND);
    assert_eq!(fixture.get("/static/../Cargo.toml", Some(&cookie)).await.status, StatusCode::NOT_FOUND);
    let answer = fixture.get("/api/v1/nothing", Some(&cookie)).await;
    assert_eq!(answer.status, StatusCode::NOT_FOUND);
    assert!(serde_json::from_str::<serde_json::Value>(&answer.body).is_ok_and(|it| it["error"].is_string()));
    let answer = fixture.send(request(Method::HEAD, "/api/v1/snapshot", Some(&cookie))).await;
    assert_eq!((answer.status, answer.body.len()), (StatusCode::OK, 0));
    assert_eq!(fixture.post("/developer", Some(&cookie), "").await.status, StatusCode::METHOD_NOT_ALLOWED);
}

#[tokio::test]
async fn a_request_that_acts_needs_the_origin_of_a_page_of_ours() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("developer").await;
    let two = format!("{OWN_ORIGIN} http://evil.example");
    let cases = [
        (Some(OWN_ORIGIN), None, true),
        (Some("http://localhost:8080"), None, true),
        (None, None, false),
        (Some("null"), None, false),
        (Some("null"), Some("cross-site"), false),
        (Some("null"), Some("same-site"), false),
        (Some("null"), Some("same-origin"), false),
        // Two headers.
        (Some(&two), Some("same-origin"), false),
        (Some("http://evil.example"), Some("same-origin"), false),
        (Some("http://127.0.0.1"), None, false),
        (Some("http://127.0.0.1:8081"), None, false),
        (Some("http://127.0.0.1:80800"), None, false),
        (Some("https://127.0.0.1:8080"), None, false),
        (Some("http://127.0.0.1:8080.evil.example"), None, false),
        (Some("http://evil.example/http://127.0.0.1:8080"), None, false),
        (Some(""), None, false),
    ];
    for (path, cookie) in [("/demo/fault", Some(cookie.as_str())), ("/login", None)] {
        for (origin, site, permitted) in cases {
            let mut request = form_request(path, cookie, "");
            request.headers_mut().remove(ORIGIN);
            for origin in origin.into_iter().flat_map(|it| it.split(' ')) {
                request.headers_mut().append(ORIGIN, origin.parse().unwrap());
            }
            if let Some(site) = site {
                request.headers_mut().insert("sec-fetch-site", site.parse().unwrap());
            }
            let answer = fixture.send(request).await;
            assert_eq!(answer.status != StatusCode::FORBIDDEN, permitted, "{path} {origin:?} {site:?}");
        }
    }
}

#[tokio::test]
async fn pages_make_browsers_send_the_origin_of_their_forms() {
    let fixture = Fixture::new().await;
    let operator = fixture.cookie_of("operator").await;
    let developer = fixture.cookie_of("developer").await;
    let meta = r#"<meta name="referrer" content="same-origin">"#;
    for (path, cookie) in [
        ("/login", None),
        ("/", Some(&operator)),
        ("/demo", Some(&operator)),
        ("/developer", Some(&developer)),
    ] {
        let answer = fixture.get(path, cookie.map(String::as_str)).await;
        assert!(answer.status == StatusCode::OK && answer.body.contains(meta), "{path}");
    }
}

#[tokio::test]
async fn a_bearer_is_no_page_and_needs_no_origin() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("developer").await;
    let (_, token) = cookie.split_once('=').unwrap();
    let with = |token: &str| {
        let mut request = form_request("/demo/fault", None, "name=can_loss&active=true");
        request.headers_mut().remove(ORIGIN);
        request.headers_mut().insert(AUTHORIZATION, format!("Bearer {token}").parse().unwrap());
        as_program(request)
    };
    assert_eq!(fixture.send(with(token)).await.status, StatusCode::OK);
    for scheme in ["bearer", "BEARER"] {
        let mut request = with(token);
        let value = format!("{scheme} {token}").parse().unwrap();
        request.headers_mut().insert(AUTHORIZATION, value);
        assert_eq!(fixture.send(request).await.status, StatusCode::OK, "{scheme}");
    }
    for wrong in [&token[1..], &"0".repeat(64), "", "é"] {
        let mut request = with("0");
        if let Ok(value) = axum::http::HeaderValue::from_bytes(format!("Bearer {wrong}").as_bytes()) {
            request.headers_mut().insert(AUTHORIZATION, value);
        }
        assert_eq!(fixture.send(request).await.status, StatusCode::UNAUTHORIZED, "{wrong:?}");
    }
    let mut request = with("0");
    request.headers_mut().insert("cookie", cookie.parse().unwrap());
    let answer = fixture.send(request).await;
    assert_eq!(answer.status, StatusCode::UNAUTHORIZED, "a wrong bearer does not fall back to the cookie");
}

#[tokio::test]
async fn a_foreign_name_for_this_machine_is_not_served() {
    let fixture = Fixture::new().await;
    for (host, served) in [
        (Some(ADDRESS), true),
        (Some("LOCALHOST:8080"), true),
        (Some("[::1]:8080"), true),
        (Some("evil.example:8080"), false),
        (Some("127.0.0.1"), false),
        (Some("127.0.0.1:8081"), false),
        (Some("127.0.0.1:8080.evil.example"), false),
        (None, false),
    ] {
        let mut request = request(Method::GET, "/login", None);
        request.headers_mut().remove(HOST);
        if let Some(host) = host {
            request.headers_mut().insert(HOST, host.parse().unwrap());
        }
        let status = fixture.send(request).await.status;
        assert_eq!(status, if served { StatusCode::OK } else { StatusCode::MISDIRECTED_REQUEST }, "{host:?}");
    }
}

pub const HEADERS: [(&str, &str); 7] = [
    (
        "content-security-policy",
        "default-src 'self'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; \
         object-src 'none'; base-uri 'none'; frame-ancestors 'none'; form-action 'self'",
    ),
    ("x-content-type-options", "nosniff"),
    ("referrer-policy", "no-referrer"),
    ("cross-origin-opener-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
    (
        "permissions-policy",
        "accelerometer=(), camera=(), display-capture=(), geolocation=(), gyroscope=(), hid=(), \
         magnetometer=(), microphone=(), midi=(), payment=(), serial=(), usb=()",
    ),
    ("cache-control", "no-store"),
];

#[tokio::test]
async fn every_answer_has_the_headers() {
    let fixture = Fixture::new().await;
    let mut requests = vec![
        request(Method::GET, "/nothing", None),
        form_request("/login", None, &"x".repeat(BODY_BYTES_MAX + 1)),
    ];
    for route in routes(true) {
        requests.push(by_route(&route, None));
        let cookie = fixture.cookie_of("developer").await;
        requests.push(by_route(&route, Some(&cookie)));
    }
    for request in requests {
        let what = format!("{} {}", request.method(), request.uri());
        let answer = fixture.send(request).await;
        for (name, value) in HEADERS {
            assert_eq!(answer.header(name), Some(value), "{what}: {name}");
        }
    }
}

#[tokio::test]
async fn files_are_found_with_and_without_their_version_and_kept_with_it_alone() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("developer").await;
    let name = "vendor/htmx.min.js";
    let versioned = fixture.get(&assets::url(name), Some(&cookie)).await;
    let plain = fixture.get(&format!("/static/{name}"), Some(&cookie)).await;
    let open = fixture.get(&assets::url("telltale.css"), None).await;
    let year = "max-age=31536000, immutable";
    for (answer, kept, kind) in [
        (&versioned, format!("private, {year}"), "text/javascript"),
        (&plain, "no-store".to_owned(), "text/javascript"),
        (&open, format!("public, {year}"), "text/css"),
    ] {
        assert_eq!(answer.status, StatusCode::OK);
        assert_eq!(answer.header("cache-control"), Some(&*kept));
        assert_eq!(answer.header("content-type"), Some(&*format!("{kind}; charset=utf-8")));
    }
    assert_eq!(versioned.header("etag"), plain.header("etag"));
    assert_ne!(versioned.header("etag"), open.header("etag"));
    let old = format!("/static/0123456789abcdef/{name}");
    for (address, cookie, status) in [
        (&*old, Some(&*cookie), StatusCode::NOT_FOUND),
        (&*assets::url("nothing.js"), Some(&*cookie), StatusCode::NOT_FOUND),
        (&*assets::url(name), None, StatusCode::UNAUTHORIZED),
    ] {
        let answer = fixture.get(address, cookie).await;
        assert_eq!((answer.status, answer.header("cache-control")), (status, Some("no-store")), "{address}");
    }
}

#[tokio::test]
async fn what_an_account_does_that_is_recorded_has_a_bound_and_a_stop_has_none() {
    let fixture = Fixture::new().await;
    let (developer, operator) = (fixture.cookie_of("developer").await, fixture.cookie_of("operator").await);
    let note = async || fixture.post("/api/v1/incidents/9/note", Some(&developer), "note=x").await;
    for number in 0..60 {
        assert_eq!(note().await.status, StatusCode::NOT_FOUND, "{number}");
    }
    let refused = note().await;
    assert_eq!((refused.status, refused.header("retry-after")), (StatusCode::TOO_MANY_REQUESTS, Some("10")));
    for _ in 0..70 {
        let stop = fixture.post("/vehicle/stop", Some(&operator), "version=0").await;
        assert_ne!(stop.status, StatusCode::TOO_MANY_REQUESTS, "{}", stop.body);
    }
    assert_eq!(fixture.post("/logout", Some(&developer), "").await.status, StatusCode::SEE_OTHER);
}

#[tokio::test]
async fn descriptions_are_compressed_once_and_not_for_each_request() {
    let fixture = Fixture::new().await;
    for role in ["operator", "authority"] {
        let cookie = fixture.cookie_of(role).await;
        for path in ["/api/v1/openapi.json", "/api/v1/schema/snapshot.json", "/api/v1/schema/stream.json"] {
            let ask = async |accepts: &str, has: &str| {
                let mut asked = request(Method::GET, path, Some(&cookie));
                asked.headers_mut().insert("accept-encoding", accepts.parse().unwrap());
                asked.headers_mut().insert("if-none-match", has.parse().unwrap());
                fixture.send(asked).await
            };
            let (plain, small) = (ask("br", "").await, ask("br, gzip", "").await);
            assert_eq!(
                (plain.header("content-encoding"), small.header("content-encoding")),
                (None, Some("gzip"))
            );
            serde_json::from_str::<serde_json::Value>(&plain.body).unwrap();
            let known = ask("gzip", small.header("etag").unwrap()).await;
            assert_eq!(known.status, StatusCode::NOT_MODIFIED, "{path} {role}");
        }
    }
}

#[tokio::test]
async fn a_file_is_sent_compressed_and_only_to_who_does_not_have_it() {
    let fixture = Fixture::new().await;
    let ask = async |name: &str, accepts: &str, has: &str| {
        let mut asked = request(Method::GET, &assets::url(name), None);
        asked.headers_mut().insert("accept-encoding", accepts.parse().unwrap());
        asked.headers_mut().insert("if-none-match", has.parse().unwrap());
        fixture.send(asked).await
    };
    let css = "telltale.css";
    let plain = ask(css, "identity", "").await;
    let small = ask(css, "br, GZIP;q=0.8", "").await;
    assert_eq!((plain.header("content-encoding"), small.header("content-encoding")), (None, Some("gzip")));
    assert_eq!(small.header("vary"), Some("accept-encoding"));
    let size = |answer: &Answer| answer.header("content-length").unwrap().parse::<usize>().unwrap();
    assert!(size(&small) * 3 < size(&plain), "{} of {}", size(&small), size(&plain));
    for accepts in ["br", "gzip;q=0", "deflate, gzip; q=0.0"] {
        let answer = ask(css, accepts, "").await;
        assert_eq!((answer.header("content-encoding"), &answer.body), (None, &plain.body), "{accepts}");
    }
    let font = ask("vendor/inter-latin-wght-normal.woff2", "gzip, br", "").await;
    assert_eq!(font.header("content-encoding"), None, "it is compressed already");
    // Each form has a tag of its own: the other one is not what the browser has.
    let (of_plain, of_small) = (plain.header("etag").unwrap(), small.header("etag").unwrap());
    for (accepts, has, status) in [
        ("gzip", of_small, StatusCode::NOT_MODIFIED),
        ("gzip", &*format!("\"0\", W/{of_small}"), StatusCode::NOT_MODIFIED),
        ("gzip", "*", StatusCode::NOT_MODIFIED),
        ("gzip", of_plain, StatusCode::OK),
        ("identity", of_plain, StatusCode::NOT_MODIFIED),
        ("identity", of_small, StatusCode::OK),
    ] {
        let answer = ask(css, accepts, has).await;
        let expected = if accepts == "gzip" { &small } else { &plain };
        assert_eq!(answer.status, status, "{accepts} {has}");
        assert_eq!(answer.body.is_empty(), status == StatusCode::NOT_MODIFIED);
        for name in ["etag", "vary", "cache-control"] {
            assert_eq!(answer.header(name), expected.header(name), "{accepts} {has}");
        }
    }
}

#[tokio::test]
async fn a_body_that_is_too_large_is_refused() {
    let fixture = Fixture::new().await;
    let name = "x".repeat(BODY_BYTES_MAX - "name=&secret=y".len());
    let fits = fixture.log_in(&name, "y").await;
    assert_eq!(fits.status, StatusCode::UNAUTHORIZED);
    assert_eq!(fixture.log_in(&format!("{name}x"), "y").await.status, StatusCode::PAYLOAD_TOO_LARGE);
    let chunked = Body::from_stream(futures_util::stream::iter(std::iter::repeat_n(
        Ok::<_, std::convert::Infallible>(axum::body::Bytes::from_static(&[b'x'; 1024])),
        BODY_BYTES_MAX / 1024 + 1,
    )));
    let mut request = form_request("/login", None, "");
    *request.body_mut() = chunked;
    assert_eq!(fixture.send(request).await.status, StatusCode::PAYLOAD_TOO_LARGE);
}

#[tokio::test]
async fn faults_are_switched_by_name_and_not_on_a_vehicle() {
    let mut fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("operator").await;
    let post = |form: &'static str| form_request("/demo/fault", Some(&cookie), form);
    let answer = fixture.send(post("name=can_loss&active=true")).await;
    assert_eq!((answer.status, answer.leads_to()), (StatusCode::SEE_OTHER, Some("/demo")));
    let switch = fixture.faults.try_recv().unwrap();
    assert_eq!((switch.name, switch.active), ("can_loss", true));
    let answer = fixture.send(as_program(post("name=can_loss&active=false"))).await;
    assert_eq!(
        (answer.status, answer.body.as_str()),
        (StatusCode::OK, r#"{"active":false,"name":"can_loss"}"#)
    );
    for wrong in ["name=flat_tyre&active=true", "name=can_loss&active=maybe", "name=can_loss", ""] {
        let answer = fixture.send(as_program(post(wrong))).await;
        assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY, "{wrong}");
        assert!(answer.body.contains(r#""names":["sensor_outage","can_loss"]"#), "{}", answer.body);
    }
    let vehicle = Fixture::with(ADDRESS, false, DemoSecrets::Refused).await;
    vehicle.store.add_user("dora", Role::Developer, "a long password").await.unwrap();
    let cookie = vehicle.log_in("dora", "a+long+password").await.cookie().unwrap();
    for path in ["/demo", "/demo/fault"] {
        assert_eq!(vehicle.get(path, Some(&cookie)).await.status, StatusCode::NOT_FOUND);
    }
}
