//! Estimates the memory of an analysis.

use super::parameters::SOLVED_LEAST;
use super::{JobKind, Parameters};
use crate::operator::OperatorKind;
use crate::spectrum::dense::is_dense;
use crate::spectrum::shift_invert::krylov_vectors_at_end;
use crate::spectrum::slicing::{SLICE, vectors_held};
use crate::spectrum::vectors::{TILE_ROWS, TILES_HELD};
use crate::spectrum::{GROUPS_HELD, GUARDS, PROLONGED_BYTES, PROLONGED_KERNEL_BYTES, group_width};

/// Bytes per point of everything that does not grow with bases: the points twice, 20 neighbors, tree, frames, cells.
const GEOMETRY_BYTES: u64 = 1_100;
/// Bytes per point that a kernel operator adds: its rows, and while it is factored hundreds of entries of the factor in
/// single precision.
const KERNEL_BYTES: u64 = 2_400;
/// The same with entries in double precision, as slices of the spectrum need them, and of operators without symmetry.
const KERNEL_BYTES_DOUBLE: u64 = 3_400;
/// The same where there are too many points to factor the kernel: its rows take the room of what the geometry has left.
const KERNEL_BYTES_UNFACTORED: u64 = 200;
/// Most points of which the kernel is factored in single precision, and in double.
const FACTORED_POINTS: [u64; 2] = [900_000, 450_000];
/// Bytes per point and binary logarithm of the number of points: the Cholesky factor of a surface under nested
/// dissection has O(n log n) entries.
const FACTOR_BYTES: u64 = 24;
/// Least tolerance for which surfaces are factored in single precision; below, a factor in double is made beside it.
const SINGLE_TOLERANCE: f64 = 1e-6;
/// Bytes of a coupled pair of points while a matrix is assembled of them: the pair with its distance and Gaussian, and the
/// matrix with its transpose.
const ENTRY_BYTES: u64 = 40;
/// Bytes of an entry of the matrix beside its factor: the matrix, and its values in single precision.
const STORED_BYTES: u64 = 16;
/// The same of a kernel beside the finite volumes while a sample is solved.
const HELD_ENTRY_BYTES: u64 = 13;
/// Bytes of any job: stacks and arenas of its threads, what the allocator has not given back yet, the cloud on its way from
/// the database.
const JOB_BYTES: u64 = 46_000_000;
/// How many times fewer points a thinned sample has at least, thinned out once, twice and three times.
const THINNED: [u64; 3] = [7, 49, 343];
/// Fewest points of a sample per basis.
const SAMPLE_POINTS_PER_BASIS: u64 = 20;
/// Bytes per point until a cloud that is thinned out has its narrow operator: points, 20 neighbors, tree, planes, and triangles
/// with the votes about their sides.
const PREPARED_BYTES: u64 = 560;
/// Bytes per point while a sample is solved: points and cloud, masses, and a narrow matrix with the weights of the sample.
const HELD_BYTES: u64 = 370;
/// Beside it what a kernel's rows take.
const HELD_KERNEL_BYTES: u64 = 490;
/// The same with [`PROLONGED_BYTES`], where the bases are in a file: nothing is at its largest at the same time.
const BESIDE_FILE_BYTES: u64 = 470;
/// Pairs of points that a kernel couples, per point of an even sample, each of which takes [`ENTRY_BYTES`] at first.
const COUPLED: u64 = 28;
/// Four square matrices of doubles: the matrix, its eigenvectors, and what they are found in.
const DENSE_BYTES: u64 = 4 * 8;

/// Peak bytes of an analysis of `points` rows with `dimension` coordinates and `faces` triangles.
///
/// At most 40 % above the peaks that were measured of whole processes for surfaces (the test below has them). It knows
/// nothing of the cloud's shape: where a matrix turns out to be larger, the analysis asks for the difference before it
/// takes it ([`Progress::afford`](crate::progress::Progress::afford)).
#[must_use]
pub fn memory_estimate(
    points: u64,
    dimension: usize,
    faces: u64,
    kind: JobKind,
    parameters: &Parameters,
) -> u64 {
    match parameters.sample_of(points, dimension, kind) {
        Some(sample) => thinned(points, dimension, faces, sample, Bases::InMemory, parameters),
        None => estimate(points, dimension, faces, kind, parameters),
    }
}

