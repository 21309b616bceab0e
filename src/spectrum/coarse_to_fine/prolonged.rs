//! More points than can be solved on: eigenvectors of a thinned sample, brought to all points.
//!
//! The sample is every ninth point or fewer, evenly spread over the surface. Its eigenvectors come to the other points along
//! the surface with quadratic weights: with linear ones the values are some per cent off however many points there are
//! (60,000 from 6,800: 2.8 % against 0.16 %). A correction by sweeps and the sample's factor, and a Rayleigh–Ritz step
//! with the full operator, make of an error of O(h²) in the vectors one of O(h⁴) in the values. No factor of the full
//! operator is made, and vectors are held in single precision, where there is no room for them in a file: what that leaves of
//! residuals in the 2-norm grows with the number of points, so that these results are judged by the dual norm.

use super::ascent::Start;
use super::level::coarser;
use super::two_grid::TwoGrid;
use super::{SHIFT_SHARE, symbolic_of};
use crate::progress::{Phase, Progress};
use crate::spectrum::certificates::{Certificates, MissedCheck};
use crate::spectrum::dual::bounds_of_group;
use crate::spectrum::ritz::change_beside;
use crate::spectrum::shifted_system::{HELD, Room, System, width};
use crate::spectrum::solution::{Method, Request, Solution, Vectors, saturation};
use crate::spectrum::vectors::Groups;
use crate::spectrum::vectors::block::Block;
use crate::spectrum::vectors::shelf::Shelf;
use crate::spectrum::vectors::single::{Scaled, gram_pair, replace_by_product, residual};
use crate::spectrum::vectors::sparse_product::{Finish, finished_product};
use crate::spectrum::weyl::Weyl;
use crate::spectrum::{Problem, SpectrumError};

/// Fewest points of a sample, as a multiple of the pairs that are asked of it.
const POINTS_PER_PAIR: usize = 12;

/// Pairs brought along beside the wanted ones: they keep what follows the last of these out of it.
pub const GUARDS: usize = 8;

/// Bytes per point of what is held beside the bases while they are brought to all points, groups of vectors apart: the factor of
/// the sample, the transposed weights, and the matrix in single precision.
pub const BESIDE_BYTES: u64 = 230;
/// The same beside the longer rows of a kernel, in addition.
pub const BESIDE_KERNEL_BYTES: u64 = 180;

/// Corrections at most, and the largest ρ, by what the correction finds, that one is enough for: it takes that of smooth
/// surfaces to a tenth, and of scans of which the sample lacks what is small to a third.
const CORRECTIONS_MAX: usize = 3;
const CORRECTED_ONCE: f64 = 0.01;

/// Steps of a correction at most, and the share of what all took that is not worth another: the first takes nearly all but at
/// rims. The last vectors need the most, and the others take no more than they.
const STEPS_MAX: usize = 4;
const GAIN_MIN: f64 = 0.02;

/// A problem on a thinned sample.
pub(in crate::spectrum) struct Sample<'a> {
    /// Its finite volumes.
    pub(in crate::spectrum) problem: &'a Problem,
    /// Where its points are.
    pub(in crate::spectrum) positions: &'a [[f64; 3]],
    /// How many pairs are asked of it.
    pub(in crate::spectrum) count: usize,
    /// Where they are expected.
    pub(in crate::spectrum) weyl: Weyl,
}

