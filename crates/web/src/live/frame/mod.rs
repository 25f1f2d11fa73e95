//! The messages to pages and programs. Only this folder knows their format.
//!
//! Every frame is made once for each snapshot and shared by all connections. The first connection that needs
//! a frame makes it, so without connections nothing is made.

mod html;
mod json;
mod parts;
mod schema;
#[cfg(test)]
mod tests;
mod wire;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use axum::body::to_bytes;
use axum::extract::ws::Utf8Bytes;
use axum::response::Response;
use serde_json::Value;

pub use html::Frame;
pub use json::Module as ModuleSchema;
pub use parts::{Form, Sent, modules};
pub use schema::{Snapshot as SnapshotSchema, StreamMessage};

use crate::schema::schema_of;
use crate::texts::Lang;
use crate::view;
use crate::view::versions::{Seen, Versions};
use crate::view::{RecorderState, Trends, permitted};
use parts::Parts;
use telltale_engine::time::Timestamp;
use telltale_runtime::Published;

/// The latest frames, one per form.
#[derive(Debug, Default)]
pub struct Frames {
    html: [Mutex<Option<Arc<Frame>>>; Lang::ALL.len()],
    parts: Mutex<Option<Parts>>,
    versions: Versions,
}

impl Frames {
    /// The frame of this snapshot, or of a newer one that another connection got already.
    pub fn html(&self, published: &Published, lang: Lang, trends: &Trends) -> Arc<Frame> {
        let mut latest = self.html[lang as usize].lock().unwrap_or_else(PoisonError::into_inner);
        match &*latest {
            Some(frame) if frame.revision() >= published.revision() => frame.clone(),
            before => {
                let seen = self.observe(published);
                let fragments = view::fragments(&permitted(published), &seen, lang, trends);
                let frame =
                    Arc::new(Frame::new(published.seq(), published.revision(), fragments, before.as_deref()));
                *latest = Some(frame.clone());
                frame
            }
        }
    }

    /// The versions by which commands about this snapshot are given.
    pub fn observe(&self, published: &Published) -> Seen {
        self.versions.observe(published)
    }

    /// The whole snapshot as JSON.
    pub fn json(&self, published: &Published) -> Utf8Bytes {
        self.with_parts(published, |parts| parts.whole(false))
    }

    /// The next message for a program that has `sent`, and what it has then.
    pub fn stream(&self, published: &Published, form: Form, sent: Option<Sent>) -> (Utf8Bytes, Sent) {
        self.with_parts(published, |parts| parts.message(form, sent))
    }

    fn with_parts<T>(&self, published: &Published, make: impl FnOnce(&mut Parts) -> T) -> T {
        let mut latest = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        match &mut *latest {
            Some(parts) => {
                if !is_as_late(parts.published(), published) {
                    self.observe(published);
                    parts.follow(permitted(published));
                }
                make(parts)
            }
            none => {
                self.observe(published);
                make(none.insert(Parts::new(permitted(published))))
            }
        }
    }
}

/// Whether neither the words nor the ages in `of` are of an earlier instant.
fn is_as_late(of: &Published, published: &Published) -> bool {
    of.revision() >= published.revision()
        && (of.rewinds, of.snapshot.now) >= (published.rewinds, published.snapshot.now)
}

/// The JSON Schema of [`Frames::json`].
pub fn snapshot_schema() -> Value {
    schema_of::<SnapshotSchema<'_>>()
}

/// The JSON Schema of the messages of [`Frames::stream`].
pub fn stream_schema() -> Value {
    schema_of::<StreamMessage<'_>>()
}

/// A sign of life for a page that shows everything up to `seq`; `number` grows by one each time.
/// `now` on the monotonic clock is what the page finds delays by: the wall clock may be stepped.
/// `recorder` is what the recorder does, if there is one.
pub fn beat(
    number: u64,
    seq: u64,
    now: Timestamp,
    at: SystemTime,
    recorder: Option<RecorderState>,
) -> Utf8Bytes {
    let (ms, at) = (now.as_nanos() / 1_000_000, wire::rfc3339(at));
    let recorder =
        recorder.map_or(String::new(), |recorder| format!(",\"recorder\":\"{}\"", recorder.as_str()));
    Utf8Bytes::from(format!("{{\"beat\":{number},\"seq\":{seq},\"ms\":{ms},\"at\":\"{at}\"{recorder}}}"))
}

/// The answer to a tap that came over the socket, as HTTP would have answered it:
/// `{"tap": NAME, "status": 200, "said": {...}}`.
pub async fn answered(tap: &str, answer: Response) -> Utf8Bytes {
    let status = answer.status().as_u16();
    // A file made a moment ago in memory can be read.
    let said = to_bytes(answer.into_body(), ANSWER_BYTES_MAX).await.unwrap_or_default();
    let said: serde_json::Value = serde_json::from_slice(&said).unwrap_or_default();
    let tap = serde_json::Value::from(tap);
    Utf8Bytes::from(format!("{{\"tap\":{tap},\"status\":{status},\"said\":{said}}}"))
}

/// That the session of a page is used from another address, too: `{"elsewhere": "..."}`.
pub fn elsewhere(words: &str) -> Utf8Bytes {
    Utf8Bytes::from(serde_json::json!({ "elsewhere": words }).to_string())
}

/// The announcement that an operator takes over a driving vehicle: `{"hand_over": "..."}`, or `null`.
pub fn hand_over(words: Option<&str>) -> Utf8Bytes {
    Utf8Bytes::from(serde_json::json!({ "hand_over": words }).to_string())
}

/// Enough for any refusal.
const ANSWER_BYTES_MAX: usize = 64 * 1024;

/// A sign of life for a developer's page, with the newest revision and the stage.
pub fn pulse(number: u64, published: &Published, now: Timestamp, lang: Lang) -> Utf8Bytes {
    let Published { snapshot, at, .. } = permitted(published);
    let (stage, overall) = (snapshot.stage, snapshot.overall);
    let pulse = serde_json::json!({
        "beat": number, "seq": snapshot.seq, "revision": snapshot.revision,
        "ms": now.as_nanos() / 1_000_000, "at": wire::rfc3339(at),
        "stage": stage.as_str(), "overall": overall.as_str(), "word": lang.stage_of(&snapshot),
        "state": lang.state(overall),
    });
    Utf8Bytes::from(pulse.to_string())
}
