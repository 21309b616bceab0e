//! Stars: the Delaunay triangles around every point of a surface.
//!
//! Every point sees its neighbors in its own tangent plane and triangulates them there; which triangles there are is
//! decided by that view, how large they are by their true sides. A view bends the surface only around its own point,
//! so that points on both sides of a crease agree on the triangles between them, and areas and cotangents are those
//! of a mesh through the points.

use rayon::prelude::*;

use super::cells::{Cell, CellKind, Cells, gather};
use super::clipper::{Clipper, View};
use super::frames::Frames;
use super::metric::TriangleMetric;
use super::neighborhoods::{NearestNeighbors, SearchTree};
use super::orientation::Link;
use super::points::{GeometryError, Points};
use super::polytope::{BOX, Polygon};
use crate::progress::Progress;

/// Neighbors steeper than this against the tangent plane (sine of the angle) belong to another sheet. The faces of a
/// cube are inclined by asin 0.816 against the plane at its corner.
const STEEPNESS_MAX: f64 = 0.9;

/// Weight of a link on which no triangle is agreed about.
const LINK_WEIGHT_MIN: f64 = 0.05;

/// Points handled between two looks at the progress.
const BATCH: usize = 16_384;

/// A neighbor in a star.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Spoke {
    /// Index of the neighbor.
    pub neighbor: u32,
    /// Whether the triangle of the point, this neighbor and the next one lies on the surface.
    pub filled: bool,
}

/// The neighbors around every point of a surface, counter-clockwise in its frame, with the triangles between them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stars {
    offsets: Vec<usize>,
    spokes: Vec<Spoke>,
}

impl Stars {
    /// Triangulates around every point; `frames` must be tangent planes.
    ///
    /// # Errors
    /// [`GeometryError::Canceled`].
    pub fn find(
        points: &Points,
        tree: &SearchTree,
        nearest: &NearestNeighbors,
        frames: &Frames,
        sheet_aware: bool,
        progress: &Progress,
    ) -> Result<Self, GeometryError> {
        let n = points.len();
        let view = Self::view(sheet_aware);
        let mut stars = Self { offsets: Vec::with_capacity(n + 1), spokes: Vec::with_capacity(7 * n) };
        stars.offsets.push(0);
        for start in (0..n).step_by(BATCH) {
            progress.advance(start as f64 / n as f64)?;
            let clipper = || Clipper::<Polygon>::new(points, tree, frames, view);
            let batch: Vec<Vec<Spoke>> = (start..n.min(start + BATCH))
                .into_par_iter()
                .with_min_len(256)
                .map_init(clipper, |clipper, i| {
                    if progress.is_canceled() {
                        return Vec::new();
                    }
                    clipper.clip::<2>(i, nearest.of(i));
                    spokes(clipper)
                })
                .collect();
            progress.checkpoint()?;
            for spokes in batch {
                stars.push(&spokes);
            }
        }
        Ok(stars)
    }

    fn view<'a>(sheet_aware: bool) -> View<'a> {
        let steepness_max = if sheet_aware { STEEPNESS_MAX } else { 1.0 };
        View { isometric: true, steepness_max, leaves_out: None }
    }

    /// The stars with those of `again` triangulated anew in their `frames`, without the neighbors that `leaves_out` names
    /// for a point. The star of a point is replaced only where `accept(point, new)`.
    ///
    /// # Errors
    /// [`GeometryError::Canceled`].
    #[allow(clippy::too_many_arguments)] // what the clipper needs, and which stars
    pub fn found_again(
        &self,
        points: &Points,
        tree: &SearchTree,
        nearest: &NearestNeighbors,
        frames: &Frames,
        leaves_out: &(dyn Fn(usize, u32) -> bool + Sync),
        again: &[bool],
        accept: impl Fn(usize, &[Spoke]) -> bool + Sync + Send,
        progress: &Progress,
    ) -> Result<Self, GeometryError> {
        let which: Vec<usize> = (0..self.len()).filter(|&i| again[i]).collect();
        let view = View { leaves_out: Some(leaves_out), ..Self::view(true) };
        let found: Vec<Vec<Spoke>> = which
            .par_iter()
            .with_min_len(64)
            .map_init(
                || Clipper::<Polygon>::new(points, tree, frames, view),
                |clipper, &i| {
                    if progress.is_canceled() {
                        return Vec::new();
                    }
                    clipper.clip::<2>(i, nearest.of(i));
                    let star = spokes(clipper);
                    if accept(i, &star) { star } else { self.of(i).to_vec() }
                },
            )
            .collect();
        progress.checkpoint()?;
        let mut stars = Self {
            offsets: Vec::with_capacity(self.offsets.len()),
            spokes: Vec::with_capacity(self.spokes.len()),
        };
        stars.offsets.push(0);
        let mut found = which.into_iter().zip(found).peekable();
        for i in 0..self.len() {
            match found.next_if(|(next, _)| *next == i) {
                Some((_, star)) => stars.push(&star),
                None => stars.push(self.of(i)),
            }
        }
        Ok(stars)
    }

