//! The last days of a simulated vehicle: one drive in virtual time with a fault on the way, told as if there had been
//! one at each of several times.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::SystemTime;

use anyhow::Context as _;

use super::cast::Member;
use super::simulated::{Incidents, PERIOD, Simulated};
use super::tape::Tape;
use crate::clock::{Clock, unix_ms, wall_at};
use crate::config::Loaded;
use crate::engine::time::{Span, Timestamp};
use crate::fleet::message::{Content, Incident};
use crate::fleet::outbox::{Limits, Outbox, Seed};
use crate::fleet::recordings::Finished;
use crate::fleet::tell::Teller;

/// How long ago the drives began.
const HOURS_AGO: [i64; 4] = [70, 45, 21, 3];

/// A drive: when its fault begins and ends, and when it is over.
const FAULT_FROM: Span = Span::from_secs(50);
const FAULT_TO: Span = Span::from_secs(75);
const LASTS: Span = Span::from_secs(100);
/// Its recording is shown from here on.
const SHOWN_FROM: Span = Span::from_secs(40);

/// Changes are told once a second.
const TOLD_EVERY: u64 = 10;

/// Incidents of one drive have numbers below this.
const NUMBERS: u64 = 100;

/// The number before the first incident of the present.
pub const LAST_NUMBER: u64 = NUMBERS * HOURS_AGO.len() as u64;

/// Puts the past into a vehicle's outbox. Each drive is a run of the program of its own, as on a vehicle that is
/// switched off in between. The last one is recorded; returns the recording of its first incident.
///
/// # Errors
/// Of the disk.
pub fn write(
    member: &Member,
    loaded: &Loaded,
    config: &str,
    folder: &Path,
    clock: Clock,
) -> anyhow::Result<Vec<Finished>> {
    let wall_ms = unix_ms(clock.wall());
    let (mut drives, mut recordings) = (BTreeMap::new(), Vec::new());
    let nonce = getrandom::u32().map_err(|error| anyhow::anyhow!("no random numbers: {error}"))?;
    for (index, hours) in HOURS_AGO.into_iter().enumerate() {
        // Each vehicle has its own hour.
        let began_ms = wall_ms - hours * 3_600_000 - member.seed as i64 * 700_000;
        let first = u32::try_from(began_ms / 1000).context("the clock is wrong")?;
        let mut outbox = Outbox::open(folder, Limits::default(), Seed { first, nonce }, clock.now())?;
        let fault = member.faults[index % member.faults.len()].fault;
        let before = NUMBERS * index as u64;
        let mut recorded = None;
        let drive = if index + 1 == HOURS_AGO.len() {
            let mut vehicle = Simulated::new(member, loaded, Timestamp::ZERO);
            let path = folder.join("last-drive.mcap");
            vehicle.record(Tape::begin(&path, &vehicle, loaded, began_ms, SHOWN_FROM)?);
            let told = drive(&mut vehicle, member, config, fault);
            let first = told.iter().flat_map(|(_, told)| told).find_map(|content| match content {
                Content::Incident(incident) => Some(before + incident.number),
                _ => None,
            });
            recorded = vehicle.take_tape().zip(first).map(|(tape, first)| tape.end(first)).transpose()?;
            drives.insert(fault, told);
            &drives[fault]
        } else {
            drives.entry(fault).or_insert_with(|| {
                drive(&mut Simulated::new(member, loaded, Timestamp::ZERO), member, config, fault)
            })
        };
        for (at_ms, told) in drive {
            let told = told.iter().map(|content| moved(content, began_ms, before, recorded.as_ref()));
            outbox.push(began_ms + at_ms, &told.collect::<Vec<_>>(), clock.now())?;
        }
        recordings.extend(recorded);
    }
    Ok(recordings)
}

/// What is told of a drive that began in 1970, with the milliseconds since then.
fn drive(vehicle: &mut Simulated, member: &Member, config: &str, fault: &str) -> Vec<(i64, Vec<Content>)> {
    let start = Timestamp::ZERO;
    let wall = |at| wall_at(SystemTime::UNIX_EPOCH, start, at);
    let at_ms = |at| unix_ms(wall(at));
    let mut incidents = Incidents::new(0, &member.version, config);
    let mut teller = Teller::default();
    let mut told = Vec::new();
    for period in 0..LASTS.as_millis() / PERIOD.as_millis() {
        let passed = vehicle.at().since(start);
        if passed == FAULT_FROM {
            vehicle.set_fault(fault, true);
        }
        if passed == FAULT_TO {
            vehicle.set_fault(fault, false);
        }
        let snapshot = vehicle.pass(wall);
        let mut news = incidents.news(&snapshot, at_ms);
        if period == 0 {
            news.extend(teller.keyframe(&snapshot));
        } else if period.is_multiple_of(TOLD_EVERY) {
            news.extend(teller.changes(&snapshot));
        }
        if !news.is_empty() {
            told.push((at_ms(vehicle.at()), news));
        }
    }
    told.push((at_ms(vehicle.at()), vec![Content::Goodbye]));
    told
}

/// The same message of a drive that began then: another number of the incident, and its recording once it has ended.
fn moved(content: &Content, began_ms: i64, before: u64, recorded: Option<&Finished>) -> Content {
    match content {
        Content::Incident(incident) => {
            let number = before + incident.number;
            let recorded = recorded.filter(|it| it.incident == number && incident.until.is_some());
            Content::Incident(Incident {
                number,
                since: began_ms + incident.since,
                until: incident.until.map(|until| began_ms + until),
                bytes: recorded.map_or(0, |it| it.bytes),
                sha256: recorded.map(|it| it.sha256.clone()),
                ..incident.clone()
            })
        }
        content => content.clone(),
    }
}
