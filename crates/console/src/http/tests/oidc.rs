//! The login at an issuer: the roles it grants, and the tokens that are refused.

use super::*;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use axum::extract::State as Of;
use axum::response::{IntoResponse, Redirect};
use axum::routing::{get, post};
use axum::{Form, Json};
use base64::Engine as _;
use base64::prelude::BASE64_URL_SAFE_NO_PAD as BASE64;
use openidconnect::url::Url;
use ring::digest::{SHA256, digest};
use ring::hmac;
use ring::rand::SystemRandom;
use ring::signature::{ECDSA_P256_SHA256_FIXED_SIGNING, EcdsaKeyPair, KeyPair as _};
use serde_json::json as value;
use telltale_clock::{ClockHand, unix_ms};
use telltale_store::{Grant, Pattern};

use crate::oidc::{Settings, issuer};

const CLIENT_SECRET: &str = "between the two of us";

/// How the issuer answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum How {
    Well,
    /// Its description of itself has no end.
    Huge,
    /// It takes requests, and says nothing.
    Slow,
    Elsewhere,
    Broken,
    /// It says that it is another one.
    OtherName,
    /// It sends browsers or codes away from this machine without TLS.
    Plain,
    HugeToken,
    SlowToken,
    NoToken,
    AlgNone,
    /// Signed by what the console knows too.
    SharedSecret,
    OtherKey,
}

struct Fake {
    address: String,
    key: EcdsaKeyPair,
    other: EcdsaKeyPair,
    how: Mutex<How>,
    /// What the next token says, beside what each says.
    claims: Mutex<Value>,
    /// The nonce and the challenge of each code that was not used.
    codes: Mutex<BTreeMap<String, (String, String)>>,
    clock: Clock,
    /// How often its description of itself was asked for.
    asked: AtomicUsize,
}

fn key() -> EcdsaKeyPair {
    let random = SystemRandom::new();
    let made = EcdsaKeyPair::generate_pkcs8(&ECDSA_P256_SHA256_FIXED_SIGNING, &random).unwrap();
    EcdsaKeyPair::from_pkcs8(&ECDSA_P256_SHA256_FIXED_SIGNING, made.as_ref(), &random).unwrap()
}

async fn never() -> Response {
    std::future::pending().await
}

fn huge() -> Response {
    format!("{{\"a\":\"{}\"}}", "a".repeat(1 << 20)).into_response()
}

async fn about(Of(fake): Of<Arc<Fake>>) -> Response {
    fake.asked.fetch_add(1, Ordering::Relaxed);
    let how = *fake.how.lock().unwrap();
    let here = |path: &str| format!("{}{path}", fake.address);
    let token = if how == How::Plain { "http://id.example/token".to_owned() } else { here("/token") };
    let name = if how == How::OtherName { "https://id.example".to_owned() } else { fake.address.clone() };
    match how {
        How::Huge => huge(),
        How::Slow => never().await,
        How::Elsewhere => Redirect::to("/elsewhere").into_response(),
        How::Broken => "<html>".into_response(),
        _ => Json(value!({
            "issuer": name, "authorization_endpoint": here("/authorize"), "token_endpoint": token,
            "jwks_uri": here("/keys"), "response_types_supported": ["code"], "subject_types_supported": ["public"],
            "id_token_signing_alg_values_supported": ["ES256"], "scopes_supported": ["openid", "profile", "groups"],
        }))
        .into_response(),
    }
}

async fn keys(Of(fake): Of<Arc<Fake>>) -> Response {
    let point = &fake.key.public_key().as_ref()[1..];
    let [x, y] = [&point[..32], &point[32..]].map(|it| BASE64.encode(it));
    Json(value!({ "keys": [{ "kty": "EC", "crv": "P-256", "use": "sig", "kid": "1", "x": x, "y": y }] }))
        .into_response()
}