    /// Every link of two points with its weight: one twentieth, and 1 for each triangle on it that all three corners see.
    ///
    /// # Errors
    /// [`GeometryError::Canceled`].
    pub fn links(&self, progress: &Progress) -> Result<Vec<Link>, GeometryError> {
        let of_point = |i: usize| {
            let count = self.of(i).len();
            let agreed = move |k: usize| self.of(i)[k].filled && self.is_agreed(i, k);
            (0..count).filter_map(move |k| {
                let q = self.of(i)[k].neighbor;
                let both = usize::from(agreed(k)) + usize::from(agreed((k + count - 1) % count));
                // the other end names the link where it sees it too
                let named = (i as u32) < q || !self.sees(q as usize, i as u32);
                named.then(|| Link {
                    ends: [q.min(i as u32), q.max(i as u32)],
                    weight: LINK_WEIGHT_MIN + both as f64,
                })
            })
        };
        // by Euler's formula about three a point
        let mut links: Vec<Link> = Vec::with_capacity(self.spokes.len() / 2);
        for start in (0..self.len()).step_by(BATCH) {
            progress.checkpoint()?;
            let batch: Vec<Link> = (start..self.len().min(start + BATCH))
                .into_par_iter()
                .with_min_len(256)
                .flat_map_iter(of_point)
                .collect();
            links.extend(batch);
        }
        progress.leaving(|leave| {
            links.par_sort_unstable_by_key(|link| {
                leave.if_canceled();
                link.ends
            });
        })?;
        Ok(links)
    }

    fn sees(&self, i: usize, q: u32) -> bool {
        self.of(i).iter().any(|spoke| spoke.neighbor == q)
    }

    /// Whether the other two corners of the triangle behind spoke `k` of point `i` have it in their stars too.
    #[must_use]
    pub fn is_agreed(&self, i: usize, k: usize) -> bool {
        self.is_seen_by_others(self.triangle(i, k))
    }

    /// Whether the second and third corner of a triangle have it in their stars.
    pub(super) fn is_seen_by_others(&self, [i, q, r]: [u32; 3]) -> bool {
        self.place(q as usize, [i, r]).is_some() && self.place(r as usize, [i, q]).is_some()
    }

    /// The spoke of point `i` behind which the triangle with `others` lies, if it does.
    pub(super) fn place(&self, i: usize, others: [u32; 2]) -> Option<usize> {
        (0..self.of(i).len()).find(|&k| {
            let [_, q, r] = self.triangle(i, k);
            self.of(i)[k].filled && ([q, r] == others || [r, q] == others)
        })
    }

    /// Stars from their spokes.
    #[must_use]
    pub fn from_spokes(all: &[Vec<Spoke>]) -> Self {
        let mut stars = Self { offsets: vec![0], spokes: Vec::new() };
        for spokes in all {
            stars.push(spokes);
        }
        stars
    }

    fn push(&mut self, spokes: &[Spoke]) {
        debug_assert!(
            (1..spokes.len())
                .all(|k| spokes[..k].iter().all(|earlier| earlier.neighbor != spokes[k].neighbor)),
            "a neighbor twice in a star: {spokes:?}"
        );
        self.spokes.extend_from_slice(spokes);
        self.offsets.push(self.spokes.len());
    }

    /// Number of points.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // a cloud has points
    pub fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// The star of point `i`.
    #[must_use]
    pub fn of(&self, i: usize) -> &[Spoke] {
        &self.spokes[self.offsets[i]..self.offsets[i + 1]]
    }

