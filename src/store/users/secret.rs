//! Secrets: what is accepted, how they are hashed, and how much of that may run at once.

use std::path::PathBuf;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};

use argon2::password_hash::phc::PasswordHash;
use argon2::{Algorithm, Argon2, Params, PasswordHasher, PasswordVerifier, Version};
use tokio::sync::oneshot;
use zxcvbn::{Score, zxcvbn};

use crate::store::{Role, StoreError};

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
    #[error(
        "a PIN of one or two digits, of digits in a row, or of a part that repeats is guessed first: choose another"
    )]
    GuessablePin,
    #[error(
        "this password is guessed within a million attempts: take several words that do not belong together"
    )]
    GuessablePassword,
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

/// On a machine with few cores the engine and the displays go first, whoever tries to log in; and
/// on a busy one, whoever does at the vehicle itself has a share still.
const VEHICLE_NICENESS: i32 = 5;
const ELSEWHERE_NICENESS: i32 = 19;
/// Hashing takes 19 MiB and tens of milliseconds of one core, so there are two lanes. In each, so
/// many logins may wait for their hash; more are refused, a flood must not fill the memory.
const HASHES_WAITING: usize = 64;

/// A hash of nothing anybody knows, with the parameters of [`argon2`]: unknown users cost the
/// same time as known ones.
const NOBODY: &str =
    "$argon2id$v=19$m=19456,t=2,p=1$dGVsbHRhbGUtbm9ib2R5$Zm9yIHVua25vd24gdXNlcnMgb25seSwgbm8gc2VjcmU";

/// Checks the `secret` of the user `name` against what `role` demands.
pub(in crate::store) fn check_policy(role: Role, name: &str, secret: &str) -> Result<(), SecretError> {
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
        Role::Operator if is_pin && is_guessed_first(secret) => Err(SecretError::GuessablePin),
        Role::Developer | Role::Authority if chars < PASSWORD_CHARS_MIN => Err(SecretError::Short),
        _ if !(is_pin && role == Role::Operator) && zxcvbn(secret, &[name]).score() < Score::Two => {
            Err(SecretError::GuessablePassword)
        }
        _ => Ok(()),
    }
}

/// Whether a PIN has at most two different digits, repeats its beginning, or each digit is the next of the
/// one before, up or down.
fn is_guessed_first(pin: &str) -> bool {
    let digits = pin.as_bytes();
    let different = (b'0'..=b'9').filter(|digit| digits.contains(digit)).count();
    let repeats = (1..=digits.len() / 2)
        .filter(|part| digits.len().is_multiple_of(*part))
        .any(|part| digits.chunks(part).all(|it| it == &digits[..part]));
    let in_a_row = |step: u8| digits.windows(2).all(|pair| (pair[0] - b'0' + step) % 10 == pair[1] - b'0');
    different <= 2 || repeats || in_a_row(1) || in_a_row(9)
}

/// Whether a secret is a PIN: digits, and fewer than a password needs. Anybody can see that of what
/// they type, so it tells nothing of anybody's secret.
pub fn is_pin(secret: &str) -> bool {
    secret.len() < PASSWORD_CHARS_MIN && secret.bytes().all(|byte| byte.is_ascii_digit())
}

fn is_demo(secret: &str) -> bool {
    DEMO_USERS.iter().any(|(_, _, known)| *known == secret)
}

/// Hashes and verifies in threads of its own, one at a time in each lane. They end with the last
/// clone.
#[derive(Debug, Clone)]
pub(in crate::store) struct Hashing {
    vehicle: SyncSender<Work>,
    elsewhere: SyncSender<Work>,
    demo: DemoSecrets,
}

/// Whence somebody comes: a flood from elsewhere does not make the vehicle's own displays wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lane {
    Vehicle,
    Elsewhere,
}

type Work = Box<dyn FnOnce() + Send>;

impl Hashing {
    pub(in crate::store) fn new(demo: DemoSecrets) -> Result<Hashing, StoreError> {
        Ok(Hashing {
            vehicle: start_lane(VEHICLE_NICENESS)?,
            elsewhere: start_lane(ELSEWHERE_NICENESS)?,
            demo,
        })
    }

    pub(in crate::store) async fn hash(&self, secret: String) -> Result<String, StoreError> {
        self.bounded(Lane::Vehicle, move || {
            argon2().hash_password(secret.as_bytes()).map(|hash| hash.to_string()).map_err(StoreError::Hash)
        })
        .await?
    }

