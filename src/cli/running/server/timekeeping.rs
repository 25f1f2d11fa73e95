//! Watches the wall clock, the certificate, the recording and the line to the fleet. Their faults are reported and keep no display from
//! starting; a renewed certificate is taken.

use std::fmt::Display;
use std::time::{Duration, SystemTime};

use tokio::sync::{mpsc, watch};

use crate::clock::Clock;
use crate::engine::input::{Input, Upkeep};
use crate::engine::text::Text;
use crate::fleet::status::Status;
use crate::record::recorder::{Meter, Recorder};
use crate::record::retention::size;
use crate::record::writer::Fault;
use crate::runtime::Stamped;
use crate::web::{CertificateValidity, Tls};

const LOOK_EVERY: Duration = Duration::from_secs(5);

/// A corrected clock may be behind earlier records by this much.
const BEHIND: Duration = Duration::from_secs(24 * 3600);

/// The parts that are watched beside the clock and the certificate.
#[derive(Debug, Clone, Default)]
pub struct Watched {
    pub recording: Option<WatchedRecording>,
    /// Whether the fleet hears of this vehicle.
    pub fleet: Option<watch::Receiver<Status>>,
}

/// What is watched of the recording.
#[derive(Debug, Clone)]
pub struct WatchedRecording {
    pub recorder: Recorder,
    /// Why nothing can be recorded.
    pub fault: watch::Receiver<Fault>,
    /// Kept recordings take more than they may.
    pub kept_too_much: watch::Receiver<bool>,
    /// `recording.topics` names more topics than are recorded.
    pub unrecorded: watch::Receiver<bool>,
}

/// Reports faults of the clock, the certificate, the recording and the fleet to the log and the engine whenever they
/// change, and takes a renewed certificate for these hosts. Never ends.
pub async fn watch(
    tls: Option<Tls>,
    hosts: Vec<String>,
    floor: SystemTime,
    watched: Watched,
    inputs: mpsc::Sender<Stamped>,
    clock: Clock,
) {
    let (found, of_time) = watch::channel(Upkeep::default());
    tokio::join!(look(tls, hosts, floor, found, clock), tell(of_time, watched, inputs, clock));
}

/// Looks at the clock and the certificate.
async fn look(
    tls: Option<Tls>,
    hosts: Vec<String>,
    floor: SystemTime,
    found: watch::Sender<Upkeep>,
    clock: Clock,
) {
    loop {
        let (tls, hosts_now) = (tls.clone(), hosts.clone());
        // A disk that hangs holds up nobody else.
        let look = tokio::task::spawn_blocking(move || {
            if let Some(tls) = &tls {
                reload(tls, &hosts_now);
            }
            faults(tls.as_ref(), floor, clock.wall())
        });
        if let Ok(now) = look.await {
            found.send_replace(now);
        }
        tokio::time::sleep(LOOK_EVERY).await;
    }
}

/// Tells what was found of them, and a fault of the recording at once.
async fn tell(
    mut of_time: watch::Receiver<Upkeep>,
    Watched { recording, fleet }: Watched,
    inputs: mpsc::Sender<Stamped>,
    clock: Clock,
) {
    // Without a recorder there is never a fault.
    let (_never, none) = watch::channel(None);
    let mut fault = recording.as_ref().map_or(none, |it| it.fault.clone());
    let lasting = || {
        let WatchedRecording { recorder, kept_too_much, unrecorded, .. } = recording.as_ref()?;
        let too_many = || (*unrecorded.borrow()).then(too_many_topics);
        shortage(&recorder.meter()).or_else(too_many).or_else(|| kept_too_much.borrow().then(too_many_kept))
    };
    let mut said = Upkeep::default();
    loop {
        let mut found = of_time.borrow_and_update().clone();
        let off = fault.borrow_and_update().as_deref().map(recording_off);
        found.recording = off.or_else(lasting);
        // Its thread has a line in the log for each change.
        found.fleet = fleet.as_ref().and_then(|status| status.borrow().fault(clock.now()));
        if found != said {
            for fault in [&found.clock, &found.certificate, &found.recording].into_iter().flatten() {
                tracing::warn!("{}", fault.en);
            }
            if found == Upkeep::default() {
                tracing::info!("the clock, the certificate and the recording are right again");
            }
            said = found.clone();
            // Where nobody takes it any more, the program ends.
            let _ = inputs.send(Stamped::new(Input::Upkeep(found), clock.now())).await;
        }
        tokio::select! {
            Ok(()) = of_time.changed() => {}
            Ok(()) = fault.changed() => {}
            () = tokio::time::sleep(LOOK_EVERY) => {}
        }
    }
}

