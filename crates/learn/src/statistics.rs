//! An interval of a share, and how probable a count is by chance.

/// The interval of 95 % of a share.
pub fn wilson(part: u64, whole: u64) -> (f64, f64) {
    if whole == 0 {
        return (0.0, 1.0);
    }
    let (n, p, z) = (whole as f64, part as f64 / whole as f64, 1.959_964);
    let middle = p + z * z / (2.0 * n);
    let spread = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    let of = 1.0 + z * z / n;
    let low = if part == 0 { 0.0 } else { (middle - spread) / of };
    (low, ((middle + spread) / of).min(1.0))
}

/// The probability of at least `part` of `whole`, each with this chance: the upper tail of the binomial distribution.
pub fn at_least(part: u64, whole: u64, chance: f64) -> f64 {
    if part == 0 || chance >= 1.0 {
        return 1.0;
    }
    if chance <= 0.0 {
        return 0.0;
    }
    // Logarithms of binomial coefficients, so that large counts do not overflow.
    let (mut log, mut sum) = (0.0_f64, 0.0);
    for k in 0..=whole {
        if k > 0 {
            log += ((whole - k + 1) as f64).ln() - (k as f64).ln();
        }
        if k >= part {
            sum += (log + k as f64 * chance.ln() + (whole - k) as f64 * (1.0 - chance).ln()).exp();
        }
    }
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_and_intervals_are_those_of_the_textbooks() {
        let near = |one: f64, other: f64| assert!((one - other).abs() < 1e-4, "{one} {other}");
        near(at_least(9, 10, 0.5), 11.0 / 1024.0);
        near(at_least(0, 10, 0.5), 1.0);
        near(at_least(5, 5, 0.1), 1e-5);
        assert_eq!(at_least(3, 9, 0.0), 0.0);
        // No event in a thousand bounds its rate.
        assert_eq!(wilson(0, 1000).0, 0.0);
        near(wilson(0, 1000).1, 0.003_83);
        // Newcombe 1998, table I: 81 of 263.
        near(wilson(81, 263).0, 0.2553);
        near(wilson(81, 263).1, 0.3662);
        assert!(wilson(5, 5).0 > 0.5 && wilson(0, 15).1 > 0.2 && wilson(0, 16).1 < 0.2);
    }
}
