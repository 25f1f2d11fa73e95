//! Watches a DDS process from outside: whether it sends beats, hears itself through the network, and keeps to
//! its memory limit. An ill process is ended.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

use super::child;
use super::inbox::Shared;
use super::memory::resident_megabytes;
use crate::DdsProcess;

/// The interval of looks.
const LOOK: Duration = Duration::from_millis(250);
/// A process that says nothing at so many consecutive looks is ended. Looks are counted, not time, so that
/// a program that was stopped itself does not blame the process.
const SILENT_MAX: u32 = 8;
/// A process is ended if the newest of its beats (four a second) that it heard is so many beats old.
/// Hearing others is no excuse: in a flood everything is heard late.
const LATE_MAX: u64 = 8;
/// The same for a process that has heard none of its beats yet, if an earlier one heard itself here.
const NEVER_HEARD_MAX: u64 = 12;
/// A participant on this network has heard itself. Not every network permits that.
static HEARS_ITSELF: AtomicBool = AtomicBool::new(false);
/// Looks at which a process may still be ending by itself.
const ENDING_MAX: u32 = 5;

/// Whether the network lets a participant hear itself.
pub fn is_self_heard() -> bool {
    HEARS_ITSELF.load(Ordering::Relaxed)
}

/// Why a participant is unusable.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ended {
    pub reason: Box<str>,
    /// The process was ill or died: nothing came from DDS any more.
    pub ill: bool,
}

/// Ends the process when it is dropped.
#[derive(Debug)]
pub struct Watch {
    close: mpsc::Sender<()>,
}

impl Watch {
    /// Lets the process end by itself, if it does so soon.
    pub fn close(&self) {
        // An error means that it is gone.
        let _ = self.close.send(());
    }
}

/// The way in which the DDS library is run.
enum Runner {
    Process(Child),
    Thread(std::thread::JoinHandle<()>),
}

/// Starts the DDS process at the other end of `socket`, and a thread that watches it. The thread that
/// starts a process must live as long as the process: otherwise the kernel takes the parent for dead.
///
/// # Errors
/// Neither thread nor process can be started.
pub fn start(how: DdsProcess, socket: UnixStream, shared: Arc<Shared>) -> io::Result<Watch> {
    let (close, closing) = mpsc::channel();
    let (started, starting) = mpsc::channel();
    std::thread::Builder::new().name("dds-watch".to_owned()).spawn(move || {
        let mut runner = match run(how, socket) {
            Ok(runner) => runner,
            Err(error) => return drop(started.send(Err(error))),
        };
        let _ = started.send(Ok(()));
        look_after(&mut runner, how, &shared, &closing);
        runner.end();
        shared.set_over();
    })?;
    let gone = |_| Err(io::Error::other("the thread that starts the process has failed"));
    starting.recv().unwrap_or_else(gone)?;
    Ok(Watch { close })
}

fn run(how: DdsProcess, socket: UnixStream) -> io::Result<Runner> {
    let DdsProcess::Child { megabytes, log } = how else {
        let thread = std::thread::Builder::new().name("dds".to_owned());
        return thread.spawn(move || child::serve(socket, false)).map(Runner::Thread);
    };
    // The program file that is running, even if another version lies at its path now.
    let mut command = Command::new("/proc/self/exe");
    command.arg0("telltale").args(["--log", log, "dds-process"]);
    command.arg(std::process::id().to_string()).arg(megabytes.to_string());
    command.stdin(Stdio::from(OwnedFd::from(socket))).stdout(Stdio::null());
    // Its threads take turns, and a heap for each of them costs memory.
    command.env("MALLOC_ARENA_MAX", "1");
    // The memory of large messages goes back to the system: by default glibc keeps it once some were freed.
    command.env("MALLOC_MMAP_THRESHOLD_", "524288");
    // Signals of a terminal to all processes are for the program only.
    command.process_group(0).spawn().map(Runner::Process)
}

/// Runs until the process has ended, is ill, or is to end.
fn look_after(runner: &mut Runner, how: DdsProcess, shared: &Shared, closing: &mpsc::Receiver<()>) {
    let mut health = Health::default();
    loop {
        if health.last.heard > 0 {
            HEARS_ITSELF.store(true, Ordering::Relaxed);
        }
        let closed = match closing.recv_timeout(LOOK) {
            Err(mpsc::RecvTimeoutError::Timeout) => false,
            Ok(()) | Err(mpsc::RecvTimeoutError::Disconnected) => true,
        };
        if let Some(reason) = runner.has_ended() {
            return shared.end(&reason, true);
        }
        if closed {
            for _ in 0..ENDING_MAX * 10 {
                if runner.has_ended().is_some() {
                    return;
                }
                std::thread::sleep(LOOK / 10);
            }
            return;
        }
        if shared.has_ended() {
            return;
        }
        let told = ProcessFigures {
            is_ready: shared.is_ready.load(Ordering::Relaxed),
            beats: shared.beats.load(Ordering::Relaxed),
            heard: shared.heard.load(Ordering::Relaxed),
            megabytes: runner.megabytes(),
        };
        if let Some(reason) = health.look(told, how, is_self_heard()) {
            return shared.end(&reason, true);
        }
    }
}

