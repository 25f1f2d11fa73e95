//! Guests of a console: people of an OpenID Connect issuer. They are no users here, and their sessions are in memory
//! alone.

use std::fmt;
use std::sync::Arc;

use super::table::Row;
use super::{SessionKind, Token, nanos, span};
use crate::{Role, SESSION_LIFE, Session, Store, StoreError};

/// Open sessions of guests; beyond it the oldest ends.
pub(super) const GUESTS_MAX: usize = 1024;

/// The names of vehicles, with `*` for any letters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern(String);

impl Pattern {
    /// `None`: no vehicle can have such a name.
    pub fn new(text: &str) -> Option<Pattern> {
        let fits = |byte: u8| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'_' | b'-' | b'*');
        let is_one = (1..=64).contains(&text.len()) && text.bytes().all(fits);
        is_one.then(|| Pattern(text.to_owned()))
    }

    fn matches(&self, name: &str) -> bool {
        let Some((first, rest)) = self.0.split_once('*') else { return self.0 == name };
        let Some(mut left) = name.strip_prefix(first) else { return false };
        let mut parts = rest.split('*').peekable();
        while let Some(part) = parts.next() {
            if parts.peek().is_none() {
                return left.ends_with(part);
            }
            let Some(at) = left.find(part) else { return false };
            left = &left[at + part.len()..];
        }
        true
    }
}

/// A role for some vehicles.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grant {
    pub role: Role,
    /// Empty: all vehicles.
    pub vehicles: Vec<Pattern>,
}

impl Grant {
    fn is_for(&self, vehicle: &str) -> bool {
        self.vehicles.is_empty() || self.vehicles.iter().any(|it| it.matches(vehicle))
    }
}

/// What a guest may do: at least one role.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grants(Vec<Grant>);

impl Grants {
    /// `None`: nothing is granted.
    pub fn new(grants: Vec<Grant>) -> Option<Grants> {
        (!grants.is_empty()).then_some(Grants(grants))
    }

    /// The first of its roles, which stands for it where no vehicle is concerned.
    fn role(&self) -> Role {
        self.0[0].role
    }
}

/// As in the audit log: `engineer:shuttle-* control_room`
impl fmt::Display for Grants {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, Grant { role, vehicles }) in self.0.iter().enumerate() {
            let names: Vec<&str> = vehicles.iter().map(|it| it.0.as_str()).collect();
            let (space, colon) = (if index > 0 { " " } else { "" }, if names.is_empty() { "" } else { ":" });
            write!(f, "{space}{}{colon}{}", role.as_str(), names.join(","))?;
        }
        Ok(())
    }
}

impl Session {
    /// Whether its holder sees this vehicle of a fleet. Users who are no guests see all.
    pub fn sees(&self, vehicle: &str) -> bool {
        self.grants.as_ref().is_none_or(|grants| grants.0.iter().any(|it| it.is_for(vehicle)))
    }

    /// Whether its holder has a role for this vehicle of a fleet.
    pub fn has(&self, role: Role, vehicle: &str) -> bool {
        match &self.grants {
            None => self.role == role,
            Some(grants) => grants.0.iter().any(|it| it.role == role && it.is_for(vehicle)),
        }
    }

    /// Whether its holder is a guest, and no user here.
    pub fn is_of_guest(&self) -> bool {
        self.grants.is_some()
    }
}

impl Store {
    /// Opens a session with a new token for a guest. It lives as long as a user's session, and ends with this process.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub fn open_guest(&self, name: &str, grants: Grants) -> Result<(Token, Session), StoreError> {
        let (token, now) = (Token::random()?, self.clock.now());
        let row = Row {
            key: token.key(),
            user: name.to_owned(),
            role: grants.role(),
            kind: SessionKind::Person,
            expires: now + span(SESSION_LIFE),
            used: nanos(now),
            is_late: false,
        };
        let session = self.sessions.add_guest(row, Arc::new(grants), now);
        Ok((token, session))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DemoSecrets;
    use crate::audit::{Action, Record};
    use crate::sessions::SESSIONS_PER_USER;
    use telltale_clock::Clock;
    use telltale_engine::time::Span;

