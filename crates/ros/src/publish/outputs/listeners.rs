//! Whether the requests to the vehicle have matching readers, from discovery.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use super::{OutputContext, offer};
use crate::Publisher;
use crate::engine_queue::stopped;
use crate::every;
use telltale_engine::input::{Input, ListenerReport};
use telltale_engine::model::output::{Output, Publication};
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::received::Stamped;

const LOOK: Duration = Duration::from_millis(250);

/// Existing readers are discovered within this time.
const DISCOVERED_WITHIN: Span = Span::from_secs(3);

/// Reports each change to the engine, until this participant's life is over.
pub async fn watch(publisher: Arc<Publisher>, mut context: OutputContext) {
    let requests: Vec<(Output, Box<str>)> = context.topics.iter().filter_map(request).collect();
    let opened = context.clock.now();
    let mut told: BTreeMap<Output, bool> = BTreeMap::new();
    let mut looks = every(LOOK);
    loop {
        tokio::select! {
            () = stopped(&mut context.end) => return,
            _ = looks.tick() => {}
        }
        for (output, topic) in &requests {
            let (type_name, quality) = offer(Publication::Vehicle(*output));
            let heard = publisher.has_reader(topic, type_name, quality);
            if is_news(heard, told.get(output).copied(), opened, context.clock.now())
                && tell(&context, ListenerReport { output: *output, topic: topic.clone(), heard })
            {
                told.insert(*output, heard);
            }
        }
    }
}

fn request(topic: &super::OutputTopic) -> Option<(Output, Box<str>)> {
    match topic.publication {
        Publication::Vehicle(output @ (Output::ManeuverStop | Output::Deceleration)) => {
            Some((output, topic.topic.clone()))
        }
        _ => None,
    }
}

/// In the beginning nobody may have been discovered yet.
fn is_news(heard: bool, told: Option<bool>, opened: Timestamp, now: Timestamp) -> bool {
    match told {
        Some(before) => before != heard,
        None => heard || now >= opened + DISCOVERED_WITHIN,
    }
}

/// A full queue is tried again with the next look.
fn tell(context: &OutputContext, news: ListenerReport) -> bool {
    let ListenerReport { topic, heard, .. } = &news;
    match heard {
        true => tracing::info!("the vehicle listens to {topic}"),
        false => tracing::warn!("nobody listens to {topic}"),
    }
    let stamped = Stamped::new(Input::Listened(news), context.clock.now());
    context.inputs.try_send(stamped).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_is_missed_before_discovery_had_its_time() {
        let at = Timestamp::from_millis;
        for (heard, told, now, news) in [
            (false, None, 2_999, false),
            (false, None, 3_000, true),
            (true, None, 10, true),
            (true, Some(true), 10, false),
            (false, Some(true), 10, true),
            (false, Some(false), 9_000, false),
            (true, Some(false), 9_000, true),
        ] {
            assert_eq!(is_news(heard, told, at(0), at(now)), news, "{heard} {told:?} {now}");
        }
    }
}
