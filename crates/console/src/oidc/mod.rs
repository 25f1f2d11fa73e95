//! Login by OpenID Connect: an issuer says who somebody is, and a claim of its token says which roles that person has, and
//! for which vehicles. The code comes back through the browser, with PKCE, state and nonce.

mod requests;
mod waiting;

use std::error::Error;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use base64::Engine as _;
use base64::prelude::BASE64_URL_SAFE_NO_PAD;
pub use openidconnect::IssuerUrl as Issuer;
use openidconnect::core::{
    CoreAuthenticationFlow, CoreClient, CoreClientAuthMethod, CoreIdToken, CoreJwsSigningAlgorithm,
    CoreProviderMetadata,
};
use openidconnect::{
    AuthType, AuthorizationCode, ClientId, ClientSecret, CsrfToken, EndpointMaybeSet, EndpointNotSet,
    EndpointSet, IssuerUrl, Nonce, PkceCodeChallenge, RedirectUrl, RequestTokenError, Scope,
    TokenResponse as _,
};
use rustls::ClientConfig;
use serde_json::{Map, Value};
use telltale_clock::Clock;
use telltale_engine::time::{Span, Timestamp};
use telltale_store::{Grant, Grants, Token};
use telltale_web::texts::{MESSAGE, NAME, clean};

use requests::{Requests, is_here};
pub use waiting::WAITS_FOR;
use waiting::{Begun, Waiting};

/// Where the browser comes back to, below an origin of the console.
pub const BACK: &str = "/login/oidc/back";

/// What the issuer says of itself, with its keys, is asked for again after this time; after a fault after the second.
const KNOWN_FOR: Span = Span::from_secs(60);
const AGAIN_AFTER: Span = Span::from_secs(5);

/// Signatures that nobody but the issuer can make.
const SIGNATURES: [CoreJwsSigningAlgorithm; 9] = [
    CoreJwsSigningAlgorithm::RsaSsaPkcs1V15Sha256,
    CoreJwsSigningAlgorithm::RsaSsaPkcs1V15Sha384,
    CoreJwsSigningAlgorithm::RsaSsaPkcs1V15Sha512,
    CoreJwsSigningAlgorithm::RsaSsaPssSha256,
    CoreJwsSigningAlgorithm::RsaSsaPssSha384,
    CoreJwsSigningAlgorithm::RsaSsaPssSha512,
    CoreJwsSigningAlgorithm::EcdsaP256Sha256,
    CoreJwsSigningAlgorithm::EcdsaP384Sha384,
    CoreJwsSigningAlgorithm::EdDsa,
];

type Client = CoreClient<
    EndpointSet,
    EndpointNotSet,
    EndpointNotSet,
    EndpointNotSet,
    EndpointMaybeSet,
    EndpointMaybeSet,
>;

/// How people log in.
pub struct Settings {
    pub issuer: IssuerUrl,
    pub client: String,
    /// Of a client that is confidential.
    pub secret: Option<String>,
    /// The claim with the values that are granted something.
    pub claim: String,
    /// What a value of the claim grants.
    pub grants: Vec<(String, Grant)>,
    /// With the certificates that are believed.
    pub tls: Option<Arc<ClientConfig>>,
}

/// Reads the address of an issuer.
///
/// # Errors
/// What to write instead.
pub fn issuer(text: &str) -> Result<IssuerUrl, String> {
    let written = "write the issuer's address as it names itself: https://id.example/realms/fleet";
    let issuer = IssuerUrl::new(text.to_owned()).map_err(|_| written.to_owned())?;
    let url = issuer.url();
    let is_bare = url.query().is_none() && url.fragment().is_none() && url.username().is_empty();
    match (url.scheme(), url.host_str()) {
        ("https", Some(_)) if is_bare => Ok(issuer),
        ("http", Some(host)) if is_bare && is_here(host) => Ok(issuer),
        ("http", Some(_)) => {
            Err("plain HTTP only reaches an issuer on this machine: write https://".to_owned())
        }
        _ => Err(written.to_owned()),
    }
}

/// Why somebody is not logged in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The issuer does not answer as it should.
    Away(String),
    /// No such login was begun in this browser, or it is too old or was used before.
    Stale,
    /// The issuer did not log the person in, and says so in a word.
    Refused(String),
    /// Its token is not one for this login.
    Unbelieved(String),
    /// The person has no role here.
    NoRole(String),
}

impl Failure {
    /// For the audit log.
    pub fn why(&self) -> String {
        match self {
            Failure::Away(why) => format!("the issuer does not answer: {why}"),
            Failure::Stale => "no such login was begun in this browser, or it is over".to_owned(),
            Failure::Refused(word) => format!("the issuer refused: {word}"),
            Failure::Unbelieved(why) => format!("the issuer's token is not believed: {why}"),
            Failure::NoRole(_) => "logged in at the issuer, but no role here".to_owned(),
        }
    }
}