async fn token(
    Of(fake): Of<Arc<Fake>>,
    headers: axum::http::HeaderMap,
    Form(form): Form<BTreeMap<String, String>>,
) -> Response {
    let how = *fake.how.lock().unwrap();
    let known = fake.codes.lock().unwrap().remove(&form["code"]);
    let Some((nonce, challenge)) = known else {
        return (StatusCode::BAD_REQUEST, Json(value!({ "error": "invalid_grant" }))).into_response();
    };
    assert!(headers[header::AUTHORIZATION].to_str().unwrap().starts_with("Basic "));
    assert_eq!(BASE64.encode(digest(&SHA256, form["code_verifier"].as_bytes())), challenge);
    assert_eq!(form["redirect_uri"], "http://127.0.0.1:8080/login/oidc/back");
    let now_s = unix_ms(fake.clock.wall()) / 1000;
    let mut claims = value!({
        "iss": fake.address, "aud": "fleet", "sub": "0815", "nonce": nonce, "iat": now_s, "exp": now_s + 60,
        "preferred_username": "anna", "groups": ["north"],
    });
    for (key, value) in fake.claims.lock().unwrap().as_object().unwrap() {
        claims[key] = value.clone();
    }
    let alg = match how {
        How::AlgNone => "none",
        How::SharedSecret => "HS256",
        _ => "ES256",
    };
    let parts =
        [value!({ "alg": alg, "kid": "1", "typ": "JWT" }), claims].map(|it| BASE64.encode(it.to_string()));
    let signed = parts.join(".");
    let sign =
        |key: &EcdsaKeyPair| key.sign(&SystemRandom::new(), signed.as_bytes()).unwrap().as_ref().to_vec();
    let signature = match how {
        How::AlgNone => Vec::new(),
        How::SharedSecret => {
            let key = hmac::Key::new(hmac::HMAC_SHA256, CLIENT_SECRET.as_bytes());
            hmac::sign(&key, signed.as_bytes()).as_ref().to_vec()
        }
        How::OtherKey => sign(&fake.other),
        _ => sign(&fake.key),
    };
    let token = format!("{signed}.{}", BASE64.encode(signature));
    match how {
        How::SlowToken => never().await,
        How::HugeToken => huge(),
        How::NoToken => Json(value!({ "access_token": "a", "token_type": "Bearer" })).into_response(),
        _ => Json(value!({ "access_token": "a", "token_type": "Bearer", "id_token": token })).into_response(),
    }
}

/// A console with an issuer.
struct World {
    router: Router,
    store: Store,
    fake: Arc<Fake>,
    hand: ClockHand,
}

impl World {
    async fn new() -> World {
        let (clock, hand) = Clock::standing();
        hand.advance(Span::from_secs(1000));
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let fake = Arc::new(Fake {
            address: address.clone(),
            key: key(),
            other: key(),
            how: Mutex::new(How::Well),
            claims: Mutex::new(value!({})),
            codes: Mutex::default(),
            clock,
            asked: AtomicUsize::new(0),
        });
        let routes = Router::new()
            .route("/.well-known/openid-configuration", get(about))
            .route("/keys", get(keys))
            .route("/token", post(token))
            .with_state(fake.clone());
        tokio::spawn(async move { axum::serve(listener, routes).await });
        let grant = |value: &str, role, name: &str| {
            (value.to_owned(), Grant { role, vehicles: vec![Pattern::new(name).unwrap()] })
        };
        let settings = Settings {
            issuer: issuer(&address).unwrap(),
            client: "fleet".into(),
            secret: Some(CLIENT_SECRET.into()),
            claim: "groups".into(),
            grants: vec![grant("north", Role::Engineer, "a"), grant("south", Role::Authority, "b*")],
            tls: None,
        };
        let oidc = Some(Arc::new(Oidc::new(settings, clock)));
        let (router, _, store) = console_with(Path::new("/nowhere"), clock, oidc).await;
        World { router, store, fake, hand }
    }

    fn is(&self, how: How) {
        *self.fake.how.lock().unwrap() = how;
        // Its description of itself is asked for again.
        self.hand.advance(Span::from_secs(61));
    }

    async fn get(&self, path: &str, cookie: &str) -> Response {
        let request = Request::get(path)
            .header(header::HOST, "127.0.0.1:8080")
            .header(header::ACCEPT, "text/html")
            .header(header::COOKIE, cookie);
        self.router.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap()
    }