/// The same within `budget` bytes: where more is needed than these and the bases can be kept in a file, what is needed beside
/// them.
#[must_use]
pub fn memory_within(
    budget: u64,
    points: u64,
    dimension: usize,
    faces: u64,
    kind: JobKind,
    parameters: &Parameters,
) -> u64 {
    let all = memory_estimate(points, dimension, faces, kind, parameters);
    match parameters.sample_of(points, dimension, kind) {
        Some(sample) if all > budget => thinned(points, dimension, faces, sample, Bases::InFile, parameters),
        _ => all,
    }
}

/// Where the bases of all points of a thinned cloud are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Bases {
    InMemory,
    InFile,
}

/// Peak bytes where a sample is solved and its bases are brought to all points.
fn thinned(
    points: u64,
    dimension: usize,
    faces: u64,
    sample: u64,
    place: Bases,
    parameters: &Parameters,
) -> u64 {
    let of_sample = Parameters { operator: OperatorKind::Voronoi, ..parameters.clone() };
    let solving = estimate(sample, dimension, 0, JobKind::Eigen, &of_sample) - JOB_BYTES;
    let [geometry, rows, kernel] = if parameters.operator.is_narrow() {
        [PREPARED_BYTES, 0, 0]
    } else {
        [GEOMETRY_BYTES + (COUPLED + 1) * ENTRY_BYTES, HELD_KERNEL_BYTES, PROLONGED_KERNEL_BYTES]
    };
    let geometry = points.saturating_mul(geometry + 16 * dimension as u64);
    let beside = points.saturating_mul(HELD_BYTES + rows);
    // groups of vectors, and the bases with their guards, or another group and what is kept of the file
    let (width, columns) = (group_width(points as usize), parameters.bases + GUARDS);
    let (all, vectors, kept) = match place {
        Bases::InMemory => (HELD_BYTES + PROLONGED_BYTES, columns + GROUPS_HELD * width, 0),
        Bases::InFile => {
            let rows = points.min((TILES_HELD * TILE_ROWS) as u64);
            (BESIDE_FILE_BYTES, (GROUPS_HELD + 1) * width, 4 * rows * columns as u64)
        }
    };
    let prolonged = points.saturating_mul(all + rows + kernel + 4 * vectors as u64).saturating_add(kept);
    // bases at the points of the first sample, from which those of all points come, beside one group of these; and what they
    // come from where that was thinned out again
    let first = 4 * columns as u64 * (points / THINNED[0]);
    let others = vectors - (GROUPS_HELD - 1) * width;
    let begun = points.saturating_mul(all + rows + kernel + 4 * others as u64).saturating_add(first);
    let twice = beside.saturating_add(2 * first);
    let most =
        [geometry, beside.saturating_add(solving), prolonged, begun, twice].into_iter().fold(0, u64::max);
    most.saturating_add(faces.saturating_mul(24)).saturating_add(JOB_BYTES)
}

impl Parameters {
    /// Points of the thinned sample of so many points that is solved; none where all of them are.
    fn sample_of(&self, points: u64, dimension: usize, kind: JobKind) -> Option<u64> {
        let most = self.solved_points.map(|most| most as u64).filter(|&most| most < points)?;
        let thins_out = kind == JobKind::Eigen && self.thins_out(dimension);
        // what is thinned out becomes several times fewer at once
        let thinned = |&sample: &u64| sample <= most;
        thins_out.then(|| THINNED.iter().map(|by| points / by).find(thinned).unwrap_or(most))
    }

    /// Whether fewer points are solved than there are.
    pub(super) fn is_thinned(&self, points: usize) -> bool {
        self.solved_points.is_some_and(|most| most < points)
    }

