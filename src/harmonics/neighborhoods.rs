//! Which points lie around which: the neighborhoods in which extrema are looked for.

use rayon::prelude::*;

use crate::cloud::PointCloud;
use crate::geometry::{GeometryError, Points, SearchTree};

/// Fewest neighbors: in sparse parts, where the ball holds less, the nearest are taken.
const NEIGHBORS_MIN: usize = 6;
/// Most neighbors: in dense parts, where the ball holds more, the nearest are taken.
const NEIGHBORS_MAX: usize = 48;

/// The points around every point that carries a result: those within a radius, at least the 6 and at most the 48
/// nearest. Distinct points only; rows without a result neither have neighbors nor are some.
#[derive(Debug, Clone)]
pub struct Neighborhoods {
    points: Points,
    radius: f64,
    offsets: Vec<usize>,
    neighbors: Vec<u32>,
}

impl Neighborhoods {
    /// Looks them up in a ball of `radius`, in units of the cloud. `mass` tells the rows that carry a result.
    ///
    /// # Errors
    /// [`GeometryError`] for a cloud that no analysis accepts.
    pub fn find(cloud: &PointCloud, mass: &[f64], radius: f64) -> Result<Self, GeometryError> {
        let points = Points::prepare(cloud, 1)?;
        let tree = SearchTree::new(&points);
        let is_used = |i: usize| !mass[points.row(i)].is_nan();
        let lists: Vec<Vec<u32>> = (0..points.len())
            .into_par_iter()
            .map_init(Vec::new, |found, i| {
                if !is_used(i) {
                    return Vec::new();
                }
                tree.within(&points, i, radius, found);
                if found.len() < NEIGHBORS_MIN {
                    tree.nearest(&points, i, NEIGHBORS_MIN, found);
                } else if found.len() > NEIGHBORS_MAX {
                    found.sort_by(|a, b| {
                        a.squared_distance.total_cmp(&b.squared_distance).then(a.index.cmp(&b.index))
                    });
                    found.truncate(NEIGHBORS_MAX);
                }
                found.iter().map(|q| q.index).filter(|&q| is_used(q as usize)).collect()
            })
            .collect();
        let mut offsets = vec![0];
        offsets.extend(lists.iter().scan(0, |end, list| {
            *end += list.len();
            Some(*end)
        }));
        Ok(Self { points, radius, offsets, neighbors: lists.concat() })
    }

    /// Number of distinct points.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // never empty
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// The radius of the ball, in units of the cloud.
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// The points around point `i`.
    #[must_use]
    pub fn of(&self, i: usize) -> &[u32] {
        &self.neighbors[self.offsets[i]..self.offsets[i + 1]]
    }

    /// Whether two points lie within the radius of each other.
    #[must_use]
    pub fn are_near(&self, i: usize, j: usize) -> bool {
        self.points.squared_distance(i, j) <= self.radius * self.radius
    }

    /// The row of the upload where point `i` occurs first.
    #[must_use]
    pub fn row(&self, i: usize) -> usize {
        self.points.row(i)
    }
}
