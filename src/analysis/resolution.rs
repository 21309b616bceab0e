//! Eigenvalues of `voronoi` for as fine a mesh as its modes would need: λ from μ.
//!
//! Ours, after two known facts. Concentrating the mass of linear finite elements in the points lowers an eigenvalue by as much as
//! the mode changes within triangles, `∑_T A/12 ∑_edges (h_a − h_b)²`; with the mass left where it is, the eigenvalue is too large
//! by the energy of what linear functions miss of the mode (Strang and Fix 1973, §6.3), so that means of both masses are of higher
//! order on even meshes (Goudreau and Taylor 1972). What is missed is known but for the mode's second derivatives: of
//! plane waves, in the mean over their directions, its energy over a triangle is `(9R²/S − 1/2)` times what the concentrated mass
//! loses there, R being the circumradius and S the sum of the squared sides: a half for equilateral triangles, 5/8 for halves of
//! squares. The difference is added. Matrices and bases stay as they are, and so does μ.

use rayon::prelude::*;

use crate::geometry::{Points, Stars, TriangleMetric};
use crate::progress::{Canceled, Progress};

/// Pairs of points that one task adds up; sums run over the same parts whatever the number of threads.
const PART: usize = 16_384;

/// What the eigenvalues of a triangulated surface lack, as a quadratic form of differences between points.
pub(super) struct Resolution {
    /// Pairs of points with the weight of their squared difference, in length².
    links: Vec<([u32; 2], f64)>,
}

impl Resolution {
    /// Of the triangles of all stars.
    ///
    /// # Errors
    /// [`Canceled`].
    pub(super) fn of(points: &Points, stars: &Stars, progress: &Progress) -> Result<Self, Canceled> {
        let of_point = |i: usize| {
            let star = if progress.is_canceled() { &[] } else { stars.of(i) };
            star.iter().enumerate().filter_map(move |(k, spoke)| {
                let q = spoke.neighbor as usize;
                let back = stars.of(q).iter().position(|spoke| spoke.neighbor == i as u32);
                // the other end names the link where it sees it too
                (i < q || back.is_none()).then(|| {
                    let seen_back = back.map_or(0.0, |k| beside(points, stars, q, k));
                    ([i as u32, q as u32], (beside(points, stars, i, k) + seen_back))
                })
            })
        };
        let links = (0..stars.len()).into_par_iter().with_min_len(256).flat_map_iter(of_point).collect();
        progress.checkpoint()?;
        Ok(Self { links })
    }

    /// The same between the points of an operator; `place` says which of them a point is, if any.
    pub(super) fn placed(mut self, place: impl Fn(usize) -> Option<u32>) -> Self {
        self.links.retain_mut(|([p, q], _)| match (place(*p as usize), place(*q as usize)) {
            (Some(a), Some(b)) => {
                [*p, *q] = [a, b];
                true
            }
            _ => false,
        });
        self
    }