    /// Where the star of each point begins among all spokes, and where the last one ends.
    #[must_use]
    pub fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// The triangle between spoke `k` of point `i` and the next spoke.
    #[must_use]
    pub fn triangle(&self, i: usize, k: usize) -> [u32; 3] {
        let star = self.of(i);
        [i as u32, star[k].neighbor, star[(k + 1) % star.len()].neighbor]
    }

    /// The triangles on the surface around point `i`, which is the first corner of each.
    pub fn triangles(&self, i: usize) -> impl Iterator<Item = [u32; 3]> {
        self.of(i).iter().enumerate().filter(|(_, spoke)| spoke.filled).map(move |(k, _)| self.triangle(i, k))
    }

    /// Puts the triangle behind spoke `k` of point `i` into its star.
    pub(super) fn fill(&mut self, i: usize, k: usize) {
        self.spokes[self.offsets[i] + k].filled = true;
    }

    /// Takes the triangle behind spoke `k` of point `i` out of its star.
    pub(super) fn empty(&mut self, i: usize, k: usize) {
        self.spokes[self.offsets[i] + k].filled = false;
    }

    /// Drops the spokes that no triangle touches.
    pub(super) fn trim(&mut self) {
        let (mut from, mut to) = (0, 0);
        let mut star: Vec<Spoke> = Vec::new();
        for i in 0..self.len() {
            let end = self.offsets[i + 1];
            star.clear();
            star.extend_from_slice(&self.spokes[from..end]);
            let before = |k: usize| star[(k + star.len() - 1) % star.len()].filled;
            for k in (0..star.len()).filter(|&k| star[k].filled || before(k)) {
                self.spokes[to] = star[k];
                to += 1;
            }
            self.offsets[i + 1] = to;
            from = end;
        }
        self.spokes.truncate(to);
    }

    /// A third of the area of all triangles of all stars: the area of the surface where corners agree.
    ///
    /// # Errors
    /// [`GeometryError::Canceled`].
    pub fn area(&self, points: &Points, progress: &Progress) -> Result<f64, GeometryError> {
        let of_star = |i: usize| -> f64 {
            self.triangles(i).map(|corners| TriangleMetric::of(points, corners).area()).sum()
        };
        let mut sum = 0.0;
        for start in (0..self.len()).step_by(BATCH) {
            progress.checkpoint()?;
            let stars = start..self.len().min(start + BATCH);
            let areas: Vec<f64> = stars.into_par_iter().with_min_len(256).map(of_star).collect();
            // one after the other, whatever the batches and threads
            for area in areas {
                sum += area;
            }
        }
        Ok(sum / 3.0)
    }

    /// Voronoi cells made of the triangles: areas between circumcenters (mixed areas around an open star), and half
    /// the sum of the cotangents that face a spoke as its conductance.
    ///
    /// # Errors
    /// [`GeometryError::Canceled`].
    pub fn cells(&self, points: &Points, progress: &Progress) -> Result<Cells, GeometryError> {
        let mut all = Vec::with_capacity(self.len());
        for start in (0..self.len()).step_by(BATCH) {
            progress.checkpoint()?;
            let stars = start..self.len().min(start + BATCH);
            all.par_extend(stars.into_par_iter().with_min_len(256).map(|i| self.cell(points, i)));
        }
        Ok(gather(all))
    }

    fn cell(&self, points: &Points, i: usize) -> Cell {
        let star = self.of(i);
        let (mut voronoi, mut mixed, mut radius) = (0.0, 0.0, 0.0_f64);
        let mut conductance: Vec<(u32, f64)> = star.iter().map(|spoke| (spoke.neighbor, 0.0)).collect();
        for k in (0..star.len()).filter(|&k| star[k].filled) {
            let triangle = TriangleMetric::of(points, self.triangle(i, k));
            if !triangle.circumradius().is_finite() {
                continue;
            }
            radius = radius.max(triangle.circumradius());
            voronoi += triangle.voronoi_area(0);
            mixed += triangle.mixed_area(0);
            conductance[k].1 += 0.5 * triangle.cotangent(2);
            conductance[(k + 1) % star.len()].1 += 0.5 * triangle.cotangent(1);
        }
        conductance.sort_unstable_by_key(|&(q, _)| q);
        let closed = star.iter().all(|spoke| spoke.filled) && !star.is_empty();
        if mixed <= 0.0 {
            return Cell { volume: 0.0, radius: 0.0, kind: CellKind::Invalid, conductance };
        }
        let (volume, kind) = match closed {
            true if voronoi > 0.0 => (voronoi, CellKind::Closed),
            true => (mixed, CellKind::Closed),
            false => (mixed, CellKind::Rim),
        };
        Cell { volume, radius, kind, conductance }
    }
}

