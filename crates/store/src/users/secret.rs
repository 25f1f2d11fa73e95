//! Secrets: which are accepted, how they are hashed, and how many hashes may run at once.

use std::path::PathBuf;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};

use argon2::password_hash::phc::{Output, PasswordHash};
use argon2::{Algorithm, Argon2, Block, Params, PasswordHasher, PasswordVerifier, Version};
use tokio::sync::oneshot;
use zxcvbn::{Score, zxcvbn};

use crate::{Caller, Role, StoreError};

/// Users of the demonstration: name, role, secret. Everybody knows these secrets.
pub const DEMO_USERS: [(&str, Role, &str); 3] = [
    ("operator", Role::Operator, "246810"),
    ("developer", Role::Developer, "demo-developer"),
    ("authority", Role::Authority, "demo-authority"),
];

/// The same of a fleet's console.
pub const DEMO_CONSOLE_USERS: [(&str, Role, &str); 3] = [
    ("control", Role::ControlRoom, "demo-control"),
    ("engineer", Role::Engineer, "demo-engineer"),
    ("authority", Role::Authority, "demo-authority"),
];

/// Whether the secrets of [`DEMO_USERS`] and [`DEMO_CONSOLE_USERS`] open a session.
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

/// On a machine with few cores the engine and the displays go before logins. On a busy machine, logins at
/// the vehicle itself still get a share.
const VEHICLE_NICENESS: i32 = 5;
const ELSEWHERE_NICENESS: i32 = 19;
/// Hashing takes 19 MiB and tens of milliseconds of one core, so there are two threads: one for the
/// vehicle's displays, one for everybody else. For each of them, this many logins may wait; more are
/// refused, so that a flood does not fill the memory.
const HASHES_WAITING: usize = 64;

/// glibc maps a piece of more than 32 MiB (`M_MMAP_THRESHOLD`) for itself and returns it at once when it is
/// freed. Of smaller pieces it may keep much. Untouched pages of the piece cost nothing.
const BLOCKS_OF_A_LANE: usize = 33 * 1024;

/// A hash of an unknown secret, with the parameters of [`argon2`]: unknown users cost the same time as
/// known ones.
pub(crate) const NOBODY: &str =
    "$argon2id$v=19$m=19456,t=2,p=1$dGVsbHRhbGUtbm9ib2R5$Zm9yIHVua25vd24gdXNlcnMgb25seSwgbm8gc2VjcmU";

/// Checks the `secret` of the user `name` against what `role` demands.
pub(crate) fn check_policy(role: Role, name: &str, secret: &str) -> Result<(), SecretError> {
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
        Role::Developer | Role::ControlRoom | Role::Engineer | Role::Authority
            if chars < PASSWORD_CHARS_MIN =>
        {
            Err(SecretError::Short)
        }
        _ if !(is_pin && role == Role::Operator) && zxcvbn(secret, &[name]).score() < Score::Two => {
            Err(SecretError::GuessablePassword)
        }
        _ => Ok(()),
    }
}

/// Whether a PIN has at most two different digits, repeats its beginning, or counts up or down.
fn is_guessed_first(pin: &str) -> bool {
    let digits = pin.as_bytes();
    let different = (b'0'..=b'9').filter(|digit| digits.contains(digit)).count();
    let repeats = (1..=digits.len() / 2)
        .filter(|part| digits.len().is_multiple_of(*part))
        .any(|part| digits.chunks(part).all(|it| it == &digits[..part]));
    let in_a_row = |step: u8| digits.windows(2).all(|pair| (pair[0] - b'0' + step) % 10 == pair[1] - b'0');
    different <= 2 || repeats || in_a_row(1) || in_a_row(9)
}

/// Whether a secret is a PIN: digits, and fewer than a password needs. Everybody can see that of their own
/// secret, so it reveals nothing about a user's secret.
pub fn is_pin(secret: &str) -> bool {
    secret.len() < PASSWORD_CHARS_MIN && secret.bytes().all(|byte| byte.is_ascii_digit())
}

