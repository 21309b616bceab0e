//! How far apart the points lie around each of them: from this follows the size of its disc.

use rayon::prelude::*;

use crate::cloud::PointCloud;
use crate::geometry::{Points, SearchTree};

/// Neighbor whose distance is taken: in a surface the six nearest surround a point.
const NEIGHBORS: usize = 7;
/// Radius of a disc as a multiple of that distance: discs of neighbors overlap, gaps of scans stay open.
const RADIUS: f64 = 0.75;
/// Radius of a disc at most, as a multiple of the median of its neighbors': a stray point does not hide the surface.
const RADIUS_MOST: f64 = 2.0;
/// Points that one thread looks at together.
const BLOCK: usize = 1024;

/// The radius of every row's disc in units of the cloud; 0 for rows without a position. `None` for clouds of so few
/// points, or so close together, that there are no neighborhoods.
pub(super) fn radii(cloud: &PointCloud) -> Option<Vec<f32>> {
    let points = Points::prepare(cloud, 1).ok()?;
    let tree = SearchTree::new(&points);
    let count = NEIGHBORS.min(points.len() - 1);
    let mut nearest = vec![0_u32; points.len() * count];
    let mut own = vec![0.0_f64; points.len()];
    let blocks = nearest.par_chunks_mut(BLOCK * count).zip(own.par_chunks_mut(BLOCK));
    blocks.enumerate().for_each_init(Vec::new, |found, (block, (nearest, own))| {
        for (place, (slots, radius)) in nearest.chunks_mut(count).zip(own).enumerate() {
            tree.nearest(&points, block * BLOCK + place, count, found);
            for (slot, neighbor) in slots.iter_mut().zip(found.iter()) {
                *slot = neighbor.index;
            }
            *radius = RADIUS * found.last().map_or(0.0, |neighbor| neighbor.squared_distance.sqrt());
        }
    });
    let bounded = |i: usize| {
        let mut around: Vec<f64> = nearest[i * count..][..count].iter().map(|&j| own[j as usize]).collect();
        around.sort_unstable_by(f64::total_cmp);
        own[i].min(RADIUS_MOST * around[count / 2]) as f32
    };
    let of_points: Vec<f32> = (0..points.len()).into_par_iter().map(bounded).collect();
    Some((0..cloud.len()).map(|row| points.of_row(row).map_or(0.0, |point| of_points[point])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::NonFinite;

    /// A square grid of spacing `step` from `left` on.
    fn grid(left: f64, step: f64) -> impl Iterator<Item = f64> {
        (0..400).flat_map(move |i| [left + step * f64::from(i % 20), step * f64::from(i / 20), 0.0])
    }

    #[test]
    fn every_part_of_a_cloud_has_radii_of_its_own() {
        let points: Vec<f64> = grid(0.0, 0.01).chain(grid(10.0, 0.1)).collect();
        let radii = radii(&PointCloud::new(3, points, NonFinite::Reject).unwrap()).unwrap();
        // The seventh neighbor within a square grid is a diagonal one.
        let inner = 210;
        assert!((f64::from(radii[inner]) - RADIUS * 0.01 * 2_f64.sqrt()).abs() < 1e-8, "{}", radii[inner]);
        assert!((f64::from(radii[400 + inner]) - RADIUS * 0.1 * 2_f64.sqrt()).abs() < 1e-7);
    }

    #[test]
    fn a_stray_point_has_a_small_disc_and_a_row_without_position_none() {
        let points: Vec<f64> = grid(0.0, 0.01).chain([0.0, 0.0, 5.0, f64::NAN, 0.0, 0.0]).collect();
        let radii = radii(&PointCloud::new(3, points, NonFinite::Drop).unwrap()).unwrap();
        assert!(radii[400] < 0.06, "{}", radii[400]);
        assert_eq!(radii[401].to_bits(), 0.0_f32.to_bits());
    }
}