/// The spokes of a clipped cell: every edge of it belongs to a neighbor, every corner to a triangle.
fn spokes(clipper: &Clipper<'_, Polygon>) -> Vec<Spoke> {
    clipper
        .corners::<2>()
        .filter(|(corner, _)| corner.sites[0].neighbor != BOX)
        .map(|(corner, filled)| Spoke { neighbor: corner.sites[0].neighbor, filled })
        .collect()
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // exact by construction
pub(crate) mod tests {
    use super::*;
    use crate::cloud::{NonFinite, PointCloud};
    use crate::geometry::frames;
    use crate::geometry::survey::{Rules, Survey};

    /// The points and stars of a surface in space, gaps opened.
    pub(crate) fn stars_of(rows: &[[f64; 3]]) -> (Points, Frames, Stars) {
        let cloud = PointCloud::new(3, rows.concat(), NonFinite::Reject).unwrap();
        let points = Points::prepare(&cloud, 2).unwrap();
        let (tree, progress) = (SearchTree::new(&points), Progress::new());
        let nearest = NearestNeighbors::find(&tree, &points, 20, &progress).unwrap();
        let frames = frames(&points, &nearest, 2, &progress).unwrap();
        let survey = Survey { points: &points, tree: &tree, nearest: &nearest, rules: Rules::default() };
        let surveyed = survey.triangulate(frames, true, &progress).unwrap();
        (points, surveyed.frames, surveyed.stars)
    }

    /// A number between -0.5 and 0.5 from a hash.
    pub(crate) fn jitter(seed: u64) -> f64 {
        let z = seed.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((z ^ (z >> 27)) >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    }

    /// The six faces of a cube of `cells³` unit cubes, points inside the faces moved within them by up to `share/2`.
    fn cube(cells: i32, share: f64) -> Vec<[f64; 3]> {
        let on_face = |p: &[i32; 3]| p.iter().any(|&x| x == 0 || x == cells);
        (0..(cells + 1).pow(3))
            .map(|i| [i % (cells + 1), i / (cells + 1) % (cells + 1), i / (cells + 1).pow(2)])
            .filter(on_face)
            .enumerate()
            .map(|(row, p)| {
                std::array::from_fn(|axis| {
                    let free = p[axis] > 0 && p[axis] < cells;
                    let moved = if free { share * jitter((3 * row + axis) as u64) } else { 0.0 };
                    f64::from(p[axis]) + moved
                })
            })
            .collect()
    }

    #[test]
    fn the_cells_of_a_cube_sampled_irregularly_cover_its_six_faces() {
        for (share, open) in [(0.0, 0), (0.5, 6)] {
            let (points, _, stars) = stars_of(&cube(10, share));
            let cells = stars.cells(&points, &Progress::new()).unwrap();
            assert!(cells.count(CellKind::Rim) <= open && cells.count(CellKind::Invalid) == 0, "{share}");
            let area: f64 = cells.volume.iter().sum();
            assert!((area / 600.0 - 1.0).abs() < 0.005, "{share}: {area}");
        }
    }

    #[test]
    fn on_a_lattice_cells_are_squares_and_end_at_the_rim() {
        let rows: Vec<[f64; 3]> = (0..64).map(|i| [f64::from(i % 8), f64::from(i / 8), 0.0]).collect();
        let (points, _, stars) = stars_of(&rows);
        let cells = stars.cells(&points, &Progress::new()).unwrap();
        for (row, [x, y, _]) in rows.iter().enumerate() {
            let i = points.of_row(row).unwrap();
            let ends = [x, y].into_iter().filter(|&&at| at == 0.0 || at == 7.0).count();
            assert!((cells.volume[i] - 0.5_f64.powf(ends as f64)).abs() < 1e-12);
            assert_eq!(cells.kind[i], if ends == 0 { CellKind::Closed } else { CellKind::Rim });
            // a wall of length 1 over the distance 1, along the rim half of it
            let along: f64 = cells.conductance[i].iter().map(|(_, w)| w).sum();
            assert!((along - [4.0, 2.0, 1.0][ends]).abs() < 1e-12, "{along}");
        }
    }
}
