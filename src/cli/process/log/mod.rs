//! The log: on standard error, text for people or JSON for programs; in the journal of systemd, entries with fields.

mod journal;

use std::fmt;
use std::io::IsTerminal as _;
use std::os::fd::AsFd;
use std::sync::OnceLock;
use std::time::SystemTime;

use serde_json::{Map, Value};
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::field::MakeExt as _;
use tracing_subscriber::fmt::format::{self, Writer};
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer as _};

use self::journal::Socket;
use crate::clock::Clock;
use crate::ros;
use crate::ros::publish::log_lines::LogLines;
use crate::yaml::plain;

/// How the log is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum LogForm {
    /// Lines for people; for the journal, entries with priority and fields
    #[default]
    Text,
    /// A JSON object on each line: time, level, target, message, fields
    Json,
}

impl LogForm {
    /// The word of the flag.
    pub fn word(self) -> &'static str {
        match self {
            LogForm::Text => "text",
            LogForm::Json => "json",
        }
    }
}

/// The form that the command line asks for. It is set once, before any log starts.
static FORM: OnceLock<LogForm> = OnceLock::new();

/// Chooses the form of the log, before [`start`].
pub fn choose(form: LogForm) {
    let _ = FORM.set(form);
}

/// The chosen form.
pub fn form() -> LogForm {
    FORM.get().copied().unwrap_or_default()
}

/// Starts the log of a program that runs on. `RUST_LOG` wins over `level`.
pub fn start(level: &str) {
    let words = std::env::var("RUST_LOG").ok().filter(|words| !words.trim().is_empty());
    let words = words.unwrap_or_else(|| level.to_owned());
    // Later directives win, so the library's flood is let through only where it is named.
    let filter = EnvFilter::new(format!("{},async_nats=off,{words}", ros::LOG_FILTER));
    let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).fmt_fields(plain_fields());
    let lines = match form() {
        LogForm::Json => lines.event_format(Json(Clock::start())).boxed(),
        LogForm::Text if is_journal() => match Socket::open() {
            Some(socket) => socket.boxed(),
            None => lines.with_ansi(false).event_format(Journal).boxed(),
        },
        LogForm::Text => {
            let colours = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
            lines.with_ansi(colours).with_target(false).boxed()
        }
    };
    tracing_subscriber::registry().with(filter).with(lines).with(LogLines).init();
}

/// Fields in which nothing acts on a terminal. Further lines are indented: none looks like an entry of its own.
fn plain_fields() -> impl for<'w> FormatFields<'w> + 'static {
    let field = |out: &mut Writer<'_>, field: &Field, value: &dyn fmt::Debug| {
        let value = plain::escaped(&format!("{value:?}")).replace('\n', "\n    ");
        match field.name() {
            "message" => write!(out, "{value}"),
            // Where in its source a library speaks.
            name if name.starts_with("log.") => Ok(()),
            name => write!(out, "{name}={value}"),
        }
    };
    format::debug_fn(field).delimited(" ")
}

/// Whether standard error leads to the journal of systemd, which names the device and the number of its stream.
fn is_journal() -> bool {
    let named = std::env::var("JOURNAL_STREAM").ok();
    let stat = rustix::fs::fstat(std::io::stderr().as_fd());
    named.zip(stat.ok()).is_some_and(|(named, stat)| named == format!("{}:{}", stat.st_dev, stat.st_ino))
}

/// Lines with the priority that the journal takes from their beginning (sd-daemon(3)), where it has no socket, as in a
/// container. It has the time itself.
struct Journal;

impl<S, N> FormatEvent<S, N> for Journal
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut out: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let mut text = String::new();
        context.format_fields(Writer::new(&mut text), event)?;
        write_with_priority(&mut out, *event.metadata().level(), &text)
    }
}

/// Each line is an entry of its own in the journal, so each has the priority.
fn write_with_priority(out: &mut dyn fmt::Write, level: Level, text: &str) -> fmt::Result {
    text.lines().try_for_each(|line| writeln!(out, "<{}>{line}", priority(level)))
}

/// The number of the level in the journal.
fn priority(level: Level) -> u8 {
    match level {
        Level::ERROR => 3,
        Level::WARN => 4,
        Level::INFO => 6,
        _ => 7,
    }
}