/// The smallest eigenpairs by those of a thinned sample, which `solve_sample` solves; none where the points are no surface
/// that can be thinned out.
///
/// # Errors
/// [`SpectrumError`].
pub(in crate::spectrum) fn solve<'a, P: Fn(u32) -> &'a [f64] + Sync>(
    problem: &Problem,
    request: &Request<'_, P>,
    solve_sample: &dyn Fn(Sample<'_>) -> Result<Solution, SpectrumError>,
    progress: &Progress,
) -> Result<Option<Solution>, SpectrumError> {
    let (n, zeros) = (problem.size(), problem.zero_modes());
    let Some(weyl) = request.weyl.filter(|weyl| weyl.dimension == 2) else { return Ok(None) };
    if request.count <= zeros || (request.position)(0).len() != 3 {
        return Ok(None);
    }
    let narrow = request.narrow.unwrap_or(&problem.matrix);
    let Some(level) = coarser(problem, narrow, &request.position, weyl.first, progress)? else {
        return Ok(None);
    };
    let wanted = request.count - zeros;
    let count = wanted + GUARDS + level.problem.zero_modes();
    if level.problem.size() > n / 4 || level.problem.size() < POINTS_PER_PAIR * count {
        return Ok(None);
    }
    let sample = solve_sample(Sample {
        problem: &level.problem,
        positions: &level.positions,
        count,
        weyl: Weyl { t: None, ..weyl },
    })?;
    progress.enter(Phase::Eigenpairs)?;
    let (missed, solved_points) = (sample.certificates.missed, sample.solved_points);
    let start = Start::of_sample(&level, &sample.values, &sample.vectors, weyl.t);
    drop(sample);
    let symbolic = symbolic_of(&level, progress)?;
    let shift = SHIFT_SHARE * start.values[start.values.len() - 1];
    let Some(factor) = symbolic.factor_roughly(&level.problem.matrix, shift, progress)? else {
        return Ok(None);
    };
    let columns = width(n);
    let mut inverse = TwoGrid::new(&level.weights, &factor, level.problem.size(), columns, progress)?;
    let system = System::new(problem);
    let mut vectors = prolonged(problem, &start, request.narrow.is_some(), progress)?;
    let mut values = vec![0.0; zeros];
    values.extend_from_slice(&start.values);
    drop(start);
    for _ in 0..CORRECTIONS_MAX {
        let dual = correct(&system, &values, request.count, &mut vectors, &mut inverse, progress)?;
        values = ritz(problem, &mut vectors, progress)?;
        if values.len() < request.count {
            return Ok(None);
        }
        if dual <= CORRECTED_ONCE {
            break;
        }
    }
    values.truncate(request.count);
    vectors.set_columns(request.count);
    into_functions(problem, &mut vectors, progress)?;
    let judged = judged(problem, &system, &values, &mut vectors, &mut inverse, progress)?;
    let certificates = Certificates {
        orthogonality: judged.orthogonality,
        residual: judged.residuals.iter().copied().fold(0.0, f64::max),
        dual_residual: Some(judged.dual_residual()),
        zero_modes: zeros,
        missed,
        missed_check: MissedCheck::Thinned,
        saturation: saturation(request, &values),
    };
    Ok(Some(Solution {
        imaginary: Vec::new(),
        values,
        vectors: Vectors::Single(vectors),
        residuals: judged.residuals,
        dual_residuals: Some(judged.dual_residuals),
        solved_points,
        certificates,
        method: Method::Prolonged,
    }))
}

/// The null vectors, then those of the sample at all points.
fn prolonged(
    problem: &Problem,
    start: &Start<'_>,
    has_kernel: bool,
    progress: &Progress,
) -> Result<Shelf, SpectrumError> {
    let (n, zeros, all) = (problem.size(), problem.zero_modes(), start.values.len());
    let groups = Groups { first: zeros, width: width(n) };
    let beside = BESIDE_BYTES + if has_kernel { BESIDE_KERNEL_BYTES } else { 0 };
    let columns = zeros + all;
    let singles = |columns: usize| (size_of::<f32>() * columns) as u64;
    let with_groups = beside + singles(columns + HELD * groups.width);
    let mut vectors = if progress.has_room_beside(with_groups.saturating_mul(n as u64)) {
        Shelf::in_memory(n, columns, groups)
    } else {
        let file = progress.scratch_file(singles(columns).saturating_mul(n as u64))?;
        Shelf::in_file(file, n, columns, groups)
    };
    let mut block = Block::<f32>::zeros(n, groups.width);
    for group in vectors.groups() {
        progress.advance(0.1 + 0.1 * group.start as f64 / (zeros + all) as f64)?;
        if group.start < zeros {
            problem.write_null_vectors(&mut block, group.clone());
        } else {
            let coarse = start.vectors.columns_from(group.start - zeros, group.len());
            finished_product(&mut block, start.weights, coarse, Finish::Product);
        }
        vectors.store(group, &block, progress)?;
    }
    Ok(vectors)
}

/// One correction of every vector behind the null vectors by its residual, of which the first `wanted` are to be good; the
/// largest ρ before it, nearly.
fn correct(
    system: &System<'_>,
    values: &[f64],
    wanted: usize,
    vectors: &mut Shelf,
    inverse: &mut TwoGrid<'_>,
    progress: &Progress,
) -> Result<f64, SpectrumError> {
    let problem = system.problem;
    let n = problem.size();
    let mut room = Room::new(n, width(n));
    let mut largest = 0.0_f64;
    let (mut steps, zeros) = (STEPS_MAX, problem.zero_modes());
    for columns in vectors.groups().into_iter().rev().filter(|group| group.start >= zeros) {
        progress.advance(0.8 - 0.6 * columns.end as f64 / values.len() as f64)?;
        let (values, is_wanted) = (&values[columns.clone()], columns.start < wanted);
        let mut group = vectors.take(columns, progress)?;
        let some = Scaled { vectors: vectors.columns_of(&group), scale: &[] };
        residual(&mut room.residual, &problem.matrix, some, values);
        room.begin();
        progress.checkpoint()?;
        let mut taken = vec![0.0; values.len()];
        for made in 0..steps {
            let step = room.step(system, inverse, progress)?;
            vectors.change(&mut group, |i, row| {
                let changes = room.direction().row(i).iter().zip(&step.lengths);
                row.iter_mut().zip(changes).for_each(|(x, (p, length))| *x -= *length as f32 * p);
            });
            taken.iter_mut().zip(&step.gains).for_each(|(taken, gain)| *taken += gain);
            if made > 0 && step.gains.iter().zip(&taken).all(|(gain, taken)| *gain <= GAIN_MIN * taken) {
                // guards alone tell nothing
                steps = if is_wanted { made } else { steps };
                break;
            }
        }
        vectors.put(group, progress)?;
        for (taken, value) in taken.iter().zip(values) {
            largest = largest.max((taken / (value + problem.shift)).sqrt());
        }
    }
    Ok(largest)
}

/// Makes Ritz vectors of vectors, and gives their values, zeros first.
fn ritz(problem: &Problem, vectors: &mut Shelf, progress: &Progress) -> Result<Vec<f64>, SpectrumError> {
    let [gram, image] = gram_pair(Some(&problem.matrix), vectors, &[], progress)?;
    let (values, change) = change_beside(problem.zero_modes(), gram.as_ref(), image.as_ref())?;
    replace_by_product(vectors, change.as_ref(), progress)?;
    progress.advance(0.9)?;
    Ok(values)
}

/// `h = B^-½ y`; functions of the null space are the same at all points of their component.
fn into_functions(problem: &Problem, vectors: &mut Shelf, progress: &Progress) -> Result<(), SpectrumError> {
    let root = &problem.root_mass;
    let (zeros, columns) = (problem.zero_modes(), vectors.columns());
    vectors.for_each_stretch(progress, |first, rows, width| {
        for (i, row) in (first..).zip(rows.chunks_mut(width)) {
            let inverse = 1.0 / root[i];
            row[zeros..columns].iter_mut().for_each(|x| *x = (f64::from(*x) * inverse) as f32);
            let (component, null) = problem.null_entry(i);
            row[component] = (null * inverse) as f32;
        }
    })
}

/// What was measured of functions as they are handed out.
struct Judged {
    residuals: Vec<f64>,
    dual_residuals: Vec<f64>,
    orthogonality: f64,
}

impl Judged {
    fn dual_residual(&self) -> f64 {
        self.dual_residuals.iter().copied().fold(0.0, f64::max)
    }
}

fn judged(
    problem: &Problem,
    system: &System<'_>,
    values: &[f64],
    vectors: &mut Shelf,
    inverse: &mut TwoGrid<'_>,
    progress: &Progress,
) -> Result<Judged, SpectrumError> {
    let (n, scale) = (problem.size(), &problem.root_mass);
    progress.enter(Phase::Certificates)?;
    let [gram, _] = gram_pair(None, vectors, scale, progress)?;
    let identity = faer::Mat::<f64>::identity(values.len(), values.len());
    let mut judged = Judged {
        residuals: Vec::with_capacity(values.len()),
        dual_residuals: Vec::with_capacity(values.len()),
        orthogonality: (gram - identity).norm_max(),
    };
    let mut room = Room::new(n, width(n));
    for columns in vectors.groups() {
        progress.advance(columns.start as f64 / values.len() as f64)?;
        let some = &values[columns.clone()];
        let group = vectors.take(columns, progress)?;
        let x = Scaled { vectors: vectors.columns_of(&group), scale };
        let squares = residual(&mut room.residual, &problem.matrix, x, some);
        vectors.put_unchanged(group);
        progress.checkpoint()?;
        let relative = |(square, value): (&f64, &f64)| square.sqrt() / (value + problem.shift);
        judged.residuals.extend(squares.iter().zip(some).map(relative));
        judged.dual_residuals.extend(bounds_of_group(
            system,
            some,
            Some(&mut *inverse),
            &mut room,
            progress,
        )?);
    }
    Ok(judged)
}