fn is_demo(secret: &str) -> bool {
    DEMO_USERS.iter().chain(&DEMO_CONSOLE_USERS).any(|(_, _, known)| *known == secret)
}

/// Hashes and verifies in threads of its own, one at a time in each. The threads end with the last
/// clone.
#[derive(Debug, Clone)]
pub(crate) struct Hashing {
    vehicle: SyncSender<Work>,
    elsewhere: SyncSender<Work>,
    demo: DemoSecrets,
}

type Work = Box<dyn FnOnce(&mut Blocks) + Send>;

/// The memory in which a thread hashes; none before its first hash.
type Blocks = Vec<Block>;

impl Hashing {
    pub(crate) fn new(demo: DemoSecrets) -> Result<Hashing, StoreError> {
        Ok(Hashing {
            vehicle: start_hashing(VEHICLE_NICENESS)?,
            elsewhere: start_hashing(ELSEWHERE_NICENESS)?,
            demo,
        })
    }

    pub(crate) async fn hash(&self, secret: String) -> Result<String, StoreError> {
        self.bounded(Caller::Vehicle, move |_| {
            argon2().hash_password(secret.as_bytes()).map(|hash| hash.to_string()).map_err(StoreError::Hash)
        })
        .await?
    }

    /// Whether `secret` is the one behind `hash`. Without a hash it takes the same time and returns false.
    pub(crate) async fn verify(
        &self,
        caller: Caller,
        secret: String,
        hash: Option<String>,
    ) -> Result<bool, StoreError> {
        let demo = self.demo;
        self.bounded(caller, move |blocks| {
            let known = hash.is_some();
            let hash = hash.unwrap_or_else(|| NOBODY.to_owned());
            let secret = if secret.len() > SECRET_BYTES_MAX { String::new() } else { secret };
            let matches =
                PasswordHash::new(&hash).is_ok_and(|hash| is_behind(&hash, secret.as_bytes(), blocks));
            matches && known && (demo == DemoSecrets::Accepted || !is_demo(&secret))
        })
        .await
    }

    async fn bounded<T: Send + 'static>(
        &self,
        caller: Caller,
        work: impl FnOnce(&mut Blocks) -> T + Send + 'static,
    ) -> Result<T, StoreError> {
        let (reply, answer) = oneshot::channel();
        let work: Work = Box::new(move |blocks| {
            // Nobody waits any more: logins that were given up cost nothing.
            if !reply.is_closed() {
                let _ = reply.send(work(blocks));
            }
        });
        let queue = match caller {
            Caller::Vehicle => &self.vehicle,
            Caller::Elsewhere => &self.elsewhere,
        };
        queue.try_send(work).map_err(|error| match error {
            TrySendError::Full(_) => StoreError::Busy,
            TrySendError::Disconnected(_) => StoreError::Ended,
        })?;
        answer.await.map_err(|_| StoreError::Ended)
    }
}

fn start_hashing(niceness: i32) -> Result<SyncSender<Work>, StoreError> {
    let (work, queue) = sync_channel::<Work>(HASHES_WAITING);
    std::thread::Builder::new()
        .name("hashing".to_owned())
        .spawn(move || {
            // On Linux this sets the priority of the calling thread only. Without it hashing still works.
            let _ = rustix::process::setpriority_process(None, niceness);
            while let Ok(work) = queue.recv() {
                // For all that wait now; freed when nobody waits.
                let mut blocks = Blocks::new();
                work(&mut blocks);
                queue.try_iter().for_each(|work| work(&mut blocks));
            }
        })
        .map_err(|reason| StoreError::Folder { path: PathBuf::from("(a new thread)"), reason })?;
    Ok(work)
}

/// OWASP's minimum for argon2id: 19 MiB, two passes, one lane.
fn argon2() -> Argon2<'static> {
    Argon2::new(Algorithm::Argon2id, Version::V0x13, Params::DEFAULT)
}