fn recording_off(why: &str) -> Text {
    Text {
        en: format!("recording off: {why}").into(),
        de: format!("es wird nichts aufgezeichnet: {why}").into(),
    }
}

fn reload(tls: &Tls, hosts: &[String]) {
    match tls.reload(hosts) {
        Ok(true) => tracing::info!("the certificate {} was renewed and is used now", tls.path().display()),
        Ok(false) => {}
        Err(error) => tracing::error!("the new certificate is not used, the old one stays: {error}"),
    }
}

/// What is wrong with the clock and the certificate.
fn faults(tls: Option<&Tls>, floor: SystemTime, wall: SystemTime) -> Upkeep {
    let date = |at| humantime::format_rfc3339_seconds(at);
    if wall + BEHIND < floor {
        // By a clock that is wrong nothing can be said of a certificate.
        return Upkeep { clock: Some(clock_behind(date(wall), date(floor))), ..Upkeep::default() };
    }
    let certificate = tls.and_then(|tls| {
        let path = tls.path().display();
        let (en, de) = match tls.validity(wall) {
            CertificateValidity::Good => return None,
            CertificateValidity::EndsSoon(at) => (
                format!("the certificate {path} ends at {}: renew it", date(at)),
                format!("das Zertifikat {path} endet am {}: erneuern", date(at)),
            ),
            CertificateValidity::Ended(at) => (
                format!(
                    "the certificate {path} ended at {}, or the clock is wrong: browsers warn of it. Renew it; \
                     `telltale tls self-signed` makes one",
                    date(at)
                ),
                format!(
                    "das Zertifikat {path} endete am {}, oder die Uhr geht falsch: Browser warnen davor. \
                     Erneuern; `telltale tls self-signed` stellt eines aus",
                    date(at)
                ),
            ),
            CertificateValidity::NotYet(at) => (
                format!(
                    "the certificate {path} is valid from {} on, or the clock is wrong: browsers warn of it \
                     until then",
                    date(at)
                ),
                format!(
                    "das Zertifikat {path} gilt erst ab {}, oder die Uhr geht falsch: bis dahin warnen \
                     Browser davor",
                    date(at)
                ),
            ),
        };
        Some(Text { en: en.into(), de: de.into() })
    });
    Upkeep { certificate, ..Upkeep::default() }
}

/// What the recorder's memory is too small for: the largest of the topics, and how many others. The words stay the same
/// while the same topics are short.
fn shortage(meter: &Meter) -> Option<Text> {
    if meter.has_too_many_topics {
        return Some(too_many_topics());
    }
    let topic = &meter.short().max_by_key(|it| it.bytes)?.topic;
    let (others, memory) = (meter.short().count() - 1, size(meter.memory as u64));
    let wanted = format!("{} s", meter.wanted.as_millis() / 1000);
    let (en, de) = match others {
        0 => (String::new(), String::new()),
        _ => (format!(" and {others} more"), format!(" und {others} weiteren")),
    };
    Some(Text {
        en: format!(
            "the last {wanted} of {topic}{en} do not fit into the memory for recordings: raise `recording.memory`, \
             which is {memory}"
        )
        .into(),
        de: format!(
            "die letzten {wanted} von {topic}{de} passen nicht in den Speicher für Aufzeichnungen: \
             `recording.memory` erhöhen, derzeit {memory}"
        )
        .into(),
    })
}

fn too_many_topics() -> Text {
    Text {
        en: "there are more topics than can be recorded, and those silent for longest are missing: name fewer in \
             `recording.topics`"
            .into(),
        de: "es gibt mehr Topics, als aufgezeichnet werden können, und die am längsten stillen fehlen: in \
             `recording.topics` weniger nennen"
            .into(),
    }
}

