//! Nearest-neighbor and ball queries.
//!
//! Ties are broken by (distance, index), so that an answer does not depend on the tree's layout.

use std::num::NonZeroUsize;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::points::{GeometryError, Points};
use crate::progress::{Canceled, Progress};

/// Points handled between two looks at the progress.
const BATCH: usize = 16_384;

/// Relative difference up to which the tree's rounding may order two squared distances either way.
const TIE: f64 = 1e-12;

/// A k-d tree over [`Points`].
///
/// The tree's dimension is fixed at compile time; points of other dimensions are padded with zeros, which leaves all
/// distances as they are. Three trees in the place of eight keep the program small.
pub struct SearchTree(Tree);

enum Tree {
    D3(Box<ImmutableKdTree<f64, 3>>),
    D4(Box<ImmutableKdTree<f64, 4>>),
    D8(Box<ImmutableKdTree<f64, 8>>),
}

/// A point, followed by zeros.
fn padded<const D: usize>(p: &[f64]) -> [f64; D] {
    std::array::from_fn(|axis| p.get(axis).copied().unwrap_or(0.0))
}

fn build<const D: usize>(
    points: &Points,
    progress: &Progress,
) -> Result<Box<ImmutableKdTree<f64, D>>, Canceled> {
    let rows: Vec<[f64; D]> = (0..points.len()).into_par_iter().map(|i| padded(points.point(i))).collect();
    let built = progress.leaving(|leave| {
        let coordinate = |row: &[f64; D], axis: usize| {
            leave.if_canceled();
            row[axis]
        };
        ImmutableKdTree::builder().build_from_source(&rows, coordinate, |i, _| i as u32)
    })?;
    #[allow(clippy::expect_used)] // fails only for trees that change
    Ok(Box::new(built.expect("a tree of points")))
}

fn nearest<const D: usize>(
    tree: &ImmutableKdTree<f64, D>,
    p: &[f64],
    count: NonZeroUsize,
    out: &mut Vec<Neighbor>,
) {
    let found = tree.query(&padded(p)).nearest_n::<SquaredEuclidean<f64>>(count).execute();
    out.extend(found.iter().map(|q| Neighbor { squared_distance: q.distance, index: q.item }));
}

fn within<const D: usize>(
    tree: &ImmutableKdTree<f64, D>,
    p: &[f64],
    squared_radius: f64,
    out: &mut Vec<Neighbor>,
) {
    let found = tree.query(&padded(p)).within::<SquaredEuclidean<f64>>(squared_radius).unsorted().execute();
    out.extend(found.iter().map(|q| Neighbor { squared_distance: q.distance, index: q.item }));
}

/// A point near another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Squared Euclidean distance.
    pub squared_distance: f64,
    /// Index of the point.
    pub index: u32,
}

macro_rules! dispatch {
    ($tree:expr, $call:ident ( $($argument:expr),* )) => {
        match $tree {
            Tree::D3(tree) => $call(tree, $($argument),*),
            Tree::D4(tree) => $call(tree, $($argument),*),
            Tree::D8(tree) => $call(tree, $($argument),*),
        }
    };
}

impl SearchTree {
    /// Builds the tree; `points` must have 1 to 8 coordinates, as [`Points::prepare`] makes sure.
    #[must_use]
    pub fn new(points: &Points) -> Self {
        #[allow(clippy::expect_used)]
        Self::new_by(points, &Progress::new()).expect("nobody cancels")
    }

    /// The same, as long as nobody cancels it.
    ///
    /// # Errors
    /// [`Canceled`].
    pub fn new_by(points: &Points, progress: &Progress) -> Result<Self, Canceled> {
        Ok(Self(match points.dimension() {
            1..=3 => Tree::D3(build(points, progress)?),
            4 => Tree::D4(build(points, progress)?),
            _ => Tree::D8(build(points, progress)?),
        }))
    }

