//! The stages of an analysis, each on its own: `cargo bench`. Compare times only within one run.

use chladni::analysis::{JobKind, Parameters, analyze};
use chladni::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
use chladni::geometry::cells::CellOptions;
use chladni::geometry::{NearestNeighbors, Points, SearchTree, cells, frames};
use chladni::operator::{LaplaceBeltrami, OperatorKind, voronoi};
use chladni::progress::Progress;
use chladni::spectrum::Problem;
use chladni::spectrum::factor::{Symbolic, nested_dissection};
use chladni::spectrum::vectors::block::{Block, gram};
use chladni::spectrum::vectors::start;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, Mat, Par, Side, Spec};

const POINTS: usize = 20_000;

fn cloud() -> chladni::cloud::PointCloud {
    let request =
        SampleRequest { sampling: Sampling::Uniform, ..SampleRequest::new(Shape::BumpySphere, POINTS) };
    sample(&request).expect("the shape can be sampled")
}

fn geometry(criterion: &mut Criterion) {
    let (cloud, progress) = (cloud(), Progress::new());
    let mut group = criterion.benchmark_group("geometry");
    group.sample_size(10).throughput(Throughput::Elements(POINTS as u64));
    group.bench_function("points in order", |b| b.iter(|| Points::prepare(&cloud, 2)));
    let points = Points::prepare(&cloud, 2).expect("the cloud is a surface");
    group.bench_function("nearest neighbors", |b| {
        b.iter(|| NearestNeighbors::find(&SearchTree::new(&points), &points, 20, &progress));
    });
    group.finish();
}

fn operators(criterion: &mut Criterion) {
    let cloud = cloud();
    let mut group = criterion.benchmark_group("operators");
    group.sample_size(10).throughput(Throughput::Elements(POINTS as u64));
    for operator in [OperatorKind::Voronoi, OperatorKind::PbMhb, OperatorKind::Graph] {
        let parameters = Parameters { operator, ..Parameters::default() };
        group.bench_with_input(BenchmarkId::from_parameter(operator.name()), &parameters, |b, parameters| {
            b.iter(|| analyze(&cloud, JobKind::Operator, parameters, &Progress::new()));
        });
    }
    group.finish();
}

/// The finite-volume problem of the cloud, and its points.
fn problem() -> (Problem, Points) {
    let progress = Progress::new();
    let points = Points::prepare(&cloud(), 2).expect("the cloud is a surface");
    let tree = SearchTree::new(&points);
    let nearest = NearestNeighbors::find(&tree, &points, 20, &progress).expect("nobody cancels");
    let frames = frames(&points, &nearest, 2, &progress).expect("nobody cancels");
    let options = CellOptions { isometric: true, clip_rims: true, sheet_aware: true };
    let cells = cells(&points, &tree, &nearest, &frames, options, &progress).expect("nobody cancels");
    let stiffness = voronoi::stiffness(&cells, &progress).expect("nobody cancels");
    let problem = Problem::new(LaplaceBeltrami::narrow(stiffness, cells.volume), 1.0, &progress);
    (problem.expect("nobody cancels"), points)
}

fn solves(criterion: &mut Criterion) {
    let (problem, points) = problem();
    let mut group = criterion.benchmark_group("solves");
    group.sample_size(10);
    let order = || {
        nested_dissection(&problem.matrix, |i| points.point(i as usize), &Progress::new())
            .expect("nobody cancels")
    };
    group.bench_function("nested dissection", |b| b.iter(order));
    let symbolic = Symbolic::analyze(&problem.matrix, order(), &Progress::new()).expect("it has a factor");
    group.bench_function("factorization", |b| {
        b.iter(|| symbolic.factor(&problem.matrix, problem.shift, &Progress::new()));
    });
    let factor = symbolic.factor(&problem.matrix, problem.shift, &Progress::new()).expect("it has a factor");
    for columns in [16, 64] {
        let mut block = Block::zeros(POINTS, columns);
        start::fill(&mut block, 0);
        group.throughput(Throughput::Elements(columns as u64));
        group.bench_with_input(BenchmarkId::new("substitution", columns), &block, |b, block| {
            b.iter(|| factor.solve(&mut block.clone(), &Progress::new()));
        });
        group.bench_with_input(BenchmarkId::new("gram", columns), &block, |b, block| {
            b.iter(|| gram(block, block));
        });
    }
    group.finish();
}