    /// Whether `secret` is the one behind `hash`. Without a hash it takes the same time and is false.
    pub(in crate::store) async fn verify(
        &self,
        lane: Lane,
        secret: String,
        hash: Option<String>,
    ) -> Result<bool, StoreError> {
        let demo = self.demo;
        self.bounded(lane, move || {
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
        lane: Lane,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, StoreError> {
        let (reply, answer) = oneshot::channel();
        let work: Work = Box::new(move || {
            // Nobody is waiting any more: a flood of logins that were given up costs nothing.
            if !reply.is_closed() {
                let _ = reply.send(work());
            }
        });
        let queue = match lane {
            Lane::Vehicle => &self.vehicle,
            Lane::Elsewhere => &self.elsewhere,
        };
        queue.try_send(work).map_err(|error| match error {
            TrySendError::Full(_) => StoreError::Busy,
            TrySendError::Disconnected(_) => StoreError::Ended,
        })?;
        answer.await.map_err(|_| StoreError::Ended)
    }
}

fn start_lane(niceness: i32) -> Result<SyncSender<Work>, StoreError> {
    let (work, queue) = sync_channel::<Work>(HASHES_WAITING);
    std::thread::Builder::new()
        .name("hashing".to_owned())
        .spawn(move || {
            // On Linux this is of the calling thread alone. Without it hashing still works.
            let _ = rustix::process::nice(niceness);
            queue.iter().for_each(|work| work());
        })
        .map_err(|reason| StoreError::Folder { path: PathBuf::from("(a new thread)"), reason })?;
    Ok(work)
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
            (Role::Operator, "123456", Err(SecretError::GuessablePin)),
            (Role::Operator, "98765432", Err(SecretError::GuessablePin)),
            (Role::Operator, "111111", Err(SecretError::GuessablePin)),
            (Role::Operator, "567890", Err(SecretError::GuessablePin)),
            (Role::Operator, "111112", Err(SecretError::GuessablePin)),
            (Role::Operator, "121212", Err(SecretError::GuessablePin)),
            (Role::Operator, "193193", Err(SecretError::GuessablePin)),
            (Role::Operator, "111923", Ok(())),
            (Role::Operator, "aaaaaaaaaaaa", Err(SecretError::GuessablePassword)),
            (Role::Authority, "passwordpassword", Err(SecretError::GuessablePassword)),
            (Role::Developer, "qwertyuiop123", Err(SecretError::GuessablePassword)),
            (Role::Developer, "annikaannikaannika", Err(SecretError::GuessablePassword)),
            (Role::Developer, "a long password", Ok(())),
            (Role::Operator, "13579", Err(SecretError::ShortOperator)),
            (Role::Operator, "13579a", Err(SecretError::ShortOperator)),
            (Role::Operator, twelve, Ok(())),
            (Role::Operator, "246810", Err(SecretError::Demo)),
            (Role::Developer, "135791", Err(SecretError::Short)),
            (Role::Developer, "elevenchars", Err(SecretError::Short)),
            (Role::Developer, twelve, Ok(())),
            (Role::Authority, "ääääääääääää", Err(SecretError::GuessablePassword)),
            (Role::Authority, "grüße öfter üben", Ok(())),
            (Role::Authority, "ääääää", Err(SecretError::Short)),
            (Role::Developer, "demo-authority", Err(SecretError::Demo)),
        ];
        for (secret, expected) in [("135791", true), ("1", true), ("", true), ("12345678901", true)] {
            assert_eq!(is_pin(secret), expected, "{secret}");
        }
        for password in ["123456789012", "12345a", "١٣٥٧٩١"] {
            assert!(!is_pin(password), "{password}");
        }
        for (role, secret, expected) in cases {
            assert_eq!(check_policy(role, "annika", secret), expected, "{role:?} {secret}");
        }
        assert_eq!(check_policy(Role::Operator, "annika", &"1".repeat(257)), Err(SecretError::Long));
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
        let hashing = Hashing::new(DemoSecrets::Refused).unwrap();
        let hash = hashing.hash("135791".to_owned()).await.unwrap();
        assert!(hashing.verify(Lane::Vehicle, "135791".to_owned(), Some(hash.clone())).await.unwrap());
        assert!(!hashing.verify(Lane::Vehicle, "135792".to_owned(), Some(hash)).await.unwrap());
        assert!(!hashing.verify(Lane::Vehicle, "135791".to_owned(), None).await.unwrap());
        let demo = hashing.hash("246810".to_owned()).await.unwrap();
        assert!(!hashing.verify(Lane::Vehicle, "246810".to_owned(), Some(demo.clone())).await.unwrap());
        let accepting = Hashing::new(DemoSecrets::Accepted).unwrap();
        assert!(accepting.verify(Lane::Vehicle, "246810".to_owned(), Some(demo)).await.unwrap());
    }
}