    /// Whether the operator is one of surfaces in space, which can be thinned out.
    fn thins_out(&self, dimension: usize) -> bool {
        use OperatorKind::{Cotangent, Mesh, PbMhb, Voronoi};
        let of_surface = matches!(self.operator, PbMhb | Voronoi | Cotangent | Mesh);
        !self.exact && of_surface && self.dimension == 2 && dimension == 3
    }

    /// The parameters that fit into `budget` bytes: where solving on all points takes more and was not asked for, solving on
    /// the largest sample of them that leaves room, or the smallest where none does.
    #[must_use]
    pub fn fitted(&self, points: u64, dimension: usize, faces: u64, kind: JobKind, budget: u64) -> Self {
        let estimate = |parameters: &Self| memory_estimate(points, dimension, faces, kind, parameters);
        if kind != JobKind::Eigen
            || self.solved_points.is_some()
            || !self.thins_out(dimension)
            || estimate(self) <= budget
        {
            return self.clone();
        }
        let least = (SAMPLE_POINTS_PER_BASIS * self.bases as u64).max(SOLVED_LEAST as u64);
        let sizes = THINNED.iter().map(|by| points / by).filter(|&sample| sample >= least);
        let solved = |sample: u64| Self { solved_points: Some(sample as usize), ..self.clone() };
        let all: Vec<Self> = sizes.map(solved).collect();
        let in_memory = all.iter().find(|fitted| estimate(fitted) <= budget);
        let in_file = || {
            let fits =
                |fitted: &&Self| memory_within(budget, points, dimension, faces, kind, fitted) <= budget;
            all.iter().find(fits)
        };
        in_memory.or_else(in_file).or(all.last()).unwrap_or(self).clone()
    }
}

fn estimate(points: u64, dimension: usize, faces: u64, kind: JobKind, parameters: &Parameters) -> u64 {
    let bases = parameters.bases;
    let sliced = bases > SLICE;
    let unfactored = points > FACTORED_POINTS[usize::from(sliced)];
    let kernel = match parameters.operator {
        OperatorKind::Voronoi | OperatorKind::Cotangent => 0,
        _ if unfactored => KERNEL_BYTES_UNFACTORED,
        kind if sliced || kind.is_pcd() => KERNEL_BYTES_DOUBLE,
        _ => KERNEL_BYTES,
    };
    // rows of an operator that is applied are long, and two matrices of them are held
    let applied = match (kind, parameters.operator) {
        (JobKind::Operator, OperatorKind::PbMhb) => 24 * (40_000_000 / points.max(1)).min(800),
        _ => 0,
    };
    let factors = if parameters.tolerance < SINGLE_TOLERANCE { 2 } else { 1 };
    let solver = match kind {
        JobKind::Operator => 0,
        JobKind::Eigen => {
            let vectors = vectors(points, parameters);
            factors * FACTOR_BYTES * u64::from(points.max(1).ilog2() + 1) + 8 * vectors as u64
        }
    };
    let per_point = GEOMETRY_BYTES + 16 * dimension as u64 + kernel + applied + solver;
    let matrices = if kind == JobKind::Eigen && is_dense(points as usize, parameters.bases) {
        DENSE_BYTES * points * points
    } else {
        0
    };
    let all =
        points.saturating_mul(per_point).saturating_add(faces.saturating_mul(24)).saturating_add(matrices);
    all.saturating_add(JOB_BYTES)
}

/// Vectors as long as the cloud that the solver holds: a Krylov space, in single precision where that is enough, or the
/// vectors that come of it and their products.
fn vectors(points: u64, parameters: &Parameters) -> usize {
    let bases = parameters.bases;
    let sliced = bases > SLICE;
    let unfactored = points > FACTORED_POINTS[usize::from(sliced)];
    let kernel = !matches!(parameters.operator, OperatorKind::Voronoi | OperatorKind::Cotangent);
    let is_single = parameters.tolerance >= SINGLE_TOLERANCE && !parameters.operator.is_pcd();
    match (kernel, unfactored, sliced) {
        (true, false, false) if is_single => krylov_vectors_at_end(bases, true).div_ceil(2).max(2 * bases),
        (true, true, _) | (true, _, false) => krylov_vectors_at_end(bases, false),
        // the pairs, their products, and a part of them on its way to the store
        _ => vectors_held(bases).max((5 * bases).div_ceil(2)),
    }
}