    /// Begins a login: the address at the issuer, and the cookie.
    async fn begin(&self) -> (Url, String) {
        let answer = self.get("/login/oidc", "").await;
        assert_eq!(answer.status(), StatusCode::SEE_OTHER);
        let cookie = answer.headers()[header::SET_COOKIE].to_str().unwrap().to_owned();
        assert!(cookie.ends_with("Path=/; Max-Age=600; HttpOnly; SameSite=Lax"), "{cookie}");
        let address = Url::parse(answer.headers()[header::LOCATION].to_str().unwrap()).unwrap();
        (address, cookie.split(';').next().unwrap().to_owned())
    }

    /// The person logs in at the issuer. Returns the address where the browser comes back.
    fn approved(&self, address: &Url) -> String {
        let of = |key: &str| address.query_pairs().find(|it| it.0 == key).unwrap().1.into_owned();
        let mut codes = self.fake.codes.lock().unwrap();
        let code = format!("code{}", codes.len());
        codes.insert(code.clone(), (of("nonce"), of("code_challenge")));
        format!("/login/oidc/back?code={code}&state={}&session_state=more", of("state"))
    }

    /// A whole login.
    async fn log_in(&self) -> Response {
        let (address, cookie) = self.begin().await;
        self.get(&self.approved(&address), &cookie).await
    }

    /// Why logins were refused, the newest first.
    async fn refusals(&self) -> Vec<String> {
        let records = self.store.audit_entries(None, 100).await.unwrap();
        let logins = records.into_iter().filter(|it| it.action == "login" && it.was_refused());
        logins.map(|it| format!("{} {}", it.target, it.outcome)).collect()
    }
}

async fn text(answer: Response) -> String {
    String::from_utf8(to_bytes(answer.into_body(), 1 << 20).await.unwrap().to_vec()).unwrap()
}

fn session(answer: &Response) -> Option<String> {
    let mut cookies = answer.headers().get_all(header::SET_COOKIE).iter().filter_map(|it| it.to_str().ok());
    let cookie = cookies.find(|it| it.starts_with("telltale="))?;
    assert!(cookie.contains("HttpOnly; SameSite=Strict"), "{cookie}");
    cookie.split(';').next().map(str::to_owned)
}

#[tokio::test]
async fn somebody_logs_in_at_the_issuer_sees_the_vehicles_of_the_grant_and_logs_out() {
    let world = World::new().await;
    let page = text(world.get("/login", "").await).await;
    assert!(page.contains("href=\"/login/oidc\">Log in with 127.0.0.1</a>"), "{page}");
    assert!(!page.contains("telltale user add"), "{page}");
    let (address, cookie) = world.begin().await;
    let asked: BTreeMap<_, _> = address.query_pairs().into_owned().collect();
    for (key, value) in [
        ("response_type", "code"),
        ("client_id", "fleet"),
        ("redirect_uri", "http://127.0.0.1:8080/login/oidc/back"),
        ("code_challenge_method", "S256"),
        ("scope", "openid profile groups"),
    ] {
        assert_eq!(asked[key], value);
    }
    let answer = world.get(&world.approved(&address), &cookie).await;
    assert_eq!(answer.status(), StatusCode::OK);
    let session = session(&answer).unwrap();
    let page = text(answer).await;
    assert!(page.contains("<meta http-equiv=\"refresh\" content=\"0; url=/\">"), "{page}");
    assert!(text(world.get("/", &session).await).await.contains("anna@127.0.0.1"));
    let vehicles = json(&world.router, "/api/v1/vehicles", &session).await;
    assert_eq!(vehicles.as_array().unwrap().len(), 1);
    for path in ["/login", "/login/oidc"] {
        assert_eq!(world.get(path, &session).await.headers()[header::LOCATION], "/");
    }
    let status = ask(&world.router, Method::POST, "/logout", &session, "").await.status();
    assert_eq!(status, StatusCode::OK);
    let status = ask(&world.router, Method::GET, "/overview", &session, "").await.status();
    assert_eq!(status, StatusCode::UNAUTHORIZED);
    let records = world.store.audit_entries(None, 100).await.unwrap();
    let said: Vec<String> =
        records.iter().map(|it| format!("{} {} {} {}", it.action, it.who, it.role, it.target)).collect();
    for expected in ["login anna@127.0.0.1 engineer sub 0815: engineer:a", "logout anna@127.0.0.1 engineer "]
    {
        assert!(said.iter().any(|it| it == expected), "{expected}: {said:?}");
    }
}

