//! Two independent sources of one value, of one pose, or of one list of positions.

use super::MonitorKind;
use super::inputs::{Inputs, UnusableInput};
use super::motion::{History, Motion, TooShort, apart_m};
use super::sequence::slack;
use super::words::{Words, span};
use crate::files::KeyframeError;
use crate::files::float;
use crate::model::monitors::{AgreementRule, Bands};
use crate::model::quantity::number;
use crate::model::sample::{FieldValue, POSITIONS_MAX};
use crate::state::State;
use crate::text::say;
use crate::time::{Span, Timestamp};
use serde::{Deserialize, Serialize};

/// The limits of the two values of poses, each named after its value.
const TRANSLATION_LIMITS: [&str; 4] = [
    "translation_m_warning_below",
    "translation_m_error_below",
    "translation_m_warning_above",
    "translation_m_error_above",
];
const ROTATION_LIMITS: [&str; 4] = [
    "rotation_deg_warning_below",
    "rotation_deg_error_below",
    "rotation_deg_warning_above",
    "rotation_deg_error_above",
];

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Agreement {
    inputs: Inputs,
    #[serde(skip)]
    max_age: Span,
    #[serde(skip)]
    rule: AgreementRule,
    /// The time over which motions are compared, with the past poses of each source.
    motion: Option<Box<(Span, [History; 2])>>,
    /// Motions are not judged before both sources were followed for long enough.
    anew: bool,
    /// The distance between the last two lists of positions.
    #[serde(with = "float")]
    apart_m: f64,
}

/// The compared quantities, each with its limits.
enum Difference<'r> {
    /// The difference, its possible rounding error, and the limits.
    Number(f64, f64, &'r Bands),
    Pose {
        metres: f64,
        degrees: f64,
        translation: &'r Bands,
        rotation_deg: &'r Bands,
    },
    Lists {
        lists: Lists,
        count: &'r Bands,
        nearest: &'r Bands,
    },
}

/// Two lists of positions, as far as they were kept.
#[derive(Clone, Copy)]
struct Lists {
    counts: [u32; 2],
    apart_m: f64,
    is_cut: bool,
}

enum NotComparable {
    Input(UnusableInput),
    TooShort(usize, TooShort),
}

impl Agreement {
    pub(super) fn new(
        inputs: Inputs,
        max_age: Span,
        motion_over: Option<Span>,
        rule: AgreementRule,
    ) -> Agreement {
        let motion = motion_over.map(|over| Box::new((over, Default::default())));
        Agreement { inputs, max_age, rule, motion, anew: false, apart_m: 0.0 }
    }
}

impl MonitorKind for Agreement {
    fn resume(&mut self, kept: Agreement) -> Result<(), KeyframeError> {
        let Agreement { inputs, max_age: _, rule: _, motion, anew, apart_m } = kept;
        if motion.as_ref().map(|it| it.0) != self.motion.as_ref().map(|it| it.0) {
            return Err(KeyframeError::new("the configuration compares motions in another way"));
        }
        (self.motion, self.anew, self.apart_m) = (motion, anew, apart_m);
        self.inputs.resume(inputs)
    }

    /// Motions are followed again from now on. Returns whether it compares motions.
    fn begin_anew(&mut self, _now: Timestamp) -> bool {
        let Some((_, histories)) = self.motion.as_deref_mut() else { return false };
        histories.iter_mut().for_each(History::clear);
        self.anew = true;
        true
    }

    fn take_value(&mut self, slot: usize, value: &FieldValue, now: Timestamp) {
        let changed = self.inputs.take(slot, value, now);
        if let (true, Some(FieldValue::Positions(a)), Some(FieldValue::Positions(b))) =
            (changed, self.inputs.last(0), self.inputs.last(1))
        {
            self.apart_m = apart_m(&a.taken, &b.taken);
        }
        if let Some((over, histories)) = self.motion.as_deref_mut() {
            match self.inputs.pose(slot, now) {
                Ok(pose) => histories[slot].push(now, &pose, *over),
                Err(_) => histories[slot].clear(),
            }
        }
    }
    fn told(&self, slot: usize) -> Option<Timestamp> {
        self.inputs.told(slot)
    }

