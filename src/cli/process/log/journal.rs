//! Entries for the journal of systemd over its own socket, which takes fields: `journalctl TELLTALE_USER=anna`.

use std::fmt::Write as _;
use std::os::unix::net::UnixDatagram;
use std::time::Duration;

use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

use super::{Fields, priority};

/// The place of the socket (systemd-journald.service(8)).
const PATH: &str = "/run/systemd/journal/socket";
/// A longer message is cut: the socket takes no larger datagram than the kernel's.
const MESSAGE_BYTES: usize = 32 << 10;
const WITHIN: Duration = Duration::from_millis(100);

/// The socket of the journal.
pub(super) struct Socket(UnixDatagram);

impl Socket {
    /// `None` where there is none.
    pub(super) fn open() -> Option<Socket> {
        Socket::at(PATH)
    }

    fn at(path: &str) -> Option<Socket> {
        let socket = UnixDatagram::unbound().ok()?;
        socket.connect(path).ok()?;
        // A journal that hangs holds nobody up for long.
        socket.set_write_timeout(Some(WITHIN)).ok()?;
        Some(Socket(socket))
    }
}

impl<S: Subscriber> Layer<S> for Socket {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut fields = Fields::default();
        event.record(&mut fields);
        let (level, target) = (priority(*event.metadata().level()), event.metadata().target());
        let sent = self.0.send(&entry(level, target, &fields, true));
        // Fields may be too many. Without the journal nobody could be told.
        if sent.is_err() {
            let _ = self.0.send(&entry(level, target, &fields, false));
        }
    }
}

/// An entry as the socket takes it: each field with its length, so that values may have several lines. The message has
/// all values too: `journalctl` shows it alone.
fn entry(priority: u8, target: &str, fields: &Fields, with_fields: bool) -> Vec<u8> {
    let mut message = fields.message.clone();
    for (name, value) in &fields.others {
        // A string never fails to grow.
        let _ = write!(message, " {name}={}", text(value));
    }
    message.truncate(message.floor_char_boundary(MESSAGE_BYTES));
    let mut entry = Vec::new();
    put(&mut entry, "MESSAGE", &message);
    put(&mut entry, "PRIORITY", &priority.to_string());
    put(&mut entry, "SYSLOG_IDENTIFIER", "telltale");
    put(&mut entry, "TELLTALE_TARGET", target);
    for (name, value) in fields.others.iter().filter(|_| with_fields) {
        let name: String = name.chars().map(|it| if it.is_ascii_alphanumeric() { it } else { '_' }).collect();
        put(&mut entry, &format!("TELLTALE_{}", name.to_ascii_uppercase()), &text(value));
    }
    entry
}

fn put(entry: &mut Vec<u8>, name: &str, value: &str) {
    entry.extend(name.as_bytes());
    entry.push(b'\n');
    entry.extend((value.len() as u64).to_le_bytes());
    entry.extend(value.as_bytes());
    entry.push(b'\n');
}

fn text(value: &serde_json::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

#[cfg(test)]
mod tests {
    use tracing_subscriber::layer::SubscriberExt as _;

    use super::*;

    #[test]
    fn an_entry_has_its_message_its_priority_and_its_fields() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let path = folder.join("socket");
        let journal = UnixDatagram::bind(&path).unwrap();
        let socket = Socket::at(path.to_str().unwrap()).unwrap();
        tracing::subscriber::with_default(tracing_subscriber::registry().with(socket), || {
            tracing::warn!(user = "anna", n = 3, error = %"no\nroom", "it is refused");
        });
        let mut bytes = [0; 4096];
        let length = journal.recv(&mut bytes).unwrap();
        let fields: Vec<(String, String)> = fields(&bytes[..length]);
        let field = |name: &str| &*fields.iter().find(|(known, _)| known == name).unwrap().1;
        assert_eq!(field("MESSAGE"), "it is refused error=no\nroom n=3 user=anna");
        assert_eq!((field("PRIORITY"), field("SYSLOG_IDENTIFIER")), ("4", "telltale"));
        assert_eq!((field("TELLTALE_USER"), field("TELLTALE_N")), ("anna", "3"));
        assert_eq!((field("TELLTALE_ERROR"), field("TELLTALE_TARGET")), ("no\nroom", module_path!()));
    }

    /// The fields of an entry.
    fn fields(mut entry: &[u8]) -> Vec<(String, String)> {
        let mut fields = Vec::new();
        while let Some(end) = entry.iter().position(|&byte| byte == b'\n') {
            let (name, rest) = (&entry[..end], &entry[end + 1..]);
            let length = u64::from_le_bytes(rest[..8].try_into().unwrap()) as usize;
            let value = &rest[8..8 + length];
            fields.push([name, value].map(|it| String::from_utf8(it.to_vec()).unwrap()).into());
            entry = &rest[8 + length + 1..];
        }
        fields
    }
}
