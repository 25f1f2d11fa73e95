//! How a `watchdog` is written: the target, the interval, and the limits of the response time.

use super::bands;
use super::{AGE_MAX, Monitor, span};
use crate::decode::{FromNode, Spanned};
use crate::fields::Fields;
use crate::file::forms::{default_span, topic_name};
use telltale_engine::model::monitors::{Bands, ProbeTarget};
use telltale_engine::time;
use telltale_yaml::schema::{default, least, most, needs_one, of_type, pattern};
use telltale_yaml::{Log, Node, Problem, key, map};

const EVERY_MIN: time::Span = time::Span::from_millis(100);
const MISSES_MAX: u64 = 1000;
const RESTARTS_MAX: u64 = 1000;

const EVERY: time::Span = time::Span::from_secs(1);
const MISSES: u32 = 3;

pub(crate) fn watchdog(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("watchdog", "a watchdog monitor")
        .about("Whether a machine, a node, a service or the publishers of a topic are there, or a lifecycle node is active.")
        .rules(|| vec![needs_one(&[&["icmp"], &["tcp"], &["node"], &["service"], &["lifecycle"], &["qos"]])]);
    let mut fields = Fields::of(node, doc, log)?;
    let kinds = [
        ("icmp", key("icmp").about("An ICMP echo to this host.").form(|_| of_type("string"))),
        ("tcp", key("tcp").about("A TCP connection to `HOST:PORT`.").form(|_| pattern(":[0-9]+$"))),
        ("node", key("node").about("A ROS node with its namespace: whether it is announced.").form(topic_name)),
        (
            "service",
            key("service").about("A ROS service with its namespace: whether a node serves it.").form(topic_name),
        ),
        (
            "lifecycle",
            key("lifecycle")
                .about("A lifecycle node with its namespace: whether it is active. It is asked by its service `get_state`.")
                .form(topic_name),
        ),
        (
            "qos",
            key("qos")
                .about("Whether all publishers and subscribers of this topic can come together: type, reliability, durability, deadline, liveliness.")
                .form(topic_name),
        ),
    ];
    let found: Vec<_> = kinds.into_iter().filter_map(|(kind, key)| Some((kind, fields.node(key)?))).collect();
    let target = match found[..] {
        [(kind, node)] => target(kind, node, fields.log),
        _ => {
            let problem = Problem::at(
                node.span,
                "a watchdog asks one of `icmp`, `tcp`, `node`, `service`, `lifecycle`, `qos`",
            );
            fields.log.push(
                problem.help("for example `icmp: 192.168.1.201`, `tcp: gateway:22` or `node: /mission`"),
            );
            None
        }
    };
    let every = key("every").about("From 100ms to 1h.").rules(|| vec![default_span(EVERY)]);
    let every = span(&mut fields, every, EVERY_MIN, AGE_MAX).unwrap_or(EVERY);
    let misses: Option<Spanned<u64>> = fields.optional(
        key("misses")
            .about("This many misses in a row make an ERROR.")
            .rules(|| vec![least(1), most(MISSES_MAX), default(MISSES)]),
    );
    if let Some(misses) = misses.filter(|misses| !(1..=MISSES_MAX).contains(&misses.value)) {
        let problem = Problem::at(misses.span, format!("{} is not between 1 and {MISSES_MAX}", misses.value));
        fields.log.push(problem.help(format!("the default is {MISSES}")));
    }
    let bands = limits(&mut fields, target.as_ref(), every);
    let bands = restarts(&mut fields, target.as_ref()).unwrap_or(bands);
    let misses = misses.map_or(MISSES, |misses| misses.value as u32);
    let place = found.first().map_or(node.span, |(_, target)| target.span);
    Some(Monitor::Watchdog { target: target?, place, every, misses, bands })
}

