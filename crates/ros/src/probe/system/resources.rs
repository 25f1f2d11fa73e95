//! Memory, disks and temperatures.

use std::collections::BTreeSet;
use std::path::Path;

use super::files;

/// Sensors that a message names.
const NAMED_MAX: usize = 10;

/// The memory that is not available to a new program.
pub(super) fn memory_percent(proc: &Path) -> Result<f64, String> {
    let path = proc.join("meminfo");
    let text = files::text(&path)?;
    let kilobytes = |key: &str| -> Result<f64, String> {
        let line = text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'));
        let number = line.and_then(|rest| rest.split_ascii_whitespace().next()?.parse().ok());
        number.ok_or_else(|| format!("{} does not tell {key}", path.display()))
    };
    let (total, available) = (kilobytes("MemTotal")?, kilobytes("MemAvailable")?);
    if total <= 0.0 {
        return Err(format!("{} tells of no memory", path.display()));
    }
    Ok(100.0 * (1.0 - available / total))
}

/// As `df` counts it: what only root may use is not available.
pub(super) fn disk_percent(path: &str) -> Result<f64, String> {
    let found = rustix::fs::statvfs(path).map_err(|error| format!("{path}: {error}"))?;
    let used = found.f_blocks.saturating_sub(found.f_bfree) as f64;
    let usable = used + found.f_bavail as f64;
    if usable <= 0.0 {
        return Err(format!("{path} is on no disk: its file system has no size"));
    }
    Ok(100.0 * used / usable)
}

/// The hottest of the sensors with this name.
pub(super) fn celsius(sensor: &str, sys: &Path) -> Result<f64, String> {
    let mut known = BTreeSet::new();
    let mut hottest: Option<f64> = None;
    let mut look = |names: [Option<&str>; 2], path: &Path| -> Result<(), String> {
        known.extend(names.into_iter().flatten().map(str::to_owned));
        if names.contains(&Some(sensor)) {
            let text = files::text(path)?;
            let thousandths: f64 =
                text.trim().parse().map_err(|_| format!("{} is no temperature", path.display()))?;
            let celsius = thousandths / 1000.0;
            hottest = Some(hottest.map_or(celsius, |known| known.max(celsius)));
        }
        Ok(())
    };
    let name = |path: &Path| files::text(path).ok().map(|text| text.trim().to_owned());
    let zones = sys.join("class/thermal");
    for zone in files::names(&zones)?.iter().filter(|it| it.starts_with("thermal_zone")) {
        let zone = zones.join(zone);
        look([name(&zone.join("type")).as_deref(), None], &zone.join("temp"))?;
    }
    let chips = sys.join("class/hwmon");
    for chip in files::names(&chips)? {
        let chip = chips.join(chip);
        let of_chip = name(&chip.join("name"));
        for input in files::names(&chip)? {
            let Some(number) = input.strip_prefix("temp").and_then(|it| it.strip_suffix("_input")) else {
                continue;
            };
            let label = name(&chip.join(format!("temp{number}_label")));
            look([of_chip.as_deref(), label.as_deref()], &chip.join(&input))?;
        }
    }
    hottest.ok_or_else(|| {
        let listed: Vec<&str> = known.iter().take(NAMED_MAX).map(|name| &**name).collect();
        match listed.is_empty() {
            true => format!("there is no sensor {sensor}, and no other one"),
            false => format!("there is no sensor {sensor}; there are {}", listed.join(", ")),
        }
    })
}
