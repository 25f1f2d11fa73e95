//! Names the topics of a configuration for which a recording has no message, and the topics of the recording that
//! were probably meant.

use std::sync::Arc;

use telltale_msg::messages::DIAGNOSTIC_ARRAY;
use telltale_record::file::Channel;

/// Topics that are named in the place of one.
const NAMED_MAX: usize = 5;

/// A topic without any message so far.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Unheard {
    pub topic: String,
    /// Empty where the configuration leaves it out.
    pub type_name: String,
}

/// The sentence about these topics. `channels`: those of the recording that the configuration does not read.
pub(super) fn sentences(unheard: &[Unheard], channels: &[&Arc<Channel>]) -> Vec<String> {
    let (mut sentences, mut without) = (Vec::new(), Vec::new());
    for it in unheard {
        let mut others: Vec<&str> =
            channels.iter().filter(|channel| may_be_meant(it, channel)).map(|it| &*it.topic).collect();
        others.sort_unstable();
        others.dedup();
        if others.is_empty() {
            without.push(&*it.topic);
            continue;
        }
        let more = match others.len().saturating_sub(NAMED_MAX) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        others.truncate(NAMED_MAX);
        let named = others.join(", ");
        let what_to_do = match it.type_name == DIAGNOSTIC_ARRAY {
            true => format!("write `diagnostics: {{ topics: [{named}] }}` to judge by what is said there"),
            false => "name that topic in the configuration if it is meant".to_owned(),
        };
        let topic = &it.topic;
        sentences
            .push(format!("the recording has no messages of {topic}, but of {named}{more}: {what_to_do}"));
    }
    if !without.is_empty() {
        sentences.push(format!("the recording has no messages of {}", without.join(", ")));
    }
    sentences
}

/// Of the same type, and called the same in another namespace; diagnostics may be called anything, but what an
/// aggregator made of them is not meant.
fn may_be_meant(unheard: &Unheard, channel: &Channel) -> bool {
    let last = |topic: &str| topic.rsplit('/').next().unwrap_or(topic).to_owned();
    let (wanted, is) = (last(&unheard.topic), last(&channel.topic));
    let is_its_type = unheard.type_name.is_empty() || unheard.type_name == *channel.type_name;
    let is_diagnostics = unheard.type_name == DIAGNOSTIC_ARRAY && is != "diagnostics_agg";
    is_its_type && (wanted == is || is_diagnostics)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_topic_of_another_namespace_is_named_with_what_to_write() {
        let unheard = |topic: &str, type_name: &str| Unheard {
            topic: topic.to_owned(),
            type_name: type_name.to_owned(),
        };
        let channel = |topic: &str, type_name: &str| Arc::new(Channel::cdr(topic, type_name, None));
        let recorded = [
            channel("/j100/diagnostics", DIAGNOSTIC_ARRAY),
            channel("/j100/diagnostics_agg", DIAGNOSTIC_ARRAY),
            channel("/j100/scan", "sensor_msgs/msg/LaserScan"),
            channel("/j100/odom", "nav_msgs/msg/Odometry"),
            channel("/imu", "sensor_msgs/msg/Imu"),
        ];
        let recorded: Vec<&Arc<Channel>> = recorded.iter().collect();
        let asked = [
            unheard("/diagnostics", DIAGNOSTIC_ARRAY),
            unheard("/scan", "sensor_msgs/msg/LaserScan"),
            unheard("/base/odom", ""),
            unheard("/odom", "geometry_msgs/msg/Pose"),
            unheard("/nothing", ""),
        ];
        let name_it = "name that topic in the configuration if it is meant";
        assert_eq!(
            sentences(&asked, &recorded),
            [
                "the recording has no messages of /diagnostics, but of /j100/diagnostics: write `diagnostics: { topics: \
                 [/j100/diagnostics] }` to judge by what is said there"
                    .to_owned(),
                format!("the recording has no messages of /scan, but of /j100/scan: {name_it}"),
                format!("the recording has no messages of /base/odom, but of /j100/odom: {name_it}"),
                "the recording has no messages of /odom, /nothing".to_owned(),
            ]
        );
        let many: Vec<_> =
            (1..8).map(|it| channel(&format!("/r{it}/diagnostics"), DIAGNOSTIC_ARRAY)).collect();
        let many: Vec<&Arc<Channel>> = many.iter().collect();
        let said = sentences(&asked[..1], &many);
        assert!(said[0].contains("/r5/diagnostics and 2 more: write"), "{said:?}");
    }
}
