//! Which near points lie on the same sheet of the surface.

use crate::geometry::{Cells, Frames, Points};
use crate::operator::Sparse;

/// Tangent frames of one handedness, as far as the surface allows it.
///
/// A Euclidean ball reaches through thin parts to the opposite side, which couples what is not adjacent. There the
/// outward normals are opposite: with frames oriented alike along the surface, `det(T_iᵀT_j) < 0` tells. Comparing
/// unoriented normals, as is often done, cannot tell two parallel sheets apart.
#[derive(Debug, Clone)]
pub struct Sheets {
    frames: Frames,
    /// Whose handedness was turned around.
    flipped: Vec<bool>,
    /// Share of clearly comparable neighbour pairs whose handedness disagrees in spite of all: 0 on orientable, well
    /// sampled surfaces.
    pub conflicts: f64,
}

/// Neighbours whose planes are within 45° of each other can be compared reliably.
const COMPARABLE: f64 = 0.7;

/// Beyond this share of conflicts handedness means nothing (a Möbius band, a tangle): only the planes' angle counts.
const CONFLICTS_MAX: f64 = 0.01;

/// Planes more than 120° apart as oriented, or 60° when handedness means nothing, belong to different sheets.
const ORIENTED_MIN: f64 = 0.0;
const UNORIENTED_MIN: f64 = 0.5;

impl Sheets {
    /// Propagates handedness over the edges of common cell walls, best agreeing pairs first (the minimum spanning
    /// tree of Hoppe et al. 1992, by a union-find that carries the sign).
    #[must_use]
    pub fn orient(mut frames: Frames, cells: &Cells, walls: &Sparse) -> Self {
        let n = walls.rows();
        debug_assert_eq!(n, cells.volume.len());
        let mut edges: Vec<(f64, u32, u32)> = (0..n)
            .flat_map(|i| walls.neighbors(i).filter(move |&j| (i as u32) < j).map(move |j| (i as u32, j)))
            .map(|(i, j)| (frames.agreement(i as usize, j as usize), i, j))
            .collect();
        edges.sort_unstable_by(|a, b| b.0.abs().total_cmp(&a.0.abs()).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut sides = Sides::new(n);
        for &(agreement, i, j) in &edges {
            sides.join(i, j, agreement < 0.0);
        }
        let flipped: Vec<bool> = (0..n as u32).map(|i| sides.find(i).1).collect();
        for i in (0..n).filter(|&i| flipped[i]) {
            frames.flip(i);
        }
        let (mut comparable, mut conflicting) = (0_usize, 0_usize);
        for &(agreement, i, j) in &edges {
            if agreement.abs() > COMPARABLE {
                comparable += 1;
                conflicting += usize::from(frames.agreement(i as usize, j as usize) < 0.0);
            }
        }
        Self { frames, flipped, conflicts: conflicting as f64 / comparable.max(1) as f64 }
    }

    /// Whether handedness can be relied on.
    #[must_use]
    pub fn is_orientable(&self) -> bool {
        self.conflicts <= CONFLICTS_MAX
    }

    /// Whether two near points lie on the same sheet; symmetric.
    #[must_use]
    pub fn same(&self, i: usize, j: usize) -> bool {
        // the smaller index first, so that both directions compute the same bits
        let agreement = self.frames.agreement(i.min(j), i.max(j));
        if self.is_orientable() { agreement > ORIENTED_MIN } else { agreement.abs() > UNORIENTED_MIN }
    }

    /// The frames, oriented alike.
    #[must_use]
    pub fn frames(&self) -> &Frames {
        &self.frames
    }

    /// Coordinates of `q − p_i` in the tangent plane of point `i` as it was found, before it was oriented.
    #[must_use]
    pub fn seen_first(&self, points: &Points, i: usize, q: usize) -> [f64; 2] {
        // turning a frame around negates its first axis
        let [x, y] = self.frames.project(points, i, q);
        [if self.flipped[i] { -x } else { x }, y]
    }

    /// Whether the frames of two adjacent points as they were found, before they were oriented, differ in handedness.
    #[must_use]
    pub fn mirrored(&self, i: usize, j: usize) -> bool {
        let opposite = !self.is_orientable() && self.frames.agreement(i.min(j), i.max(j)) < 0.0;
        self.flipped[i] ^ self.flipped[j] ^ opposite
    }
}

/// Union-find whose members know on which of two sides they are relative to their root.
struct Sides {
    parent: Vec<u32>,
    flipped: Vec<bool>,
}

impl Sides {
    fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect(), flipped: vec![false; n] }
    }

    /// Root of `i`, and whether `i` is on the other side than its root.
    fn find(&mut self, i: u32) -> (u32, bool) {
        let (mut root, mut flipped) = (i, false);
        while self.parent[root as usize] != root {
            flipped ^= self.flipped[root as usize];
            root = self.parent[root as usize];
        }
        let (mut k, mut side) = (i, flipped);
        while self.parent[k as usize] != root && k != root {
            let (next, step) = (self.parent[k as usize], self.flipped[k as usize]);
            self.parent[k as usize] = root;
            self.flipped[k as usize] = side;
            side ^= step;
            k = next;
        }
        (root, flipped)
    }

    fn join(&mut self, i: u32, j: u32, opposite: bool) {
        let ((a, side_i), (b, side_j)) = (self.find(i), self.find(j));
        if a != b {
            let (leader, follower) = (a.min(b), a.max(b));
            self.parent[follower as usize] = leader;
            self.flipped[follower as usize] = side_i ^ side_j ^ opposite;
        }
    }
}