/// `{"time":"...","level":"warn","target":"...","message":"...","fields":{...}}`
struct Json(Clock);

impl<S, N> FormatEvent<S, N> for Json
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, _: &FmtContext<'_, S, N>, mut out: Writer<'_>, event: &Event<'_>) -> fmt::Result {
        let mut fields = Fields::default();
        event.record(&mut fields);
        let (level, target) = (*event.metadata().level(), event.metadata().target());
        let line = line(self.0.wall(), level, target, fields).to_string();
        writeln!(out, "{}", plain::json(&line))
    }
}

fn line(time: SystemTime, level: Level, target: &str, fields: Fields) -> Value {
    // The order of the keys is that of the text.
    serde_json::json!({
        "time": humantime::format_rfc3339_millis(time).to_string(),
        "level": level.as_str().to_ascii_lowercase(),
        "target": target,
        "message": fields.message,
        "fields": fields.others,
    })
}

#[derive(Default)]
struct Fields {
    message: String,
    others: Map<String, Value>,
}

impl Fields {
    fn put(&mut self, field: &Field, value: impl Into<Value>) {
        self.others.insert(field.name().to_owned(), value.into());
    }
}

impl Visit for Fields {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        match field.name() {
            "message" => self.message = format!("{value:?}"),
            _ => self.put(field, format!("{value:?}")),
        }
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        match field.name() {
            "message" => self.message = value.to_owned(),
            _ => self.put(field, value),
        }
    }

    fn record_error(&mut self, field: &Field, value: &(dyn std::error::Error + 'static)) {
        self.put(field, value.to_string());
    }

    fn record_bool(&mut self, field: &Field, value: bool) {
        self.put(field, value);
    }

    fn record_i64(&mut self, field: &Field, value: i64) {
        self.put(field, value);
    }

    fn record_u64(&mut self, field: &Field, value: u64) {
        self.put(field, value);
    }

    fn record_f64(&mut self, field: &Field, value: f64) {
        self.put(field, value);
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::sync::{Arc, Mutex};

    use super::*;

    #[derive(Clone, Default)]
    struct Written(Arc<Mutex<Vec<u8>>>);

    impl Write for Written {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    /// What is written of two events.
    fn written<N>(
        format: impl FormatEvent<tracing_subscriber::Registry, N> + Send + Sync + 'static,
        fields: N,
    ) -> String
    where
        N: for<'w> FormatFields<'w> + Send + Sync + 'static,
    {
        let written = Written::default();
        let writer = written.clone();
        let log = tracing_subscriber::fmt().with_ansi(false).with_writer(move || writer.clone());
        let log = log.fmt_fields(fields);
        tracing::subscriber::with_default(log.event_format(format).finish(), || {
            tracing::warn!(late = true, peer = "10.0.0.1", n = 3, "the first \"line\"\nthe second\u{1b}[2J");
            tracing::error!(error = %std::io::Error::other("broken"), "it does not go on");
        });
        let bytes = written.0.lock().unwrap().clone();
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn the_journal_gets_a_priority_on_each_line() {
        let expected = "<4>the first \"line\"\n<4>    the second\\u{1b}[2J late=true peer=\"10.0.0.1\" n=3\n\
                        <3>it does not go on error=broken\n";
        assert_eq!(written(Journal, plain_fields()), expected);
    }

    #[test]
    fn programs_get_an_object_on_each_line() {
        let text = written(Json(Clock::start()), plain_fields());
        let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let [first, second] = &lines[..] else { panic!("{text}") };
        assert_eq!(first["message"], "the first \"line\"\nthe second\u{1b}[2J");
        assert_eq!(first["fields"], serde_json::json!({ "late": true, "peer": "10.0.0.1", "n": 3 }));
        assert_eq!((&first["level"], &second["level"]), (&"warn".into(), &"error".into()));
        assert_eq!(first["target"], module_path!());
        assert_eq!(second["fields"]["error"], "broken");
        let time = first["time"].as_str().unwrap();
        assert!(humantime::parse_rfc3339(time).is_ok(), "{time}");
    }
}
