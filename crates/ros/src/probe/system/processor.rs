//! The load of the cores, from the kernel's counters in `/proc/stat`.

use std::path::Path;

use super::files;

/// The counters of all cores together since the start of the computer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Processor {
    all: u64,
    /// Idle, also while waiting for a disk.
    idle: u64,
    pub(super) cores: u32,
}

impl Processor {
    pub(super) fn read(proc: &Path) -> Result<Processor, String> {
        let path = proc.join("stat");
        let text = files::text(&path)?;
        let unclear = || format!("{} has another form than expected", path.display());
        let sum = text.lines().find_map(|line| line.strip_prefix("cpu ")).ok_or_else(unclear)?;
        // user, nice, system, idle, iowait, irq, softirq, steal; guests are counted in the first two.
        let parts: Option<Vec<u64>> =
            sum.split_ascii_whitespace().take(8).map(|part| part.parse().ok()).collect();
        let parts = parts.filter(|parts| parts.len() >= 4).ok_or_else(unclear)?;
        let is_core = |line: &&str| {
            line.strip_prefix("cpu").is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
        };
        let cores = text.lines().filter(is_core).count().max(1) as u32;
        let all = parts.iter().fold(0_u64, |sum, part| sum.saturating_add(*part));
        let idle = parts[3].saturating_add(parts.get(4).copied().unwrap_or(0));
        Ok(Processor { all, idle, cores })
    }

    /// The time that passed on all cores together, in the kernel's ticks.
    pub(super) fn ticks_since(&self, before: &Processor) -> Result<f64, String> {
        match self.all.saturating_sub(before.all) {
            0 => Err("the kernel's counters of time stand still".to_owned()),
            ticks => Ok(ticks as f64),
        }
    }

    pub(super) fn busy_percent(&self, before: &Processor) -> Result<f64, String> {
        let idle = self.idle.saturating_sub(before.idle) as f64;
        Ok((100.0 * (1.0 - idle / self.ticks_since(before)?)).max(0.0))
    }
}
