//! Points that stand for their neighbors.

use crate::operator::Sparse;
use crate::progress::{Canceled, Progress};

/// Points handled between two looks at the progress.
const BATCH: usize = 1 << 17;

/// No root yet.
const NONE: u32 = u32::MAX;

/// Roots, ascending, no two of which have a common neighbor, and for every point the root that stands for it.
pub(super) struct Roots {
    pub(super) points: Vec<u32>,
    /// Which of `points`.
    pub(super) owner: Vec<u32>,
}

impl Roots {
    /// Takes every point of which neither it nor a neighbor has a root yet, in the order of the points: on a surface about
    /// every ninth, evenly spread even where the points are not. Points for which `stays` all stand for themselves.
    ///
    /// # Errors
    /// [`Canceled`].
    pub(super) fn of(
        graph: &Sparse,
        stays: impl Fn(usize) -> bool,
        progress: &Progress,
    ) -> Result<Self, Canceled> {
        let n = graph.rows();
        let mut owner = vec![NONE; n];
        let mut points = Vec::with_capacity(n / 8);
        for i in 0..n {
            if i.is_multiple_of(BATCH) {
                progress.checkpoint()?;
            }
            let free = |j: u32| owner[j as usize] == NONE;
            if stays(i) || (free(i as u32) && graph.neighbors(i).all(free)) {
                let root = points.len() as u32;
                owner[i] = root;
                if !stays(i) {
                    graph.neighbors(i).for_each(|j| owner[j as usize] = root);
                }
                points.push(i as u32);
            }
        }
        // the others join the neighbor that they are coupled to most: entries beside the diagonal are negative
        let first = owner.clone();
        for i in 0..n {
            if i.is_multiple_of(BATCH) {
                progress.checkpoint()?;
            }
            if first[i] != NONE {
                continue;
            }
            let (columns, values) = graph.row(i);
            let owned = columns.iter().zip(values).filter(|(j, _)| first[**j as usize] != NONE);
            owner[i] = owned.min_by(|a, b| a.1.total_cmp(b.1)).map_or_else(
                || {
                    points.push(i as u32);
                    points.len() as u32 - 1
                },
                |(&j, _)| first[j as usize],
            );
        }
        Ok(Self { points, owner })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::grid::grid;

    #[test]
    fn roots_have_no_common_neighbor_and_stand_for_all_points_near_them() {
        let graph = grid(40).matrix;
        let stays = |i: usize| i < 3;
        let roots = Roots::of(&graph, stays, &Progress::new()).unwrap();
        assert!((1_600 / 7..1_600 / 4).contains(&roots.points.len()), "{}", roots.points.len());
        for (k, &root) in roots.points.iter().enumerate() {
            assert_eq!(roots.owner[root as usize] as usize, k);
        }
        let is_root = |j: u32| !stays(j as usize) && roots.points.contains(&j);
        for i in 4..1_600 {
            assert!(graph.row(i).0.iter().filter(|&&j| is_root(j)).count() <= 1);
            let root = roots.points[roots.owner[i] as usize];
            let near =
                graph.neighbors(i).any(|j| j == root || graph.neighbors(j as usize).any(|k| k == root));
            assert!(near || root as usize == i);
        }
    }
}
