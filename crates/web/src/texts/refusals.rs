//! The texts of what is refused: why, and what to do.

use super::{Lang, NAME, clean};
use telltale_engine::input::Refusal;
use telltale_engine::model::Stage;
use telltale_engine::model::countermeasure::RequestKind;
use telltale_engine::state::State;

texts! {
    /// A refusal that is about `name`.
    text refused(refusal: &Refusal; name: &str) {
        Refusal::NoSuchStop(_) => "There is no stop {name}.", "Es gibt keine Haltestelle {name}.";
        Refusal::PoseTooFar { nearest_m, limit_m } => "The nearest stop is {nearest_m} m away, the limit is {limit_m} m. Check the position.", "Die nächste Haltestelle ist {nearest_m} m entfernt, erlaubt sind {limit_m} m. Position prüfen.";
        Refusal::Group { state: State::Ignore, .. } => "{name} cannot be judged: what it needs fails.", "{name} ist nicht beurteilbar: Eine Voraussetzung ist gestört.";
        Refusal::Group { state: State::Unknown, .. } => "{name} says nothing. Wait, or look for the cause.", "{name} meldet sich nicht. Warten oder Ursache suchen.";
        Refusal::Group { .. } => "{name} is in error. Mend the cause first.", "{name} meldet einen Fehler. Zuerst die Ursache beheben.";
        Refusal::Warning { .. } => "{name} has a warning. Acknowledge it first.", "{name} meldet eine Warnung. Zuerst quittieren.";
        Refusal::CauseRemains { .. } => "The cause is still there: {name}.", "Die Ursache besteht noch: {name}.";
        Refusal::NoSuchAlarm(number) => "There is no alarm {number}.", "Es gibt keinen Alarm {number}.";
        Refusal::NoSuchNode(_) => "There is nothing called {name}.", "Es gibt nichts namens {name}.";
        Refusal::NothingToAcknowledge(_) => "{name} has nothing to acknowledge.", "Bei {name} ist nichts zu quittieren.";
        Refusal::NoSuchModule(_) => "There is no module {name}.", "Es gibt kein Modul {name}.";
        Refusal::NotLatched(_) => "{name} holds no error.", "{name} hält keinen Fehler fest.";
        Refusal::StillInError(_) => "{name} is in error still. Mend the cause first.", "{name} meldet noch immer einen Fehler. Zuerst die Ursache beheben.";
        Refusal::NotKnownToStand => "The vehicle is not known to stand. Nothing is shelved while it may move.", "Es ist nicht sicher, dass das Fahrzeug steht. Solange es sich bewegen kann, kommt nichts in Wartung.";
        Refusal::ShelvedTooLong { limit_h } => "A module is shelved for at least a minute and at most {limit_h} h.", "Ein Modul kommt für mindestens eine Minute und höchstens {limit_h} h in Wartung.";
        Refusal::ShelvesFull { limit } => "At most {limit} modules are shelved at once. End one of them first.", "Höchstens {limit} Module sind zugleich in Wartung. Zuerst eine Wartung beenden.";
        Refusal::NeverShelved(_) => "{name} is one of Telltale's own modules and is never shelved.", "{name} gehört zu Telltale selbst und kommt nie in Wartung.";
        Refusal::CountermeasureRests { .. } => "A request to slow down or to stop rests on {name}: it is never shelved.", "An {name} hängt, ob das Fahrzeug abbremsen oder anhalten soll: Es kommt nie in Wartung.";
        Refusal::NotShelved(_) => "{name} is not shelved.", "{name} ist nicht in Wartung.";
        Refusal::NobodyLoggedIn => "Nobody is logged in. Log in first.", "Niemand ist angemeldet. Zuerst anmelden.";
        Refusal::WrongStage(Stage::Locked) => "The vehicle is locked. Log in first.", "Das Fahrzeug ist gesperrt. Zuerst anmelden.";
        Refusal::WrongStage(Stage::Localizing) => "The vehicle is not localized yet.", "Das Fahrzeug ist noch nicht lokalisiert.";
        Refusal::WrongStage(Stage::Standby) | Refusal::NotDriving => "The vehicle does not drive.", "Das Fahrzeug fährt nicht.";
        Refusal::WrongStage(Stage::Cleared) => "The vehicle is cleared already.", "Das Fahrzeug ist bereits freigegeben.";
        Refusal::WrongStage(Stage::Active) => "The vehicle drives. Wait until it has arrived.", "Das Fahrzeug fährt. Ankunft abwarten.";
        Refusal::NoStages => "This machine is neither localized nor cleared.", "Diese Maschine wird weder lokalisiert noch freigegeben.";
        Refusal::LogoutWhileActive => "The vehicle drives. Log out after it has arrived.", "Das Fahrzeug fährt. Erst nach der Ankunft abmelden.";
        Refusal::ShutdownWhileActive => "The vehicle drives. Lock the display after it has arrived.", "Das Fahrzeug fährt. Anzeige erst nach der Ankunft sperren.";
        Refusal::PoseNotFinite => "The position is no number. Enter it again.", "Die Position ist keine Zahl. Neu eingeben.";
        Refusal::NotLocalized => "The position is not confirmed yet. Wait, or give it again.", "Die Position ist noch nicht bestätigt. Warten oder neu angeben.";
        Refusal::NoGoal => "No destination is set. Wait for one.", "Kein Ziel gesetzt. Auf ein Ziel warten.";
        Refusal::Countermeasure(RequestKind::Notify) => "A warning is on the screen.", "Eine Warnung wird angezeigt.";
        Refusal::Countermeasure(RequestKind::ManeuverStop) => "A stop is requested. Release the vehicle when its cause is gone.", "Ein Anhalten ist angefordert. Fahrzeug freigeben, wenn die Störung vorbei ist.";
        Refusal::Countermeasure(RequestKind::Decelerate) => "The vehicle is being slowed down. Release it when the cause is gone.", "Das Fahrzeug wird abgebremst. Freigeben, wenn die Störung vorbei ist.";
        Refusal::NobodyListens(RequestKind::Decelerate) => "No vehicle hears a request to slow down. Call the control room.", "Kein Fahrzeug empfängt die Anforderung abzubremsen. Leitstelle rufen.";
        Refusal::NobodyListens(_) => "No vehicle hears a request to stop. Call the control room.", "Kein Fahrzeug empfängt die Anforderung anzuhalten. Leitstelle rufen.";
        Refusal::StopNotPublished => "The vehicle cannot be stopped from here. Take over and stop it.", "Von hier lässt sich das Fahrzeug nicht anhalten. Übernehmen und anhalten.";
        Refusal::DisplayNotLive => "The display is not up to date. Wait for it, then try again.", "Die Anzeige ist nicht aktuell. Warten, dann erneut versuchen.";
        Refusal::StorageNotWritable => "Nothing can be recorded. Call the control room.", "Es kann nichts aufgezeichnet werden. Leitstelle rufen.";
        Refusal::StoppedSince => "STOP was tapped in the meantime, so this was not done. Look again.", "Inzwischen wurde STOP gedrückt, daher nicht ausgeführt. Neu hinsehen.";
        Refusal::NothingToRelease => "Nothing keeps the vehicle from driving on.", "Nichts hindert das Fahrzeug am Weiterfahren.";
    }

    /// Why a tap does not count.
    word invalid_tap(tap: InvalidTap) {
        InvalidTap::SessionEnded => "Log in first.", "Bitte zuerst anmelden.";
        InvalidTap::NotInCharge => "Somebody else leads the vehicle. Log in again to take their place.", "Jemand anderes führt das Fahrzeug. Zum Ablösen neu anmelden.";
        InvalidTap::Stale => "Things have changed since this was shown. Look again.", "Die Lage hat sich seit der Anzeige geändert. Neu hinsehen.";
        InvalidTap::ForOperator => "While the vehicle is cleared or drives, this is for its operator at the page.", "Während das Fahrzeug freigegeben ist oder fährt, ist das Sache der Fahrbegleitung an der Anzeige.";
        InvalidTap::StoppedSince => "STOP was tapped in the meantime, so this was not done. Look again.", "Inzwischen wurde STOP gedrückt, daher nicht ausgeführt. Neu hinsehen.";
        InvalidTap::Late => "This waited too long and was not done. Look again.", "Das hat zu lange gewartet und wurde nicht ausgeführt. Neu hinsehen.";
        InvalidTap::NotPending => "Nothing waits for this confirmation. Begin again.", "Auf diese Bestätigung wartet nichts. Bitte neu beginnen.";
        InvalidTap::ConfirmedLate => "The confirmation came later than 10 s. Begin again.", "Die Bestätigung kam später als 10 s. Bitte neu beginnen.";
    }

    text wrong_field(general: &str, field: &str) { "{general} Missing or wrong: {field}.", "{general} Es fehlt oder ist falsch: {field}." }

    text bad_address(why: &str) {
        "The address is not understood: {why}. /api/v1/openapi.json lists the parameters.", "Die Adresse ist nicht verständlich: {why}. /api/v1/openapi.json nennt die Parameter."
    }
}