#[tokio::test]
async fn a_login_comes_back_once_in_its_browser_and_in_time() {
    let world = World::new().await;
    let (address, cookie) = world.begin().await;
    let back = world.approved(&address);
    let (_, other) = world.begin().await;
    let foreign = back.replace("state=", "state=x");
    for (path, cookie, late_s) in [
        (foreign.as_str(), cookie.as_str(), 0),
        ("/login/oidc/back", cookie.as_str(), 0),
        ("/login/oidc/back?code=a&code=b&state", cookie.as_str(), 0),
        (&back, "", 0),
        (&back, cookie.as_str(), 0),
    ] {
        world.hand.advance(Span::from_secs(late_s));
        let answer = world.get(path, cookie).await;
        assert_eq!(answer.status(), StatusCode::BAD_REQUEST, "{path}");
        assert!(session(&answer).is_none());
        assert!(text(answer).await.contains("begun in another browser. Begin again."));
    }
    assert!(world.refusals().await.iter().all(|it| it.contains("no such login was begun in this browser")));
    // Another browser brings it; after that it counts no more.
    let (address, own) = world.begin().await;
    let back = world.approved(&address);
    for cookie in [other, own] {
        assert_eq!(world.get(&back, &cookie).await.status(), StatusCode::BAD_REQUEST);
    }
    let (address, cookie) = world.begin().await;
    let back = world.approved(&address);
    assert!(session(&world.get(&back, &cookie).await).is_some());
    assert_eq!(world.get(&back, &cookie).await.status(), StatusCode::BAD_REQUEST, "again");
    let (address, cookie) = world.begin().await;
    world.hand.advance(Span::from_secs(600));
    assert_eq!(world.get(&world.approved(&address), &cookie).await.status(), StatusCode::BAD_REQUEST);
    // A code that was used at the issuer before.
    let (address, cookie) = world.begin().await;
    let back = world.approved(&address);
    world.fake.codes.lock().unwrap().clear();
    assert_eq!(world.get(&back, &cookie).await.status(), StatusCode::FORBIDDEN);
    assert_eq!(world.refusals().await[0], " refused: the issuer refused: invalid_grant");
    let (address, cookie) = world.begin().await;
    let back = world.approved(&address).replace("code=", "error=access_denied&x=");
    let answer = world.get(&back, &cookie).await;
    assert_eq!(answer.status(), StatusCode::FORBIDDEN);
    assert!(text(answer).await.contains("127.0.0.1 did not log you in."));
    assert_eq!(world.refusals().await[0], " refused: the issuer refused: access_denied");
}

#[tokio::test]
async fn a_token_that_is_not_for_this_login_is_not_believed() {
    let world = World::new().await;
    let now_s = unix_ms(world.fake.clock.wall()) / 1000;
    for (how, claims) in [
        (How::Well, value!({ "aud": "other" })),
        (How::Well, value!({ "aud": ["fleet", "other"] })),
        (How::Well, value!({ "iss": "https://id.example" })),
        (How::Well, value!({ "exp": now_s - 1 })),
        (How::Well, value!({ "nonce": "another" })),
        (How::Well, value!({ "nonce": null })),
        (How::AlgNone, value!({})),
        (How::SharedSecret, value!({})),
        (How::OtherKey, value!({})),
        (How::NoToken, value!({})),
        (How::Well, value!({ "sub": "\u{200b}" })),
    ] {
        world.is(how);
        *world.fake.claims.lock().unwrap() = claims.clone();
        let answer = world.log_in().await;
        assert_eq!(answer.status(), StatusCode::FORBIDDEN, "{how:?} {claims}");
        assert!(session(&answer).is_none());
        assert!(text(answer).await.contains("The answer of the login service is not valid."));
        let last = world.refusals().await[0].clone();
        assert!(last.contains("the issuer's token is not believed"), "{how:?} {claims}: {last}");
    }
    world.is(How::Well);
    *world.fake.claims.lock().unwrap() = value!({});
    assert!(session(&world.log_in().await).is_some());
}

