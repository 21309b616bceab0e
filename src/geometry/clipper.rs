//! Clips one Voronoi cell after the other in the tangent spaces.

use super::frames::Frames;
use super::neighborhoods::{Neighbor, SearchTree};
use super::points::Points;
use super::polytope::{Corner, Polytope, Site, dot};

/// Nearest neighbors that define the local spacing.
pub(super) const SPACING_NEIGHBORS: usize = 16;

/// Corners farther than this many local spacings are not on the manifold: among Poisson-distributed points of a surface
/// one in 10⁸ is (the chance of an empty circumcircle of radius r at density ρ is `(1+πρr²)·exp(−πρr²)`).
const CORNER_RADIUS_MAX: f64 = 2.5;

/// Neighbors after which a cell is left as it is: on a manifold a hundred reach across the starting box, so that more
/// lie around points that fill more dimensions.
const CANDIDATES_MAX: usize = 2_000;

/// How neighbors are seen from a point's tangent space.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    /// Scale every projected neighbor back to its true distance.
    pub(super) isometric: bool,
    /// Neighbors steeper than this against the tangent space (sine of the angle) are left out.
    pub(super) steepness_max: f64,
    /// Of a point and its neighbor, whether the neighbor is left out.
    pub(super) leaves_out: Option<&'a (dyn Fn(usize, u32) -> bool + Sync)>,
}

/// Scratch memory of one thread.
pub(super) struct Clipper<'a, P> {
    points: &'a Points,
    tree: &'a SearchTree,
    frames: &'a Frames,
    view: View<'a>,
    polytope: P,
    candidates: Vec<Neighbor>,
    /// Largest distance of a corner that counts as on the manifold.
    limit: f64,
}

impl<'a, P: Default> Clipper<'a, P> {
    pub(super) fn new(points: &'a Points, tree: &'a SearchTree, frames: &'a Frames, view: View<'a>) -> Self {
        Self { points, tree, frames, view, polytope: P::default(), candidates: Vec::new(), limit: 0.0 }
    }
}

impl<P> Clipper<'_, P> {
    /// Makes the cell of point `i`, whose nearest neighbors are `nearest`.
    ///
    /// Only the nearest few neighbors can bound a cell (Lemma 1.4 of the supplement of [PBMHB]), so clipping by
    /// bisectors, nearest first, until the next neighbor is farther than twice the farthest corner gives the cell of
    /// the full diagram.
    pub(super) fn clip<const K: usize>(&mut self, i: usize, nearest: &[u32])
    where
        P: Polytope<K>,
    {
        let count = self.frames.reach(i, SPACING_NEIGHBORS).min(self.points.len() - 1);
        let reach = if let Some(&last) = nearest.get(count - 1) {
            self.points.squared_distance(i, last as usize)
        } else {
            self.tree.nearest(self.points, i, count, &mut self.candidates);
            self.candidates.last().map_or(0.0, |q| q.squared_distance)
        };
        self.limit = CORNER_RADIUS_MAX * spacing_within::<K>(reach, count);
        self.polytope.reset(self.limit);

        let mut closed = self.clip_by::<K>(i, nearest.iter().copied());
        let mut count = nearest.len();
        let most = CANDIDATES_MAX.min(self.points.len() - 1);
        while !closed && count < most {
            let seen = count;
            count = most.min(2 * count);
            let mut candidates = std::mem::take(&mut self.candidates);
            self.tree.nearest(self.points, i, count, &mut candidates);
            // the longer list begins with the shorter one
            closed = self.clip_by::<K>(i, candidates[seen..].iter().map(|q| q.index));
            self.candidates = candidates;
        }
    }

    /// Clips by `neighbors`, nearest first; true when no farther one can reach the cell.
    fn clip_by<const K: usize>(&mut self, i: usize, neighbors: impl Iterator<Item = u32>) -> bool
    where
        P: Polytope<K>,
    {
        let flattest = 1.0 - self.view.steepness_max * self.view.steepness_max;
        for neighbor in neighbors {
            let squared_distance = self.points.squared_distance(i, neighbor as usize);
            if squared_distance > 4.0 * self.polytope.squared_radius() {
                return true;
            }
            if self.view.leaves_out.is_some_and(|leaves_out| leaves_out(i, neighbor)) {
                continue;
            }
            let flat: [f64; K] = self.frames.project(self.points, i, neighbor as usize);
            let squared_flat = dot(&flat, &flat);
            if squared_flat == 0.0 || squared_flat < flattest * squared_distance {
                continue;
            }
            let scale = if self.view.isometric { (squared_distance / squared_flat).sqrt() } else { 1.0 };
            self.polytope.clip(Site { at: flat.map(|x| scale * x), neighbor });
        }
        false
    }

    /// The corners of the cell, on a surface counter-clockwise, each with whether it lies on the manifold.
    pub(super) fn corners<const K: usize>(&self) -> impl Iterator<Item = (Corner<K>, bool)>
    where
        P: Polytope<K>,
    {
        self.polytope.corners().map(|corner| {
            let near = dot(&corner.at, &corner.at) <= self.limit * self.limit;
            (corner, near && !corner.is_open())
        })
    }
}

/// Distance between points that are spread evenly, `count` of them within `radius`: the k-th root of the volume of
/// the ball over the count.
fn spacing_within<const K: usize>(squared_radius: f64, count: usize) -> f64 {
    let unit_ball = [2.0, std::f64::consts::PI, 4.0 / 3.0 * std::f64::consts::PI][K - 1];
    (unit_ball * squared_radius.powf(0.5 * K as f64) / count as f64).powf(1.0 / K as f64)
}
