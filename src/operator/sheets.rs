//! Which near points lie on the same sheet of the surface.

use crate::geometry::orientation::{Link, Orientation};
use crate::geometry::{Frames, Points};
use crate::operator::Sparse;
use crate::progress::{Canceled, Progress};

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
    /// Share of clearly comparable neighbor pairs whose handedness disagrees in spite of all: 0 on orientable, well
    /// sampled surfaces.
    pub conflicts: f64,
}

/// Beyond this share of conflicts handedness means nothing (a Möbius band, a tangle): only the planes' angle counts.
const CONFLICTS_MAX: f64 = 0.01;

/// Planes more than 120° apart as oriented, or 60° when handedness means nothing, belong to different sheets.
const ORIENTED_MIN: f64 = 0.0;
const UNORIENTED_MIN: f64 = 0.5;

impl Sheets {
    /// Orients frames along common cell walls.
    ///
    /// # Errors
    /// [`Canceled`].
    pub fn orient(frames: Frames, walls: &Sparse, progress: &Progress) -> Result<Self, Canceled> {
        let links: Vec<Link> = (0..walls.rows() as u32)
            .flat_map(|i| walls.neighbors(i as usize).filter(move |&j| i < j).map(move |j| [i, j]))
            .map(|ends| Link { ends, weight: 1.0 })
            .collect();
        let orientation = Orientation::find(&frames, walls.rows(), &links, progress)?;
        Ok(Self::oriented(frames, orientation))
    }

    /// Frames whose orientation is known.
    #[must_use]
    pub fn oriented(mut frames: Frames, orientation: Orientation) -> Self {
        let Orientation { flipped, conflicts } = orientation;
        for i in (0..flipped.len()).filter(|&i| flipped[i]) {
            frames.flip(i);
        }
        Self { frames, flipped, conflicts }
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
