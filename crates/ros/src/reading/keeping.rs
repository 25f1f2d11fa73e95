//! Decides which messages of a topic a recording keeps whole. A monitor that only counts a point cloud needs none of
//! its points.

use telltale_engine::time::{Span, Timestamp};
use telltale_msg::subscription::{Keeping, LARGE_BYTES_PER_S};

/// A topic's bytes are counted over this time.
const MEASURED_OVER: Span = Span::from_secs(2);

/// The decisions for the messages so far.
#[derive(Debug, Default)]
pub struct Kept {
    /// With [`Keeping::Every`]: when the next message may be.
    from: Timestamp,
    since: Timestamp,
    bytes: u64,
    is_large: bool,
}

impl Kept {
    /// Whether a message is recorded whole.
    pub fn is_whole(&mut self, keeping: Keeping, bytes: usize, now: Timestamp) -> bool {
        match keeping {
            Keeping::Whole => true,
            Keeping::Never => false,
            Keeping::Every(_) if now < self.from => false,
            Keeping::Every(every) => {
                self.from = now + every;
                true
            }
            Keeping::UnlessLarge => {
                self.measure(bytes as u64, now);
                !self.is_large
            }
        }
    }

    /// A topic is large at once, and small again after a time with less than half of that.
    fn measure(&mut self, bytes: u64, now: Timestamp) {
        let passed_ms = now.since(self.since).as_millis();
        if passed_ms >= MEASURED_OVER.as_millis() {
            let large = if self.is_large { LARGE_BYTES_PER_S / 2 } else { LARGE_BYTES_PER_S };
            self.is_large = self.bytes.saturating_mul(1000) / passed_ms > large;
            (self.since, self.bytes) = (now, 0);
        }
        self.bytes += bytes;
        self.is_large |= self.bytes.saturating_mul(1000) > LARGE_BYTES_PER_S * MEASURED_OVER.as_millis();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many of ten messages a second are whole, in each of these seconds.
    fn whole(keeping: Keeping, bytes: &[usize]) -> Vec<usize> {
        let mut kept = Kept::default();
        let whole = |(second, bytes): (usize, &usize)| {
            let at = |tenth: u64| Timestamp::from_millis(10_000 + 1000 * second as u64 + 100 * tenth);
            (0..10).filter(|&tenth| kept.is_whole(keeping, *bytes, at(tenth))).count()
        };
        bytes.iter().enumerate().map(whole).collect()
    }

    #[test]
    fn large_messages_are_kept_whole_only_where_somebody_asked_for_them() {
        const LARGE: usize = 5_000_000;
        let small = LARGE_BYTES_PER_S as usize / 20;
        assert_eq!(whole(Keeping::Whole, &[LARGE; 3]), [10, 10, 10]);
        assert_eq!(whole(Keeping::Never, &[10; 2]), [0, 0]);
        assert_eq!(whole(Keeping::UnlessLarge, &[small; 4]), [10, 10, 10, 10]);
        assert_eq!(whole(Keeping::UnlessLarge, &[LARGE; 3]), [0, 0, 0]);
        let changes = whole(Keeping::UnlessLarge, &[small, LARGE, LARGE, 10, 10, 10, 10, 10]);
        assert_eq!((changes[0], changes[2], changes[7]), (10, 0, 10), "{changes:?}");
        assert_eq!(whole(Keeping::Every(Span::from_millis(500)), &[LARGE; 2]), [2, 2]);
    }
}
