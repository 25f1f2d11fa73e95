//! The file as it is written: every key of a configuration, with its place and its documentation for the JSON
//! Schema. Nothing here is checked against anything else; `resolve` does that.

pub(super) mod countermeasure;
pub(super) mod fleet;
mod forms;
pub(super) mod monitors;
pub(super) mod motion;
pub(super) mod nodes;
pub(super) mod publishing;
pub(super) mod recording;
pub(super) mod ros_names;
pub(super) mod services;
pub(super) mod signals;
pub(super) mod units;

use std::ops::RangeInclusive;

use crate::decode::{Entries, FromNode, Spanned};
use crate::fields::Fields;
use countermeasure::RawRule;
use fleet::RawFleet;
use forms::{ID, default_span, with_about};
use monitors::sources::RawDiagnostics;
use motion::RawMotion;
pub(super) use nodes::filters::{Filter, FilterKind, Pattern, Writers};
use nodes::other::RawOther;
pub(super) use nodes::policy::Policy;
pub(super) use nodes::{Dependency, DependsOn, Group, Module, TILE_MAX, Tile, When};
use publishing::{RawPublishing, Switch};
use recording::RawRecording;
use services::RawServices;
pub(super) use signals::{Signal, SignalFrom};
use telltale_engine::model::monitors::StampClock;
use telltale_engine::model::{DISPLAY_DPI, Driving, Limits as Bounds, Other, StageModel, Within};
use telltale_engine::text::Text;
use telltale_engine::time;
use telltale_yaml::decode::{scalar, word};
use telltale_yaml::schema::{Json, default, least, most, one_of, words};
use telltale_yaml::{Kind, Log, Members, Node, Problem, Schema, Span, key, map};

#[derive(Debug, Default)]
pub(super) struct File {
    /// Further files, relative to this one, whose lists are added to the lists of this one.
    pub include: Vec<Spanned<String>>,
    pub vehicle: Option<Vehicle>,
    pub signals: Entries<Signal>,
    pub stops: Vec<Stop>,
    pub motion: Option<RawMotion>,
    pub defaults: Option<Defaults>,
    pub limits: Option<Limits>,
    pub display: Option<Display>,
    pub localized_after: Option<time::Span>,
    pub other: Option<RawOther>,
    pub groups: Vec<Group>,
    /// The place of the key `groups`.
    pub groups_span: Option<Span>,
    pub countermeasures: Vec<RawRule>,
    pub publish: Option<RawPublishing>,
    pub recording: Option<Switch<RawRecording>>,
    pub services: Option<RawServices>,
    pub fleet: Option<RawFleet>,
    /// The topics on which components report; without it, `/diagnostics`.
    pub diagnostics: Option<RawDiagnostics>,
    /// The clock of the stamps in messages.
    pub clock: Option<StampClock>,
    /// Folders with definitions of messages, each relative to the file that names it.
    pub message_folders: Vec<Spanned<String>>,
    /// Keys that only the main file may have, with their places.
    pub main_only: Vec<(&'static str, Span)>,
}

impl FromNode for File {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(
            node,
            map("configuration", "a configuration").about(
                "The configuration of Telltale: a vehicle's groups and modules, what they depend on, and when they matter.",
            ),
            log,
        )?;
        if let Some(span) = fields.key_span("modules") {
            fields.node("modules");
            let problem = Problem::at(span, "a module stands in no group");
            fields.log.push(problem.help("move `modules` into one of the `groups`"));
        }
        let main_only = [
            "vehicle",
            "motion",
            "defaults",
            "limits",
            "display",
            "localized_after",
            "other",
            "publish",
            "recording",
            "services",
            "fleet",
            "diagnostics",
            "clock",
        ];
        let main_only = main_only.into_iter().filter_map(|key| Some((key, fields.key_span(key)?)));
        Some(File {
            main_only: main_only.collect(),
            include: fields.or_default(key("include").about("Further files, relative to this one, whose lists are added to the lists of this one.")),
            vehicle: fields.optional("vehicle"),
            signals: fields.or_default(key("signals").about("Named truth values of the vehicle, each from a topic or from a condition over values.").rules(|| vec![("propertyNames", Json::Object(vec![("$ref", "#/$defs/id".into())]))])),
            stops: fields.or_default(key("stops").about("Where the vehicle stops and may be localized.")),
            motion: fields.optional("motion"),
            defaults: fields.optional("defaults"),
            limits: fields.optional("limits"),
            display: fields.optional("display"),
            localized_after: fields.optional(key("localized_after").about("Localization counts as done when its group was OK for this long.").rules(|| vec![default_span(Driving::default().localized_after)])),
            other: fields.optional(key("other").about("What becomes of statuses that no group takes: for developers alone, one line for the operator when one is not OK, or a tile like any other.").rules(|| vec![default(Other::default().as_str())])),
            groups_span: fields.key_span("groups"),
            groups: fields.or_default(key("groups").about("The tiles of the operator's screen, in order.")),
            countermeasures: fields.or_default(key("countermeasures").about("What the vehicle is asked to do when something fails.")),
            publish: fields.optional("publish"),
            recording: fields.optional("recording"),
            services: fields.optional("services"),
            fleet: fields.optional("fleet"),
            diagnostics: fields.optional("diagnostics"),
            clock: fields.optional(key("clock").about("The clock of the stamps in messages: that of this machine, or the time on /clock, as nodes with use_sim_time have it.").rules(|| vec![default("system")])),
            message_folders: fields.or_default(key("message_folders").about("Folders with `package/msg/Name.msg`, relative to this file, for types that are not built in: a ROS installation's `share`.")),
        })
    }
}

