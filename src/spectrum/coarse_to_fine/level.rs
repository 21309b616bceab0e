//! A coarse level: points, operator, and weights at the finer level's points.

use rayon::prelude::*;

use super::roots::Roots;
use super::weights::Weights;
use crate::cloud::{NonFinite, PointCloud};
use crate::geometry::survey::{Rules, Survey};
use crate::geometry::{GeometryError, NearestNeighbors, Points, SearchTree, frames};
use crate::operator::{LaplaceBeltrami, Sparse, voronoi};
use crate::progress::{Canceled, Progress};
use crate::spectrum::Problem;

/// Neighbors that planes and cells are made of.
const NEIGHBORS: usize = 20;

/// Components of fewer points are not thinned out.
const THINNED_MIN: usize = 2_000;

/// Components of so many points at all, beyond which a cloud is none that thins out.
const COMPONENTS_MAX: usize = 32;

/// A coarse sample.
pub(super) struct Level {
    /// Its finite-volume operator, scaled by the masses.
    pub(super) problem: Problem,
    /// Where its points are.
    pub(super) positions: Vec<[f64; 3]>,
    /// From its vectors to those of the finer level.
    pub(super) weights: Weights,
    /// Components that are connected on the finer level and not on this one, one less than they are in each.
    pub(super) apart: Vec<usize>,
}

/// The level above the points of `problem`, which are at `position` and coupled by `graph`, a narrow operator with
/// entries that are negative beside the diagonal; none where they do not make up a surface in space.
///
/// # Errors
/// [`Canceled`].
pub(super) fn coarser<'a>(
    problem: &Problem,
    graph: &Sparse,
    position: impl Fn(u32) -> &'a [f64] + Sync,
    first_eigenvalue: f64,
    progress: &Progress,
) -> Result<Option<Level>, Canceled> {
    let components = &problem.components;
    if components.size.len() > COMPONENTS_MAX {
        return Ok(None);
    }
    let label = |i: usize| components.label[i] as usize;
    let Roots { points: roots, mut owner } =
        Roots::of(graph, |i| components.size[label(i)] < THINNED_MIN, progress)?;
    let count = roots.len();
    let mut coarse = Pieces::with_room(count);
    let mut place = vec![0_u32; count];
    let mut positions = vec![[0.0; 3]; count];
    // surfaces that come near each other are triangulated apart
    for component in 0..components.size.len() {
        let own: Vec<usize> = (0..count).filter(|&r| label(roots[r] as usize) == component).collect();
        let at = |&r: &usize| position(roots[r]);
        let coordinates = own.iter().flat_map(at).copied().collect();
        let Some(points) = points_at(coordinates, progress)? else { return Ok(None) };
        for (row, root) in own.iter().enumerate() {
            let Some(point) = points.of_row(row) else { return Ok(None) };
            let point = coarse.mass.len() + point;
            place[*root] = point as u32;
            positions[point].copy_from_slice(at(root));
        }
        if !coarse.append(&points, progress)? {
            return Ok(None);
        }
    }
    let Pieces { rows, mass, planes } = coarse;
    let stiffness =
        Sparse::from_rows(count, || (), |i, (), row| row.extend_from_slice(&rows[i]), |_| Ok(()))?;
    drop(rows);
    let coarse = Problem::new(LaplaceBeltrami::narrow(stiffness, mass), first_eigenvalue, progress)?;
    if coarse.zero_modes() > COMPONENTS_MAX {
        return Ok(None);
    }
    progress.checkpoint()?;
    owner.par_iter_mut().with_min_len(1 << 14).for_each(|owner| *owner = place[*owner as usize]);
    let weights = Weights::fit(
        |i| position(i as u32),
        owner,
        &positions,
        &planes,
        &coarse.matrix,
        |i, c| problem.root_mass[i] / coarse.root_mass[c],
        progress,
    )?;
    // of every component here the first part there is the one that is not counted
    let part_of = |r: usize| coarse.components.label[place[r] as usize] as usize;
    let mut begun = vec![false; components.size.len()];
    let mut known = vec![false; coarse.zero_modes()];
    let mut apart = Vec::new();
    for r in 0..count {
        let whole = label(roots[r] as usize);
        if !std::mem::replace(&mut known[part_of(r)], true) && std::mem::replace(&mut begun[whole], true) {
            apart.push(part_of(r));
        }
    }
    Ok(Some(Level { problem: coarse, positions, weights, apart }))
}

/// Points of a surface in space; none where they do not span a plane.
fn points_at(coordinates: Vec<f64>, progress: &Progress) -> Result<Option<Points>, Canceled> {
    let Ok(cloud) = PointCloud::new(3, coordinates, NonFinite::Reject) else { return Ok(None) };
    match Points::prepare_by(&cloud, 2, progress) {
        Ok(points) => Ok(Some(points).filter(|points| points.len() == cloud.len())),
        Err(GeometryError::Canceled(canceled)) => Err(canceled),
        Err(_) => Ok(None),
    }
}

