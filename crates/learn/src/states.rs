//! Finds stages, and values of signals, while a module is always silent: nothing is to be expected of it then.

use telltale_engine::model::{Model, ModuleId, Stage};
use telltale_engine::state::State;

use super::lateness::latest;
use super::past::{History, Stretch};
use super::{JITTER_MS, SHARE_DOUBTED, wilson};

/// So many times a value has to hold before anything is said of it.
pub const EPISODES: u64 = 20;
/// The module is silent in more than this share of them: the lower end of the interval of 95 %.
pub const SILENT_LEAST: f64 = 0.8;
/// An episode lasts at least so long after the module had its time to fall silent, or to be heard.
const EPISODE_MS: i64 = 1_000;

/// What else the history knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum About {
    /// Index into the signals of the model. Its values are 0 for false and 1 for true.
    Signal(usize),
    /// Its values are the stages in their order.
    Stages,
}

/// Each value with the times for which it held, in the order of time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fact {
    pub about: About,
    /// From when to when, in milliseconds since 1970, and the value.
    pub periods: Vec<(i64, i64, usize)>,
}

/// The times at which a value began to hold: those when the module stayed silent, and those when it was heard.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Episodes {
    pub silent: Vec<i64>,
    pub heard: Vec<i64>,
}

impl Episodes {
    pub fn count(&self) -> u64 {
        (self.silent.len() + self.heard.len()) as u64
    }

    /// The interval of 95 % of the share of silent episodes.
    pub fn silent_share(&self) -> (f64, f64) {
        wilson(self.silent.len() as u64, self.count())
    }
}

/// A module is silent at some values of a fact, and heard at others.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Silence {
    pub module: ModuleId,
    pub about: About,
    /// Values at which it is silent, and values at which it is heard. Of others too little is known.
    pub silent: Vec<usize>,
    pub heard: Vec<usize>,
    /// Of each value.
    pub episodes: Vec<Episodes>,
}

impl About {
    fn values(self) -> usize {
        match self {
            About::Signal(_) => 2,
            About::Stages => Stage::ALL.len(),
        }
    }
}

impl Silence {
    /// The `when` to be written for it. It stays relevant at values with too few episodes.
    pub fn when(&self, model: &Model) -> String {
        match self.about {
            About::Signal(index) => {
                let value = !self.silent.contains(&1);
                format!("{{ signals: {{ {}: {value} }} }}", model.signals[index].name)
            }
            About::Stages => {
                let relevant = |it: &&Stage| **it != Stage::Locked && !self.silent.contains(&(**it as usize));
                let stages: Vec<&str> = Stage::ALL.iter().filter(relevant).map(|it| it.as_str()).collect();
                format!("{{ stages: [{}] }}", stages.join(", "))
            }
        }
    }

    /// The exceptions at this value: the times when the module was heard, or silent, against its habit.
    pub fn against(&self, value: usize) -> &[i64] {
        let Episodes { silent, heard } = &self.episodes[value];
        match (self.silent.contains(&value), self.heard.contains(&value)) {
            (true, _) => heard,
            (_, true) => silent,
            _ => &[],
        }
    }

    /// A value in words of the configuration.
    pub fn value(&self, model: &Model, value: usize) -> String {
        match self.about {
            About::Signal(index) => format!("{} is {}", model.signals[index].name, value == 1),
            About::Stages => Stage::ALL.get(value).map_or("", |it| it.as_str()).to_owned(),
        }
    }
}

/// Modules that are silent at a value and heard at another one. A module that is not relevant has no say.
/// `None` where `go_on` ends it: see [`super::learn_within`].
pub(crate) fn silences(
    history: &History,
    model: &Model,
    go_on: &dyn Fn(usize) -> bool,
) -> Option<Vec<Silence>> {
    let (mut all, mut bytes) = (Vec::new(), 0);
    for (index, (stretches, spec)) in history.modules.iter().zip(&model.modules).enumerate() {
        let late_ms = latest(model, spec) + JITTER_MS;
        for fact in &history.facts {
            if !go_on(bytes) {
                return None;
            }
            let mut episodes = vec![Episodes::default(); fact.about.values()];
            for &(from_ms, to_ms, value) in &fact.periods {
                let Some(of_value) = episodes.get_mut(value) else { continue };
                match is_silent(stretches, from_ms.saturating_add(late_ms), to_ms) {
                    Some(true) => of_value.silent.push(from_ms),
                    Some(false) => of_value.heard.push(from_ms),
                    None => {}
                }
            }
            let those = |is: &dyn Fn(f64, f64) -> bool| {
                let known = episodes.iter().enumerate().filter(|(_, it)| it.count() >= EPISODES);
                known
                    .filter(|(_, it)| is(it.silent_share().0, it.silent_share().1))
                    .map(|(it, _)| it)
                    .collect()
            };
            let silent: Vec<usize> = those(&|low, _| low >= SILENT_LEAST);
            let heard: Vec<usize> = those(&|_, high| high <= SHARE_DOUBTED);
            if !silent.is_empty() && !heard.is_empty() {
                let (module, about) = (ModuleId(index as u32), fact.about);
                bytes += episodes.iter().map(|it| it.count() as usize * size_of::<i64>()).sum::<usize>();
                all.push(Silence { module, about, silent, heard, episodes });
            }
        }
    }
    Some(all)
}

