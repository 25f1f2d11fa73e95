//! Keeps the participants that live known to the DDS library, and replaces a process that has lost one of them.
//!
//! The library takes a participant for gone after one lease without an announcement, drops announcements where many
//! come at once, and matches nothing of a participant that comes back. So it is told once a second of each that lives,
//! by what was heard beside it (`announced`).

use std::net::Ipv4Addr;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::sync::mpsc;

use super::announced::Life;
use super::spdp;
use crate::every;
use crate::transport::ids::{Prefix, prefix};
use crate::transport::inbox::{Loss, Shared};
use crate::transport::wire::{Change, Order};
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::sample_bytes::Guid;

const ROUND: Duration = Duration::from_secs(1);
/// The pause between two copies: of more than eight life signs at once the library drops the rest.
const PAUSE: Duration = Duration::from_millis(5);
/// A younger process is not replaced for a participant that it has lost. So one that nobody can keep, because its lease
/// is shorter than the library's own intervals, costs little.
const AGE_MIN: Span = Span::from_secs(5);
/// The library announces itself once, and after ten seconds again: if the first announcement is lost, the participants that
/// live know nothing of ours for so long.
const ANNOUNCED_AGAIN_FOR: Span = Span::from_secs(10);

/// Runs until the process is over, and says goodbye for it. `port` is where it listens for announcements.
pub async fn run(
    own: Guid,
    port: u16,
    networks: Option<Vec<Ipv4Addr>>,
    shared: Arc<Shared>,
    orders: mpsc::WeakSender<Order>,
) {
    let prefix = prefix(&own);
    tokio::select! {
        _ = shared.ended() => {}
        () = keep(prefix, port, networks.as_deref(), &shared, orders) => {}
    }
    shared.announced.has_left(&prefix);
    // As long as it lives it may announce itself again.
    shared.over().await;
    // One that was killed says nothing, and Fast DDS does not read what the library says: its writers would keep the readers
    // for a lease, and wait for what they acknowledge.
    tell_others(&spdp::goodbye(&own), &prefix, networks.as_deref(), &shared).await;
}

/// Sends a packet about our participant to those that live.
async fn tell_others(packet: &[u8], own: &Prefix, networks: Option<&[Ipv4Addr]>, shared: &Shared) {
    let announced = &*shared.announced;
    let from = match networks {
        Some([ip]) => *ip,
        _ => Ipv4Addr::UNSPECIFIED,
    };
    // The interface may be gone.
    let Ok(socket) = UdpSocket::bind((from, 0)).await else { return };
    for participant in announced.to_repeat(|it| shared.has_discovered(it)).iter().filter(|it| *it != own) {
        for address in announced.addresses(participant) {
            let _ = socket.send_to(packet, address).await;
        }
    }
}

async fn keep(
    own: Prefix,
    port: u16,
    networks: Option<&[Ipv4Addr]>,
    shared: &Shared,
    orders: mpsc::WeakSender<Order>,
) {
    let announced = &*shared.announced;
    let socket = match UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await {
        Ok(socket) => socket,
        Err(error) => {
            tracing::error!("the DDS library cannot be told who lives: {error}");
            return std::future::pending().await;
        }
    };
    let started = announced.now();
    let mut rounds = every(ROUND);
    loop {
        rounds.tick().await;
        announced.note_met(&shared.seen());
        let age = announced.now().since(started);
        let is_old = age >= AGE_MIN;
        if age < ANNOUNCED_AGAIN_FOR
            && let Some(packet) = announced.packet(&own)
        {
            tell_others(&packet, &own, networks, shared).await;
        }
        for (participant, loss) in shared.lost() {
            match judge(loss, announced.life(&participant), shared.seen().has_any_of(&participant)) {
                Judgement::Over => {
                    shared.is_judged(&participant);
                    let Some(orders) = orders.upgrade() else { return };
                    // If there are too many orders, the process is ended anyway.
                    let _ = orders.try_send(Order::Forget { participant });
                }
                Judgement::Replace(why) if is_old => shared.end(why, false),
                Judgement::Replace(_) | Judgement::Wait => {}
            }
        }
        repeat(shared, &own, &socket, port).await;
    }
}

/// Repeats who lives to the library.
async fn repeat(shared: &Shared, own: &Prefix, socket: &UdpSocket, port: u16) {
    let announced = &*shared.announced;
    for participant in announced.to_repeat(|it| shared.has_discovered(it)).iter().filter(|it| *it != own) {
        if let Some(copy) = announced.copy(participant) {
            // The next round tries again.
            let _ = socket.send_to(&copy, (Ipv4Addr::LOCALHOST, port)).await;
            tokio::time::sleep(PAUSE).await;
        }
    }
}

#[derive(Debug, PartialEq, Eq)]
enum Judgement {
    /// It is gone.
    Over,
    Wait,
    /// Only another process can hear it.
    Replace(&'static str),
}

/// Judges a loss by the lease, where `has_endpoints` is whether the library had found any of it.
fn judge(loss: Loss, life: Life, has_endpoints: bool) -> Judgement {
    let heard_again = |heard: Timestamp| heard > loss.at;
    match life {
        // The copy was under way while it left. The library loses it once more.
        Life::Over if loss.change == Change::Copied => Judgement::Wait,
        _ if loss.change != Change::Lost => {
            Judgement::Replace("a participant is back that the DDS library had lost")
        }
        Life::Heard(heard) if heard_again(heard) => {
            Judgement::Replace("a participant lives that the DDS library has lost")
        }
        Life::Heard(_) => Judgement::Wait,
        Life::Over => Judgement::Over,
        Life::Unheard if has_endpoints => Judgement::Replace(
            "whether a participant lives that was lost shows only when it is looked for anew",
        ),
        Life::Unheard => Judgement::Over,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_is_gone_who_lives_or_may_live() {
        let at = Timestamp::from_millis;
        let lost = Loss { at: at(5000), change: Change::Lost };
        let is_replaced = |judgement| matches!(judgement, Judgement::Replace(_));
        assert_eq!(judge(lost, Life::Heard(at(4000)), true), Judgement::Wait);
        assert!(is_replaced(judge(lost, Life::Heard(at(5001)), false)));
        assert_eq!(judge(lost, Life::Over, true), Judgement::Over);
        assert!(is_replaced(judge(lost, Life::Unheard, true)), "the library alone hears it");
        assert_eq!(judge(lost, Life::Unheard, false), Judgement::Over);
        let [back, copied] = [Change::Back, Change::Copied].map(|change| Loss { change, ..lost });
        assert!(is_replaced(judge(back, Life::Over, true)));
        assert!(is_replaced(judge(copied, Life::Heard(at(4000)), true)));
        assert_eq!(judge(copied, Life::Over, true), Judgement::Wait, "it has just left");
    }
}