    fn judge(&mut self, now: Timestamp) -> Option<State> {
        if !self.inputs.any() {
            return None;
        }
        let difference = self.difference(now);
        if self.anew && matches!(difference, Err(NotComparable::TooShort(_, TooShort::Young))) {
            return None;
        }
        let is_compared = difference.is_ok();
        let state = match difference {
            Ok(Difference::Number(difference, slack, bands)) => bands.judge_within(difference, slack),
            Ok(Difference::Pose { metres, degrees, translation, rotation_deg }) => {
                translation.judge(metres).max(rotation_deg.judge(degrees))
            }
            Ok(Difference::Lists { lists, count, nearest }) => lists.judge(count, nearest),
            Err(NotComparable::Input(_) | NotComparable::TooShort(..)) => State::Unknown,
        };
        self.anew &= !is_compared;
        Some(state)
    }

    fn due(&self, now: Timestamp) -> Option<Timestamp> {
        self.inputs.due(now)
    }

    fn is_aged(&self, now: Timestamp) -> bool {
        self.inputs.any()
            && matches!(self.difference(now), Err(NotComparable::Input(unusable)) if unusable.is_age())
    }

    fn words(&self, now: Timestamp) -> Words {
        if !self.inputs.any() {
            return Words::default();
        }
        match self.difference(now) {
            Ok(Difference::Number(difference, _, bands)) => {
                let by = bands.say_in(difference, self.inputs.common_quantity());
                let message = say!("they differ by {by}", "Abweichung {by}", by);
                let mut values = bands.values("difference", difference);
                for (name, slot) in [("a", 0), ("b", 1)] {
                    if let Some(FieldValue::Number(value)) = self.inputs.last(slot) {
                        values.push((name, number(*value)));
                    }
                }
                Words { message, values }
            }
            Ok(Difference::Pose { metres, degrees, translation, rotation_deg }) => {
                self.say_pose(metres, degrees, translation, rotation_deg)
            }
            Ok(Difference::Lists { lists, count, nearest }) => lists.words(count, nearest),
            Err(NotComparable::Input(unusable)) => Words::plain(self.inputs.say(unusable)),
            Err(NotComparable::TooShort(slot, why)) => {
                let over = self.motion.as_ref().map_or("".into(), |motion| span(motion.0));
                let label = self.inputs.label(slot);
                Words::plain(match why {
                    TooShort::Young => say!(
                        "{label} has not been followed for {over} yet",
                        "{label} noch keine {over} verfolgt",
                        label,
                        over
                    ),
                    TooShort::Gap => say!(
                        "of {label} too little came {over} ago",
                        "von {label} kam vor {over} zu wenig",
                        label,
                        over
                    ),
                })
            }
        }
    }
}

impl Agreement {
    fn say_pose(&self, metres: f64, degrees: f64, translation: &Bands, rotation_deg: &Bands) -> Words {
        let what = match self.motion.as_deref() {
            Some((over, _)) => say!(
                "over {over} their motions differ by",
                "Abweichung der Bewegungen über {over}:",
                over = span(*over)
            ),
            None => say!("they differ by", "Abweichung"),
        };
        // Finer digits than millimetres and hundredths of a degree are noise, and would change the text each
        // time.
        let (metres, degrees) = ((metres * 1e3).round() / 1e3, (degrees * 1e2).round() / 1e2);
        let message = say!(
            "{what} {shift}; {turn}",
            "{what} {shift}; {turn}",
            what,
            shift = translation.say(metres, "m".into()),
            turn = rotation_deg.say(degrees, say!("deg", "Grad"))
        );
        let measured = [("translation_m", number(metres)), ("rotation_deg", number(degrees))];
        let limits = translation.limits(TRANSLATION_LIMITS).chain(rotation_deg.limits(ROTATION_LIMITS));
        Words { message, values: measured.into_iter().chain(limits).collect() }
    }

