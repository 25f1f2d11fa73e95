//! Secrets: what is accepted, how they are hashed, and how much of that may run at once.

use std::sync::Arc;

use argon2::password_hash::phc::PasswordHash;
use argon2::{Algorithm, Argon2, Params, PasswordHasher, PasswordVerifier, Version};
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;

use super::{Role, StoreError};

/// Users of the demonstration: name, role, secret. Everybody knows these secrets.
pub const DEMO_USERS: [(&str, Role, &str); 3] = [
    ("operator", Role::Operator, "246810"),
    ("developer", Role::Developer, "demo-developer"),
    ("authority", Role::Authority, "demo-authority"),
];

/// Whether the secrets of [`DEMO_USERS`] open a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DemoSecrets {
    Accepted,
    Refused,
}

/// Why a secret is not good enough.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SecretError {
    #[error(
        "a PIN needs {PIN_DIGITS_MIN} digits or more, a password {PASSWORD_CHARS_MIN} characters or more"
    )]
    ShortOperator,
    #[error("a password needs {PASSWORD_CHARS_MIN} characters or more")]
    Short,
    #[error("a secret has at most {SECRET_BYTES_MAX} bytes")]
    Long,
    #[error("this secret is printed in the documentation of the demonstration; choose another one")]
    Demo,
}

const PIN_DIGITS_MIN: usize = 6;
const PASSWORD_CHARS_MIN: usize = 12;
const SECRET_BYTES_MAX: usize = 256;

/// Hashing takes 19 MiB and tens of milliseconds of one core each.
const HASHES_AT_ONCE: usize = 2;
/// Logins that may wait for their hash; more are refused, a flood must not fill the memory.
const HASHES_WAITING: usize = 64;

/// A hash of nothing anybody knows, with the parameters of [`argon2`]: unknown users cost the
/// same time as known ones.
const NOBODY: &str =
    "$argon2id$v=19$m=19456,t=2,p=1$dGVsbHRhbGUtbm9ib2R5$Zm9yIHVua25vd24gdXNlcnMgb25seSwgbm8gc2VjcmU";

/// Checks `secret` against what `role` demands.
pub(super) fn check_policy(role: Role, secret: &str) -> Result<(), SecretError> {
    if secret.len() > SECRET_BYTES_MAX {
        return Err(SecretError::Long);
    }
    if is_demo(secret) {
        return Err(SecretError::Demo);
    }
    let chars = secret.chars().count();
    let is_pin = chars >= PIN_DIGITS_MIN && secret.bytes().all(|byte| byte.is_ascii_digit());
    match role {
        Role::Operator if !is_pin && chars < PASSWORD_CHARS_MIN => Err(SecretError::ShortOperator),
        Role::Developer | Role::Authority if chars < PASSWORD_CHARS_MIN => Err(SecretError::Short),
        _ => Ok(()),
    }
}

fn is_demo(secret: &str) -> bool {
    DEMO_USERS.iter().any(|(_, _, known)| *known == secret)
}

/// Hashes and verifies off the async runtime, a bounded number at a time.
#[derive(Debug, Clone)]
pub(super) struct Hashing {
    running: Arc<Semaphore>,
    waiting: Arc<Semaphore>,
    demo: DemoSecrets,
}

impl Hashing {
    pub(super) fn new(demo: DemoSecrets) -> Hashing {
        Hashing {
            running: Arc::new(Semaphore::new(HASHES_AT_ONCE)),
            waiting: Arc::new(Semaphore::new(HASHES_WAITING)),
            demo,
        }
    }

    pub(super) async fn hash(&self, secret: String) -> Result<String, StoreError> {
        self.bounded(move || {
            argon2().hash_password(secret.as_bytes()).map(|hash| hash.to_string()).map_err(StoreError::Hash)
        })
        .await?
    }

    /// Whether `secret` is the one behind `hash`. Without a hash it takes the same time and is false.
    pub(super) async fn verify(&self, secret: String, hash: Option<String>) -> Result<bool, StoreError> {
        let demo = self.demo;
        self.bounded(move || {
            let known = hash.is_some();
            let hash = hash.unwrap_or_else(|| NOBODY.to_owned());
            let secret = if secret.len() > SECRET_BYTES_MAX { String::new() } else { secret };
            let matches = PasswordHash::new(&hash)
                .is_ok_and(|hash| argon2().verify_password(secret.as_bytes(), &hash).is_ok());
            matches && known && (demo == DemoSecrets::Accepted || !is_demo(&secret))
        })
        .await
    }

    async fn bounded<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, StoreError> {
        let waiting = self.waiting.clone().try_acquire_owned().map_err(|_| StoreError::Busy)?;
        let running = self.running.clone().acquire_owned().await.map_err(|_| StoreError::Ended)?;
        // The permits move into the work: a caller that goes away does not free its place early.
        let work = spawn_blocking(move || {
            let _held = (waiting, running);
            work()
        });
        work.await.map_err(|_| StoreError::Ended)
    }
}

/// OWASP's minimum for argon2id: 19 MiB, two passes, one lane.
fn argon2() -> Argon2<'static> {
    Argon2::new(Algorithm::Argon2id, Version::V0x13, Params::DEFAULT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_policy_by_role() {
        let twelve = "correct horse".get(..12).unwrap();
        let cases = [
            (Role::Operator, "135791", Ok(())),
            (Role::Operator, "13579", Err(SecretError::ShortOperator)),
            (Role::Operator, "13579a", Err(SecretError::ShortOperator)),
            (Role::Operator, twelve, Ok(())),
            (Role::Operator, "246810", Err(SecretError::Demo)),
            (Role::Developer, "135791", Err(SecretError::Short)),
            (Role::Developer, "elevenchars", Err(SecretError::Short)),
            (Role::Developer, twelve, Ok(())),
            (Role::Authority, "ääääääääääää", Ok(())),
            (Role::Authority, "ääääää", Err(SecretError::Short)),
            (Role::Developer, "demo-authority", Err(SecretError::Demo)),
        ];
        for (role, secret, expected) in cases {
            assert_eq!(check_policy(role, secret), expected, "{role:?} {secret}");
        }
        assert_eq!(check_policy(Role::Operator, &"1".repeat(257)), Err(SecretError::Long));
    }

    #[test]
    fn parameters_are_those_of_the_hash_for_unknown_users() {
        let params = Params::DEFAULT;
        assert_eq!((params.m_cost(), params.t_cost(), params.p_cost()), (19 * 1024, 2, 1));
        let hash = PasswordHash::new(NOBODY).unwrap();
        assert_eq!(Params::try_from(&hash).unwrap().m_cost(), params.m_cost());
        assert_eq!(hash.hash.unwrap().as_bytes().len(), Params::DEFAULT_OUTPUT_LEN);
    }

    #[tokio::test]
    async fn only_the_right_secret_verifies() {
        let hashing = Hashing::new(DemoSecrets::Refused);
        let hash = hashing.hash("135791".to_owned()).await.unwrap();
        assert!(hashing.verify("135791".to_owned(), Some(hash.clone())).await.unwrap());
        assert!(!hashing.verify("135792".to_owned(), Some(hash)).await.unwrap());
        assert!(!hashing.verify("135791".to_owned(), None).await.unwrap());
        let demo = hashing.hash("246810".to_owned()).await.unwrap();
        assert!(!hashing.verify("246810".to_owned(), Some(demo.clone())).await.unwrap());
        assert!(Hashing::new(DemoSecrets::Accepted).verify("246810".to_owned(), Some(demo)).await.unwrap());
    }
}
