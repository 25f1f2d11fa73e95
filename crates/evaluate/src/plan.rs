//! The faults of one trial, drawn from its seed.

use super::random::Random;

/// A fault that a machine can have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    pub name: String,
    /// The modules of the broken component. Each of them names it.
    pub truth: Vec<String>,
    /// It breaks what other components work with.
    pub spreads: bool,
    /// How much it asks of the operator: 0 to 2.
    pub urgency: u8,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    Single,
    /// Two independent faults.
    Overlapping,
    /// One whose effects spread, that comes and goes, or that shows for moments.
    Restless,
}

/// Where the machine is when the trial begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Place {
    OnItsWay,
    AtAStop,
}

/// One fault and when it is there, in milliseconds after the beginning of the trial.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Injection {
    pub fault: usize,
    pub spells: Vec<(u64, u64)>,
}

impl Injection {
    pub fn begins_ms(&self) -> u64 {
        self.spells[0].0
    }

    /// The end of the last spell.
    pub fn ends_ms(&self) -> u64 {
        self.spells[self.spells.len() - 1].1
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    pub seed: u64,
    pub class: Class,
    pub place: Place,
    pub injections: Vec<Injection>,
    /// Of the beginnings of two faults.
    pub gap_ms: Option<u64>,
    pub length_ms: u64,
}

/// After the last fault.
const TAIL_MS: u64 = 4_000;

impl Plan {
    pub fn draw(seed: u64, faults: &[Fault]) -> Plan {
        let mut random = Random::new(seed, 1);
        let begins = random.between(500, 1500);
        // Sixteen of each class before the share at a stop changes, so that each class is at both places.
        let place = if (seed / 3).is_multiple_of(5) { Place::AtAStop } else { Place::OnItsWay };
        let any = random.below(faults.len());
        let (class, gap_ms, injections) = match seed % 3 {
            0 => {
                let ends = begins + random.between(3_000, 15_000);
                (Class::Single, None, vec![Injection { fault: any, spells: vec![(begins, ends)] }])
            }
            1 => {
                let (gap, injections) = two(seed, begins, faults, &mut random);
                (Class::Overlapping, Some(gap), injections)
            }
            _ => (Class::Restless, None, vec![restless(begins, faults, &mut random)]),
        };
        let ends = injections.iter().map(Injection::ends_ms).max().unwrap_or(begins);
        Plan { seed, class, place, injections, gap_ms, length_ms: ends + TAIL_MS }
    }
}

/// Two faults of different names. Half of the pairs are chosen for harm: one spreads, and the other is at least as urgent.
fn two(seed: u64, begins: u64, faults: &[Fault], random: &mut Random) -> (u64, Vec<Injection>) {
    let different: Vec<(usize, usize)> = (0..faults.len())
        .flat_map(|one| (0..faults.len()).map(move |other| (one, other)))
        .filter(|(one, other)| faults[*one].truth != faults[*other].truth)
        .collect();
    let harmful: Vec<(usize, usize)> = different
        .iter()
        .copied()
        .filter(|(one, other)| faults[*one].spreads && faults[*other].urgency >= faults[*one].urgency)
        .collect();
    let from = if random.chance(50) && !harmful.is_empty() { &harmful } else { &different };
    let (one, other) = from[random.below(from.len())];
    let (first, second) = if random.chance(50) { (one, other) } else { (other, one) };
    let gap = [500, 5_000, 60_000][(seed / 3 % 3) as usize];
    let both_until = begins + gap + random.between(8_000, 12_000);
    let later = both_until + random.between(0, 3_000);
    let (first_ends, second_ends) = if random.chance(50) { (both_until, later) } else { (later, both_until) };
    let injections = vec![
        Injection { fault: first, spells: vec![(begins, first_ends)] },
        Injection { fault: second, spells: vec![(begins + gap, second_ends)] },
    ];
    (gap, injections)
}

fn restless(begins: u64, faults: &[Fault], random: &mut Random) -> Injection {
    let spreading: Vec<usize> = (0..faults.len()).filter(|index| faults[*index].spreads).collect();
    match random.below(3) {
        0 if !spreading.is_empty() => {
            let ends = begins + random.between(8_000, 15_000);
            Injection { fault: spreading[random.below(spreading.len())], spells: vec![(begins, ends)] }
        }
        // It comes and goes.
        1 => Injection {
            fault: random.below(faults.len()),
            spells: spells(begins, (300, 2_500), (300, 2_500), random),
        },
        // It shows for moments.
        _ => Injection {
            fault: random.below(faults.len()),
            spells: spells(begins, (100, 500), (1_500, 4_000), random),
        },
    }
}

/// Spells within twelve seconds; the last one is long enough to be named.
fn spells(begins: u64, there: (u64, u64), gone: (u64, u64), random: &mut Random) -> Vec<(u64, u64)> {
    let mut spells = Vec::new();
    let mut at = begins;
    while at < begins + 12_000 {
        let ends = at + random.between(there.0, there.1);
        spells.push((at, ends));
        at = ends + random.between(gone.0, gone.1);
    }
    spells.push((at, at + 5_000));
    spells
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults() -> Vec<Fault> {
        let fault = |name: &str, spreads, urgency| Fault {
            name: name.into(),
            truth: vec![format!("{name}/it")],
            spreads,
            urgency,
        };
        vec![fault("lidar", true, 1), fault("brake", false, 2), fault("camera", false, 0)]
    }

    #[test]
    fn a_seed_is_always_the_same_trial_and_each_class_is_a_third() {
        let plans: Vec<Plan> = (0..300).map(|seed| Plan::draw(seed, &faults())).collect();
        assert_eq!(plans, (0..300).map(|seed| Plan::draw(seed, &faults())).collect::<Vec<_>>());
        for class in [Class::Single, Class::Overlapping, Class::Restless] {
            let of_class: Vec<_> = plans.iter().filter(|plan| plan.class == class).collect();
            assert_eq!(of_class.len(), 100);
            assert!((15..25).contains(&of_class.iter().filter(|plan| plan.place == Place::AtAStop).count()));
        }
    }

    #[test]
    fn two_faults_overlap_in_both_orders_with_each_gap() {
        let plans =
            (0..3_000).map(|seed| Plan::draw(seed, &faults())).filter(|plan| plan.injections.len() == 2);
        let mut seen = std::collections::BTreeSet::new();
        for plan in plans {
            let [first, second] = &plan.injections[..] else { panic!("two") };
            assert_eq!(Some(second.begins_ms() - first.begins_ms()), plan.gap_ms);
            assert!(first.ends_ms() >= second.begins_ms() + 8_000, "{plan:?}");
            seen.insert((first.fault, second.fault, plan.gap_ms));
        }
        assert_eq!(seen.len(), 6 * 3);
    }

    #[test]
    fn spells_are_in_order_and_end_before_the_trial() {
        for seed in 0..300 {
            let plan = Plan::draw(seed, &faults());
            for injection in &plan.injections {
                let times: Vec<u64> = injection.spells.iter().flat_map(|(from, to)| [*from, *to]).collect();
                assert!(times.is_sorted_by(|one, other| one < other), "{plan:?}");
                assert!(injection.ends_ms() < plan.length_ms);
            }
        }
    }
}
