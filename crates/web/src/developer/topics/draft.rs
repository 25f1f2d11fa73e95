//! A monitor of a topic's rate, as text for the configuration.

use telltale_engine::discovery::TopicSeen;
use telltale_engine::pace::RateLimits;

use crate::texts::DevWords;

/// The text, if one can be proposed, and what there is to say of it.
pub struct Draft {
    pub text: Option<String>,
    pub about: &'static str,
}

/// `None` for what the configuration cannot name.
pub fn draft(words: &'static DevWords, topic: &TopicSeen) -> Option<Draft> {
    let publisher = topic.publishers.iter().find(|it| !it.ours)?;
    // These mean nothing in YAML, so no name can be more than a name.
    let is_plain =
        |name: &str| name.bytes().all(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'/'));
    let (name, type_name) = (&*topic.name, &*publisher.type_name);
    if !name.starts_with('/') || !is_plain(name) || !is_plain(type_name) || type_name.is_empty() {
        return None;
    }
    let measured = topic.rate_hz.map(f64::from).filter(|rate| *rate > 0.0);
    let promised = publisher.deadline_ns.filter(|ns| *ns > 0).map(|ns| 1e9 / ns as f64);
    let (limits, about) = match measured.or(promised) {
        Some(rate) => {
            let RateLimits { window_s, warning_below, error_below } = RateLimits::of(rate);
            let of = if measured.is_some() { "measured" } else { "promised" };
            let limits = format!(
                "      window: {window_s}s\n      warning_below: {warning_below}  # Hz; {of}: {rate:.1}\n      \
                 error_below: {error_below}\n"
            );
            (limits, words.draft_of_rate)
        }
        None if topic.publishers.iter().all(|it| it.transient_local) => {
            return Some(Draft { text: None, about: words.draft_of_kept });
        }
        None => ("      window: 10s\n      error_below: 0.1  # Hz\n".to_owned(), words.draft_of_unread),
    };
    let id = name.trim_matches('/').replace('/', "_").to_lowercase();
    let text = format!(
        "- id: {id}_rate\n  monitor:\n    frequency:\n      topic: {name}\n      type: {type_name}\n{limits}"
    );
    Some(Draft { text: Some(text), about })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texts::Lang;
    use telltale_engine::discovery::Endpoint;

    fn topic(name: &str, publisher: Endpoint, rate_hz: Option<f32>) -> TopicSeen {
        let publisher = Endpoint { type_name: "sensor_msgs/msg/LaserScan".to_owned(), ..publisher };
        TopicSeen { name: name.to_owned(), publishers: vec![publisher], rate_hz, ..TopicSeen::default() }
    }

    fn drafted(topic: &TopicSeen) -> Option<Option<String>> {
        draft(DevWords::of(Lang::En), topic).map(|it| it.text)
    }

    #[test]
    fn the_limits_are_those_of_the_measured_or_promised_rate() {
        let text = drafted(&topic("/front/Scan", Endpoint::default(), Some(10.0))).flatten().expect("a text");
        let expect = "- id: front_scan_rate\n  monitor:\n    frequency:\n      topic: /front/Scan\n      \
                      type: sensor_msgs/msg/LaserScan\n      window: 2s\n      warning_below: 7  # Hz; measured: 10.0\n      \
                      error_below: 4\n";
        assert_eq!(text, expect);
        let promises = Endpoint { deadline_ns: Some(50_000_000), ..Endpoint::default() };
        let text = drafted(&topic("/scan", promises, None)).flatten().expect("a text");
        assert!(text.contains("warning_below: 14  # Hz; promised: 20.0"), "{text}");
        let text = drafted(&topic("/scan", Endpoint::default(), None)).flatten().expect("a text");
        assert!(text.contains("window: 10s\n      error_below: 0.1"), "{text}");
    }

    #[test]
    fn what_comes_once_has_no_rate_and_what_is_no_name_no_monitor() {
        let kept = Endpoint { transient_local: true, ..Endpoint::default() };
        assert_eq!(drafted(&topic("/map", kept, None)), Some(None));
        for name in ["/a: b", "/a\n- id: x", "a", "/a#", "/ä"] {
            assert_eq!(drafted(&topic(name, Endpoint::default(), Some(1.0))), None, "{name}");
        }
        assert_eq!(drafted(&TopicSeen::default()), None);
        let ours = Endpoint { ours: true, ..Endpoint::default() };
        assert_eq!(drafted(&topic("/telltale/stage", ours, None)), None);
    }
}