/// Whether this secret is the one behind a hash.
fn is_behind(hash: &PasswordHash, secret: &[u8], blocks: &mut Blocks) -> bool {
    let argon2 = argon2();
    let (Some(salt), Some(expected), true) = (&hash.salt, &hash.hash, is_by(&argon2, hash)) else {
        // Made with the parameters of another version.
        return argon2.verify_password(secret, hash).is_ok();
    };
    if blocks.is_empty() {
        blocks.reserve_exact(BLOCKS_OF_A_LANE);
        blocks.resize(argon2.params().block_count(), Block::new());
    }
    let mut made = [0; Params::DEFAULT_OUTPUT_LEN];
    argon2.hash_password_into_with_memory(secret, salt, &mut made, blocks.as_mut_slice()).is_ok()
        // In constant time.
        && Output::new(&made).is_ok_and(|made| made == *expected)
}

/// Whether a hash has the parameters of new ones.
fn is_by(argon2: &Argon2<'_>, hash: &PasswordHash) -> bool {
    let params = argon2.params();
    let costs = |it: &Params| (it.m_cost(), it.t_cost(), it.p_cost());
    hash.algorithm == Algorithm::Argon2id.ident()
        && hash.version == Some(Version::V0x13.into())
        && Params::try_from(hash).is_ok_and(|it| {
            costs(&it) == costs(params)
                && it.keyid().is_empty()
                && it.output_len() == Some(Params::DEFAULT_OUTPUT_LEN)
        })
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
        let argon2 = argon2();
        let params = argon2.params();
        assert_eq!((params.m_cost(), params.t_cost(), params.p_cost()), (19 * 1024, 2, 1));
        let hash = PasswordHash::new(NOBODY).unwrap();
        assert!(is_by(&argon2, &hash));
        assert_eq!(hash.hash.unwrap().as_bytes().len(), Params::DEFAULT_OUTPUT_LEN);
    }

    #[test]
    fn what_was_hashed_before_in_the_same_memory_changes_nothing() {
        let of = |params: Params, secret: &str| {
            let argon2 = Argon2::new(Algorithm::Argon2id, Version::V0x13, params);
            argon2.hash_password(secret.as_bytes()).unwrap()
        };
        let (first, second) = (of(Params::DEFAULT, "135791"), of(Params::DEFAULT, "246802"));
        let weaker = of(Params::new(1024, 1, 1, None).unwrap(), "135791");
        let mut blocks = Blocks::new();
        for (hash, secret, expected) in [
            (&weaker, "135791", true),
            (&first, "135791", true),
            (&second, "135791", false),
            (&second, "246802", true),
            (&weaker, "246802", false),
            (&first, "135791", true),
        ] {
            assert_eq!(is_behind(hash, secret.as_bytes(), &mut blocks), expected, "{hash} {secret}");
            let used = if blocks.is_empty() { 0 } else { Params::DEFAULT.block_count() };
            assert_eq!(blocks.len(), used);
        }
        assert!(blocks.len() == Params::DEFAULT.block_count() && blocks.capacity() >= BLOCKS_OF_A_LANE);
    }

    #[tokio::test]
    async fn only_the_right_secret_verifies() {
        let hashing = Hashing::new(DemoSecrets::Refused).unwrap();
        let hash = hashing.hash("135791".to_owned()).await.unwrap();
        assert!(hashing.verify(Caller::Vehicle, "135791".to_owned(), Some(hash.clone())).await.unwrap());
        assert!(!hashing.verify(Caller::Vehicle, "135792".to_owned(), Some(hash)).await.unwrap());
        assert!(!hashing.verify(Caller::Vehicle, "135791".to_owned(), None).await.unwrap());
        let demo = hashing.hash("246810".to_owned()).await.unwrap();
        assert!(!hashing.verify(Caller::Vehicle, "246810".to_owned(), Some(demo.clone())).await.unwrap());
        let accepting = Hashing::new(DemoSecrets::Accepted).unwrap();
        assert!(accepting.verify(Caller::Vehicle, "246810".to_owned(), Some(demo)).await.unwrap());
    }
}
