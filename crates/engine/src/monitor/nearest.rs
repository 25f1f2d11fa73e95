//! The distance between two lists of positions.

use crate::model::sample::Position;

/// The largest distance of any position of one list to the nearest of the other, in metres (the
/// Hausdorff distance): 0 for two empty lists, infinite where one of them is empty.
pub(super) fn apart_m(a: &[Position], b: &[Position]) -> f64 {
    farthest(a, b).max(farthest(b, a))
}

fn farthest(from: &[Position], to: &[Position]) -> f64 {
    let nearest = |one: &Position| {
        let distances = to.iter().map(|other| (one.x_m - other.x_m).hypot(one.y_m - other.y_m));
        distances.fold(f64::INFINITY, f64::min)
    };
    from.iter().map(nearest).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_position_of_both_lists_counts() {
        let at = |places: &[(f64, f64)]| -> Vec<Position> {
            places.iter().map(|&(x_m, y_m)| Position { x_m, y_m }).collect()
        };
        for (a, b, apart) in [
            (at(&[]), at(&[]), 0.0),
            (at(&[(1.0, 2.0)]), at(&[]), f64::INFINITY),
            (at(&[(0.0, 0.0), (10.0, 0.0)]), at(&[(10.0, 0.5), (0.3, 0.4)]), 0.5),
            // Two that one source sees as one are near; one that only one source sees is not.
            (at(&[(0.0, 0.0), (0.6, 0.0)]), at(&[(0.3, 0.0)]), 0.3),
            (at(&[(0.0, 0.0), (3.0, 4.0)]), at(&[(0.0, 0.0)]), 5.0),
            (at(&[(1e200, 0.0)]), at(&[(-1e200, 0.0)]), 2e200),
        ] {
            assert_eq!([apart_m(&a, &b), apart_m(&b, &a)], [apart, apart], "{a:?} {b:?}");
        }
    }
}