/// A person that the issuer logged in, with at least one role.
#[derive(Debug)]
pub struct Person {
    /// With the issuer's host, so that no user here has this name.
    pub name: String,
    /// The issuer's own name for the person, for the audit log.
    pub subject: String,
    pub grants: Grants,
}

/// The answer of the issuer's page, as the browser brings it.
#[derive(Debug, Default, serde::Deserialize)]
pub struct Brought {
    #[serde(default)]
    state: String,
    code: Option<String>,
    error: Option<String>,
}

/// Logins at one issuer.
pub struct Oidc {
    settings: Settings,
    requests: Requests,
    clock: Clock,
    /// What the issuer said of itself, and when.
    known: tokio::sync::Mutex<Option<(Timestamp, Result<CoreProviderMetadata, Failure>)>>,
    waiting: Mutex<Waiting>,
}

impl std::fmt::Debug for Oidc {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Oidc({})", *self.settings.issuer)
    }
}

impl Oidc {
    pub fn new(settings: Settings, clock: Clock) -> Oidc {
        let requests = Requests::new(settings.tls.clone());
        Oidc { settings, requests, clock, known: Default::default(), waiting: Mutex::default() }
    }

    /// The name of the issuer for people.
    pub fn host(&self) -> &str {
        self.settings.issuer.url().host_str().unwrap_or_default()
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the issuer says of itself, with its keys.
    ///
    /// # Errors
    /// It does not answer as it should.
    pub async fn issuer(&self) -> Result<CoreProviderMetadata, Failure> {
        let mut known = self.known.lock().await;
        let is_fresh = |(at, said): &(Timestamp, Result<_, _>)| {
            self.clock.now().since(*at) <= if said.is_ok() { KNOWN_FOR } else { AGAIN_AFTER }
        };
        if let Some((_, said)) = known.as_ref().filter(|it| is_fresh(it)) {
            return said.clone();
        }
        let said = CoreProviderMetadata::discover_async(self.settings.issuer.clone(), &self.requests).await;
        let said = said.map_err(|error| Failure::Away(chain(&error))).and_then(checked);
        if let Err(failure) = &said {
            tracing::warn!("{}: {}", *self.settings.issuer, failure.why());
        }
        *known = Some((self.clock.now(), said.clone()));
        said
    }

    fn client(&self, said: CoreProviderMetadata, back: RedirectUrl) -> Client {
        let Settings { client, secret, .. } = &self.settings;
        let methods = said.token_endpoint_auth_methods_supported();
        let takes_basic = methods.is_none_or(|it| it.contains(&CoreClientAuthMethod::ClientSecretBasic));
        let secret = secret.clone().map(ClientSecret::new);
        let client = CoreClient::from_provider_metadata(said, ClientId::new(client.clone()), secret);
        let kind = if takes_basic { AuthType::BasicAuth } else { AuthType::RequestBody };
        client.set_auth_type(kind).set_redirect_uri(back)
    }

    /// Begins a login of a browser that reaches the console by an origin. Returns the address at the issuer, and the value
    /// of the browser's cookie.
    ///
    /// # Errors
    /// The issuer does not answer.
    pub async fn begin(&self, origin: &str, network: IpAddr) -> Result<(String, Token), Failure> {
        let said = self.issuer().await?;
        let unusable = |why: String| Failure::Away(why);
        let back =
            RedirectUrl::new(format!("{origin}{BACK}")).map_err(|error| unusable(error.to_string()))?;
        let browser = Token::random().map_err(|error| unusable(error.to_string()))?;
        let wanted = ["profile", "email", self.settings.claim.as_str()];
        let offered = said.scopes_supported().cloned();
        let is_offered = |name: &str| match &offered {
            Some(offered) => offered.iter().any(|it| it.as_str() == name),
            None => name != self.settings.claim,
        };
        let scopes = wanted.into_iter().filter(|it| is_offered(it)).map(|it| Scope::new(it.to_owned()));
        let client = self.client(said, back.clone());
        let (challenge, verifier) = PkceCodeChallenge::new_random_sha256();
        let (state, nonce) = (CsrfToken::new_random(), Nonce::new_random());
        let (own_state, own_nonce) = (state.clone(), nonce.clone());
        let request = client.authorize_url(
            CoreAuthenticationFlow::AuthorizationCode,
            move || own_state,
            move || own_nonce,
        );
        let (address, ..) = request.add_scopes(scopes).set_pkce_challenge(challenge).url();
        let (state, now) = (state.secret().clone(), self.clock.now());
        let until = now + WAITS_FOR;
        let begun = Begun { state, browser: browser.clone(), nonce, verifier, back, network, until };
        self.waiting().add(begun, now);
        Ok((address.into(), browser))
    }

    /// Ends a login with what a browser brings from the issuer.
    ///
    /// # Errors
    /// Why the person is not logged in.
    pub async fn finish(&self, brought: Brought, browser: Option<&Token>) -> Result<Person, Failure> {
        let begun = self.waiting().take(&brought.state, browser, self.clock.now()).ok_or(Failure::Stale)?;
        let code = match brought {
            Brought { error: Some(word), .. } => return Err(Failure::Refused(clean(&word, NAME))),
            Brought { code, .. } => code.ok_or(Failure::Stale)?,
        };
        let client = self.client(self.issuer().await?, begun.back);
        let away = |error: &dyn Error| Failure::Away(chain(error));
        let request = client.exchange_code(AuthorizationCode::new(code)).map_err(|error| away(&error))?;
        let answer = request.set_pkce_verifier(begun.verifier).request_async(&self.requests).await;
        let answer = answer.map_err(|error| match &error {
            RequestTokenError::ServerResponse(said) => Failure::Refused(clean(said.error().as_ref(), NAME)),
            _ => away(&error),
        })?;
        let unbelieved = |why: &str| Failure::Unbelieved(why.to_owned());
        let token = answer.id_token().ok_or_else(|| unbelieved("there is none"))?;
        let wall = self.clock.wall();
        let verifier =
            client.id_token_verifier().set_allowed_algs(SIGNATURES).set_time_fn(move || wall.into());
        token.claims(&verifier, &begun.nonce).map_err(|error| Failure::Unbelieved(chain(&error)))?;
        let claims = claims(token).ok_or_else(|| unbelieved("its claims cannot be read"))?;
        self.person(&claims)
    }

    /// The person, with the grants.
    fn person(&self, claims: &Map<String, Value>) -> Result<Person, Failure> {
        let text = |key: &str| {
            let text = claims.get(key).and_then(Value::as_str).map(|it| clean(it, NAME));
            text.filter(|it| !it.is_empty())
        };
        let subject = text("sub").ok_or_else(|| Failure::Unbelieved("it is of nobody".to_owned()))?;
        let name = text("preferred_username").or_else(|| text("email")).unwrap_or_else(|| subject.clone());
        let name = format!("{name}@{}", self.host());
        let values: Vec<&str> = match claims.get(&self.settings.claim) {
            Some(Value::String(value)) => vec![value],
            Some(Value::Array(values)) => values.iter().filter_map(Value::as_str).collect(),
            _ => Vec::new(),
        };
        let granted = self.settings.grants.iter().filter(|(value, _)| values.contains(&value.as_str()));
        let grants = Grants::new(granted.map(|(_, grant)| grant.clone()).collect());
        let Some(grants) = grants else {
            let values = clean(&values.join(", "), MESSAGE);
            tracing::info!("to {name} nothing is granted; the claim `{}` has: {values}", self.settings.claim);
            return Err(Failure::NoRole(name));
        };
        Ok(Person { name, subject, grants })
    }
}

/// Checks the addresses for browsers and for codes, as the issuer's own.
fn checked(said: CoreProviderMetadata) -> Result<CoreProviderMetadata, Failure> {
    let token = said.token_endpoint().map(|it| it.url());
    for url in [Some(said.authorization_endpoint().url()), token] {
        let url = url.ok_or_else(|| Failure::Away("it names no address for tokens".to_owned()))?;
        if url.scheme() != "https" && !(url.scheme() == "http" && url.host_str().is_some_and(is_here)) {
            return Err(Failure::Away(format!("{} is no https:// address", clean(url.as_str(), MESSAGE))));
        }
    }
    Ok(said)
}

/// All claims of a token that was verified.
fn claims(token: &CoreIdToken) -> Option<Map<String, Value>> {
    let token = token.to_string();
    let payload = BASE64_URL_SAFE_NO_PAD.decode(token.split('.').nth(1)?).ok()?;
    serde_json::from_slice(&payload).ok()
}

/// An error with its causes, in one line of bounded length.
fn chain(error: &dyn Error) -> String {
    let (mut words, mut cause) = (error.to_string(), error.source());
    while let Some(error) = cause {
        words = format!("{words}: {error}");
        cause = error.source();
    }
    clean(&words, MESSAGE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_issuer_is_reached_over_tls_or_on_this_machine() {
        for good in
            ["https://id.example", "https://id.example/realms/a", "http://localhost:9400", "http://[::1]:80"]
        {
            assert!(issuer(good).is_ok(), "{good}");
        }
        for (bad, says) in [
            ("id.example", "https://id.example"),
            ("http://id.example", "write https://"),
            ("http://localhost.example", "write https://"),
            ("ftp://localhost", "https://id.example"),
            ("https://anna@id.example", "https://id.example"),
            ("https://id.example?a=b", "https://id.example"),
        ] {
            assert!(issuer(bad).unwrap_err().contains(says), "{bad}");
        }
    }
}