    /// λ of every μ, ascending. `row(i, y)` writes the modes at point `i` times the root of its mass, of norm 1 over all points.
    ///
    /// # Errors
    /// [`Canceled`].
    pub(super) fn corrected(
        &self,
        mu: &[f64],
        clusters: &[[usize; 2]],
        root_mass: &[f64],
        row: impl Fn(usize, &mut [f64]) + Sync,
        progress: &Progress,
    ) -> Result<Vec<f64>, Canceled> {
        let modes = mu.len();
        let values = |point: u32, values: &mut [f64]| {
            row(point as usize, values);
            for value in values.iter_mut() {
                *value /= root_mass[point as usize];
            }
        };
        let of_part = |part: &[([u32; 2], f64)]| {
            let (mut sums, mut a, mut b) = (vec![0.0; modes], vec![0.0; modes], vec![0.0; modes]);
            let mut last = None;
            for &([p, q], weight) in part.iter().take_while(|_| !progress.is_canceled()) {
                if last != Some(p) {
                    values(p, &mut a);
                    last = Some(p);
                }
                values(q, &mut b);
                for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(&b)) {
                    *sum += weight * (a - b) * (a - b);
                }
            }
            sums
        };
        let parts: Vec<Vec<f64>> = self.links.par_chunks(PART).map(of_part).collect();
        progress.checkpoint()?;
        let mut lacking: Vec<f64> =
            (0..modes).map(|mode| parts.iter().map(|sums| sums[mode]).sum::<f64>()).collect();
        for cluster in clusters {
            let of_cluster = &mut lacking[cluster[0]..=cluster[1]];
            let mean = of_cluster.iter().sum::<f64>() / of_cluster.len() as f64;
            of_cluster.fill(mean);
        }
        let mut lambdas: Vec<f64> =
            mu.iter().zip(lacking).map(|(mu, lacking)| mu * (1.0 + lacking)).collect();
        // where triangles differ in size the order of μ need not be that of λ
        lambdas.sort_unstable_by(f64::total_cmp);
        Ok(lambdas)
    }
}

/// Half of the weights of the two triangles beside spoke `k` of point `i`: the other half is seen from the other end.
fn beside(points: &Points, stars: &Stars, i: usize, k: usize) -> f64 {
    let star = stars.of(i);
    let before = (k + star.len() - 1) % star.len();
    let weight = |k: usize| {
        if star[k].filled { unresolved(&TriangleMetric::of(points, stars.triangle(i, k))) } else { 0.0 }
    };
    0.5 * (weight(before) + weight(k))
}

/// Weight of the squared differences along each side of a triangle. Where it is so flat that more is missed of waves across it than
/// its mass loses, directions matter, and nothing is added.
fn unresolved(triangle: &TriangleMetric) -> f64 {
    let (radius, sides) = (triangle.circumradius(), triangle.squared_sides().iter().sum::<f64>());
    let share = 1.5 - 9.0 * radius * radius / sides;
    // not so of a triangle without area, whose radius is infinite or no number
    if share > 0.0 { share * triangle.area() / 12.0 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weight_of_a_triangle_is_what_quadratic_functions_lack_in_the_mean_over_directions() {
        // by hand: 1 − θ is 1/2 of an equilateral triangle, 3/8 of half a square; a needle's angle of nearly 180° has none
        for (squared, expected) in [
            ([1.0, 1.0, 1.0], 0.5 * 3.0_f64.sqrt() / 4.0 / 12.0),
            ([1.0, 1.0, 2.0], 0.375 * 0.5 / 12.0),
            ([1.0, 1.0, 3.9], 0.0),
            ([1.0, 1.0, 4.0], 0.0),
            ([0.0, 0.0, 0.0], 0.0),
        ] {
            let found = unresolved(&TriangleMetric::from_squared_sides(squared));
            assert!((found - expected).abs() < 1e-15, "{squared:?}: {found} {expected}");
        }
    }
    #[test]
    fn modes_that_may_mix_lack_the_same() {
        let resolution = Resolution { links: vec![([0, 1], 0.01), ([1, 2], 0.02)] };
        let modes = [[0.5, 0.0, 1.0], [0.5, 1.0, 0.0], [0.5, 0.0, 0.0]];
        let row = |i: usize, y: &mut [f64]| y.copy_from_slice(&modes[i]);
        let corrected = |clusters: &[[usize; 2]]| {
            resolution.corrected(&[0.0, 2.0, 2.0], clusters, &[0.5; 3], row, &Progress::new()).unwrap()
        };
        // by hand: 4·(0.01 + 0.02) and 4·0.01 of each
        let near = |found: Vec<f64>, expected: [f64; 3]| {
            found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6)
        };
        assert!(near(corrected(&[]), [0.0, 2.08, 2.24]));
        assert!(near(corrected(&[[1, 2]]), [0.0, 2.16, 2.16]));
    }
}
