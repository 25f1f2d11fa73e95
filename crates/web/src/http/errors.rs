//! The texts of refusals and errors.

use axum::http::StatusCode;

use crate::view::Lang;
use telltale_store::StoreError;

/// Why a request is answered with a refusal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HttpError {
    NotFound,
    WrongMethod,
    NoSession,
    /// The role may not do this.
    Forbidden,
    ForeignOrigin,
    ForeignHost,
    BadForm,
    BadRequest,
    TooSlow,
    TooLarge,
    /// A configuration that was edited is larger than what is run here.
    LargeConfiguration,
    TooMany,
    LongHeader,
    TooManySockets,
    /// The action cannot be written.
    Storage,
    /// A stop was requested and is not recorded yet.
    StopNotKept,
    /// A stop was requested, and no node of the vehicle hears it.
    StopNotHeard,
    /// Too many wait already.
    Busy,
    Unavailable,
    /// No diagnosis is shown before an operator logs in.
    Locked,
    /// A recording is shown, in which nothing can be done.
    Replay,
    /// There is no recorder, so nothing can be marked.
    NotRecording,
    /// A mark is in memory, and the disk has not taken it yet.
    MarkUnsure,
    /// An incident has as many marks as it may.
    ManyMarks,
    /// A note is longer than it may be.
    LongNote,
    /// A body is no form.
    NoForm,
    /// The recording of an incident is still written.
    Unfinished,
    /// The file of a recording is gone.
    NoRecording,
    /// A recording cannot be replayed.
    NoReplay,
    /// No moment that can be read stands in an address.
    BadMoment,
    /// A moment that is still to come, and no recording to say so.
    Future,
    /// A long recording is being read for its replay.
    Opening,
}

impl From<StoreError> for HttpError {
    fn from(error: StoreError) -> HttpError {
        match error {
            StoreError::NoSuchIncident(_) => HttpError::NotFound,
            error if error.is_of_storage() => HttpError::Storage,
            _ => HttpError::Unavailable,
        }
    }
}

impl HttpError {
    pub const fn status(self) -> StatusCode {
        match self {
            HttpError::NotFound | HttpError::NoRecording | HttpError::Future => StatusCode::NOT_FOUND,
            HttpError::WrongMethod => StatusCode::METHOD_NOT_ALLOWED,
            HttpError::NoSession => StatusCode::UNAUTHORIZED,
            HttpError::Forbidden | HttpError::ForeignOrigin => StatusCode::FORBIDDEN,
            HttpError::ForeignHost => StatusCode::MISDIRECTED_REQUEST,
            HttpError::Locked | HttpError::Replay | HttpError::Unfinished | HttpError::NoReplay => {
                StatusCode::CONFLICT
            }
            HttpError::BadForm | HttpError::LongNote => StatusCode::UNPROCESSABLE_ENTITY,
            HttpError::NoForm => StatusCode::UNSUPPORTED_MEDIA_TYPE,
            HttpError::BadRequest | HttpError::BadMoment => StatusCode::BAD_REQUEST,
            HttpError::TooSlow => StatusCode::REQUEST_TIMEOUT,
            HttpError::TooLarge | HttpError::LargeConfiguration => StatusCode::PAYLOAD_TOO_LARGE,
            HttpError::TooMany | HttpError::ManyMarks => StatusCode::TOO_MANY_REQUESTS,
            HttpError::LongHeader => StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE,
            HttpError::TooManySockets
            | HttpError::Storage
            | HttpError::StopNotKept
            | HttpError::StopNotHeard
            | HttpError::Busy
            | HttpError::Opening
            | HttpError::NotRecording
            | HttpError::MarkUnsure
            | HttpError::Unavailable => StatusCode::SERVICE_UNAVAILABLE,
        }
    }