impl Runner {
    fn has_ended(&mut self) -> Option<String> {
        match self {
            Runner::Process(child) => match child.try_wait() {
                Ok(Some(status)) => Some(describe(status)),
                Ok(None) => None,
                Err(error) => Some(format!("nothing is known of it: {error}")),
            },
            Runner::Thread(thread) => thread.is_finished().then(|| "its thread has ended".to_owned()),
        }
    }

    /// A thread cannot be ended; it notices that its socket is closed.
    fn end(&mut self) {
        if let Runner::Process(child) = self {
            // It may be gone already.
            let _ = child.kill();
            let _ = child.wait();
        }
    }

    fn megabytes(&self) -> u64 {
        let Runner::Process(child) = self else { return 0 };
        resident_megabytes(&child.id().to_string())
    }
}

fn describe(status: ExitStatus) -> String {
    match status.signal() {
        // SIGABRT, as when memory is refused.
        Some(6) => "it was aborted: its memory is used up, or its library failed".to_owned(),
        Some(signal) => format!("it was ended by signal {signal}"),
        None => "it has ended".to_owned(),
    }
}

/// The figures of a process at one look.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct ProcessFigures {
    /// It has made its participant.
    is_ready: bool,
    beats: u64,
    heard: u64,
    megabytes: u64,
}

/// Judges a process by its figures, look by look.
#[derive(Debug, Default)]
struct Health {
    last: ProcessFigures,
    silent: u32,
}

impl Health {
    fn look(&mut self, told: ProcessFigures, how: DdsProcess, hears_itself: bool) -> Option<String> {
        let last = std::mem::replace(&mut self.last, told);
        if let DdsProcess::Child { megabytes, .. } = how
            && told.megabytes > u64::from(megabytes)
        {
            return Some(format!("it takes {} MB of memory; its limit is {megabytes}", told.megabytes));
        }
        // The caller waits only for a limited time for the participant.
        self.silent = if told.beats != last.beats || !told.is_ready { 0 } else { self.silent + 1 };
        if self.silent >= SILENT_MAX {
            return Some("it does not answer".to_owned());
        }
        let late = told.beats.saturating_sub(told.heard);
        let (patience, reason) = match told.heard {
            0 => (NEVER_HEARD_MAX, "it hears nothing, not even itself"),
            _ => (LATE_MAX, "it hears nothing any more, or late"),
        };
        (hears_itself && late >= patience).then(|| reason.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const READY: ProcessFigures = ProcessFigures { is_ready: true, beats: 0, heard: 0, megabytes: 0 };
    const HOW: DdsProcess = DdsProcess::Child { megabytes: 100, log: "text" };

    /// The look at which it is found ill, and why; `None` within 30 looks.
    fn found_ill(hears_itself: bool, told: impl Fn(u64) -> ProcessFigures) -> Option<(u64, String)> {
        let mut health = Health::default();
        (0..30).find_map(|look| Some((look, health.look(told(look), HOW, hears_itself)?)))
    }

    #[test]
    fn a_process_that_is_well_is_left_alone() {
        assert_eq!(found_ill(true, |look| ProcessFigures { beats: look, heard: look, ..READY }), None);
        // Still making its participant.
        assert_eq!(found_ill(true, |_| ProcessFigures::default()), None);
        // On a network that lets nobody hear itself.
        assert_eq!(found_ill(false, |look| ProcessFigures { beats: look, ..READY }), None);
        // The newest beat that it heard is a second old now and then.
        let slow = |look| ProcessFigures { beats: look, heard: look / 5 * 5, ..READY };
        assert_eq!(found_ill(true, slow), None);
    }

    #[test]
    fn what_is_silent_deaf_or_too_large_is_found() {
        let silent = found_ill(true, |look| ProcessFigures { beats: look.min(4), heard: look, ..READY });
        assert_eq!(silent, Some((12, "it does not answer".to_owned())));
        assert_eq!(
            found_ill(true, |_| READY),
            Some((7, "it does not answer".to_owned())),
            "before its first beat"
        );
        let deaf =
            |heard: u64| move |look: u64| ProcessFigures { beats: look, heard: look.min(heard), ..READY };
        let found = |look, reason: &str| Some((look, reason.to_owned()));
        assert_eq!(found_ill(true, deaf(4)), found(12, "it hears nothing any more, or late"));
        let never = "it hears nothing, not even itself";
        assert_eq!(found_ill(true, deaf(0)), found(12, never), "from its beginning");
        // It still hears, but falls behind by half of the time.
        let behind = |look| ProcessFigures { beats: look, heard: look.div_ceil(2), ..READY };
        assert_eq!(found_ill(true, behind), found(16, "it hears nothing any more, or late"));
        let large = |look| ProcessFigures { beats: look, heard: look, megabytes: 99 + look, ..READY };
        assert_eq!(
            found_ill(true, large),
            Some((2, "it takes 101 MB of memory; its limit is 100".to_owned()))
        );
    }
}
