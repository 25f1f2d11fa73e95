//! Whether the wall clock and the certificate are right. Neither keeps a display from starting: what is wrong
//! is said, and what is renewed is taken.

use std::time::{Duration, SystemTime};

use crate::clock::Clock;
use crate::web::{Tls, Validity};

const LOOK_EVERY: Duration = Duration::from_secs(5);

/// A clock that was put right may be a little behind what was written before.
const BEHIND: Duration = Duration::from_secs(24 * 3600);

/// Says what is wrong whenever that changes, and takes a certificate that was renewed. It has to be for
/// these hosts. Never ends.
pub async fn watch(tls: Option<Tls>, hosts: Vec<String>, floor: SystemTime, clock: Clock) {
    let mut said = Vec::new();
    loop {
        let (tls, hosts_now) = (tls.clone(), hosts.clone());
        // A disk that hangs holds up nobody else.
        let look = tokio::task::spawn_blocking(move || {
            if let Some(tls) = &tls {
                reload(tls, &hosts_now);
            }
            faults(tls.as_ref(), floor, clock.wall())
        });
        let found = look.await.unwrap_or_default();
        if found != said {
            found.iter().for_each(|fault| tracing::warn!("{fault}"));
            if found.is_empty() {
                tracing::info!("the clock and the certificate are right again");
            }
            said = found;
        }
        tokio::time::sleep(LOOK_EVERY).await;
    }
}

fn reload(tls: &Tls, hosts: &[String]) {
    match tls.reload(hosts) {
        Ok(true) => tracing::info!("the certificate {} was renewed and is used now", tls.path().display()),
        Ok(false) => {}
        Err(error) => tracing::error!("the new certificate is not used, the old one stays: {error}"),
    }
}

/// What is wrong with the clock and the certificate.
fn faults(tls: Option<&Tls>, floor: SystemTime, wall: SystemTime) -> Vec<String> {
    let date = |at| humantime::format_rfc3339_seconds(at);
    let is_behind = wall + BEHIND < floor;
    let clock = is_behind.then(|| {
        format!(
            "the clock shows {}, which is before {}, when this vehicle was in use already: set it. Until then \
             sessions and tokens are judged by the later time",
            date(wall),
            date(floor)
        )
    });
    // By a clock that is wrong nothing can be said of a certificate.
    let certificate = tls.filter(|_| !is_behind).and_then(|tls| {
        let path = tls.path().display();
        match tls.validity(wall) {
            Validity::Good => None,
            Validity::EndsSoon(at) => Some(format!("the certificate {path} ends at {}: renew it", date(at))),
            Validity::Ended(at) => Some(format!(
                "the certificate {path} ended at {}, or the clock is wrong: browsers warn of it. Renew it; \
                 `telltale tls self-signed` makes one",
                date(at)
            )),
            Validity::NotYet(at) => Some(format!(
                "the certificate {path} is valid from {} on, or the clock is wrong: browsers warn of it until then",
                date(at)
            )),
        }
    });
    clock.into_iter().chain(certificate).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::earliest;

    #[test]
    fn a_clock_is_wrong_if_it_is_more_than_a_day_behind_what_was_written() {
        let floor = earliest() + 10 * BEHIND;
        for (wall, is_wrong) in [
            (SystemTime::UNIX_EPOCH, true),
            (floor - BEHIND * 2, true),
            (floor - BEHIND / 2, false),
            (floor, false),
            (floor + BEHIND * 10_000, false),
        ] {
            let found = faults(None, floor, wall);
            assert_eq!(found.len(), usize::from(is_wrong), "{found:?}");
        }
    }
}