/// Peak bytes of an analysis once the entries of its matrix have been counted, without the factor.
pub(super) fn memory_with_entries(
    points: u64,
    dimension: usize,
    entries: u64,
    parameters: &Parameters,
) -> u64 {
    with_matrix(points, dimension, entries.saturating_mul(ENTRY_BYTES), parameters)
}

/// The same once the matrices are stored, beside the factor, for which the solver asks when it knows its pattern, and beside the
/// bases of a thinned cloud.
pub(super) fn memory_beside_factor(
    points: u64,
    dimension: usize,
    stored: u64,
    parameters: &Parameters,
) -> u64 {
    if parameters.sample_of(points, dimension, JobKind::Eigen).is_none() {
        return with_matrix(points, dimension, stored.saturating_mul(STORED_BYTES), parameters);
    }
    let matrix = if parameters.operator.is_narrow() { 0 } else { stored.saturating_mul(HELD_ENTRY_BYTES) };
    points.saturating_mul(HELD_BYTES).saturating_add(matrix).saturating_add(JOB_BYTES)
}

fn with_matrix(points: u64, dimension: usize, matrix: u64, parameters: &Parameters) -> u64 {
    let geometry = GEOMETRY_BYTES + 16 * dimension as u64;
    let vectors = match parameters.sample_of(points, dimension, JobKind::Eigen) {
        // they come when the geometry has gone
        Some(_) => 0,
        None => 8 * vectors(points, parameters) as u64,
    };
    points.saturating_mul(geometry + vectors).saturating_add(matrix).saturating_add(JOB_BYTES)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn megabytes(points: u64, operator: OperatorKind, bases: usize) -> u64 {
        let parameters = Parameters { operator, bases, ..Parameters::default() };
        memory_estimate(points, 3, 0, JobKind::Eigen, &parameters) / 1_000_000
    }

    /// Peak resident set sizes, in MB, of `chladni analyze` for bumpy spheres and Igea (134,345 points).
    #[test]
    fn the_estimate_bounds_what_was_measured_and_is_near_it() {
        for (points, operator, bases, measured) in [
            (60_000, OperatorKind::Voronoi, 20, 172),
            (60_000, OperatorKind::Voronoi, 400, 506),
            (90_000, OperatorKind::Voronoi, 100, 362),
            (134_345, OperatorKind::Voronoi, 50, 451),
            (60_000, OperatorKind::PbMhb, 20, 250),
            (60_000, OperatorKind::PbMhb, 150, 413),
            (90_000, OperatorKind::PbMhb, 100, 409),
            (134_345, OperatorKind::PbMhb, 50, 596),
            (134_345, OperatorKind::PbMhb, 100, 705),
            (250_000, OperatorKind::PbMhb, 100, 1_125),
            (600_000, OperatorKind::PbMhb, 100, 2_701),
            (100_000, OperatorKind::PbMhb, 1_000, 2_121),
            (1_000_000, OperatorKind::PbMhb, 20, 3_053),
            (1_000_000, OperatorKind::PbMhb, 100, 4_331),
        ] {
            let estimate = megabytes(points, operator, bases);
            let ratio = estimate as f64 / f64::from(measured);
            assert!((1.0..1.4).contains(&ratio), "{operator:?} {points} {bases}: {estimate} for {measured}");
        }
    }

    /// 3,000 points of which more than a fifth are asked for are solved densely, in four matrices of 72 MB.
    #[test]
    fn dense_matrices_count() {
        let (iterated, dense) =
            (megabytes(3_000, OperatorKind::Voronoi, 600), megabytes(3_000, OperatorKind::Voronoi, 601));
        assert!((288..293).contains(&(dense - iterated)), "{dense} {iterated}");
    }

    /// Peaks of the same, thinned out.
    #[test]
    fn the_estimate_bounds_what_thinned_clouds_took() {
        for (points, solved, measured) in
            [(134_345, 19_200, 230), (600_000, 85_000, 940), (5_000_000, 714_000, 6_460)]
        {
            let operator = OperatorKind::Voronoi;
            let parameters = Parameters { operator, solved_points: Some(solved), ..Parameters::default() };
            let estimate = memory_estimate(points, 3, 0, JobKind::Eigen, &parameters) / 1_000_000;
            let ratio = estimate as f64 / f64::from(measured);
            assert!((1.0..1.4).contains(&ratio), "{points} {solved}: {estimate} for {measured}");
        }
    }

    #[test]
    fn what_does_not_fit_is_thinned_out_as_little_as_possible() {
        let parameters = Parameters { operator: OperatorKind::Voronoi, ..Parameters::default() };
        let fitted = |points, kind, budget: u64| parameters.fitted(points, 3, 0, kind, budget << 30);
        assert_eq!(fitted(1_000_000, JobKind::Eigen, 12), parameters);
        let thinned = fitted(5_000_000, JobKind::Eigen, 12);
        assert_eq!(thinned.solved_points, Some(5_000_000 / 7));
        assert!(memory_estimate(5_000_000, 3, 0, JobKind::Eigen, &thinned) <= 12 << 30);
        let largest = fitted(11_000_000, JobKind::Eigen, 12);
        assert!(memory_estimate(11_000_000, 3, 0, JobKind::Eigen, &largest) <= 12 << 30);
        let within = |points, parameters: &Parameters, budget: u64| {
            memory_within(budget << 30, points, 3, 0, JobKind::Eigen, parameters)
        };
        assert_eq!(
            within(11_000_000, &largest, 12),
            memory_estimate(11_000_000, 3, 0, JobKind::Eigen, &largest),
            "bases stay in memory where they fit"
        );
        let in_file = fitted(20_000_000, JobKind::Eigen, 12);
        assert!(memory_estimate(20_000_000, 3, 0, JobKind::Eigen, &in_file) > 20 << 30);
        assert!(within(20_000_000, &in_file, 12) <= 12 << 30, "in a file");
        let exact = Parameters { exact: true, ..parameters.clone() };
        assert!(within(20_000_000, &exact, 12) > 40 << 30);
        assert_eq!(fitted(5_000_000, JobKind::Operator, 12), parameters);
        let smallest = fitted(50_000_000, JobKind::Eigen, 12);
        assert_eq!(
            smallest.solved_points,
            Some(50_000_000 / 343),
            "nothing fits: what needs the least is refused"
        );
        for all in [
            Parameters { exact: true, ..parameters.clone() },
            Parameters { dimension: 1, ..parameters.clone() },
            Parameters { operator: OperatorKind::Pcd, ..parameters.clone() },
        ] {
            assert_eq!(all.fitted(5_000_000, 3, 0, JobKind::Eigen, 12 << 30), all);
        }
        assert_eq!(parameters.fitted(5_000_000, 2, 0, JobKind::Eigen, 12 << 30), parameters, "in a plane");
        let few = Parameters { solved_points: Some(20_000), ..parameters.clone() };
        assert_eq!(few.fitted(5_000_000, 3, 0, JobKind::Eigen, 12 << 30), few);
    }

    #[test]
    fn more_of_anything_takes_more() {
        let base = megabytes(100_000, OperatorKind::Voronoi, 50);
        assert!(megabytes(200_000, OperatorKind::Voronoi, 50) > 9 * base / 5);
        assert!(megabytes(100_000, OperatorKind::Voronoi, 100) > base);
        let parameters = Parameters { operator: OperatorKind::Voronoi, bases: 50, ..Parameters::default() };
        let operator_alone = memory_estimate(100_000, 3, 0, JobKind::Operator, &parameters);
        assert!(operator_alone / 1_000_000 < base);
        assert_eq!(memory_estimate(u64::MAX, 3, u64::MAX, JobKind::Eigen, &parameters), u64::MAX);
    }
}