impl Lang {
    /// Why an operator's action was refused, with what to do.
    pub fn refusal(self, refusal: &Refusal) -> String {
        let name = match refusal {
            Refusal::Group { group: name, .. }
            | Refusal::Warning { module: name }
            | Refusal::CauseRemains { node: name }
            | Refusal::NoSuchStop(name)
            | Refusal::NoSuchNode(name)
            | Refusal::NothingToAcknowledge(name)
            | Refusal::NoSuchModule(name)
            | Refusal::NotLatched(name)
            | Refusal::StillInError(name)
            | Refusal::NeverShelved(name)
            | Refusal::CountermeasureRests { module: name }
            | Refusal::NotShelved(name) => clean(name, NAME),
            _ => String::new(),
        };
        self.refused(refusal, &name)
    }
}

/// Why a tap does not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InvalidTap {
    /// The user who made it has no session any more.
    SessionEnded,
    /// Another operator is in charge.
    NotInCharge,
    /// The part of the state that it was made for is not as it was shown.
    Stale,
    /// While the vehicle is cleared or drives, it is for the operator alone.
    ForOperator,
    /// It confirms a request, and the operator tapped STOP since.
    StoppedSince,
    /// It waited too long, on its way or here.
    Late,
    /// It confirms a request that was used, replaced, or made by somebody else.
    NotPending,
    /// It confirms a request that was made too long ago.
    ConfirmedLate,
}
