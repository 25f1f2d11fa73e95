//! The frames that are sent: the only place that knows their format.
//!
//! Every frame is made once for each snapshot and shared by all listeners. The first listener that needs it
//! makes it, so without a listener nothing is made, and nobody waits for another task.

mod html;
mod json;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use axum::body::to_bytes;
use axum::extract::ws::Utf8Bytes;
use axum::response::Response;

pub use html::Frame;

use crate::engine::snapshot::Snapshot;
use crate::engine::time::Timestamp;
use crate::runtime::Published;
use crate::web::view;
use crate::web::view::versions::{Seen, Versions};
use crate::web::view::{Lang, Trends, permitted};

/// The latest frames, one per form.
#[derive(Debug, Default)]
pub struct Frames {
    html: [Mutex<Option<Arc<Frame>>>; Lang::ALL.len()],
    json: Mutex<Option<(Arc<Snapshot>, Utf8Bytes)>>,
    versions: Versions,
}

impl Frames {
    /// The frame of this snapshot, or of a newer one that another listener has seen already.
    pub fn html(&self, published: &Published, lang: Lang, trends: &Trends) -> Arc<Frame> {
        let mut latest = self.html[lang as usize].lock().unwrap_or_else(PoisonError::into_inner);
        match &*latest {
            Some(frame) if frame.revision() >= published.snapshot.revision => frame.clone(),
            before => {
                let Published { snapshot, .. } = published;
                let seen = self.observe(published);
                let fragments = view::fragments(&permitted(published), &seen, lang, trends);
                let frame =
                    Arc::new(Frame::new(snapshot.seq, snapshot.revision, fragments, before.as_deref()));
                *latest = Some(frame.clone());
                frame
            }
        }
    }

    /// The versions by which commands about this snapshot are given.
    pub fn observe(&self, published: &Published) -> Seen {
        self.versions.observe(&published.snapshot)
    }

    /// The snapshot as JSON.
    pub fn json(&self, published: &Published) -> Utf8Bytes {
        let mut latest = self.json.lock().unwrap_or_else(PoisonError::into_inner);
        match &*latest {
            Some((of, json))
                if of.revision >= published.snapshot.revision && of.now >= published.snapshot.now =>
            {
                json.clone()
            }
            _ => {
                self.observe(published);
                let json = Utf8Bytes::from(json::encode(&permitted(published)));
                *latest = Some((published.snapshot.clone(), json.clone()));
                json
            }
        }
    }
}

/// A sign of life for a page that shows everything up to `seq`; `number` grows by one each time.
/// `now` on the monotonic clock is what the page finds delays by: the wall clock may be stepped.
pub fn beat(number: u64, seq: u64, now: Timestamp, at: SystemTime) -> Utf8Bytes {
    let (ms, at) = (now.as_nanos() / 1_000_000, json::rfc3339(at));
    Utf8Bytes::from(format!("{{\"beat\":{number},\"seq\":{seq},\"ms\":{ms},\"at\":\"{at}\"}}"))
}

/// What became of a tap that came over the socket, as HTTP would have answered it:
/// `{"tap": NAME, "status": 200, "said": {...}}`.
pub async fn answered(tap: &str, answer: Response) -> Utf8Bytes {
    let status = answer.status().as_u16();
    // What was made a moment ago in memory can be read.
    let said = to_bytes(answer.into_body(), ANSWER_BYTES_MAX).await.unwrap_or_default();
    let said: serde_json::Value = serde_json::from_slice(&said).unwrap_or_default();
    let tap = serde_json::Value::from(tap);
    Utf8Bytes::from(format!("{{\"tap\":{tap},\"status\":{status},\"said\":{said}}}"))
}

/// Who takes over a vehicle that drives, in words: `{"hand_over": "..."}`, or `null`.
pub fn hand_over(words: Option<&str>) -> Utf8Bytes {
    Utf8Bytes::from(serde_json::json!({ "hand_over": words }).to_string())
}

/// The words of a refusal are few.
const ANSWER_BYTES_MAX: usize = 64 * 1024;

/// A sign of life for a page that asks for what it shows: what there is to ask for, and the stage.
pub fn pulse(number: u64, published: &Published, now: Timestamp, lang: Lang) -> Utf8Bytes {
    let Published { snapshot, at } = permitted(published);
    let (stage, overall) = (snapshot.stage, snapshot.overall);
    let pulse = serde_json::json!({
        "beat": number, "seq": snapshot.seq, "revision": snapshot.revision,
        "ms": now.as_nanos() / 1_000_000, "at": json::rfc3339(at),
        "stage": stage.as_str(), "overall": overall.as_str(), "word": lang.stage(stage, overall),
    });
    Utf8Bytes::from(pulse.to_string())
}
