//! The flags of `serve` and `demo` for metrics, and the start of their listener.

use std::net::SocketAddr;

use anyhow::bail;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;

use crate::metrics::{self, Reach, Text};

/// Where metrics are if no address is given: on this machine alone.
const LISTEN: &str = "127.0.0.1:9808";

/// Metrics show the vehicle's faults without a login, so there are none unless they are asked for.
#[derive(Debug, Clone, clap::Args)]
pub struct MetricsFlags {
    /// Serve metrics for Prometheus at /metrics of this address [without one: 127.0.0.1:9808]
    ///
    /// They have no login: every program on this machine can read the states of the vehicle there.
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = LISTEN, value_parser = super::address)]
    metrics: Option<SocketAddr>,
    /// Metrics may leave this machine: everybody who reaches their address reads the diagnosis, without a login
    #[arg(long, requires = "metrics")]
    metrics_without_login: bool,
}

/// A listener that is bound and not served yet.
#[derive(Debug)]
pub struct MetricsListener(TcpListener, Reach);

impl MetricsFlags {
    /// Listens, if metrics are asked for.
    ///
    /// # Errors
    /// If the address is beyond this machine and that was not asked for, or if nothing can listen there.
    pub async fn bind(&self) -> anyhow::Result<Option<MetricsListener>> {
        let Some(address) = self.metrics else { return Ok(None) };
        let reach = match (address.ip().is_loopback(), self.metrics_without_login) {
            (true, _) => Reach::Loopback,
            (false, true) => Reach::Everybody,
            (false, false) => bail!(
                "{address} is beyond this machine, and metrics have no login: everybody who reaches it would read \
                 what is wrong with the vehicle. Give a loopback address, such as --metrics {LISTEN}, and let \
                 Prometheus or a proxy with a login read it there, or ask for it by name with \
                 --metrics-without-login"
            ),
        };
        Ok(Some(MetricsListener(super::bind_as(address, "--metrics").await?, reach)))
    }
}

impl MetricsListener {
    pub fn serve(self, text: Text) -> JoinHandle<()> {
        let MetricsListener(listener, reach) = self;
        if let Ok(address) = listener.local_addr() {
            tracing::info!("metrics are on http://{address}/metrics, without a login");
        }
        tokio::spawn(metrics::serve(listener, reach, text))
    }
}
