//! Intervals and tests: bootstrap, McNemar, Wilcoxon's signed ranks, and Holm's correction.

pub use telltale_learn::wilson;

use super::random::Random;

const RESAMPLES: usize = 1_000;

/// The middle 95 % of a value over trials that are drawn again, with the same draws for each value. A value that is
/// missing in a draw is left out.
pub fn bootstrap(trials: usize, mut value: impl FnMut(&[usize]) -> Option<f64>) -> (f64, f64) {
    if trials == 0 {
        return (0.0, 0.0);
    }
    let mut random = Random::new(trials as u64, 4);
    let mut drawn = vec![0; trials];
    let mut values = Vec::with_capacity(RESAMPLES);
    for _ in 0..RESAMPLES {
        drawn.fill_with(|| random.below(trials));
        values.extend(value(&drawn));
    }
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get(((values.len().max(1) - 1) as f64 * share).round() as usize).copied();
    (at(0.025).unwrap_or(0.0), at(0.975).unwrap_or(0.0))
}

pub fn percentile(values: &mut [u64], share: f64) -> Option<f64> {
    values.sort_unstable();
    let last = values.len().checked_sub(1)?;
    Some(values[(last as f64 * share).round() as usize] as f64)
}

/// McNemar's exact test: how probable it is that so many of the pairs that differ favour one side by chance.
pub fn mcnemar(only_one: u64, only_other: u64) -> f64 {
    let n = only_one + only_other;
    if n == 0 {
        return 1.0;
    }
    // Logarithms of binomial coefficients, so that large counts do not overflow.
    let mut log = 0.0_f64;
    let mut sum = 0.0;
    for k in 0..=only_one.min(only_other) {
        if k > 0 {
            log += ((n - k + 1) as f64).ln() - (k as f64).ln();
        }
        sum += (log - n as f64 * std::f64::consts::LN_2).exp();
    }
    (2.0 * sum).min(1.0)
}

/// Wilcoxon's test of signed ranks over differences, by its normal approximation. Differences of 0 are left out.
pub fn wilcoxon(differences: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = differences.iter().copied().filter(|it| *it != 0.0).collect();
    sizes.sort_by(|one, other| one.abs().total_cmp(&other.abs()));
    let n = sizes.len() as f64;
    if n < 1.0 {
        return 1.0;
    }
    let (mut positive, mut ties) = (0.0, 0.0);
    let mut start = 0;
    while start < sizes.len() {
        let same = sizes[start..].iter().take_while(|it| it.abs() == sizes[start].abs()).count();
        let rank = start as f64 + (same as f64 + 1.0) / 2.0;
        positive += rank * sizes[start..start + same].iter().filter(|it| **it > 0.0).count() as f64;
        ties += (same as f64).powi(3) - same as f64;
        start += same;
    }
    let variance = n * (n + 1.0) * (2.0 * n + 1.0) / 24.0 - ties / 48.0;
    if variance <= 0.0 {
        return 1.0;
    }
    2.0 * normal_tail((positive - n * (n + 1.0) / 4.0).abs() / variance.sqrt())
}

/// Holm's correction of several tests, in their order.
pub fn holm(tests: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..tests.len()).collect();
    order.sort_by(|one, other| tests[*one].total_cmp(&tests[*other]));
    let mut corrected = vec![0.0; tests.len()];
    let mut least: f64 = 0.0;
    for (place, index) in order.into_iter().enumerate() {
        least = least.max(tests[index] * (tests.len() - place) as f64).min(1.0);
        corrected[index] = least;
    }
    corrected
}

/// The upper tail of the normal distribution (Abramowitz and Stegun, 7.1.26).
fn normal_tail(z: f64) -> f64 {
    let x = z / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let series = [0.254_829_592, -0.284_496_736, 1.421_413_741, -1.453_152_027, 1.061_405_429];
    let sum = series.iter().rev().fold(0.0, |sum, factor| (sum + factor) * t);
    0.5 * sum * (-x * x).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(one: f64, other: f64, by: f64) {
        assert!((one - other).abs() < by, "{one} {other}");
    }

    #[test]
    fn tests_give_the_probabilities_of_the_textbooks() {
        near(mcnemar(5, 0), 0.0625, 1e-9);
        near(mcnemar(1, 9), 0.021_484_375, 1e-9);
        assert_eq!(mcnemar(0, 0), 1.0);
        assert!(mcnemar(3_000, 2_000) < 1e-9);
        near(normal_tail(1.959_964), 0.025, 1e-6);
        near(wilcoxon(&(1..=20).map(f64::from).collect::<Vec<_>>()), 8.86e-5, 2e-6);
        assert_eq!(wilcoxon(&[0.0, 0.0]), 1.0);
        let corrected = holm(&[0.01, 0.04, 0.03]);
        near(corrected[0], 0.03, 1e-12);
        near(corrected[1], 0.06, 1e-12);
        near(corrected[2], 0.06, 1e-12);
    }

    #[test]
    fn an_interval_by_drawing_holds_the_value() {
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0];
        let mean = |drawn: &[usize]| Some(drawn.iter().map(|index| values[*index]).sum::<f64>() / 10.0);
        let (low, high) = bootstrap(10, mean);
        assert!(low < 4.5 && high > 6.5 && low > 3.0 && high < 8.0, "{low} {high}");
        assert_eq!(percentile(&mut [3, 1, 2], 0.5), Some(2.0));
        assert_eq!(percentile(&mut [], 0.5), None);
    }
}
