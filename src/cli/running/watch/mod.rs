//! `telltale watch`: the components of a vehicle live in a terminal, or as lines for other programs. It reads the
//! stream of snapshots of a running server and changes nothing.

mod connection;
mod freshness;
mod lines;
mod screen;
mod server;
mod snapshot;

use std::io::{BufRead as _, IsTerminal as _, Write as _, stderr, stdin, stdout};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context as _, bail};
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use tokio::sync::mpsc;
use tokio::time::{MissedTickBehavior, interval};

use self::connection::{Connection, News};
use self::freshness::{Freshness, Link};
use self::lines::Lines;
use self::screen::Colours;
use self::server::{Credentials, Server, ServerUrl};
use self::snapshot::Vehicle;
use crate::cli::print::{self, note};
use crate::cli::process::shutdown_signal::ShutdownSignal;
use crate::cli::{EXIT_NO, EXIT_USAGE};
use crate::clock::Clock;
use crate::store::Role;

/// The variable with a program's token, which no list of processes shows.
const TOKEN_VARIABLE: &str = "TELLTALE_TOKEN";
/// What is shown is judged by the clock this often: a frozen screen must not look live.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// How long the keyboard is waited for, so that its thread ends with the program.
const KEYS_EVERY: Duration = Duration::from_millis(100);

/// Watch a vehicle in a terminal: its components, what is broken, and what is requested of it.
///
/// It logs in as a page does, or with a token of `telltale user token`. It changes nothing, but an operator who
/// logs in is in charge of the vehicle: use a developer's or an authority's name. `q` ends it.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale watch http://127.0.0.1:8080 --name developer\n  \
    telltale watch https://shuttle-1.example:8443 --ca /etc/telltale/ca.pem\n  \
    printf 'developer\\ndemo-developer\\n' | telltale watch http://127.0.0.1:8080 --plain\n  \
    TELLTALE_TOKEN=... telltale watch http://127.0.0.1:8080 --json | jq .overall\n\n\
    Exit codes: 0, ended by the user or the reader of a pipe; 1, the server refuses or cannot be reached at \
    the start; 2, wrong usage")]
pub struct Args {
    /// The address of the display, as browsers use it
    #[arg(value_name = "URL")]
    url: ServerUrl,
    /// The user; without it the terminal asks, or the first line of standard input has the name
    #[arg(long, conflicts_with = "token")]
    name: Option<String>,
    /// A program's token instead of a login; better in the variable TELLTALE_TOKEN, which other users cannot see
    #[arg(long)]
    token: Option<String>,
    /// Certificates to trust instead of those of the system, PEM: of an authority, or the server's own
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// Plain HTTP may leave this machine: everybody on the way reads the secret and the diagnosis
    #[arg(long)]
    insecure_http: bool,
    /// A line for each change, for pipes and logs
    #[arg(long, conflicts_with = "json")]
    plain: bool,
    /// The whole snapshots of the server, one a line
    #[arg(long)]
    json: bool,
}

/// How it is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shown {
    Screen,
    Plain,
    Json,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let shown = match (args.plain, args.json) {
        (true, _) => Shown::Plain,
        (_, true) => Shown::Json,
        _ if stdout().is_terminal() => Shown::Screen,
        _ => bail!("standard output is no terminal: give --plain or --json"),
    };
    let server = Server::new(args.url.clone(), args.ca.as_deref(), args.insecure_http)?;
    let credentials = credentials(args)?;
    let runtime = tokio::runtime::Runtime::new().context("the async runtime cannot be started")?;
    let result = runtime.block_on(watch(server, credentials, shown));
    // The thread of the keyboard is not waited for.
    runtime.shutdown_background();
    match result {
        Ok(()) => Ok(ExitCode::SUCCESS),
        Err(error) => {
            note!("telltale: {error:#}");
            Ok(ExitCode::from(if error.is::<Usage>() { EXIT_USAGE } else { EXIT_NO }))
        }
    }
}

/// An error of how it was called, and not of the server.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Usage(String);

/// The token of the command line or the environment; otherwise a name and a secret, which are asked for on a
/// terminal and read from standard input elsewhere.
fn credentials(args: &Args) -> anyhow::Result<Credentials> {
    let variable = || std::env::var(TOKEN_VARIABLE).ok().filter(|_| args.name.is_none());
    if let Some(token) = args.token.clone().or_else(variable) {
        return Ok(Credentials::Token(token.trim().to_owned()));
    }
    let is_asked = stdin().is_terminal();
    let mut lines = stdin().lock().lines();
    let mut line = |what: &str| {
        let line =
            lines.next().with_context(|| format!("standard input ends before the line with the {what}"))?;
        line.context("standard input cannot be read")
    };
    let name = match &args.name {
        Some(name) => name.clone(),
        None => {
            if is_asked {
                write!(stderr(), "Name: ")?;
            }
            line("name")?.trim().to_owned()
        }
    };
    let secret = if is_asked { rpassword::prompt_password("Secret: ")? } else { line("secret")? };
    Ok(Credentials::Login { name, secret })
}