    /// The `count` points nearest to point `i`, itself left out, nearest first; of points at equal distances the first
    /// by index, so that a longer list begins with the shorter one.
    pub fn nearest(&self, points: &Points, i: usize, count: usize, out: &mut Vec<Neighbor>) {
        out.clear();
        let count = count.min(points.len() - 1);
        // one more for the point itself, and one beyond the last
        let wanted = NonZeroUsize::MIN.saturating_add((count + 1).min(points.len() - 1));
        dispatch!(&self.0, nearest(points.point(i), wanted, out));
        finish(points, i, out);
        if let Some(beyond) = out.get(count)
            && let Some(last) = count.checked_sub(1).map(|last| out[last])
            && beyond.squared_distance <= last.squared_distance * (1.0 + TIE)
        {
            // the tree cuts a tie where its layout does
            out.clear();
            let reach = last.squared_distance * (1.0 + 2.0 * TIE);
            dispatch!(&self.0, within(points.point(i), reach, out));
            finish(points, i, out);
        }
        out.truncate(count);
    }

    /// All points within `radius` of point `i`, itself left out, by index.
    pub fn within(&self, points: &Points, i: usize, radius: f64, out: &mut Vec<Neighbor>) {
        out.clear();
        // a little wider, then cut by the distance that both ends of a pair compute alike
        dispatch!(&self.0, within(points.point(i), radius * radius * (1.0 + 1e-12), out));
        for q in out.iter_mut() {
            q.squared_distance = points.squared_distance(i, q.index as usize);
        }
        out.retain(|q| q.index as usize != i && q.squared_distance <= radius * radius);
        out.sort_unstable_by_key(|q| q.index);
    }
}

fn finish(points: &Points, i: usize, out: &mut Vec<Neighbor>) {
    out.retain(|q| q.index as usize != i);
    for q in out.iter_mut() {
        q.squared_distance = points.squared_distance(i, q.index as usize);
    }
    out.sort_unstable_by(|a, b| {
        a.squared_distance.total_cmp(&b.squared_distance).then(a.index.cmp(&b.index))
    });
}

/// The same number of nearest neighbors for every point.
#[derive(Debug, Clone)]
pub struct NearestNeighbors {
    count: usize,
    indices: Vec<u32>,
}

impl NearestNeighbors {
    /// Finds the `count` nearest neighbors of every point (fewer when there are not as many points).
    ///
    /// # Errors
    /// [`GeometryError::Canceled`].
    pub fn find(
        tree: &SearchTree,
        points: &Points,
        count: usize,
        progress: &Progress,
    ) -> Result<Self, GeometryError> {
        let count = count.min(points.len() - 1);
        let mut indices = vec![0; points.len() * count];
        let batches = points.len().div_ceil(BATCH);
        for (batch, rows) in indices.chunks_mut(BATCH * count).enumerate() {
            progress.advance(0.7 * batch as f64 / batches as f64)?;
            rows.par_chunks_mut(256 * count).enumerate().for_each_init(Vec::new, |out, (block, rows)| {
                for (row, slots) in rows.chunks_mut(count).enumerate() {
                    tree.nearest(points, batch * BATCH + block * 256 + row, count, out);
                    for (slot, neighbor) in slots.iter_mut().zip(out.iter()) {
                        *slot = neighbor.index;
                    }
                }
            });
        }
        Ok(Self { count, indices })
    }

    /// Neighbors of point `i`, nearest first.
    #[must_use]
    pub fn of(&self, i: usize) -> &[u32] {
        &self.indices[i * self.count..(i + 1) * self.count]
    }

    /// Neighbors per point.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{NonFinite, PointCloud};
    use crate::geometry::stars::tests::jitter;

    #[test]
    fn a_tree_is_left_in_the_middle_of_its_build() {
        for dimension in [3, 4, 8] {
            let coordinates = (0..5_000 * dimension as u64).map(jitter).collect();
            let cloud = PointCloud::new(dimension, coordinates, NonFinite::Reject).unwrap();
            let points = Points::distinct(&cloud);
            // every point is looked at a few times
            let built = SearchTree::new_by(&points, &Progress::canceled_after(4_000));
            assert_eq!(built.err(), Some(Canceled), "{dimension}");
        }
    }
}
