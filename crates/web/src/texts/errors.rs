//! The errors that a request is answered with: the status, a title and a sentence of each.

use axum::http::StatusCode;

use telltale_store::StoreError;

macro_rules! errors {
    ($($(#[$doc:meta])* $name:ident, $status:ident: $title:literal, $title_de:literal; $text:literal, $text_de:literal;)*) => {
        /// Why a request is answered with a refusal.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum HttpError { $($(#[$doc])* $name,)* }

        impl HttpError {
            pub const fn status(self) -> StatusCode {
                match self { $(HttpError::$name => StatusCode::$status,)* }
            }
        }

        texts! {
            word error_title(error: HttpError) { $(HttpError::$name => $title, $title_de;)* }

            word error_text(error: HttpError) { $(HttpError::$name => $text, $text_de;)* }
        }
    };
}

errors! {
    NotFound, NOT_FOUND: "Not found", "Nicht gefunden";
        "There is nothing at this address.", "Unter dieser Adresse gibt es nichts.";
    WrongMethod, METHOD_NOT_ALLOWED: "Not like this", "So nicht";
        "This address does not take that kind of request.", "Diese Adresse nimmt diese Art von Anfrage nicht an.";
    NoSession, UNAUTHORIZED: "Not logged in", "Nicht angemeldet";
        "Log in first.", "Bitte zuerst anmelden.";
    /// The role may not do this.
    Forbidden, FORBIDDEN: "Not permitted", "Nicht erlaubt";
        "Your role does not permit this.", "Ihre Rolle erlaubt das nicht.";
    ForeignOrigin, FORBIDDEN: "Not permitted", "Nicht erlaubt";
        "This request does not come from a page of this server.", "Diese Anfrage kommt nicht von einer Seite dieses Servers.";
    ForeignHost, MISDIRECTED_REQUEST: "Unknown name", "Unbekannter Name";
        "This server does not go by this name. Its configuration lists the names.", "Dieser Server hat diesen Namen nicht. Die Konfiguration nennt seine Namen.";
    BadForm, UNPROCESSABLE_ENTITY: "Not understood", "Nicht verstanden";
        "The form is not as it should be.", "Das Formular ist nicht, wie es sein soll.";
    BadRequest, BAD_REQUEST: "Not understood", "Nicht verstanden";
        "The address or the request is not as it should be. Go back to the page and try again.", "Die Adresse oder die Anfrage ist nicht, wie sie sein soll. Zurück zur Seite und noch einmal versuchen.";
    TooSlow, REQUEST_TIMEOUT: "Took too long", "Zu langsam";
        "The answer did not come in time. Look at the display before you try again.", "Die Antwort kam nicht rechtzeitig. Vor einem neuen Versuch auf die Anzeige sehen.";
    TooLarge, PAYLOAD_TOO_LARGE: "Too large", "Zu groß";
        "Nothing was changed. Send at most 16 KiB; shorten what was typed.", "Nichts wurde geändert. Höchstens 16 KiB senden; die Eingabe kürzen.";
    /// A configuration that was edited is larger than what is run here.
    LargeConfiguration, PAYLOAD_TOO_LARGE: "Too large", "Zu groß";
        "The configuration is larger than 256 KiB. Run it with `telltale replay --what-if`.", "Die Konfiguration ist größer als 256 KiB. Spielen Sie sie mit `telltale replay --what-if` durch.";
    TooMany, TOO_MANY_REQUESTS: "Too many requests", "Zu viele Anfragen";
        "Wait a moment and try again.", "Kurz warten und noch einmal versuchen.";
    LongHeader, REQUEST_HEADER_FIELDS_TOO_LARGE: "Headers too long", "Kopfzeilen zu lang";
        "Remove the cookies of this address in the browser and try again.", "Im Browser die Cookies dieser Adresse entfernen und noch einmal versuchen.";
    TooManySockets, SERVICE_UNAVAILABLE: "Too many displays", "Zu viele Anzeigen";
        "Close one of the open displays first.", "Bitte zuerst eine der offenen Anzeigen schließen.";
    /// The action cannot be written.
    Storage, SERVICE_UNAVAILABLE: "Not done", "Nicht ausgeführt";
        "The disk is full or broken, so nothing was changed. Call the control room.", "Der Speicher ist voll oder defekt, daher wurde nichts geändert. Leitstelle rufen.";
    /// A stop was requested and is not recorded yet.
    StopNotKept, SERVICE_UNAVAILABLE: "Stop requested, not recorded", "Anhalten verlangt, nicht aufgezeichnet";
        "The vehicle is asked to stop. The disk is full or broken, so that is not recorded yet. Call the control room.", "Das Fahrzeug soll anhalten. Der Speicher ist voll oder defekt, daher ist das noch nicht aufgezeichnet. Leitstelle rufen.";
    /// A stop was requested, and no node of the vehicle hears it.
    StopNotHeard, SERVICE_UNAVAILABLE: "Stop not received", "Anhalten nicht angekommen";
        "Nobody listens: the vehicle does not hear the request. Take over and stop it. The request goes out as soon as the vehicle listens.", "Niemand hört zu: Das Fahrzeug erfährt nichts davon. Übernehmen und anhalten. Die Anforderung geht hinaus, sobald das Fahrzeug zuhört.";
    /// Too many wait already.
    Busy, SERVICE_UNAVAILABLE: "Not done", "Nicht ausgeführt";
        "Others are waiting already, so nothing was changed. Look at the display, then try again.", "Es warten schon andere, daher wurde nichts geändert. Auf die Anzeige sehen, dann erneut versuchen.";
    Unavailable, SERVICE_UNAVAILABLE: "Not available", "Nicht verfügbar";
        "The server cannot do this now. Try again.", "Der Server kann das gerade nicht. Bitte noch einmal versuchen.";
    /// No diagnosis is shown before an operator logs in.
    Locked, CONFLICT: "Locked", "Gesperrt";
        "The vehicle is locked: no diagnosis is shown before an operator logs in.", "Das Fahrzeug ist gesperrt: keine Diagnose, bevor sich jemand anmeldet.";
    /// A recording is shown, in which nothing can be done.
    Replay, CONFLICT: "This is a replay", "Dies ist eine Aufzeichnung";
        "A recording is shown, so nothing was done. Act at the live display of the vehicle.", "Eine Aufzeichnung wird gezeigt, daher wurde nichts getan. An der Live-Anzeige des Fahrzeugs handeln.";
    /// There is no recorder, so nothing can be marked.
    NotRecording, SERVICE_UNAVAILABLE: "Not marked", "Nicht markiert";
        "Nothing is recorded at present, so this moment is not marked. Note the time.", "Gerade wird nichts aufgezeichnet, daher ist dieser Moment nicht markiert. Bitte die Uhrzeit notieren.";
    /// A mark is in memory, and the disk has not taken it yet.
    MarkUnsure, SERVICE_UNAVAILABLE: "Not surely marked", "Nicht sicher markiert";
        "The disk does not take it at present, so it is not sure that this moment is kept. Note the time.", "Der Speicher nimmt ihn gerade nicht auf, daher ist nicht sicher, ob dieser Moment erhalten bleibt. Bitte die Uhrzeit notieren.";
    /// An incident has as many marks as it may.
    ManyMarks, TOO_MANY_REQUESTS: "Not marked", "Nicht markiert";
        "This incident has many marks already, so this moment has none of its own. It is recorded all the same.", "Dieser Vorfall ist schon oft markiert, daher hat dieser Moment keine eigene Marke. Aufgezeichnet wird er.";
    /// A note is longer than it may be.
    LongNote, UNPROCESSABLE_ENTITY: "Not done", "Nicht ausgeführt";
        "A note has at most 2,000 bytes. Nothing was changed. Shorten it.", "Eine Notiz hat höchstens 2.000 Byte. Es wurde nichts geändert. Bitte kürzen.";
    /// A body is no form.
    NoForm, UNSUPPORTED_MEDIA_TYPE: "Not a form", "Kein Formular";
        "Nothing was done. Send it as a form: application/x-www-form-urlencoded.", "Es wurde nichts getan. Bitte als Formular senden: application/x-www-form-urlencoded.";
    /// The recording of an incident is still written.
    Unfinished, CONFLICT: "Not finished", "Noch nicht fertig";
        "This incident is still being recorded. Try again in a minute.", "Dieser Vorfall wird noch aufgezeichnet. In einer Minute noch einmal versuchen.";
    /// No recording of a group of incidents is at the console.
    NoneFetched, CONFLICT: "Nothing to judge", "Nichts zu beurteilen";
        "No recording of this group is here. Fetch some at their vehicles first.", "Von dieser Gruppe ist keine Aufzeichnung hier. Zuerst welche bei den Fahrzeugen holen.";
    /// A user has a what-if that is not over.
    StillJudging, TOO_MANY_REQUESTS: "Still running", "Läuft noch";
        "Your last what-if is not over, or too many wait. Wait for its end, or cancel it.", "Ihr letztes Was-wäre-wenn ist noch nicht fertig, oder zu viele warten. Das Ende abwarten oder es abbrechen.";
    /// The file of a recording is gone.
    NoRecording, NOT_FOUND: "No recording", "Keine Aufzeichnung";
        "The file of this recording is gone. `telltale incident verify` says more.", "Die Datei dieser Aufzeichnung ist nicht mehr da. `telltale incident verify` sagt mehr.";
    /// A recording cannot be replayed.
    NoReplay, CONFLICT: "No replay", "Keine Wiedergabe";
        "This recording cannot be replayed; the server's log says why. It can be downloaded.", "Diese Aufzeichnung kann nicht wiedergegeben werden; das Protokoll des Servers sagt, warum. Sie kann heruntergeladen werden.";
    /// No moment that can be read stands in an address.
    BadMoment, BAD_REQUEST: "Not a moment", "Kein Zeitpunkt";
        "Write a moment in the address as milliseconds since 1970, at=1795621444500, or in UTC, at=2026-11-25T15:44:04.5Z.", "Ein Zeitpunkt steht in der Adresse in Millisekunden seit 1970, at=1795621444500, oder in UTC, at=2026-11-25T15:44:04.5Z.";
    /// A moment that is still to come, and no recording to say so.
    Future, NOT_FOUND: "Still to come", "Noch nicht";
        "This moment is later than now, so nothing can show it. Choose an earlier one.", "Dieser Zeitpunkt liegt in der Zukunft: Nichts kann ihn zeigen. Einen früheren wählen.";
    /// A long recording is being read for its replay.
    Opening, SERVICE_UNAVAILABLE: "Opening the recording", "Die Aufzeichnung wird geöffnet";
        "It is read from its beginning to its end. This page goes on by itself.", "Sie wird vom Anfang bis zum Ende gelesen. Diese Seite geht von selbst weiter.";
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
