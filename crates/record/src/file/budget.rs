//! How much a file may unpack to. A few kilobytes can stand for terabytes of zeroes: reading them would take hours,
//! and tell nothing.

/// Every file may unpack to this much.
const FREE_BYTES: u64 = 1 << 30;
/// And to so many bytes for each of its own. Recordings of messages have less than a hundred.
const TIMES: u64 = 256;

/// The bytes that a file may still unpack to. Each place counts once, however often it is read.
#[derive(Debug)]
pub struct Budget<P> {
    left: u64,
    /// The last place that was counted.
    furthest: Option<P>,
    /// The place at which it was spent: what follows is left out.
    end: Option<P>,
}

impl<P: Copy + Ord> Budget<P> {
    pub fn of_file(bytes: u64) -> Budget<P> {
        Budget { left: bytes.saturating_mul(TIMES).saturating_add(FREE_BYTES), furthest: None, end: None }
    }

    #[cfg(test)]
    pub fn of(left: u64) -> Budget<P> {
        Budget { left, furthest: None, end: None }
    }

    /// Whether something at this place may be unpacked.
    pub fn has_room(&self, place: P) -> bool {
        self.end.is_none_or(|end| place <= end)
    }

    /// So much was unpacked there.
    pub fn spend(&mut self, place: P, bytes: u64) {
        if self.furthest.is_some_and(|furthest| place <= furthest) {
            return;
        }
        self.furthest = Some(place);
        match self.left.checked_sub(bytes) {
            Some(left) => self.left = left,
            None => self.end = self.end.or(Some(place)),
        }
    }
}

/// Why the rest of a file is left out.
pub const SPENT: &str = "the file unpacks to far more than a recording does: from here on it is left out";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_place_counts_once_and_what_follows_the_last_is_left_out() {
        let mut budget = Budget::of_file(0);
        for _ in 0..3 {
            budget.spend(1, FREE_BYTES);
        }
        assert!(budget.has_room(2), "it is not overdrawn");
        budget.spend(2, 1);
        assert!(budget.has_room(1) && budget.has_room(2) && !budget.has_room(3));
        budget.spend(1, u64::MAX);
        assert!(budget.has_room(2) && !budget.has_room(3));
        let mut larger = Budget::of_file(10);
        larger.spend(1, FREE_BYTES + 10 * TIMES);
        assert!(larger.has_room(2));
    }
}