#[derive(Debug, Default)]
pub(super) struct Vehicle {
    pub id: Option<Spanned<String>>,
    pub name: Option<Text>,
    pub stages: Option<Spanned<StageModel>>,
}

impl FromNode for Vehicle {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, map("vehicle", "the vehicle"), log)?;
        Some(Vehicle {
            id: fields.optional(ID),
            name: fields.optional("name"),
            stages: fields.optional(
                key("stages")
                    .about("`none` for a machine that is no shuttle: it is always active.")
                    .rules(|| vec![default("shuttle")]),
            ),
        })
    }
}

impl FromNode for StageModel {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "stage model", &[("shuttle", StageModel::Shuttle), ("none", StageModel::None)])
    }

    fn form(_: &mut Schema) -> Members {
        words(["shuttle", "none"])
    }
}

#[derive(Debug)]
pub(super) struct Stop {
    pub id: Option<Spanned<String>>,
    pub name: Option<Text>,
    pub x: Option<f64>,
    pub y: Option<f64>,
    pub yaw_deg: Option<f64>,
}

impl FromNode for Stop {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, map("stop", "a stop"), log)?;
        Some(Stop {
            id: fields.required(ID),
            name: fields.optional("name"),
            x: fields.required(key("x").about("Metres in the map's frame.")),
            y: fields.required(key("y").about("Metres in the map's frame.")),
            yaw_deg: fields.optional(
                key("yaw_deg")
                    .about("Degrees, counter-clockwise from the x axis.")
                    .rules(|| vec![default(0)]),
            ),
        })
    }
}

#[derive(Debug, Default)]
pub(super) struct Defaults {
    pub policy: Policy,
    pub explains_within: Option<Within>,
}

impl FromNode for Defaults {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about = "Holds for every module that has no value of its own.";
        let mut fields = Fields::of(node, map("defaults", "the defaults").about(about), log)?;
        let forget_after = fields.optional(key("forget_after").about("Modules that statuses make, also those in `other`, leave after this long without a report. It does not hold for modules under `modules`."));
        let within = key("explains_within")
            .about("How far apart the beginnings of a cause and of an ERROR that it explains may be, for dependencies without `within`; `always`: any time.")
            .rules(|| match Within::default() {
                Within::Limit(limit) => vec![default_span(limit)],
                Within::Always => vec![default("always")],
            });
        let explains_within = fields.optional(within);
        let policy = Policy { forget_after, ..Policy::of(&mut fields) };
        Some(Defaults { policy, explains_within })
    }
}

#[derive(Debug, Default)]
pub(super) struct Limits {
    pub discovered_modules: Option<Spanned<u64>>,
    pub values_per_status: Option<Spanned<u64>>,
    pub string_bytes: Option<Spanned<u64>>,
    pub status_bytes: Option<Spanned<u64>>,
    pub source_bytes: Option<Spanned<u64>>,
}

