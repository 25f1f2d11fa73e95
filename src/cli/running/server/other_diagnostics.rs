//! Says if the statuses of the vehicle are on a topic that the configuration does not read, as those of a robot with a
//! namespace are.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;

use crate::engine::discovery::{Discovery, Endpoint, TopicSeen};
use crate::engine::model::monitors::{DIAGNOSTIC_ARRAY, DIAGNOSTICS};
use crate::engine::model::{Model, same_topic};

/// Nodes that are only late, and a reader that is only being made, are found in this time.
const LOOK_EVERY: Duration = Duration::from_secs(10);
/// Topics that are named.
const NAMED_MAX: usize = 5;

/// Looks until there is something to say, which is said once. `model`: the configuration at the start.
pub async fn say(model: Arc<Model>, discovery: watch::Receiver<Arc<Discovery>>) {
    loop {
        tokio::time::sleep(LOOK_EVERY).await;
        if let Some(sentence) = sentence(&model, &discovery.borrow()) {
            tracing::warn!("{sentence}");
            return;
        }
    }
}

/// `None` while a topic of diagnostics is read or will be, or nobody publishes any.
fn sentence(model: &Model, discovery: &Discovery) -> Option<String> {
    let is_published = |topic: &&TopicSeen| {
        topic.publishers.iter().any(|it: &Endpoint| !it.ours && it.type_name == DIAGNOSTIC_ARRAY)
            && !topic.name.ends_with("/diagnostics_agg")
    };
    let published: Vec<&TopicSeen> = discovery.topics.iter().filter(is_published).collect();
    let is_read = |topic: &&TopicSeen| {
        model.watched.diagnostics_topics().any(|(it, _)| same_topic(it, &topic.name))
            || topic.subscribers.iter().any(|it| it.ours)
    };
    if published.is_empty() || published.iter().any(is_read) {
        return None;
    }
    let named: Vec<&str> = published.iter().take(NAMED_MAX).map(|topic| &*topic.name).collect();
    let named = named.join(", ");
    Some(format!(
        "nobody publishes a topic of diagnostics that the configuration reads ({} without `diagnostics`), but {named}: write \
         `diagnostics: {{ topics: [{named}] }}` if these are the statuses of this vehicle",
        DIAGNOSTICS
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn topic(name: &str, is_read: bool) -> TopicSeen {
        let end = |ours| Endpoint { ours, type_name: DIAGNOSTIC_ARRAY.to_owned(), ..Endpoint::default() };
        let subscribers = if is_read { vec![end(true)] } else { vec![end(false)] };
        TopicSeen { name: name.to_owned(), publishers: vec![end(false)], subscribers, ..TopicSeen::default() }
    }

    fn said(topics: Vec<TopicSeen>) -> Option<String> {
        let file = "vehicle: { stages: none }\ngroups: [{ id: a, modules: [{ id: b, status: b }] }]\n";
        let model = crate::config::parse("a.yaml", file).unwrap().model;
        sentence(&model, &Discovery { topics, ..Discovery::default() })
    }

    #[test]
    fn statuses_on_a_topic_that_nobody_reads_are_said() {
        let unread = said(vec![topic("/j100/diagnostics", false), topic("/diagnostics_agg", false)]);
        assert!(
            unread.is_some_and(|said| said.contains("write `diagnostics: { topics: [/j100/diagnostics] }`"))
        );
        assert_eq!(said(vec![topic("/diagnostics", true), topic("/j100/diagnostics", false)]), None);
        assert_eq!(said(vec![topic("/diagnostics_agg", false)]), None);
        assert_eq!(said(Vec::new()), None);
        // Its reader is only being made.
        assert_eq!(said(vec![topic("/diagnostics", false)]), None);
    }
}