#[tokio::test]
async fn a_claim_makes_the_roles_and_a_person_without_one_reads_why() {
    let world = World::new().await;
    for (claims, name, grants) in [
        (value!({ "groups": "north" }), "anna", Some("engineer:a")),
        (value!({ "groups": ["x", "south", 7, "north"] }), "anna", Some("engineer:a authority:b*")),
        (value!({ "groups": ["North"] }), "anna", None),
        (value!({ "groups": { "north": true } }), "anna", None),
        (value!({ "groups": null, "preferred_username": null, "email": "a@b.example" }), "a@b.example", None),
        (value!({ "groups": "south", "preferred_username": " " }), "0815", Some("authority:b*")),
        (value!({ "groups": [], "preferred_username": "<b>\u{202e}anna" }), "<b>anna", None),
    ] {
        *world.fake.claims.lock().unwrap() = claims.clone();
        let answer = world.log_in().await;
        let is_in = session(&answer).is_some();
        assert_eq!(
            (is_in, answer.status() == StatusCode::FORBIDDEN),
            (grants.is_some(), grants.is_none()),
            "{claims}"
        );
        let page = text(answer).await;
        let records = world.store.audit_entries(None, 1).await.unwrap();
        let name = format!("{name}@127.0.0.1");
        match grants {
            Some(grants) => {
                assert_eq!((&records[0].who, &records[0].target), (&name, &format!("sub 0815: {grants}")))
            }
            None => {
                assert!(page.contains("but have no role here") && !page.contains("<b>"), "{page}");
                assert_eq!((&records[0].target, &records[0].who), (&name, &String::new()));
                assert_eq!(records[0].outcome, "refused: logged in at the issuer, but no role here");
            }
        }
    }
}

#[tokio::test]
async fn an_issuer_that_is_ill_is_said_and_keeps_nobody_from_a_login_here() {
    let world = World::new().await;
    for how in [How::Huge, How::Elsewhere, How::Broken, How::OtherName, How::Plain, How::Slow] {
        world.is(how);
        let before = world.fake.asked.load(Ordering::Relaxed);
        for _ in 0..3 {
            let answer = world.get("/login/oidc", "").await;
            assert_eq!(answer.status(), StatusCode::SERVICE_UNAVAILABLE, "{how:?}");
            assert!(text(answer).await.contains("The login service does not answer."));
        }
        assert_eq!(world.fake.asked.load(Ordering::Relaxed), before + 1, "it is not asked each time");
        let last = world.refusals().await[0].clone();
        assert!(last.contains("the issuer does not answer"), "{how:?}: {last}");
        assert!(session(&log_in(&world.router, "engineer", SECRET).await).is_some());
    }
    world.is(How::Well);
    assert!(session(&world.log_in().await).is_some(), "it is asked again");
    for how in [How::HugeToken, How::SlowToken] {
        world.is(how);
        assert_eq!(world.log_in().await.status(), StatusCode::SERVICE_UNAVAILABLE, "{how:?}");
    }
    let foreign = Request::get("/login/oidc").header(header::HOST, "elsewhere.example:8080");
    let answer = world.router.clone().oneshot(foreign.body(Body::empty()).unwrap()).await.unwrap();
    assert_eq!(answer.status(), StatusCode::MISDIRECTED_REQUEST);
    let (router, ..) = console().await;
    for path in ["/login/oidc", "/login/oidc/back?code=a&state=b"] {
        assert_eq!(ask(&router, Method::GET, path, "", "").await.status(), StatusCode::NOT_FOUND);
    }
}