async fn watch(server: Server, credentials: Credentials, shown: Shown) -> anyhow::Result<()> {
    let mut signal = ShutdownSignal::listen()?;
    let clock = Clock::start();
    let session = tokio::select! {
        session = server.enter(credentials) => session?,
        _ = signal.requested() => return Ok(()),
    };
    if session.role == Some(Role::Operator) {
        note!(
            "telltale: you are logged in as an operator, and may be in charge of the vehicle now, as on its page. \
             This session goes on after the end of `watch`, because a logout can lock the vehicle"
        );
    }
    let place = server.url.to_string();
    let connection = Connection::open(server, session, shown == Shown::Json).await?;
    let (news, leaving) = connection.start();
    let ended = tokio::select! {
        ended = show(shown, &place, news, clock) => ended,
        _ = signal.requested() => Ok(()),
    };
    if shown == Shown::Screen {
        ratatui::restore();
    }
    leaving.leave().await;
    match ended {
        // The reader of the pipe has closed it.
        Err(error) if is_broken_pipe(&error) => Ok(()),
        ended => ended,
    }
}

fn nobody_reads() -> anyhow::Error {
    std::io::Error::from(std::io::ErrorKind::BrokenPipe).into()
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let io = error.downcast_ref::<std::io::Error>();
    io.is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe)
}

/// Shows what comes until the user ends it or the server refuses.
async fn show(shown: Shown, place: &str, mut news: mpsc::Receiver<News>, clock: Clock) -> anyhow::Result<()> {
    let mut output = match shown {
        Shown::Screen => Output::Screen(ratatui::try_init().context("the terminal cannot be used")?, keys()),
        Shown::Plain => Output::Plain(Lines::default()),
        Shown::Json => Output::Json,
    };
    let mut looks = interval(LOOK_EVERY);
    looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut link = Link::default();
    let mut vehicle: Option<Vehicle> = None;
    loop {
        let changed = tokio::select! {
            came = news.recv() => match came {
                Some(News::Message(text)) => {
                    link.heard(clock.now());
                    if shown == Shown::Json {
                        if !print::json(&text) {
                            return Err(nobody_reads());
                        }
                        continue;
                    }
                    Vehicle::take(&mut vehicle, &text)?;
                    true
                }
                Some(News::Connected) => {
                    link.connected = true;
                    false
                }
                Some(News::Lost) => {
                    link.connected = false;
                    false
                }
                Some(News::Refused(why)) => bail!(why),
                None => bail!("the connection has ended"),
            },
            () = output.quit() => return Ok(()),
            _ = looks.tick() => false,
        };
        let freshness = link.freshness(clock.now());
        output.show(place, vehicle.as_ref(), freshness, changed)?;
    }
}

enum Output {
    Screen(DefaultTerminal, mpsc::Receiver<()>),
    Plain(Lines),
    Json,
}

impl Output {
    /// Waits until the user ends it by a key.
    async fn quit(&mut self) {
        match self {
            // Without a keyboard a signal ends it.
            Output::Screen(_, keys) => {
                if keys.recv().await.is_none() {
                    std::future::pending().await
                }
            }
            _ => std::future::pending().await,
        }
    }

    fn show(
        &mut self,
        place: &str,
        vehicle: Option<&Vehicle>,
        freshness: Freshness,
        changed: bool,
    ) -> anyhow::Result<()> {
        match self {
            Output::Screen(terminal, _) => {
                let colours = Colours::of_environment();
                terminal.draw(|frame| screen::draw(frame, place, vehicle, freshness, colours))?;
            }
            Output::Plain(lines) => {
                if !lines.changes(vehicle.filter(|_| changed), freshness).iter().all(|line| print::line(line))
                {
                    return Err(nobody_reads());
                }
            }
            Output::Json => {}
        }
        Ok(())
    }
}

/// Reads the keyboard in a thread of its own until `q`, Escape or Ctrl-C.
fn keys() -> mpsc::Receiver<()> {
    let (quit, quits) = mpsc::channel(1);
    std::thread::spawn(move || {
        while !quit.is_closed() {
            match event::poll(KEYS_EVERY).and_then(|is_there| is_there.then(event::read).transpose()) {
                Ok(Some(Event::Key(key))) if key.kind == KeyEventKind::Press => {
                    let ends = match key.code {
                        KeyCode::Char('q') | KeyCode::Esc => true,
                        KeyCode::Char('c') => key.modifiers.contains(KeyModifiers::CONTROL),
                        _ => false,
                    };
                    // A full queue has the request already.
                    if ends && quit.try_send(()).is_ok() {
                        return;
                    }
                }
                Ok(_) => {}
                Err(_) => return,
            }
        }
    });
    quits
}