/// Whether the module said nothing all the time; `None` if the time is too short, or the module was not relevant, or the
/// history has a gap.
fn is_silent(stretches: &[Stretch], from_ms: i64, to_ms: i64) -> Option<bool> {
    if to_ms.saturating_sub(from_ms) < EPISODE_MS {
        return None;
    }
    let first = stretches.partition_point(|it| it.to_ms <= from_ms);
    let (mut known_ms, mut is_silent) = (from_ms, true);
    for stretch in stretches[first..].iter().take_while(|it| it.from_ms < to_ms) {
        if stretch.from_ms > known_ms || stretch.own == State::Ignore {
            return None;
        }
        known_ms = stretch.to_ms;
        is_silent &= stretch.own == State::Unknown;
    }
    (known_ms >= to_ms).then_some(is_silent)
}

#[cfg(test)]
mod tests {
    use telltale_engine::model::{GroupId, GroupSpec, ModuleMonitor, ModuleSpec, Parts, StageModel};
    use telltale_engine::text::Text;
    use telltale_engine::time::Span;

    use super::*;

    const MINUTE_MS: i64 = 60_000;

    fn model() -> Model {
        let mut parts = Parts::empty("vehicle", StageModel::Shuttle);
        parts.groups.push(GroupSpec::new("all", Text::plain("All")));
        let status = ModuleMonitor::SelfState("0".into());
        parts.modules.push(ModuleSpec::new("all/0", GroupId(0), status));
        // Its silence is noticed after ten seconds at the latest.
        parts.modules[0].policy.timeout = Span::from_secs(10);
        Model::new(parts).expect("it has no circle")
    }

    /// In each minute one value holds, and the module is in one state from ten seconds after its beginning on.
    fn found(about: About, minutes: &[(usize, State)]) -> Vec<Silence> {
        let (mut stretches, mut periods) = (Vec::new(), Vec::new());
        for (minute, (value, own)) in minutes.iter().enumerate() {
            let from_ms = minute as i64 * MINUTE_MS;
            let (middle_ms, to_ms) = (from_ms + 10_000, from_ms + MINUTE_MS);
            stretches.push(Stretch { from_ms, to_ms: middle_ms, own: State::Ok });
            stretches.push(Stretch { from_ms: middle_ms, to_ms, own: *own });
            periods.push((from_ms, to_ms, *value));
        }
        let history = History { modules: vec![stretches], facts: vec![Fact { about, periods }] };
        assert_eq!(silences(&history, &model(), &|_| false), None);
        silences(&history, &model(), &|_| true).expect("it goes on to its end")
    }

    fn minutes(all: &[(usize, usize, State)]) -> Vec<(usize, State)> {
        all.iter().flat_map(|(count, value, own)| vec![(*value, *own); *count]).collect()
    }

    #[test]
    fn twenty_silences_at_one_value_and_twenty_times_heard_at_the_other_are_a_proposal() {
        let signal = About::Signal(0);
        let all = found(signal, &minutes(&[(20, 0, State::Unknown), (20, 1, State::Ok)]));
        let [silence] = &all[..] else { panic!("{all:?}") };
        assert_eq!((&silence.silent[..], &silence.heard[..]), (&[0][..], &[1][..]));
        assert_eq!((silence.episodes[0].silent.len(), silence.episodes[1].heard.len()), (20, 20));
        for few in [
            [(19, 0, State::Unknown), (0, 0, State::Ok), (20, 1, State::Ok)],
            [(20, 0, State::Unknown), (0, 0, State::Ok), (19, 1, State::Ok)],
            // Heard once of twenty-one times.
            [(20, 0, State::Unknown), (1, 0, State::Error), (20, 1, State::Ok)],
            // Silent at both.
            [(20, 0, State::Unknown), (0, 0, State::Ok), (20, 1, State::Unknown)],
            // Not relevant at one of them already.
            [(20, 0, State::Ignore), (0, 0, State::Ok), (20, 1, State::Ok)],
        ] {
            assert_eq!(found(signal, &minutes(&few)), [], "{few:?}");
        }
        // One counterexample of thirty is told, and does not forbid it.
        let one = [(29, 0, State::Unknown), (1, 0, State::Ok), (20, 1, State::Ok)];
        assert_eq!(found(signal, &minutes(&one))[0].episodes[0].heard, [29 * MINUTE_MS]);
    }

    #[test]
    fn a_module_stays_relevant_in_stages_of_which_too_little_is_known() {
        let [standby, cleared, active] =
            [Stage::Standby, Stage::Cleared, Stage::Active].map(|it| it as usize);
        let all = [(20, standby, State::Unknown), (5, cleared, State::Unknown), (20, active, State::Ok)];
        let found = found(About::Stages, &minutes(&all));
        assert_eq!(found[0].when(&model()), "{ stages: [localizing, cleared, active] }");
        assert_eq!(found[0].value(&model(), standby), "standby");
    }

    #[test]
    fn gaps_and_short_times_do_not_count() {
        let stretch = |from_ms, to_ms, own| Stretch { from_ms, to_ms, own };
        let all = [stretch(0, 5_000, State::Unknown), stretch(6_000, 9_000, State::Unknown)];
        assert_eq!(is_silent(&all, 0, 5_000), Some(true));
        for (from_ms, to_ms) in [(0, 9_000), (4_500, 5_000), (8_000, 10_000), (20_000, 30_000)] {
            assert_eq!(is_silent(&all, from_ms, to_ms), None, "{from_ms} {to_ms}");
        }
    }
}