/// Limits of the restarts of a node; `None` if there are none.
fn restarts(fields: &mut Fields, target: Option<&ProbeTarget>) -> Option<Bands> {
    let about = "With `node`: crashes after which it was started again, within three leases of DDS (30 s with Cyclone DDS). More are a fault.";
    let names = ["restarts_warning_above", "restarts_error_above"];
    let (place, bands) =
        bands::counts_above(fields, names, about, (RESTARTS_MAX, || vec![least(0), most(RESTARTS_MAX)]))?;
    if !matches!(target, Some(ProbeTarget::Node { .. }) | None) {
        let problem = Problem::at(place, "only the restarts of a `node` are known");
        fields.log.push(problem.help("remove the limit, or watch the `node`"));
    }
    Some(bands)
}

/// Limits of the response time.
fn limits(fields: &mut Fields, target: Option<&ProbeTarget>, every: time::Span) -> Bands {
    let bands = bands::durations_above(
        fields,
        "With `icmp`, `tcp` and `lifecycle`: how long an answer may take, below `every`.",
    );
    let first = ["warning_above", "error_above"].into_iter().find_map(|key| fields.key_span(key));
    let asks_discovery = matches!(
        target,
        Some(ProbeTarget::Node { .. } | ProbeTarget::Service { .. } | ProbeTarget::Qos { .. })
    );
    if let (true, Some(place)) = (asks_discovery, first) {
        let problem = Problem::at(place, "discovery says that it is there, not how soon it answers");
        fields.log.push(problem.help(
            "remove the limit; for a time, watch the latency of what it publishes, or ask its machine by `icmp` or `tcp`",
        ));
        return bands;
    }
    let every_s = every.as_secs_f64();
    for (key, limit) in [("warning_above", bands.warning_above), ("error_above", bands.error_above)] {
        if limit.is_some_and(|limit| limit >= every_s) {
            let text = format!("`{key}` is never reached: no answer within `every` is a miss");
            let problem = Problem::at(fields.key_span(key).unwrap_or(fields.span()), text);
            let every = crate::describe::words::span(every);
            fields.log.push(problem.help(format!("choose less than {every}, or ask less often")));
        } else if limit.is_some_and(|limit| limit <= 0.0) {
            let problem = Problem::at(
                fields.key_span(key).unwrap_or(fields.span()),
                "an answer always takes longer than this",
            );
            fields.log.push(problem.help("choose a duration above 0, for example `20ms`"));
        }
    }
    bands
}

fn target(kind: &str, node: &Node, log: &mut Log) -> Option<ProbeTarget> {
    let text = String::from_node(node, log)?;
    let host = |host: &str| {
        let good = |c: char| c.is_ascii_alphanumeric() || ".-_:%".contains(c);
        !host.is_empty() && host.len() <= 253 && host.chars().all(good)
    };
    let address = || {
        let (name, port) = text.rsplit_once(':')?;
        let bracketed = name.strip_prefix('[').and_then(|name| name.strip_suffix(']'));
        let name = bracketed.or_else(|| (!name.contains(':')).then_some(name))?;
        (host(name) && port.parse::<u16>().is_ok_and(|port| port > 0)).then_some(())
    };
    let full_name = crate::file::ros_names::is_full_name(&text);
    let (target, good, help) = match kind {
        "icmp" => (
            ProbeTarget::Icmp { host: text.as_str().into() },
            host(&text),
            "write the name or the address of a machine: `192.168.1.201`",
        ),
        "tcp" => (
            ProbeTarget::Tcp { address: text.as_str().into() },
            address().is_some(),
            "write `HOST:PORT`: `gateway:22`, `192.168.1.201:80` or `[fe80::1]:80`",
        ),
        "qos" => (
            ProbeTarget::Qos { topic: text.as_str().into() },
            full_name,
            "write the topic with its namespace: `/camera/image`",
        ),
        "service" => (
            ProbeTarget::Service { name: text.as_str().into() },
            full_name,
            "write the service with its namespace: `/planning/get_plan`",
        ),
        "lifecycle" => (
            ProbeTarget::Lifecycle { name: text.as_str().into() },
            full_name,
            "write the lifecycle node with its namespace: `/planner_server`",
        ),
        _ => (
            ProbeTarget::Node { name: text.as_str().into() },
            full_name,
            "write the node with its namespace: `/planning/planner`",
        ),
    };
    if !good {
        log.push(Problem::at(node.span, format!("`{text}` cannot be asked by {kind}")).help(help));
    }
    Some(target)
}
