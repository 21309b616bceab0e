//! The stages of an analysis, each on its own: `cargo bench`. Compare times only within one run.

use chladni::analysis::{JobKind, Parameters, analyze};
use chladni::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
use chladni::geometry::cells::CellOptions;
use chladni::geometry::{NearestNeighbors, Points, SearchTree, cells, frames};
use chladni::operator::{LaplaceBeltrami, OperatorKind, voronoi};
use chladni::progress::Progress;
use chladni::spectrum::Problem;
use chladni::spectrum::block::{Block, gram};
use chladni::spectrum::cholesky::Symbolic;
use chladni::spectrum::order::nested_dissection;
use chladni::spectrum::start;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

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
    group.bench_function("nearest neighbours", |b| {
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
    (Problem::new(LaplaceBeltrami::narrow(stiffness, cells.volume), 1.0), points)
}

fn solves(criterion: &mut Criterion) {
    let (problem, points) = problem();
    let mut group = criterion.benchmark_group("solves");
    group.sample_size(10);
    let order = || nested_dissection(&problem.matrix, |i| points.point(i as usize));
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

criterion_group!(benches, geometry, operators, solves);
criterion_main!(benches);