/// The permitted range of each limit.
pub(super) const DISCOVERED_MODULES: RangeInclusive<u64> = 0..=1_000_000;
pub(super) const VALUES_PER_STATUS: RangeInclusive<u64> = 0..=65_536;
pub(super) const STRING_BYTES: RangeInclusive<u64> = 16..=1 << 20;
pub(super) const STATUS_BYTES: RangeInclusive<u64> = 65_536..=1 << 30;
pub(super) const SOURCE_BYTES_MIN: u64 = 16_384;

fn bounded(range: &RangeInclusive<u64>, otherwise: Option<usize>) -> Members {
    let bounds = [least(*range.start()), most(*range.end())];
    bounds.into_iter().chain(otherwise.map(default)).collect()
}

impl FromNode for Limits {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(
            node,
            map("limits", "the limits").about("Bounds on everything that is received."),
            log,
        )?;
        Some(Limits {
            discovered_modules: fields.optional(key("discovered_modules").rules(|| {
                bounded(&DISCOVERED_MODULES, Some(Bounds::default().discovered_modules))
            })),
            values_per_status: fields.optional(key("values_per_status").rules(|| {
                bounded(&VALUES_PER_STATUS, Some(Bounds::default().values_per_status))
            })),
            string_bytes: fields.optional(key("string_bytes").rules(|| {
                bounded(&STRING_BYTES, Some(Bounds::default().string_bytes))
            })),
            status_bytes: fields.optional(key("status_bytes").about("Messages, hardware ids, keys and values of all statuses together take at most this; beyond it the longest are cut.").rules(|| {
                bounded(&STATUS_BYTES, Some(Bounds::default().status_bytes))
            })),
            source_bytes: fields.optional(key("source_bytes").about("The same for one publisher, up to `status_bytes`. The default is half of `status_bytes`.").rules(|| {
                bounded(&(SOURCE_BYTES_MIN..=*STATUS_BYTES.end()), None)
            })),
        })
    }
}

/// `display: { dpi: 149 }`
#[derive(Debug, Default)]
pub(super) struct Display {
    pub dpi: Option<Spanned<u64>>,
}

/// The permitted densities of the vehicle's display.
pub(super) const DPI: RangeInclusive<u64> = 60..=400;

impl FromNode for Display {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about = "The operator's display in the vehicle.";
        let mut fields = Fields::of(node, map("display", "the display").about(about), log)?;
        Some(Display {
            dpi: fields.optional(
                key("dpi")
                    .about("Its dots per inch: buttons are 15 mm high and more, and texts grow with them.")
                    .rules(|| bounded(&DPI, Some(DISPLAY_DPI as usize))),
            ),
        })
    }
}

/// A text in `en` and `de`; in one language, it serves both.
fn languages(fields: &mut Fields) -> Option<Text> {
    let (en, de): (Option<String>, Option<String>) = (fields.optional("en"), fields.optional("de"));
    if fields.key_span("en").is_none() && fields.key_span("de").is_none() {
        let problem = Problem::at(fields.span(), "a text needs `en` or `de`");
        fields.log.push(problem.help("write the text alone, or `{ en: ..., de: ... }`"));
    }
    let (en, de) = (en.as_ref().or(de.as_ref())?.as_str(), de.as_ref().or(en.as_ref())?.as_str());
    Some(Text { en: en.into(), de: de.into() })
}

impl FromNode for Text {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if scalar(node).is_some() || !matches!(node.kind, Kind::Mapping(_)) {
            return String::from_node(node, log).map(|text| Text::plain(&text));
        }
        let mut fields = Fields::of(
            node,
            map("languages", "a text in two languages").rules(|| vec![("minProperties", 1.into())]),
            log,
        )?;
        languages(&mut fields)
    }

    fn form(schema: &mut Schema) -> Members {
        schema.define("text", |schema| {
            let plain = vec![("type", vec!["string", "number"].into())];
            let forms = one_of([plain, schema.decoder(Self::from_node)]);
            with_about("One text, or one in each language.", forms)
        })
    }
}