/// Finite volumes of several clouds, one after the other.
struct Pieces {
    /// Entries of the stiffness matrix, row by row.
    rows: Vec<Vec<(u32, f64)>>,
    mass: Vec<f64>,
    planes: Vec<[[f64; 3]; 2]>,
}

impl Pieces {
    fn with_room(points: usize) -> Self {
        let planes = Vec::with_capacity(points);
        Self { rows: Vec::with_capacity(points), mass: Vec::with_capacity(points), planes }
    }

    /// Triangulates and measures; false where that cannot be done.
    fn append(&mut self, points: &Points, progress: &Progress) -> Result<bool, Canceled> {
        match self.triangulate(points, progress) {
            Ok(()) => Ok(true),
            Err(GeometryError::Canceled(canceled)) => Err(canceled),
            Err(_) => Ok(false),
        }
    }

    fn triangulate(&mut self, points: &Points, progress: &Progress) -> Result<(), GeometryError> {
        let tree = SearchTree::new_by(points, progress)?;
        let nearest = NearestNeighbors::find(&tree, points, NEIGHBORS, progress)?;
        let frames = frames(points, &nearest, 2, progress)?;
        let survey = Survey { points, tree: &tree, nearest: &nearest, rules: Rules::default() };
        let surveyed = survey.triangulate(frames, true, progress)?;
        let cells = surveyed.stars.cells(points, progress)?;
        let walls = voronoi::stiffness(&cells, progress)?;
        let from = self.mass.len() as u32;
        for i in 0..points.len() {
            let (columns, values) = walls.row(i);
            self.rows.push(columns.iter().zip(values).map(|(&j, &value)| (from + j, value)).collect());
            let axis = |axis: usize| {
                let tangent = surveyed.frames.tangent(i, axis);
                [tangent[0], tangent[1], tangent[2]]
            };
            self.planes.push([axis(0), axis(1)]);
        }
        self.mass.extend(cells.volume);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::shapes::{SampleRequest, Shape, sample};
    use crate::spectrum::vectors::sparse_product::Matrix;

    #[test]
    fn a_spheres_coarse_level_is_the_sphere_and_a_second_one_stays_apart() {
        let sphere = sample(&SampleRequest::new(Shape::Sphere, 6_000)).unwrap();
        let both: Vec<f64> = sphere
            .coordinates()
            .chunks_exact(3)
            .flat_map(|p| [[p[0], p[1], p[2]], [p[0] + 2.02, p[1], p[2]]].concat())
            .collect();
        let points_at = |at: Vec<f64>| points_at(at, &Progress::new()).unwrap();
        let points = points_at(both).unwrap();
        let mut pieces = Pieces::with_room(12_000);
        let half = |right: bool| -> Points {
            let of = |p: &&[f64]| (p[0] > 0.0) == right;
            let all = points.coordinates().chunks_exact(3).filter(of);
            points_at(all.flatten().copied().collect()).unwrap()
        };
        let halves = [half(false), half(true)];
        let mut positions = Vec::new();
        for half in &halves {
            assert!(pieces.append(half, &Progress::new()).unwrap());
            let shift = if positions.is_empty() { -1.01 } else { 1.01 };
            positions.extend(half.coordinates().chunks_exact(3).map(|p| [p[0] + shift, p[1], p[2]]));
        }
        let Pieces { rows, mass, .. } = pieces;
        let all = |i: usize, (): &mut (), row: &mut Vec<(u32, f64)>| row.extend_from_slice(&rows[i]);
        let stiffness = Sparse::from_rows(12_000, || (), all, |_| Ok::<(), Canceled>(())).unwrap();
        let fine = Problem::new(LaplaceBeltrami::narrow(stiffness, mass), 2.0, &Progress::new()).unwrap();
        assert_eq!(fine.zero_modes(), 2);
        let at = |i: u32| &positions[i as usize][..];
        let level = coarser(&fine, &fine.matrix, at, 2.0, &Progress::new()).unwrap().unwrap();
        let coarse = &level.problem;
        assert!((1_200..1_700).contains(&coarse.size()), "{}", coarse.size());
        assert_eq!((coarse.zero_modes(), level.apart.len()), (2, 0));
        let area = |problem: &Problem| problem.root_mass.iter().map(|m| m * m).sum::<f64>();
        assert!((area(coarse) / area(&fine) - 1.0).abs() < 0.01);
        // x y on each sphere is an eigenfunction: what the weights make of it is nearly what it is there
        let function = |at: &[f64; 3]| (at[0].abs() - 1.01) * at[1];
        for (i, at) in positions.iter().enumerate() {
            let rows = &level.weights;
            let (columns, values) = rows.row(i);
            let of = |(&c, &weight): (&u32, &f32)| {
                let c = c as usize;
                f64::from(weight) * coarse.root_mass[c] * function(&level.positions[c])
            };
            let value: f64 = columns.iter().zip(values).map(of).sum();
            let exact = fine.root_mass[i] * function(at);
            assert!((value - exact).abs() < 0.01 * fine.root_mass[i], "{i}: {value} {exact}");
        }
    }
}
