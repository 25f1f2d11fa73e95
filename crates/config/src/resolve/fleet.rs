//! Converts the settings of the fleet: its address, and files beside the configuration.

use std::path::Path;

use super::within;
use crate::decode::Spanned;
use crate::file::fleet::{HubUrl, KBIT_S, KBIT_S_DEFAULT, RawFleet};
use crate::fleet::Fleet;
use telltale_yaml::{Log, Problem};

/// Characters of a vehicle's id in the subjects of the hub.
const ID_CHARS_MAX: usize = 64;

/// `None`: the vehicle belongs to no fleet. Files are relative to the folder `base`.
pub(crate) fn fleet(
    raw: Option<&RawFleet>,
    id: Option<&Spanned<String>>,
    base: &Path,
    log: &mut Log,
) -> Option<Fleet> {
    let raw = raw?;
    match id {
        None => {
            let problem =
                Problem::at(raw.span, "a fleet knows its vehicles by their ids, and this one has none");
            log.push(problem.help("give it one: `vehicle: { id: shuttle-03 }`"));
        }
        Some(id) if !is_subject(&id.value) => {
            let text = format!("a fleet cannot know a vehicle as `{}`", id.value);
            let help = format!("use at most {ID_CHARS_MAX} small letters, digits, `_` and `-`");
            log.push(Problem::at(id.span, text).help(help));
        }
        Some(_) => {}
    }
    let kbit_s = within(raw.max_kbit_s, KBIT_S_DEFAULT as usize, KBIT_S, log);
    let Spanned { value: HubUrl(hub), span } = raw.hub.as_ref()?;
    if !is_hub(hub) {
        let problem = Problem::at(*span, format!("`{hub}` is no address of a hub"));
        log.push(problem.help("write `tls://HOST:PORT`: `tls://hub.example:4222`"));
    }
    let beside = |file: &Spanned<String>| base.join(&file.value);
    Some(Fleet {
        hub: hub.clone(),
        credentials: beside(raw.credentials.as_ref()?),
        ca: beside(raw.ca.as_ref()?),
        max_kbit_s: u32::try_from(kbit_s).unwrap_or(u32::MAX),
        recordings: raw.recordings.unwrap_or_default(),
    })
}

fn is_subject(id: &str) -> bool {
    let is_plain = |it: u8| it.is_ascii_lowercase() || it.is_ascii_digit() || it == b'_' || it == b'-';
    (1..=ID_CHARS_MAX).contains(&id.len()) && id.bytes().all(is_plain)
}

fn is_hub(text: &str) -> bool {
    let parts = text.strip_prefix("tls://").and_then(|rest| rest.rsplit_once(':'));
    parts.is_some_and(|(host, port)| {
        let is_host = !host.is_empty() && !host.contains(['/', '@', ' ', '?', '#']);
        is_host && port.parse::<u16>().is_ok_and(|port| port > 0)
    })
}
