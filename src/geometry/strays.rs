//! Points that lie off the surface, alone or in clouds of their own.
//!
//! On a surface neighbors are mutual: each is among the other's nearest, and chains of mutual neighbors run all over it
//! (after Brito et al. 1997). A stray has neighbors that do not have it. What hangs together apart from the rest is stray
//! if it is sparse and fills space: of few points, sparser than those that it sees; of many, than the surface.

use super::components::components;
use super::frames::axes_in_space;
use super::neighborhoods::NearestNeighbors;
use super::points::{GeometryError, Points};
use crate::progress::Progress;

/// Nearest neighbor whose distance is the local scale.
const SCALE: usize = 8;

/// Fewer points than this are compared with those around them.
const FEW: usize = 20;

/// They are stray when so many times as far apart.
const SPARSE_FEW: f64 = 2.0;

/// Of more points, so many times as far apart as those of the surface.
const SPARSE: f64 = 3.0;

/// Third over second principal variance of neighbors: at a pole of rings, and beside sparser sampling, points are as lonely as
/// strays, but with their neighbors in one plane.
const FLAT_FEW: f64 = 0.3;
const FLAT: f64 = 0.2;

/// The stray points among points in space, ascending; none in other dimensions.
///
/// # Errors
/// [`GeometryError::Canceled`].
pub fn strays(
    points: &Points,
    nearest: &NearestNeighbors,
    progress: &Progress,
) -> Result<Vec<u32>, GeometryError> {
    if points.dimension() != 3 {
        return Ok(Vec::new());
    }
    let mutual = |i: usize| {
        let is_back = move |q: &u32| nearest.of(*q as usize).contains(&(i as u32));
        nearest.of(i).iter().copied().filter(is_back)
    };
    let found = components(points.len(), mutual, progress)?;
    let Some(surface) = (0..found.size.len()).max_by_key(|&group| (found.size[group], usize::MAX - group))
    else {
        return Ok(Vec::new());
    };
    if found.size.len() == 1 {
        return Ok(Vec::new());
    }
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); found.size.len()];
    found.label.iter().enumerate().for_each(|(i, &group)| members[group as usize].push(i));
    let scale = |i: usize| {
        let around = nearest.of(i);
        points.squared_distance(i, around[SCALE.min(around.len()) - 1] as usize).sqrt()
    };
    let of_surface = middle(members[surface].iter().map(|&i| scale(i)));
    let is_stray = |group: &usize| {
        let own = &members[*group];
        let apart = middle(own.iter().map(|&i| scale(i)));
        let thickness = || middle(own.iter().map(|&i| thickness(points, i, nearest.of(i))));
        if own.len() >= FEW {
            return apart > SPARSE * of_surface && thickness() > FLAT;
        }
        let others = own
            .iter()
            .flat_map(|&i| nearest.of(i))
            .filter(|&&q| found.label[q as usize] as usize != *group)
            .map(|&q| scale(q as usize));
        apart > SPARSE_FEW * middle(others) && thickness() > FLAT_FEW
    };
    let stray: Vec<bool> = (0..members.len()).map(|group| group != surface && is_stray(&group)).collect();
    Ok((0..points.len() as u32).filter(|&i| stray[found.label[i as usize] as usize]).collect())
}

/// Third over second principal variance of the neighbors, seen from the point.
fn thickness(points: &Points, i: usize, neighbors: &[u32]) -> f64 {
    let p = points.point(i);
    let offset = |q: &u32| std::array::from_fn(|axis| points.point(*q as usize)[axis] - p[axis]);
    match axes_in_space(neighbors.iter().map(offset)) {
        Some(axes) if axes.variances[1] > 0.0 => axes.variances[2].max(0.0) / axes.variances[1],
        _ => 0.0,
    }
}

/// The middle value; infinite of none.
fn middle(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let place = values.len() / 2;
    if values.is_empty() { f64::INFINITY } else { *values.select_nth_unstable_by(place, f64::total_cmp).1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{NonFinite, PointCloud};
    use crate::geometry::SearchTree;
    use crate::geometry::stars::tests::jitter;

    fn found(rows: &[[f64; 3]]) -> Vec<usize> {
        let cloud = PointCloud::new(3, rows.concat(), NonFinite::Reject).unwrap();
        let points = Points::prepare(&cloud, 2).unwrap();
        let tree = SearchTree::new(&points);
        let nearest = NearestNeighbors::find(&tree, &points, 20, &Progress::new()).unwrap();
        strays(&points, &nearest, &Progress::new())
            .unwrap()
            .into_iter()
            .map(|i| points.row(i as usize))
            .collect()
    }

    /// Points of the unit sphere along a spiral, `sparse` times as many above the equator as below.
    fn sphere(n: usize, sparse: usize) -> Vec<[f64; 3]> {
        let spiral = |n: usize| {
            (0..n).map(move |i| {
                let z = 1.0 - (2 * i + 1) as f64 / n as f64;
                let (r, angle) = ((1.0 - z * z).sqrt(), 2.399_963_229_728_653 * i as f64);
                [r * angle.cos(), r * angle.sin(), z]
            })
        };
        spiral(n).filter(|p| p[2] >= 0.0).chain(spiral(n / sparse).filter(|p| p[2] < 0.0)).collect()
    }

    #[test]
    fn points_scattered_in_space_are_strays_and_those_of_the_surface_are_not() {
        let mut rows = sphere(3_000, 1);
        let surface = rows.len();
        let at = |k: u64| 6.0 * jitter(k);
        rows.extend((0..150).map(|k| [at(3 * k), at(3 * k + 1), at(3 * k + 2)]));
        let found = found(&rows);
        assert!(found.iter().all(|&row| row >= surface), "{found:?}");
        // those within a few spacings of the sphere may pass for noise
        assert!(found.len() >= 140, "{}", found.len());
    }

    #[test]
    fn sparser_halves_and_poles_of_rings_are_no_strays() {
        for sparse in [1, 8, 16, 32] {
            assert_eq!(found(&sphere(4_000, sparse)), [0_usize; 0], "{sparse}");
        }
        let mut rings = vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
        for ring in 1..40 {
            for k in 0..80 {
                let (theta, phi) = (0.5 * f64::from(ring) / 20.0, f64::from(k) / 40.0);
                let ((s, z), (y, x)) =
                    ((theta * std::f64::consts::PI).sin_cos(), (phi * std::f64::consts::PI).sin_cos());
                rings.push([s * x, s * y, z]);
            }
        }
        assert_eq!(found(&rings), [0_usize; 0]);
    }
}