    /// A title and a sentence.
    pub const fn say(self, lang: Lang) -> (&'static str, &'static str) {
        match (self, lang) {
            (HttpError::NotFound, Lang::En) => ("Not found", "There is nothing at this address."),
            (HttpError::NotFound, Lang::De) => ("Nicht gefunden", "Unter dieser Adresse gibt es nichts."),
            (HttpError::WrongMethod, Lang::En) => {
                ("Not like this", "This address does not take that kind of request.")
            }
            (HttpError::WrongMethod, Lang::De) => {
                ("So nicht", "Diese Adresse nimmt diese Art von Anfrage nicht an.")
            }
            (HttpError::NoSession, Lang::En) => ("Not logged in", "Log in first."),
            (HttpError::NoSession, Lang::De) => ("Nicht angemeldet", "Bitte zuerst anmelden."),
            (HttpError::Forbidden, Lang::En) => ("Not permitted", "Your role does not permit this."),
            (HttpError::Forbidden, Lang::De) => ("Nicht erlaubt", "Ihre Rolle erlaubt das nicht."),
            (HttpError::ForeignOrigin, Lang::En) => {
                ("Not permitted", "This request does not come from a page of this server.")
            }
            (HttpError::ForeignOrigin, Lang::De) => {
                ("Nicht erlaubt", "Diese Anfrage kommt nicht von einer Seite dieses Servers.")
            }
            (HttpError::ForeignHost, Lang::En) => {
                ("Unknown name", "This server does not go by this name. Its configuration lists the names.")
            }
            (HttpError::ForeignHost, Lang::De) => (
                "Unbekannter Name",
                "Dieser Server hat diesen Namen nicht. Die Konfiguration nennt seine Namen.",
            ),
            (HttpError::BadForm, Lang::En) => ("Not understood", "The form is not as it should be."),
            (HttpError::BadForm, Lang::De) => {
                ("Nicht verstanden", "Das Formular ist nicht, wie es sein soll.")
            }
            (HttpError::BadRequest, Lang::En) => (
                "Not understood",
                "The address or the request is not as it should be. Go back to the page and try again.",
            ),
            (HttpError::BadRequest, Lang::De) => (
                "Nicht verstanden",
                "Die Adresse oder die Anfrage ist nicht, wie sie sein soll. Zurück zur Seite und noch einmal versuchen.",
            ),
            (HttpError::BadMoment, Lang::En) => (
                "Not a moment",
                "Write a moment in the address as milliseconds since 1970, at=1795621444500, or in UTC, at=2026-11-25T15:44:04.5Z.",
            ),
            (HttpError::BadMoment, Lang::De) => (
                "Kein Zeitpunkt",
                "Ein Zeitpunkt steht in der Adresse in Millisekunden seit 1970, at=1795621444500, oder in UTC, \
                 at=2026-11-25T15:44:04.5Z.",
            ),
            (HttpError::Future, Lang::En) => {
                ("Still to come", "This moment is later than now, so nothing can show it.")
            }
            (HttpError::Future, Lang::De) => {
                ("Noch nicht", "Dieser Zeitpunkt liegt in der Zukunft: Nichts kann ihn zeigen.")
            }
            (HttpError::TooSlow, Lang::En) => (
                "Took too long",
                "The answer did not come in time. Look at the display before you try again.",
            ),
            (HttpError::TooSlow, Lang::De) => (
                "Zu langsam",
                "Die Antwort kam nicht rechtzeitig. Vor einem neuen Versuch auf die Anzeige sehen.",
            ),
            (HttpError::LargeConfiguration, Lang::En) => (
                "Too large",
                "The configuration is larger than 256 KiB. Run it with `telltale replay --what-if`.",
            ),
            (HttpError::LargeConfiguration, Lang::De) => (
                "Zu groß",
                "Die Konfiguration ist größer als 256 KiB. Spielen Sie sie mit `telltale replay --what-if` durch.",
            ),
            (HttpError::TooLarge, Lang::En) => {
                ("Too large", "Nothing was changed. Send at most 16 KiB; shorten what was typed.")
            }
            (HttpError::TooLarge, Lang::De) => {
                ("Zu groß", "Nichts wurde geändert. Höchstens 16 KiB senden; die Eingabe kürzen.")
            }
            (HttpError::TooMany, Lang::En) => ("Too many requests", "Wait a moment and try again."),
            (HttpError::TooMany, Lang::De) => ("Zu viele Anfragen", "Kurz warten und noch einmal versuchen."),
            (HttpError::LongHeader, Lang::En) => {
                ("Headers too long", "Remove the cookies of this address in the browser and try again.")
            }
            (HttpError::LongHeader, Lang::De) => (
                "Kopfzeilen zu lang",
                "Im Browser die Cookies dieser Adresse entfernen und noch einmal versuchen.",
            ),
            (HttpError::TooManySockets, Lang::En) => {
                ("Too many displays", "Close one of the open displays first.")
            }
            (HttpError::TooManySockets, Lang::De) => {
                ("Zu viele Anzeigen", "Bitte zuerst eine der offenen Anzeigen schließen.")
            }
            (HttpError::Storage, Lang::En) => {
                ("Not done", "The disk is full or broken, so nothing was changed. Call the control room.")
            }
            (HttpError::Storage, Lang::De) => (
                "Nicht ausgeführt",
                "Der Speicher ist voll oder defekt, daher wurde nichts geändert. Leitstelle rufen.",
            ),
            (HttpError::StopNotKept, Lang::En) => (
                "Stop requested, not recorded",
                "The vehicle is asked to stop. The disk is full or broken, so that is not recorded yet. Call the control room.",
            ),
            (HttpError::StopNotKept, Lang::De) => (
                "Anhalten verlangt, nicht aufgezeichnet",
                "Das Fahrzeug soll anhalten. Der Speicher ist voll oder defekt, daher ist das noch nicht aufgezeichnet. \
                 Leitstelle rufen.",
            ),
            (HttpError::StopNotHeard, Lang::En) => (
                "Stop not received",
                "Nobody listens: the vehicle does not hear the request. Take over and stop it. \
                 The request goes out as soon as the vehicle listens.",
            ),
            (HttpError::StopNotHeard, Lang::De) => (
                "Anhalten nicht angekommen",
                "Niemand hört zu: Das Fahrzeug erfährt nichts davon. Übernehmen und anhalten. \
                 Die Anforderung geht hinaus, sobald das Fahrzeug zuhört.",
            ),
            (HttpError::Busy, Lang::En) => (
                "Not done",
                "Others are waiting already, so nothing was changed. Look at the display, then try again.",
            ),
            (HttpError::Busy, Lang::De) => (
                "Nicht ausgeführt",
                "Es warten schon andere, daher wurde nichts geändert. Auf die Anzeige sehen, dann erneut versuchen.",
            ),
            (HttpError::Unavailable, Lang::En) => {
                ("Not available", "The server cannot do this now. Try again.")
            }
            (HttpError::Unavailable, Lang::De) => {
                ("Nicht verfügbar", "Der Server kann das gerade nicht. Bitte noch einmal versuchen.")
            }
            (HttpError::NotRecording, Lang::En) => {
                ("Not marked", "Nothing is recorded at present, so this moment is not marked. Note the time.")
            }
            (HttpError::NotRecording, Lang::De) => (
                "Nicht markiert",
                "Gerade wird nichts aufgezeichnet, daher ist dieser Moment nicht markiert. Bitte die Uhrzeit notieren.",
            ),
            (HttpError::MarkUnsure, Lang::En) => (
                "Not surely marked",
                "The disk does not take it at present, so it is not sure that this moment is kept. Note the time.",
            ),
            (HttpError::MarkUnsure, Lang::De) => (
                "Nicht sicher markiert",
                "Der Speicher nimmt ihn gerade nicht auf, daher ist nicht sicher, ob dieser Moment erhalten bleibt. Bitte die \
                 Uhrzeit notieren.",
            ),
            (HttpError::ManyMarks, Lang::En) => (
                "Not marked",
                "This incident has many marks already, so this moment has none of its own. It is recorded all the same.",
            ),
            (HttpError::ManyMarks, Lang::De) => (
                "Nicht markiert",
                "Dieser Vorfall ist schon oft markiert, daher hat dieser Moment keine eigene Marke. Aufgezeichnet wird er.",
            ),
            (HttpError::LongNote, Lang::En) => {
                ("Not done", "A note has at most 2,000 bytes. Nothing was changed. Shorten it.")
            }
            (HttpError::LongNote, Lang::De) => (
                "Nicht ausgeführt",
                "Eine Notiz hat höchstens 2.000 Byte. Es wurde nichts geändert. Bitte kürzen.",
            ),
            (HttpError::NoForm, Lang::En) => {
                ("Not a form", "Nothing was done. Send it as a form: application/x-www-form-urlencoded.")
            }
            (HttpError::NoForm, Lang::De) => (
                "Kein Formular",
                "Es wurde nichts getan. Bitte als Formular senden: application/x-www-form-urlencoded.",
            ),
            (HttpError::Unfinished, Lang::En) => {
                ("Not finished", "This incident is still being recorded. Try again in a minute.")
            }
            (HttpError::Unfinished, Lang::De) => (
                "Noch nicht fertig",
                "Dieser Vorfall wird noch aufgezeichnet. In einer Minute noch einmal versuchen.",
            ),
            (HttpError::NoReplay, Lang::En) => (
                "No replay",
                "This recording cannot be replayed; the server's log says why. It can be downloaded.",
            ),
            (HttpError::NoReplay, Lang::De) => (
                "Keine Wiedergabe",
                "Diese Aufzeichnung kann nicht wiedergegeben werden; das Protokoll des Servers sagt, warum. Sie kann \
                 heruntergeladen werden.",
            ),
            (HttpError::Opening, Lang::En) => (
                "Opening the recording",
                "It is read from its beginning to its end. This page goes on by itself.",
            ),
            (HttpError::Opening, Lang::De) => (
                "Die Aufzeichnung wird geöffnet",
                "Sie wird vom Anfang bis zum Ende gelesen. Diese Seite geht von selbst weiter.",
            ),
            (HttpError::NoRecording, Lang::En) => {
                ("No recording", "The file of this recording is gone. `telltale incident verify` says more.")
            }
            (HttpError::NoRecording, Lang::De) => (
                "Keine Aufzeichnung",
                "Die Datei dieser Aufzeichnung ist nicht mehr da. `telltale incident verify` sagt mehr.",
            ),
            (HttpError::Locked, Lang::En) => {
                ("Locked", "The vehicle is locked: no diagnosis is shown before an operator logs in.")
            }
            (HttpError::Locked, Lang::De) => {
                ("Gesperrt", "Das Fahrzeug ist gesperrt: keine Diagnose, bevor sich jemand anmeldet.")
            }
            (HttpError::Replay, Lang::En) => (
                "This is a replay",
                "A recording is shown, so nothing was done. Act at the live display of the vehicle.",
            ),
            (HttpError::Replay, Lang::De) => (
                "Dies ist eine Aufzeichnung",
                "Eine Aufzeichnung wird gezeigt, daher wurde nichts getan. An der Live-Anzeige des Fahrzeugs handeln.",
            ),
        }
    }
}
