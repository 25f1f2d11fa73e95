//! The process in which the library of a transport runs. It executes orders, and passes received samples and
//! discovered endpoints up as bytes.
//!
//! A packet from the network can make the library take all memory or hang. So it runs in a process of its own,
//! and `watch` checks it from outside.

use std::io::Write as _;
use std::os::fd::AsFd as _;
use std::os::unix::net::UnixStream;
use std::process::ExitCode;

use tokio::signal::unix::{SignalKind, signal};
use tokio_util::codec::FramedRead;

use super::dds;
use super::parent::{ToParent, next};
use super::wire::{self, FromChild, Network, Order};
use super::zenoh;

/// `telltale dds-process PARENT MEGABYTES`, with the socket to its parent as standard input.
pub fn process(parent: u32, megabytes: u64) -> ExitCode {
    if let Err(error) = confine(parent, megabytes) {
        tell(&error);
        return ExitCode::FAILURE;
    }
    // Nobody notices when a thread of the library panics: the process would go on deaf.
    std::panic::set_hook(Box::new(|panic| {
        tell(&panic);
        std::process::abort();
    }));
    match std::io::stdin().as_fd().try_clone_to_owned() {
        Ok(socket) => serve(UnixStream::from(socket), true),
        Err(error) => tell(&error),
    }
    // Threads of the library that do not end are left behind.
    std::process::exit(0)
}

/// Says why it ends. Where nobody reads standard error it ends all the same.
fn tell(why: &dyn std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "telltale dds-process: {}", why.to_string().replace('\n', " "));
}

/// Limits the process: no more memory than `megabytes`, no longer life than its parent's, and the first to
/// be killed when the machine runs out of memory.
fn confine(parent: u32, megabytes: u64) -> std::io::Result<()> {
    use rustix::process::{Resource, Rlimit, Signal};
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
    if std::os::unix::process::parent_id() != parent {
        return Err(std::io::Error::other("it is started by `telltale serve`, `demo` and `sim` alone"));
    }
    let limit = |bytes| Rlimit { current: Some(bytes), maximum: Some(bytes) };
    rustix::process::setrlimit(Resource::Data, limit(megabytes << 20))?;
    rustix::process::setrlimit(Resource::Core, limit(0))?;
    // If that cannot be written, the limit above still holds.
    let _ = std::fs::write("/proc/self/oom_score_adj", "500");
    Ok(())
}

/// Executes the orders that come over the socket, until the socket closes.
pub fn serve(socket: UnixStream, alone: bool) {
    let served = tokio::runtime::Builder::new_current_thread().enable_all().build().and_then(|runtime| {
        let lived = runtime.block_on(live(socket, alone));
        runtime.shutdown_background();
        lived
    });
    if let Err(error) = served {
        tracing::error!("the process of DDS or Zenoh cannot be started: {error}");
    }
}

async fn live(socket: UnixStream, alone: bool) -> std::io::Result<()> {
    if alone {
        // The parent decides when to end: a signal to all processes of a service must not end this one
        // before the last messages to the vehicle are published. After this call, these signals are ignored
        // for good.
        let _ = [SignalKind::interrupt(), SignalKind::terminate(), SignalKind::hangup()].map(signal);
    }
    socket.set_nonblocking(true)?;
    let (reading, writing) = tokio::net::UnixStream::from_std(socket)?.into_split();
    let mut orders = FramedRead::new(reading, wire::frames());
    let mut first = next(&mut orders).await.unwrap_or_default().into_iter();
    let Some(Order::Open(network)) = first.next() else { return Ok(()) };
    let mut out = ToParent::new(writing);
    let first = first.collect();
    let ended = match network {
        Network::Dds { domain, interfaces } => {
            dds::child::run(domain, interfaces, first, &mut orders, &mut out).await
        }
        Network::Zenoh { domain, router } => {
            zenoh::child::run(domain, router, first, &mut orders, &mut out).await
        }
    };
    if let Err(reason) = ended {
        out.frame.news(&FromChild::Broken { reason: wire::cut(&reason) });
        let _ = out.send().await;
    }
    Ok(())
}
