//! The warnings and errors of the program's own log, on their way to `/rosout`.
//!
//! The log is one for the whole program, and so is this channel. A receiver that is too slow loses the oldest
//! lines, which is counted; nobody waits for it.

use std::fmt::Write as _;
use std::sync::{Arc, LazyLock};

use tokio::sync::broadcast;
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

use telltale_engine::model::output::LogLevel;

/// Lines that may wait for their receiver.
const LINES_MAX: usize = 64;

/// The longest line.
pub const TEXT_BYTES_MAX: usize = 1024;

static LINES: LazyLock<broadcast::Sender<Arc<LogLine>>> = LazyLock::new(|| broadcast::Sender::new(LINES_MAX));

/// A line of the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogLine {
    pub level: LogLevel,
    /// The part of the program that says it.
    pub name: &'static str,
    pub text: String,
    pub file: &'static str,
    pub line: u32,
}

/// The lines from now on.
pub fn subscribe() -> broadcast::Receiver<Arc<LogLine>> {
    LINES.subscribe()
}

/// Takes the warnings and errors out of the log.
#[derive(Debug, Clone, Copy)]
pub struct LogLines;

impl<S: Subscriber> Layer<S> for LogLines {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let metadata = event.metadata();
        let Some(level) = level(metadata) else { return };
        let mut text = Text::default();
        event.record(&mut text);
        let (file, line) = (metadata.file().unwrap_or_default(), metadata.line().unwrap_or_default());
        // Nobody may listen.
        let _ = LINES.send(Arc::new(LogLine { level, name: NAME, text: text.whole(), file, line }));
    }
}

/// The name of the lines of the log.
const NAME: &str = "telltale";

/// `None` for what is not published: the vehicle's network is not told who knocks at the page's door.
fn level(metadata: &Metadata<'_>) -> Option<LogLevel> {
    let target = metadata.target();
    if !target.starts_with("telltale") || target.starts_with("telltale_web") {
        return None;
    }
    match *metadata.level() {
        Level::ERROR => Some(LogLevel::Error),
        Level::WARN => Some(LogLevel::Warning),
        _ => None,
    }
}

/// The text of a line, without fields that name users and addresses.
#[derive(Default)]
struct Text {
    message: String,
    error: String,
}

impl Text {
    fn whole(self) -> String {
        let Text { mut message, error } = self;
        if !error.is_empty() {
            message = format!("{message}: {error}");
        }
        message.truncate(message.floor_char_boundary(TEXT_BYTES_MAX));
        message
    }
}

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        let into = match field.name() {
            "message" => &mut self.message,
            "error" => &mut self.error,
            _ => return,
        };
        // A string takes everything.
        let _ = write!(into, "{value:?}");
    }
}

#[cfg(test)]
mod tests {
    use tracing_subscriber::layer::SubscriberExt as _;

    use super::*;

    #[test]
    fn warnings_and_errors_are_taken_without_users_and_callers() {
        let mut lines = subscribe();
        let log = tracing_subscriber::registry().with(LogLines);
        tracing::subscriber::with_default(log, || {
            tracing::info!("nobody needs to know");
            tracing::error!(target: "telltale_web::auth", "a login failed");
            tracing::error!(target: "rustdds", "another program");
            tracing::warn!(who = "anna", error = %"the disk is full", "in no audit log");
            tracing::error!("{}", "x".repeat(2 * TEXT_BYTES_MAX));
        });
        let first = lines.try_recv().unwrap();
        assert_eq!((first.level, &*first.text), (LogLevel::Warning, "in no audit log: the disk is full"));
        assert!(first.file.ends_with("log_lines.rs") && first.line > 0);
        let second = lines.try_recv().unwrap();
        assert_eq!((second.level, second.text.len()), (LogLevel::Error, TEXT_BYTES_MAX));
        assert!(lines.try_recv().is_err());
    }
}
