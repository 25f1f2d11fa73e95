//! Two independent sources of one value, or of one pose.

use super::inputs::{Doubt, Inputs};
use super::motion::{History, Motion, TooShort};
use super::sequence::slack;
use super::spec::{AgreementRule, Bands};
use super::words::{Words, number, say, span};
use crate::engine::sample::FieldValue;
use crate::engine::state::State;
use crate::engine::time::{Span, Timestamp};

#[derive(Debug, Clone)]
pub(in crate::engine) struct Agreement {
    inputs: Inputs,
    max_age: Span,
    rule: AgreementRule,
    /// Over which time motions are compared, with where each source was.
    motion: Option<(Span, [History; 2])>,
}

enum Difference {
    Number(f64, f64),
    Pose { metres: f64, degrees: f64 },
}

enum Why {
    Doubt(Doubt),
    TooShort(usize, TooShort),
}

impl Agreement {
    pub(super) fn new(
        inputs: Inputs,
        max_age: Span,
        motion_over: Option<Span>,
        rule: AgreementRule,
    ) -> Agreement {
        let motion = motion_over.map(|over| (over, [History::default(), History::default()]));
        Agreement { inputs, max_age, rule, motion }
    }

    pub(super) fn take(&mut self, slot: usize, value: &FieldValue, now: Timestamp) {
        self.inputs.take(slot, value, now);
        if let Some((over, histories)) = &mut self.motion {
            match self.inputs.pose(slot, now) {
                Ok(pose) => histories[slot].push(now, &pose, *over),
                Err(_) => histories[slot].clear(),
            }
        }
    }

    pub(super) fn judge(&self, now: Timestamp) -> Option<State> {
        self.inputs.any().then(|| match (self.difference(now), &self.rule) {
            (Ok(Difference::Number(difference, slack)), AgreementRule::Number(bands)) => {
                bands.judge_within(difference, slack)
            }
            (Ok(Difference::Pose { metres, degrees }), AgreementRule::Pose { translation, rotation_deg }) => {
                translation.judge(metres).max(rotation_deg.judge(degrees))
            }
            _ => State::Unknown,
        })
    }

    pub(super) fn due(&self, now: Timestamp) -> Option<Timestamp> {
        self.inputs.due(now)
    }

    pub(super) fn words(&self, now: Timestamp) -> Words {
        if !self.inputs.any() {
            return Words::default();
        }
        match (self.difference(now), &self.rule) {
            (Ok(Difference::Number(difference, _)), AgreementRule::Number(bands)) => {
                let message =
                    say!("they differ by {by}", "Abweichung {by}", by = bands.say(difference, "".into()));
                let mut values = bands.values("difference", difference);
                for (name, slot) in [("a", 0), ("b", 1)] {
                    if let Some(FieldValue::Number(value)) = self.inputs.last(slot) {
                        values.push((name, number(*value)));
                    }
                }
                Words { message, values }
            }
            (Ok(Difference::Pose { metres, degrees }), AgreementRule::Pose { translation, rotation_deg }) => {
                self.say_pose(metres, degrees, translation, rotation_deg)
            }
            (Err(Why::Doubt(doubt)), _) => Words::plain(self.inputs.say(doubt)),
            (Err(Why::TooShort(slot, why)), _) => {
                let over = self.motion.as_ref().map_or("".into(), |(over, _)| span(*over));
                let label = self.inputs.label(slot);
                Words::plain(match why {
                    TooShort::Young => say!(
                        "{label} has not been followed for {over} yet",
                        "{label} noch keine {over} verfolgt",
                        label = label,
                        over = over
                    ),
                    TooShort::Gap => say!(
                        "of {label} too little came {over} ago",
                        "von {label} kam vor {over} zu wenig",
                        label = label,
                        over = over
                    ),
                })
            }
            _ => Words::default(),
        }
    }

    fn say_pose(&self, metres: f64, degrees: f64, translation: &Bands, rotation_deg: &Bands) -> Words {
        let what = match &self.motion {
            Some((over, _)) => say!(
                "over {over} their motions differ by",
                "Abweichung der Bewegungen über {over}:",
                over = span(*over)
            ),
            None => say!("they differ by", "Abweichung"),
        };
        // Millimetres and hundredths of a degree are noise, and would change the words each time.
        let (metres, degrees) = ((metres * 1e3).round() / 1e3, (degrees * 1e2).round() / 1e2);
        let message = say!(
            "{what} {shift}; {turn}",
            "{what} {shift}; {turn}",
            what = what,
            shift = translation.say(metres, "m".into()),
            turn = rotation_deg.say(degrees, say!("deg", "Grad"))
        );
        Words { message, values: vec![("translation_m", number(metres)), ("rotation_deg", number(degrees))] }
    }

    fn difference(&self, now: Timestamp) -> Result<Difference, Why> {
        if let AgreementRule::Number(_) = self.rule {
            let a = self.inputs.number(0, now).map_err(Why::Doubt)?;
            let b = self.inputs.number(1, now).map_err(Why::Doubt)?;
            return Ok(Difference::Number((a - b).abs(), slack(a, b)));
        }
        let a = self.inputs.pose(0, now).map_err(Why::Doubt)?;
        let b = self.inputs.pose(1, now).map_err(Why::Doubt)?;
        let (a, b) = match &self.motion {
            None => (Motion::to(&a), Motion::to(&b)),
            Some((over, histories)) => {
                let motion = |slot: usize| {
                    let motion = histories[slot].motion(*over, self.max_age);
                    motion.map_err(|why| Why::TooShort(slot, why))
                };
                (motion(0)?, motion(1)?)
            }
        };
        Ok(Difference::Pose { metres: a.distance_m(&b), degrees: a.angle_deg(&b) })
    }
}
