//! How an `agreement` is written: two sources of one kind, and their limits.

use super::bands::{self, Unit, bands};
use super::sources::AnySource;
use super::{MAX_AGE, Monitor, Source, WINDOW_MAX, age, span};
use crate::fields::Fields;
use telltale_engine::model::monitors::{AgreementRule, Bands, FieldKind};
use telltale_engine::time;
use telltale_yaml::{KeyDoc, Log, MapDoc, Node, Problem, Span, key, map};

/// The written limits, before the kind of the sources is known.
struct AgreementLimits {
    numbers: Bands,
    has_numbers: bool,
    translation: Option<Bands>,
    rotation_deg: Option<Bands>,
    count: Option<Bands>,
    nearest: Option<Bands>,
    /// The place of the first limit of a pose, valid or not, and of a list.
    of_pose: Option<Span>,
    of_list: Option<Span>,
}

const MOTION_OVER: KeyDoc =
    key("motion_over").about("Compares the motion over this time instead of the positions.");

pub(crate) fn agreement(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("agreement", "an agreement monitor").about(
        "Two independent sources; limits on the absolute difference, for poses on the translation and the rotation, for lists on the difference in number and the distance to the nearest.",
    );
    let mut fields = Fields::of(node, doc, log)?;
    let a = fields.required("a").map(|AnySource(source)| source);
    let b = fields.required("b").map(|AnySource(source)| source);
    let max_age = age(&mut fields, MAX_AGE);
    let motion_over = span(&mut fields, MOTION_OVER, time::Span::from_nanos(1), WINDOW_MAX);
    let limits = AgreementLimits::of(&mut fields);
    let motion = fields.key_span("motion_over");
    let kinds = a.as_ref().zip(b.as_ref()).map(|(a, b): (&Source, &Source)| (a.kind(), b.kind()));
    if let (Some((FieldKind::Positions, FieldKind::Positions)), Some(motion)) = (kinds, motion) {
        let problem = Problem::at(motion, "lists of positions have no motion");
        fields.log.push(problem.help("remove `motion_over`; it is for poses"));
    }
    match kinds {
        Some((a, b)) if a != b => unlike(node, a, b, fields.log),
        Some((kind, _)) => limits.check(kind, node, fields.log),
        None => {}
    }
    let rule = limits.rule(kinds.map_or(FieldKind::Scalar, |(a, _)| a));
    Some(Monitor::Agreement { a: a?, b: b?, max_age, motion_over, rule })
}

fn unlike(node: &Node, a: FieldKind, b: FieldKind, log: &mut Log) {
    let problem = match [a, b].contains(&FieldKind::Positions) {
        true => Problem::at(node.span, "a list is compared with what is none")
            .help("write `list` on both sides, or compare lengths: `field: poses.length`"),
        false => Problem::at(node.span, "a pose is compared with a single value")
            .help("write `pose` on both sides, or `field` on both"),
    };
    log.push(problem);
}

impl AgreementLimits {
    fn of(fields: &mut Fields) -> AgreementLimits {
        let numbers = bands(fields, Unit::Size);
        let mut part = |name, doc: MapDoc, unit| {
            let read = |node: &Node, log: &mut Log| bands::map(node, doc, unit, log);
            fields.optional_by(name, |schema| schema.decoder(read), read)
        };
        let nearest = map("nearest", "the limits of a distance").about(
            "In metres on the ground: of any position in one list to the nearest in the other, the largest of both lists.",
        );
        AgreementLimits {
            numbers,
            translation: part(
                "translation",
                map("translation", "the limits of a translation").about("In metres."),
                Unit::Size,
            ),
            rotation_deg: part(
                "rotation_deg",
                map("rotation", "the limits of a rotation").about("In degrees."),
                Unit::Degrees,
            ),
            count: part(
                "count",
                map("count", "the limits of a difference in number")
                    .about("In positions: by how many the two lists differ."),
                Unit::Size,
            ),
            nearest: part("nearest", nearest, Unit::Size),
            has_numbers: bands::any(fields),
            of_pose: ["translation", "rotation_deg"].into_iter().find_map(|key| fields.key_span(key)),
            of_list: ["count", "nearest"].into_iter().find_map(|key| fields.key_span(key)),
        }
    }

    /// Each kind of source has its own limits, and needs at least one.
    fn check(&self, kind: FieldKind, node: &Node, log: &mut Log) {
        let own = match kind {
            FieldKind::Scalar
            | FieldKind::Named
            | FieldKind::Transforms
            | FieldKind::Elements
            | FieldKind::Content => self.has_numbers,
            FieldKind::Pose => self.of_pose.is_some(),
            FieldKind::Positions => self.of_list.is_some(),
        };
        if let Some(place) = self.of_pose.filter(|_| kind != FieldKind::Pose) {
            let help = match kind {
                FieldKind::Positions => {
                    "write the limits in `count` and `nearest`, or `pose` instead of `list`"
                }
                _ => "write the limits beside `a` and `b`, or `pose` instead of `field`",
            };
            log.push(Problem::at(place, "only poses have a translation and a rotation").help(help));
        } else if let Some(place) = self.of_list.filter(|_| kind != FieldKind::Positions) {
            let problem =
                Problem::at(place, "only lists have a number of elements and distances between them");
            log.push(problem.help("write `list` on both sides"));
        } else if self.has_numbers && kind != FieldKind::Scalar {
            let (text, help) = match kind {
                FieldKind::Positions => (
                    "limits of lists stand in `count` and `nearest`",
                    "for example `nearest: { warning_above: 1, error_above: 3 }`",
                ),
                _ => (
                    "limits of poses stand in `translation` and `rotation_deg`",
                    "for example `translation: { warning_above: 0.5, error_above: 1 }`",
                ),
            };
            log.push(Problem::at(node.span, text).help(help));
        } else if !own {
            let text = "without a limit this would never be anything but OK";
            match kind {
                FieldKind::Scalar
                | FieldKind::Named
                | FieldKind::Transforms
                | FieldKind::Elements
                | FieldKind::Content => bands::without_a_limit(node.span, "", log),
                FieldKind::Pose => log
                    .push(Problem::at(node.span, text).help(
                        "add `translation: { error_above: 1 }` or `rotation_deg: { error_above: 10 }`",
                    )),
                FieldKind::Positions => log.push(
                    Problem::at(node.span, text)
                        .help("add `count: { error_above: 2 }` or `nearest: { error_above: 3 }`"),
                ),
            }
        }
    }

    fn rule(self, kind: FieldKind) -> AgreementRule {
        match kind {
            FieldKind::Scalar
            | FieldKind::Named
            | FieldKind::Transforms
            | FieldKind::Elements
            | FieldKind::Content => AgreementRule::Number(self.numbers),
            FieldKind::Pose => AgreementRule::Pose {
                translation: self.translation.unwrap_or_default(),
                rotation_deg: self.rotation_deg.unwrap_or_default(),
            },
            FieldKind::Positions => AgreementRule::Positions {
                count: self.count.unwrap_or_default(),
                nearest: self.nearest.unwrap_or_default(),
            },
        }
    }
}
