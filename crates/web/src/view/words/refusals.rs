//! The texts of refused actions: why, and what to do.

use super::Lang;
use crate::view::text::{NAME, clean};
use telltale_engine::input::Refusal;
use telltale_engine::model::Stage;
use telltale_engine::model::countermeasure::RequestKind;
use telltale_engine::state::State;

impl Lang {
    /// Why an operator's action was refused, with what to do.
    pub fn refusal(self, refusal: &Refusal) -> String {
        let name = |name: &str| clean(name, NAME);
        match (self, refusal) {
            (Lang::En, Refusal::NoSuchStop(stop)) => format!("There is no stop {}.", name(stop)),
            (Lang::De, Refusal::NoSuchStop(stop)) => format!("Es gibt keine Haltestelle {}.", name(stop)),
            (Lang::En, Refusal::PoseTooFar { nearest_m, limit_m }) => {
                format!(
                    "The nearest stop is {nearest_m} m away, the limit is {limit_m} m. Check the position."
                )
            }
            (Lang::De, Refusal::PoseTooFar { nearest_m, limit_m }) => {
                format!(
                    "Die nächste Haltestelle ist {nearest_m} m entfernt, erlaubt sind {limit_m} m. Position prüfen."
                )
            }
            (_, Refusal::Group { group, state }) => self.refused_by_group(&name(group), *state),
            (Lang::En, Refusal::Warning { module }) => {
                format!("{} has a warning. Acknowledge it first.", name(module))
            }
            (Lang::De, Refusal::Warning { module }) => {
                format!("{} meldet eine Warnung. Zuerst quittieren.", name(module))
            }
            (Lang::En, Refusal::CauseRemains { node }) => {
                format!("The cause is still there: {}.", name(node))
            }
            (Lang::De, Refusal::CauseRemains { node }) => {
                format!("Die Ursache besteht noch: {}.", name(node))
            }
            (Lang::En, Refusal::NoSuchAlarm(number)) => format!("There is no alarm {number}."),
            (Lang::De, Refusal::NoSuchAlarm(number)) => format!("Es gibt keinen Alarm {number}."),
            (Lang::En, Refusal::NoSuchNode(node)) => format!("There is nothing called {}.", name(node)),
            (Lang::De, Refusal::NoSuchNode(node)) => format!("Es gibt nichts namens {}.", name(node)),
            (Lang::En, Refusal::NothingToAcknowledge(node)) => {
                format!("{} has nothing to acknowledge.", name(node))
            }
            (Lang::De, Refusal::NothingToAcknowledge(node)) => {
                format!("Bei {} ist nichts zu quittieren.", name(node))
            }
            (Lang::En, Refusal::NoSuchModule(module)) => format!("There is no module {}.", name(module)),
            (Lang::De, Refusal::NoSuchModule(module)) => format!("Es gibt kein Modul {}.", name(module)),
            (Lang::En, Refusal::NotLatched(module)) => format!("{} holds no error.", name(module)),
            (Lang::De, Refusal::NotLatched(module)) => format!("{} hält keinen Fehler fest.", name(module)),
            (Lang::En, Refusal::StillInError(module)) => {
                format!("{} is in error still. Mend the cause first.", name(module))
            }
            (Lang::De, Refusal::StillInError(module)) => {
                format!("{} meldet noch immer einen Fehler. Zuerst die Ursache beheben.", name(module))
            }
            _ => self.plain_refusal(refusal).to_owned(),
        }
    }

    fn refused_by_group(self, group: &str, state: State) -> String {
        match (self, state) {
            (Lang::En, State::Ignore) => format!("{group} cannot be judged: what it needs fails."),
            (Lang::De, State::Ignore) => {
                format!("{group} ist nicht beurteilbar: Eine Voraussetzung ist gestört.")
            }
            (Lang::En, State::Unknown) => format!("{group} says nothing. Wait, or look for the cause."),
            (Lang::De, State::Unknown) => format!("{group} meldet sich nicht. Warten oder Ursache suchen."),
            (Lang::En, _) => format!("{group} is in error. Mend the cause first."),
            (Lang::De, _) => format!("{group} meldet einen Fehler. Zuerst die Ursache beheben."),
        }
    }