fn too_many_kept() -> Text {
    Text {
        en: "kept recordings fill `recording.disk`, so others are soon removed: release some with `telltale incident keep \
             ID --off`, or permit more"
            .into(),
        de: "behaltene Aufzeichnungen füllen `recording.disk`, darum werden andere bald gelöscht: welche freigeben mit \
             `telltale incident keep ID --off`, oder mehr erlauben"
            .into(),
    }
}

fn clock_behind(wall: impl Display, floor: impl Display) -> Text {
    Text {
        en: format!(
            "the clock shows {wall}, which is before {floor}, when this vehicle was in use already: set it. Until \
             then sessions and tokens are judged by the later time"
        )
        .into(),
        de: format!(
            "die Uhr zeigt {wall}, aber {floor} war dieses Fahrzeug schon in Betrieb: Uhr stellen. Bis dahin gilt \
             für Anmeldungen und Token die spätere Zeit"
        )
        .into(),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::clock::earliest;
    use crate::engine::Engine;
    use crate::engine::model::{Model, Parts, StageModel};
    use crate::engine::time::Span;
    use crate::fleet::status::Contact;
    use crate::record::feed::Feed;
    use crate::record::incident::Margins;
    use crate::record::recorder::Settings;
    use crate::record::ring::Held;

    #[test]
    fn a_clock_is_wrong_if_it_is_more_than_a_day_behind_what_was_written() {
        let floor = earliest() + 10 * BEHIND;
        for (wall, is_wrong) in [
            (SystemTime::UNIX_EPOCH, true),
            (floor - BEHIND * 2, true),
            (floor - BEHIND / 2, false),
            (floor, false),
            (floor + BEHIND * 10_000, false),
        ] {
            let found = faults(None, floor, wall);
            assert_eq!((found.clock.is_some(), found.certificate), (is_wrong, None));
        }
    }

    #[test]
    fn a_memory_that_is_too_small_is_told_with_its_topics() {
        let held = |topic: &str, age_s: Option<u64>| Held {
            topic: topic.into(),
            messages: 1,
            bytes: if topic == "/b" { 2 } else { 1 },
            span: Span::from_secs(1),
            dropped: 1,
            dropped_age: age_s.map(Span::from_secs),
            is_sizes_only: false,
        };
        let said = |topics| {
            let wanted = Span::from_secs(45);
            let meter = Meter { wanted, memory: 1_000_000, topics, has_too_many_topics: false };
            shortage(&meter).map(|said| (said.en.to_string(), said.de.to_string()))
        };
        assert_eq!(said(vec![held("/a", None), held("/b", Some(45))]), None);
        let (en, de) = said(vec![held("/a", Some(1)), held("/b", Some(44)), held("/c", None)]).unwrap();
        assert!(en.contains("the last 45 s of /b and 1 more") && en.contains("which is 1.0 MB"), "{en}");
        assert!(de.contains("die letzten 45 s von /b und 1 weiteren"), "{de}");
    }

    #[test]
    fn a_certificate_is_told_of_thirty_days_before_its_end_and_after_it() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let [path, key] = ["cert.pem", "key.pem"].map(|name| folder.join(name));
        let (begins, ends) = (rcgen::date_time_ymd(2026, 1, 1), rcgen::date_time_ymd(2026, 7, 1));
        let mut params = rcgen::CertificateParams::new(vec!["display".to_owned()]).unwrap();
        (params.not_before, params.not_after) = (begins, ends);
        let pair = rcgen::KeyPair::generate().unwrap();
        std::fs::write(&path, params.self_signed(&pair).unwrap().pem()).unwrap();
        std::fs::write(&key, pair.serialize_pem()).unwrap();
        let tls = Tls::load(&path, &key).unwrap();
        let (begins, ends, floor) =
            (SystemTime::from(begins), SystemTime::from(ends), SystemTime::UNIX_EPOCH);
        let day = Duration::from_secs(24 * 3600);
        for (wall, en, de) in [
            (begins - day, "is valid from 2026-01-01", "gilt erst ab 2026-01-01"),
            (begins + day, "", ""),
            (ends - day * 31, "", ""),
            (ends - day * 29, "ends at 2026-07-01", "endet am 2026-07-01"),
            (ends + day, "ended at 2026-07-01", "endete am 2026-07-01"),
        ] {
            let said = faults(Some(&tls), floor, wall).certificate.unwrap_or_default();
            assert!(said.en.contains(en) && said.de.contains(de), "{said:?}");
            assert_eq!(said.en.is_empty(), en.is_empty(), "{said:?}");
        }
        // By a clock that is wrong nothing can be said of it.
        let found = faults(Some(&tls), ends, begins - day);
        assert!(found.clock.is_some() && found.certificate.is_none());
    }

    #[tokio::test(start_paused = true)]
    async fn what_is_wrong_is_told_to_the_engine() {
        let (inputs, mut told) = mpsc::channel(4);
        let clock = Clock::start();
        let floor = clock.wall() + 400 * BEHIND;
        let watching = tokio::spawn(watch(None, Vec::new(), floor, Watched::default(), inputs, clock));
        let Input::Upkeep(found) = told.recv().await.unwrap().input else { panic!("it tells of that alone") };
        assert!(
            found.clock.is_some_and(|said| said.en.contains("set it") && said.de.contains("Uhr stellen"))
        );
        watching.abort();
    }

    #[tokio::test(start_paused = true)]
    async fn a_fleet_that_does_not_hear_is_told() {
        let (inputs, mut told) = mpsc::channel(4);
        let (_found, of_time) = watch::channel(Upkeep::default());
        let clock = Clock::start();
        let (change, status) = watch::channel(Status::new(clock.now()));
        let watched = Watched { recording: None, fleet: Some(status) };
        let telling = tokio::spawn(tell(of_time, watched, inputs, clock));
        for contact in [Contact::TwoVehicles, Contact::Reached { since: clock.now() }] {
            let is_error = (contact == Contact::TwoVehicles).then_some(true);
            change.send_modify(|status| status.contact = contact);
            let Input::Upkeep(found) = told.recv().await.unwrap().input else { panic!("of that alone") };
            assert_eq!(found.fleet.map(|fault| fault.is_error), is_error);
        }
        telling.abort();
    }

    #[tokio::test(start_paused = true)]
    async fn a_recording_that_is_off_is_told_at_once() {
        let (inputs, mut told) = mpsc::channel(4);
        let (_found, of_time) = watch::channel(Upkeep::default());
        let (fail, fault) = watch::channel(None);
        let clock = Clock::start();
        let model = Model::new(Parts::empty("v", StageModel::None)).unwrap();
        let recorder = Recorder::start(
            Feed::new(clock).1,
            Engine::begin(Arc::new(model), clock.now()).snapshot(),
            Settings {
                margins: Margins::default(),
                memory: 1 << 20,
                longest_memory: Span::ZERO,
                configuration: Arc::default(),
            },
            1,
            clock,
        );
        let (_kept, kept_too_much) = watch::channel(false);
        let (crowd, unrecorded) = watch::channel(false);
        let recording = WatchedRecording { recorder: recorder.unwrap(), fault, kept_too_much, unrecorded };
        let watched = Watched { recording: Some(recording), fleet: None };
        let telling = tokio::spawn(tell(of_time, watched, inputs, clock));
        tokio::task::yield_now().await;
        for fault in [Some("the disk is full"), None] {
            fail.send_replace(fault.map(Into::into));
            let news = tokio::time::timeout(Duration::from_millis(1), told.recv()).await.expect("at once");
            let Input::Upkeep(found) = news.unwrap().input else { panic!("of that alone") };
            let said = found.recording.map(|said| said.en.to_string());
            assert_eq!(said, fault.map(|fault| format!("recording off: {fault}")));
        }
        crowd.send_replace(true);
        let news = tokio::time::timeout(LOOK_EVERY * 2, told.recv()).await.expect("at the next look");
        let Input::Upkeep(found) = news.unwrap().input else { panic!("of that alone") };
        assert!(found.recording.is_some_and(|said| said.en.contains("more topics than can be recorded")));
        telling.abort();
    }
}
