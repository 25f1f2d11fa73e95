//! Streams of messages inside the shuttle, and the noise of measured values.

/// A stream of messages: when the last one arrived.
#[derive(Debug, Clone)]
pub(crate) struct Feed {
    period_ms: u64,
    next_ms: u64,
    last_ms: u64,
}

impl Feed {
    pub fn new(period_ms: u64) -> Feed {
        Feed { period_ms, next_ms: 0, last_ms: 0 }
    }

    /// The source keeps its rhythm whether or not its messages arrive. Returns whether one arrived now.
    pub fn run(&mut self, now_ms: u64, jitter_ms: u64, arrives: bool) -> bool {
        if self.next_ms + jitter_ms > now_ms {
            return false;
        }
        self.next_ms += self.period_ms;
        if arrives {
            self.last_ms = now_ms;
        }
        arrives
    }

    pub fn age_ms(&self, now_ms: u64) -> u64 {
        now_ms - self.last_ms
    }
}

/// SplitMix64: good enough for plausible numbers, and the same everywhere.
#[derive(Debug, Clone)]
pub(crate) struct Noise {
    state: u64,
}

impl Noise {
    pub fn new(seed: u64) -> Noise {
        Noise { state: seed }
    }

    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn up_to(&mut self, most: u64) -> u64 {
        self.next() % (most + 1)
    }

    /// Between `-spread` and `spread`.
    pub fn around(&mut self, spread: f64) -> f64 {
        let unit = (self.next() >> 11) as f64 / (1u64 << 53) as f64;
        (unit * 2.0 - 1.0) * spread
    }
}
