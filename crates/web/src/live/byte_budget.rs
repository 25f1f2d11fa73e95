//! Limits the bytes that browsers and programs may send over their sockets: a budget for each socket and
//! for all sockets of one account. The shortest frame has six bytes, so this bounds the number of frames, too.

use std::collections::HashMap;
use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, ReadBuf};
use tokio::sync::watch;

use telltale_clock::Clock;
use telltale_engine::time::Timestamp;

/// A token bucket of bytes. A page sends about 600 bytes a second.
#[derive(Debug)]
struct Rate {
    burst_bytes: u64,
    bytes_per_s: u64,
}

const SOCKET: Rate = Rate { burst_bytes: 64 * 1024, bytes_per_s: 8 * 1024 };
const ACCOUNT: Rate = Rate { burst_bytes: 1024 * 1024, bytes_per_s: 128 * 1024 };

#[derive(Debug)]
struct Bucket {
    rate: &'static Rate,
    left_bytes: u64,
    filled: Timestamp,
}

impl Bucket {
    fn new(rate: &'static Rate, now: Timestamp) -> Bucket {
        Bucket { rate, left_bytes: rate.burst_bytes, filled: now }
    }

    /// Takes bytes out of the bucket. Returns whether it held as many.
    fn spend(&mut self, now: Timestamp, bytes: u64) -> bool {
        let refill = now.since(self.filled).as_millis() * self.rate.bytes_per_s / 1000;
        if refill > 0 {
            self.left_bytes = (self.left_bytes + refill).min(self.rate.burst_bytes);
            self.filled = now;
        }
        let is_there = bytes <= self.left_bytes;
        self.left_bytes = self.left_bytes.saturating_sub(bytes);
        is_there
    }
}

/// The buckets of the accounts with open sockets, by name.
#[derive(Debug, Default)]
pub struct Accounts(Mutex<HashMap<Arc<str>, Weak<Mutex<Bucket>>>>);

impl Accounts {
    fn of(&self, user: &Arc<str>, now: Timestamp) -> Arc<Mutex<Bucket>> {
        let mut accounts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        accounts.retain(|_, bucket| bucket.strong_count() > 0);
        if let Some(bucket) = accounts.get(user).and_then(Weak::upgrade) {
            return bucket;
        }
        let bucket = Arc::new(Mutex::new(Bucket::new(&ACCOUNT, now)));
        accounts.insert(user.clone(), Arc::downgrade(&bucket));
        bucket
    }
}

/// Counts the bytes of one connection, from the moment when it becomes a socket.
#[derive(Debug, Clone)]
pub struct Meter(Arc<Mutex<Option<Budget>>>, watch::Sender<bool>);

#[derive(Debug)]
struct Budget {
    clock: Clock,
    socket: Bucket,
    account: Arc<Mutex<Bucket>>,
}

impl Default for Meter {
    fn default() -> Meter {
        Meter(Arc::default(), watch::channel(false).0)
    }
}

impl Meter {
    /// Starts counting for this user. The returned flag turns true when a budget is spent.
    pub fn begin(&self, accounts: &Accounts, user: &Arc<str>, clock: Clock) -> watch::Receiver<bool> {
        let now = clock.now();
        let budget = Budget { clock, socket: Bucket::new(&SOCKET, now), account: accounts.of(user, now) };
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(budget);
        self.1.subscribe()
    }

    fn count(&self, bytes: usize) {
        let mut budget = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(budget) = budget.as_mut() else { return };
        let (now, bytes) = (budget.clock.now(), bytes as u64);
        let mut account = budget.account.lock().unwrap_or_else(PoisonError::into_inner);
        let is_within = [budget.socket.spend(now, bytes), account.spend(now, bytes)];
        if is_within.contains(&false) {
            self.1.send_replace(true);
        }
    }

    fn is_over(&self) -> bool {
        *self.1.borrow()
    }
}

/// The reading half of a connection. It is read no more once it has sent too much.
#[derive(Debug)]
pub struct Metered<S> {
    stream: S,
    meter: Meter,
}

impl<S> Metered<S> {
    pub fn new(stream: S, meter: Meter) -> Metered<S> {
        Metered { stream, meter }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Metered<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        // The task of the socket is told by the meter, and ends it.
        if self.meter.is_over() {
            return Poll::Pending;
        }
        let before = buffer.filled().len();
        ready!(Pin::new(&mut self.stream).poll_read(cx, buffer))?;
        self.meter.count(buffer.filled().len() - before);
        Poll::Ready(Ok(()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_engine::time::Span;

    #[test]
    fn a_page_is_within_its_budget_for_a_day_and_a_flood_is_not() {
        let (clock, hand) = Clock::with_hand();
        let (accounts, user): (Accounts, Arc<str>) = (Accounts::default(), "anna".into());
        let pages: Vec<Meter> = (0..100).map(|_| Meter::default()).collect();
        for page in &pages {
            page.begin(&accounts, &user, clock);
        }
        for _ in 0..24 * 3600 {
            hand.advance(Span::from_secs(1));
            pages.iter().for_each(|page| page.count(1000));
        }
        assert!(!pages.iter().any(Meter::is_over));
        pages[0].count(60 * 1024);
        assert!(!pages[0].is_over());
        pages[0].count(10 * 1024);
        assert!(pages[0].is_over() && !pages[1].is_over());
        // All of them together have less than each for itself would.
        pages[1..].iter().for_each(|page| page.count(32 * 1024));
        assert!(!pages[1].is_over() && pages[99].is_over());
        let other = Meter::default();
        let over = other.begin(&accounts, &"bert".into(), clock);
        other.count(32 * 1024);
        assert!(!*over.borrow(), "another account");
    }

    #[test]
    fn only_sockets_are_counted_and_only_accounts_with_sockets_are_kept() {
        let accounts = Accounts::default();
        let meter = Meter::default();
        meter.count(usize::MAX);
        assert!(!meter.is_over());
        for number in 0..1000 {
            Meter::default().begin(&accounts, &format!("user-{number}").into(), Clock::start());
        }
        assert!(accounts.0.lock().unwrap().len() <= 1);
    }
}
