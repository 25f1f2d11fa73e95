//! `telltale replay --serve`: shows a recording in the display, on this computer alone.

use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context as _, anyhow, bail};

use super::Args;
use crate::cli::print::{note, say};
use crate::cli::process::log;
use crate::cli::process::shutdown_signal::ShutdownSignal;
use crate::cli::running::server::{self, url};
use crate::clock::Clock;
use crate::engine::model::{Model, Parts, StageModel};
use crate::replay::{Playback, ReplayError, Run};
use crate::runtime;
use crate::store::{DemoSecrets, Role, Store};
use crate::web::{self, AppState, Origins, ServedFile, ServedFiles, Settings};

/// The user who may look.
const USER: &str = "developer";

/// Opens the recording; each viewer has an engine of their own.
type Open = dyn Fn() -> Result<Run, ReplayError> + Send + Sync;

pub fn run(args: &Args, name: String, open: Arc<Open>) -> anyhow::Result<ExitCode> {
    log::start("warn");
    if !args.listen.ip().is_loopback() {
        bail!("{} is beyond this computer: a recording is shown on a loopback address alone", args.listen);
    }
    // What cannot be replayed is told now, not by a page.
    let mut playback = Playback::open(open()?).with_context(|| name.clone())?;
    if playback.snapshot().is_none() {
        bail!("{name} has no state of the engine to begin with");
    }
    let missing = playback.gaps().sentences(playback.facts());
    missing.iter().for_each(|sentence| note!("telltale: {sentence}"));
    playback.unheard_sentences().iter().for_each(|sentence| note!("telltale: {sentence}"));
    drop(playback);
    tokio::runtime::Runtime::new()
        .context("the async runtime cannot be started")?
        .block_on(serve(args.listen, ServedFile::new(name, String::new(), move || open())))
}

async fn serve(listen: SocketAddr, file: ServedFile) -> anyhow::Result<ExitCode> {
    let mut signal = ShutdownSignal::listen()?;
    let listener = server::bind(listen).await?;
    let address = listener.local_addr().context("the listener has no address")?;
    let clock = Clock::start();
    let store = Store::in_memory(clock, DemoSecrets::Refused)?;
    let password = password()?;
    store.add_user(USER, Role::Developer, &password).await?;
    say!("{} is shown at {}", file.name, url(address, false));
    say!("Log in as `{USER}` with the password `{password}`. Ctrl-C ends it.");
    let origins = Origins::of_listener(address, false);
    let settings = Settings { replayed: Some(ServedFiles::one(file)), ..Settings::plain(origins, false) };
    // Somebody can only log in at an engine. Nothing shows this one: its model is empty.
    let model = Model::new(Parts::empty("", StageModel::None)).map_err(|cycle| anyhow!("{cycle:?}"))?;
    let app = AppState::new(runtime::start(Arc::new(model), clock), store, clock, settings);
    web::serve(listener, None, app, signal.requested()).await?;
    Ok(ExitCode::SUCCESS)
}

/// A password that nobody can guess, in letters that cannot be mistaken.
fn password() -> anyhow::Result<String> {
    const LETTERS: &[u8; 32] = b"abcdefghijkmnpqrstuvwxyz23456789";
    let mut random = [0; 16];
    getrandom::fill(&mut random).context("this system gives no random numbers")?;
    Ok(random.iter().map(|byte| char::from(LETTERS[usize::from(byte % 32)])).collect())
}