    fn grants(all: &[(Role, &[&str])]) -> Grants {
        let pattern = |text: &&str| Pattern::new(text).unwrap();
        let grant = |(role, names): &(Role, &[&str])| Grant {
            role: *role,
            vehicles: names.iter().map(pattern).collect(),
        };
        Grants::new(all.iter().map(grant).collect()).unwrap()
    }

    #[test]
    fn a_pattern_takes_whole_names() {
        for (pattern, name, is_one) in [
            ("bus-1", "bus-1", true),
            ("bus-1", "bus-11", false),
            ("bus-*", "bus-11", true),
            ("bus-*", "bus-", true),
            ("bus-*", "a-bus-1", false),
            ("*-1", "bus-1", true),
            ("*-1", "bus-1-2", false),
            ("b*s*1", "bus-11", true),
            ("b*s*1", "bus", false),
            ("ab*ba", "aba", false),
            ("*", "bus", true),
            ("**", "bus", true),
        ] {
            assert_eq!(Pattern::new(pattern).unwrap().matches(name), is_one, "{pattern} {name}");
        }
        for none in ["", "Bus", "bus 1", "bus/1", "bus?", &"b".repeat(65)] {
            assert_eq!(Pattern::new(none), None, "{none}");
        }
    }

    #[test]
    fn a_guest_has_each_role_for_its_vehicles_alone() {
        let store = Store::in_memory(Clock::standing().0, DemoSecrets::Refused).unwrap();
        let granted = grants(&[(Role::Engineer, &["bus-*"]), (Role::Authority, &["bus-1", "van"])]);
        assert_eq!(granted.to_string(), "engineer:bus-* authority:bus-1,van");
        let (token, session) = store.open_guest("anna@id", granted).unwrap();
        assert!(store.session(&token).is_some_and(|it| it.is(&session) && it.is_of_guest()));
        assert_eq!(["bus-1", "van", "robot"].map(|it| session.sees(it)), [true, true, false]);
        let roles = |role| ["bus-1", "bus-2", "van", "robot"].map(|it| session.has(role, it));
        assert_eq!(roles(Role::Engineer), [true, true, false, false]);
        assert_eq!(roles(Role::Authority), [true, false, true, false]);
        assert_eq!(roles(Role::ControlRoom), [false; 4]);
    }

    #[tokio::test]
    async fn sessions_of_guests_are_bounded_and_a_change_of_users_ends_none() {
        let (clock, hand) = Clock::standing();
        let store = Store::in_memory(clock, DemoSecrets::Refused).unwrap();
        let open = |name: &str| {
            hand.advance(Span::from_millis(1));
            store.open_guest(name, grants(&[(Role::Engineer, &[])])).unwrap()
        };
        let (first, mut ended) = open("anna@id");
        let all: Vec<Token> = (0..SESSIONS_PER_USER).map(|_| open("anna@id").0).collect();
        assert!(store.session(&first).is_none() && store.session(&all[0]).is_some());
        ended.ended().await;
        store.add_user("ben", Role::Engineer, "three words apart").await.unwrap();
        let user = store.authenticate("ben", "three words apart").await.unwrap().unwrap();
        let (local, session) = store.open_session(&user).await.unwrap();
        assert!(!session.is_of_guest() && session.sees("any") && session.has(Role::Engineer, "any"));
        assert!(store.session(&all[0]).is_some());
        for number in 0..GUESTS_MAX {
            open(&format!("{number}@id"));
        }
        assert!(store.session(&all[0]).is_none() && store.session(&local).is_some());
        let (last, session) = open("last@id");
        store.end_at_once(&session, Record::of(Action::Logout, "1.2.3.4"));
        assert!(store.session(&last).is_none());
        store.change_secret("ben", "three words apart").await.unwrap();
        assert!(store.session(&last).is_none() && store.session(&local).is_none());
    }
}