    fn difference(&self, now: Timestamp) -> Result<Difference<'_>, NotComparable> {
        match &self.rule {
            AgreementRule::Number(bands) => {
                let a = self.inputs.number(0, now).map_err(NotComparable::Input)?;
                let b = self.inputs.number(1, now).map_err(NotComparable::Input)?;
                Ok(Difference::Number((a - b).abs(), slack(a, b), bands))
            }
            AgreementRule::Positions { count, nearest } => {
                let a = self.inputs.positions(0, now).map_err(NotComparable::Input)?;
                let b = self.inputs.positions(1, now).map_err(NotComparable::Input)?;
                let (counts, is_cut) = ([a.count, b.count], a.is_cut() || b.is_cut());
                let lists = Lists { counts, apart_m: self.apart_m, is_cut };
                Ok(Difference::Lists { lists, count, nearest })
            }
            AgreementRule::Pose { translation, rotation_deg } => {
                let (metres, degrees) = self.moved(now)?;
                Ok(Difference::Pose { metres, degrees, translation, rotation_deg })
            }
        }
    }

    /// The distance between two poses, or two motions: in metres and degrees.
    fn moved(&self, now: Timestamp) -> Result<(f64, f64), NotComparable> {
        let a = self.inputs.pose(0, now).map_err(NotComparable::Input)?;
        let b = self.inputs.pose(1, now).map_err(NotComparable::Input)?;
        let (a, b) = match self.motion.as_deref() {
            None => (Motion::to(&a), Motion::to(&b)),
            Some((over, histories)) => {
                let motion = |slot: usize| {
                    let motion = histories[slot].motion(*over, self.max_age);
                    motion.map_err(|why| NotComparable::TooShort(slot, why))
                };
                (motion(0)?, motion(1)?)
            }
        };
        Ok((a.distance_m(&b), a.angle_deg(&b)))
    }
}

impl Lists {
    fn difference(self) -> f64 {
        f64::from(self.counts[0].abs_diff(self.counts[1]))
    }

    fn judge(self, count: &Bands, nearest: &Bands) -> State {
        let near = if *nearest == Bands::default() {
            State::Ok
        } else if self.is_cut {
            State::Unknown
        } else {
            // A position without any counterpart is beyond every limit.
            nearest.judge(self.apart_m.min(f64::MAX))
        };
        count.judge(self.difference()).max(near)
    }

    fn words(self, count: &Bands, nearest: &Bands) -> Words {
        let [a, b] = self.counts;
        let counts = say!(
            "{a} against {b} objects: {by}",
            "{a} gegen {b} Objekte: {by}",
            a,
            b,
            by = count.say(self.difference(), "".into())
        );
        let mut values = vec![("a", a.to_string()), ("b", b.to_string())];
        values.extend(count.values("count_difference", self.difference()));
        // Centimetres, because finer digits would change the text each time.
        let apart_m = (self.apart_m * 1e2).round() / 1e2;
        if *nearest == Bands::default() {
            return Words { message: counts, values };
        }
        let apart = if self.is_cut {
            say!(
                "of more than {most} the distances are not known",
                "bei mehr als {most} sind die Abstände nicht bekannt",
                most = POSITIONS_MAX
            )
        } else if apart_m.is_infinite() {
            say!("an empty list has no counterpart", "leere Liste ohne Gegenstück")
        } else {
            values.push(("nearest_m", number(apart_m)));
            say!(
                "apart by up to {metres}",
                "Abstand bis zu {metres}",
                metres = nearest.say(apart_m, "m".into())
            )
        };
        let message = say!("{counts}; {apart}", "{counts}; {apart}", counts, apart);
        Words { message, values }
    }
}
