//! Processes by the name of their program.

use std::collections::BTreeMap;
use std::path::Path;

use super::processor::Processor;
use super::{Reading, files};
use telltale_engine::model::monitors::ProcessMeasure;
use telltale_engine::model::sample::ProbeOutcome;

/// Processes of one name that are measured.
const SAME_MAX: usize = 4096;
/// Programs that run a script, which then gives the process its name; with or without a version behind.
const INTERPRETERS: [&str; 7] = ["python", "perl", "ruby", "node", "bash", "dash", "sh"];

/// The ticks that each process has taken, by its number and its start, and those of the processor.
#[derive(Debug)]
pub(super) struct Processes {
    ticks: BTreeMap<(u32, u64), u64>,
    processor: Processor,
}

/// The fields of `/proc/PID/stat`.
struct Stat {
    started: u64,
    ticks: u64,
}

pub(super) fn read(
    name: &str,
    measure: Option<ProcessMeasure>,
    proc: &Path,
    before: &mut Option<Processes>,
) -> Reading {
    let (mut found, mut unreadable) = (BTreeMap::new(), false);
    let numbers = files::names(proc)?;
    for pid in numbers.iter().filter_map(|name| name.parse::<u32>().ok()) {
        let folder = proc.join(pid.to_string());
        let command = match files::bytes(&folder.join("cmdline")) {
            Ok(command) => command,
            // It has ended meanwhile.
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            Err(error) => {
                unreadable |= error.kind() == std::io::ErrorKind::PermissionDenied;
                continue;
            }
        };
        if !is_named(&command, name) {
            continue;
        }
        if found.len() >= SAME_MAX {
            return Err(format!("more than {SAME_MAX} processes are called {name}"));
        }
        if let Some(stat) = files::bytes(&folder.join("stat")).ok().as_deref().and_then(running) {
            found.insert((pid, stat.started), stat.ticks);
        }
    }
    if found.is_empty() {
        *before = None;
        // Without the first process, those of other users are hidden too.
        if unreadable || files::bytes(&proc.join("1/stat")).is_err() {
            return Err(format!(
                "no process {name} is seen, and those of other users are hidden; in a service, ProtectProc=default shows them"
            ));
        }
        return Ok(Some(ProbeOutcome::Missed(format!("no process {name}").into())));
    }
    match measure {
        None => Ok(Some(ProbeOutcome::Announced)),
        Some(ProcessMeasure::Memory) => {
            let pids = found.keys().map(|(pid, _)| *pid);
            let kilobytes: Option<Vec<f64>> =
                pids.map(|pid| resident_kb(&proc.join(pid.to_string()))).collect();
            let kilobytes = kilobytes.ok_or_else(|| format!("a process {name} does not tell its memory"))?;
            // The kernel's kB are 1,024 bytes.
            Ok(Some(ProbeOutcome::Measured(kilobytes.iter().sum::<f64>() * 1024.0 / 1e6)))
        }
        Some(ProcessMeasure::Cpu) => {
            let now = Processes { ticks: found, processor: Processor::read(proc)? };
            let share = before.as_ref().map(|before| now.percent_since(before)).transpose()?;
            *before = Some(now);
            Ok(share.map(ProbeOutcome::Measured))
        }
    }
}

impl Processes {
    /// In percent of one core. A process that is new has taken all of its ticks since.
    fn percent_since(&self, before: &Processes) -> Result<f64, String> {
        let taken = self.ticks.iter().map(|(process, ticks)| {
            ticks.saturating_sub(before.ticks.get(process).copied().unwrap_or(0)) as f64
        });
        let share = taken.sum::<f64>() / self.processor.ticks_since(&before.processor)?;
        Ok(100.0 * share * f64::from(self.processor.cores))
    }
}

/// Whether a command runs this program, or an interpreter with this script.
fn is_named(command: &[u8], name: &str) -> bool {
    let mut words = command.split(|byte| *byte == 0);
    let last = |word: &[u8]| {
        String::from_utf8_lossy(word.rsplit(|byte| *byte == b'/').next().unwrap_or(word)).into_owned()
    };
    let Some(program) = words.next().map(last) else { return false };
    if program == name {
        return true;
    }
    let bare = program.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.');
    let script = words.find(|word| !word.starts_with(b"-"));
    INTERPRETERS.contains(&bare) && script.map(last).is_some_and(|script| script == name)
}

/// `None` for a process that has ended and waits to be taken note of, and for an unknown form.
fn running(stat: &[u8]) -> Option<Stat> {
    let text = String::from_utf8_lossy(stat);
    // The name before may have spaces and parentheses.
    let (_, rest) = text.rsplit_once(')')?;
    let fields: Vec<&str> = rest.split_ascii_whitespace().collect();
    let number = |at: usize| fields.get(at)?.parse::<u64>().ok();
    if matches!(*fields.first()?, "Z" | "X" | "x" | "T" | "t") {
        return None;
    }
    Some(Stat { started: number(19)?, ticks: number(11)?.saturating_add(number(12)?) })
}

fn resident_kb(folder: &Path) -> Option<f64> {
    let status = files::bytes(&folder.join("status")).ok()?;
    let status = String::from_utf8_lossy(&status);
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.split_ascii_whitespace().next()?.parse().ok()
}