    /// Refusals that name nothing.
    fn plain_refusal(self, refusal: &Refusal) -> &'static str {
        let (en, de) = match refusal {
            Refusal::NobodyLoggedIn => {
                ("Nobody is logged in. Log in first.", "Niemand ist angemeldet. Zuerst anmelden.")
            }
            Refusal::WrongStage(stage) => wrong_stage(*stage),
            Refusal::NotDriving => wrong_stage(Stage::Standby),
            Refusal::NoStages => (
                "This machine is neither localized nor cleared.",
                "Diese Maschine wird weder lokalisiert noch freigegeben.",
            ),
            Refusal::LogoutWhileActive => (
                "The vehicle drives. Log out after it has arrived.",
                "Das Fahrzeug fährt. Erst nach der Ankunft abmelden.",
            ),
            Refusal::ShutdownWhileActive => (
                "The vehicle drives. Shut down after it has arrived.",
                "Das Fahrzeug fährt. Erst nach der Ankunft herunterfahren.",
            ),
            Refusal::PoseNotFinite => {
                ("The position is no number. Enter it again.", "Die Position ist keine Zahl. Neu eingeben.")
            }
            Refusal::NotLocalized => (
                "The position is not confirmed yet. Wait, or give it again.",
                "Die Position ist noch nicht bestätigt. Warten oder neu angeben.",
            ),
            Refusal::NoGoal => ("No goal is set. Wait for one.", "Kein Ziel gesetzt. Auf ein Ziel warten."),
            Refusal::Countermeasure(RequestKind::Notify) => {
                ("A warning is on the screen.", "Eine Warnung wird angezeigt.")
            }
            Refusal::Countermeasure(RequestKind::ManeuverStop) => (
                "A stop is requested. End it when its cause is gone.",
                "Ein Anhalten ist angefordert. Aufheben, wenn die Ursache behoben ist.",
            ),
            Refusal::Countermeasure(RequestKind::Decelerate) => (
                "The vehicle is being slowed down. End that when the cause is gone.",
                "Das Fahrzeug wird verzögert. Aufheben, wenn die Ursache behoben ist.",
            ),
            Refusal::NobodyListens(RequestKind::Decelerate) => (
                "No vehicle hears a request to slow down. Call the control room.",
                "Kein Fahrzeug hört, wenn es abbremsen soll. Leitstelle rufen.",
            ),
            Refusal::NobodyListens(_) => (
                "No vehicle hears a request to stop. Call the control room.",
                "Kein Fahrzeug hört, wenn es anhalten soll. Leitstelle rufen.",
            ),
            Refusal::StopNotPublished => (
                "The vehicle cannot be stopped from here. Take over and stop it.",
                "Von hier lässt sich das Fahrzeug nicht anhalten. Übernehmen und anhalten.",
            ),
            Refusal::DisplayNotLive => (
                "The display is not up to date. Wait for it, then try again.",
                "Die Anzeige ist nicht aktuell. Warten, dann erneut versuchen.",
            ),
            Refusal::StorageNotWritable => (
                "Nothing can be recorded. Call the control room.",
                "Es kann nichts aufgezeichnet werden. Leitstelle rufen.",
            ),
            Refusal::NothingToRelease => {
                ("Nothing keeps the vehicle from driving on.", "Nichts hindert das Fahrzeug am Weiterfahren.")
            }
            // Those that name something have words above.
            _ => ("This is not possible now.", "Das ist jetzt nicht möglich."),
        };
        match self {
            Lang::En => en,
            Lang::De => de,
        }
    }
}

fn wrong_stage(stage: Stage) -> (&'static str, &'static str) {
    match stage {
        Stage::Locked => {
            ("The vehicle is locked. Log in first.", "Das Fahrzeug ist gesperrt. Zuerst anmelden.")
        }
        Stage::Localizing => {
            ("The vehicle is not localized yet.", "Das Fahrzeug ist noch nicht lokalisiert.")
        }
        Stage::Standby => ("The vehicle does not drive.", "Das Fahrzeug fährt nicht."),
        Stage::Cleared => ("The vehicle is cleared already.", "Das Fahrzeug ist bereits freigegeben."),
        Stage::Active => {
            ("The vehicle drives. Wait until it has arrived.", "Das Fahrzeug fährt. Ankunft abwarten.")
        }
    }
}
