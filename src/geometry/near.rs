//! Points that repeat one another but for rounding or jitter: copies in another precision, repeated frames.
//!
//! Around a sample of a surface the nearest distances grow steadily: of Poisson-distributed points, the ball with `j`
//! points can be grown by a factor `r` without meeting another with the chance `r^(-2j)`. Points behind a gap that such
//! sampling has once in a hundred thousand are taken for repetitions of one.

use rayon::prelude::*;

use super::components::components;
use super::neighborhoods::NearestNeighbors;
use super::points::{GeometryError, Points};
use crate::progress::Progress;

/// Chance of a gap, its tenth logarithm.
const CHANCE: f64 = -5.0;

/// Least factor between the distances before and behind a gap.
const GAP_MIN: f64 = 10.0;

/// The points that stand for others, and for whom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Repetitions {
    /// The group of every point, numbered by their first points.
    pub group: Vec<u32>,
    /// Points of every group.
    pub sizes: Vec<usize>,
}

impl Repetitions {
    /// Groups of points that repeat one another; `None` when there are none.
    ///
    /// # Errors
    /// [`GeometryError::Canceled`].
    pub fn find(
        points: &Points,
        nearest: &NearestNeighbors,
        progress: &Progress,
    ) -> Result<Option<Self>, GeometryError> {
        // the factor that each number of points has by chance, squared
        let least: Vec<f64> = (0..nearest.count())
            .map(|count| 10.0_f64.powf(-CHANCE / count as f64).max(GAP_MIN * GAP_MIN))
            .collect();
        let before_gap: Vec<usize> = (0..points.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let around = if progress.is_canceled() { &[] } else { nearest.of(i) };
                before_gap(&least, around.iter().map(|&q| points.squared_distance(i, q as usize)))
            })
            .collect();
        progress.checkpoint()?;
        // both must see the other before a gap: a stray beside a cluster is not of it
        let same = |i: usize| {
            let before_gap = &before_gap;
            nearest.of(i)[..before_gap[i]]
                .iter()
                .copied()
                .filter(move |&q| nearest.of(q as usize)[..before_gap[q as usize]].contains(&(i as u32)))
        };
        if (0..points.len()).all(|i| same(i).next().is_none()) {
            return Ok(None);
        }
        let found = components(points.len(), same, progress)?;
        Ok(Some(Self { group: found.label, sizes: found.size }))
    }
}

/// Neighbors before the last gap among these ascending squared distances, each of which would have to be `least` times the one
/// before; 0 without a gap.
fn before_gap(least: &[f64], squared: impl Iterator<Item = f64>) -> usize {
    let (mut last, mut found) = (None, 0);
    for (count, (squared, least)) in squared.zip(least).enumerate() {
        if last.is_some_and(|last: f64| squared > least * last) {
            found = count;
        }
        last = Some(squared);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{NonFinite, PointCloud};
    use crate::geometry::SearchTree;
    use crate::geometry::stars::tests::jitter;

    fn repetitions(rows: &[[f64; 3]]) -> Option<Repetitions> {
        let cloud = PointCloud::new(3, rows.concat(), NonFinite::Reject).unwrap();
        let points = Points::prepare(&cloud, 2).unwrap();
        let tree = SearchTree::new(&points);
        let progress = Progress::new();
        let nearest = NearestNeighbors::find(&tree, &points, 20, &progress).unwrap();
        Repetitions::find(&points, &nearest, &progress).unwrap()
    }

    /// Points of a plate, each `copies` times, moved by up to `share` of the spacing.
    fn plate(copies: u64, share: f64) -> Vec<[f64; 3]> {
        (0..1_000 * copies)
            .map(|row| {
                let point = row / copies;
                let place = [point % 40, point / 40, 0];
                std::array::from_fn(|axis| {
                    let flat = if axis < 2 { 0.5 * jitter(2 * point + axis as u64) } else { 0.0 };
                    place[axis] as f64 + flat + share * jitter(1_000_000 + 3 * row + axis as u64)
                })
            })
            .collect()
    }

    #[test]
    fn independent_points_and_lattices_have_no_repetitions() {
        let iid: Vec<_> = (0..2_000).map(|i| [jitter(2 * i), jitter(2 * i + 1), 0.0]).collect();
        assert!(repetitions(&iid).is_none_or(|found| found.sizes.len() >= 1_998));
        let lattice: Vec<_> = (0..400).map(|i| [f64::from(i % 20), f64::from(i / 20), 0.0]).collect();
        assert_eq!(repetitions(&lattice), None);
    }

    #[test]
    fn copies_are_found_whatever_their_number_and_jitter() {
        for (copies, share) in [(2, 1e-6), (5, 1e-3), (12, 1e-2)] {
            let found = repetitions(&plate(copies, share)).unwrap();
            assert_eq!(found.sizes.len(), 1_000, "{copies}");
        }
    }
}
