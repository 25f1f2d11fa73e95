//! How long something takes, as a histogram that Prometheus reads.

use prometheus_client::metrics::histogram::Histogram;

use telltale_engine::time::Span;

/// The upper bounds of the buckets in seconds: from a fast turn of the engine to a disk that hangs.
const BUCKETS_S: [f64; 14] =
    [0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0];

/// Clones count into the same histogram.
#[derive(Debug, Clone)]
pub struct Latency(Histogram);

impl Default for Latency {
    fn default() -> Latency {
        Latency(Histogram::new(BUCKETS_S))
    }
}

impl Latency {
    pub fn observe(&self, took: Span) {
        self.0.observe(took.as_nanos() as f64 / 1e9);
    }

    pub const fn histogram(&self) -> &Histogram {
        &self.0
    }
}