/// Factors of `A + σI` and solutions with them beside those of faer's sparse Cholesky, with the same elimination order and
/// on one thread: why `spectrum::factor` exists.
fn factors(criterion: &mut Criterion) {
    let (problem, points) = problem();
    let (matrix, n) = (&problem.matrix, problem.matrix.rows());
    let mut group = criterion.benchmark_group("factors on one thread");
    group.sample_size(10);
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread can be had");
    let elimination =
        nested_dissection(matrix, |i| points.point(i as usize), &Progress::new()).expect("nobody cancels");
    let order = elimination.order.clone();
    let symbolic = Symbolic::analyze(matrix, elimination, &Progress::new()).expect("it has a factor");
    let ours = |single: bool| {
        let factor = if single { Symbolic::factor } else { Symbolic::factor_double };
        factor(&symbolic, matrix, problem.shift, &Progress::new()).expect("it has a factor")
    };

    let mut place = vec![0_u32; n];
    order.iter().zip(0..).for_each(|(&row, k)| place[row as usize] = k);
    let offsets: Vec<u32> = matrix.offsets().iter().map(|&offset| offset as u32).collect();
    let shifted_row = |i: usize| {
        let (columns, values) = matrix.row(i);
        columns.iter().zip(values).map(
            move |(&j, value)| {
                if j as usize == i { value + problem.shift } else { *value }
            },
        )
    };
    let values: Vec<f64> = (0..n).flat_map(shifted_row).collect();
    let pattern = SymbolicSparseColMatRef::new_checked(n, n, &offsets, None, matrix.columns());
    let shifted = SparseColMatRef::new(pattern, &values);
    let order = SymmetricOrdering::Custom(PermRef::new_checked(&order, &place, n));
    let parameters = CholeskySymbolicParams {
        supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
        ..CholeskySymbolicParams::default()
    };
    let theirs =
        factorize_symbolic_cholesky(pattern, Side::Lower, order, parameters).expect("it has a factor");
    let mut numbers = vec![0.0_f64; theirs.len_val()];
    let scratch = theirs.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
    let mut memory = MemBuffer::new(scratch);
    let mut factorize = || {
        let stack = MemStack::new(&mut memory);
        let regularization = LltRegularization::default();
        theirs
            .factorize_numeric_llt(
                &mut numbers,
                shifted,
                Side::Lower,
                regularization,
                Par::Seq,
                stack,
                Spec::default(),
            )
            .expect("it has a factor");
    };
    group.bench_function("faer: factorization", |b| b.iter(&mut factorize));
    group.bench_function("double: factorization", |b| b.iter(|| one.install(|| ours(false))));
    group.bench_function("single: factorization", |b| b.iter(|| one.install(|| ours(true))));

    let columns = 64;
    let mut block = Block::zeros(n, columns);
    start::fill(&mut block, 0);
    let right = Mat::from_fn(n, columns, |i, j| block.row(i)[j]);
    let factor = LltRef::new(&theirs, &numbers);
    let mut memory = MemBuffer::new(theirs.solve_in_place_scratch::<f64>(columns, Par::Seq));
    group.throughput(Throughput::Elements(columns as u64));
    group.bench_function("faer: substitution", |b| {
        b.iter(|| {
            let mut x = right.clone();
            factor.solve_in_place_with_conj(Conj::No, x.as_mut(), Par::Seq, MemStack::new(&mut memory));
        });
    });
    for (name, factor) in [("double", ours(false)), ("single", ours(true))] {
        group.bench_function(format!("{name}: substitution"), |b| {
            b.iter(|| one.install(|| factor.solve(&mut block.clone(), &Progress::new())));
        });
    }
    group.finish();
}

criterion_group!(benches, geometry, operators, solves, factors);
criterion_main!(benches);
