//! Pairs beside those of block Lanczos.

mod prolonged;

use super::*;
use crate::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
use crate::cloud::{NonFinite, PointCloud};
use crate::geometry::survey::{Rules, Survey};
use crate::geometry::{NearestNeighbors, Points, SearchTree, frames};
use crate::operator::bandwidth::Bandwidth;
use crate::operator::pb_mhb::{self, Coupling};
use crate::operator::rims::Rims;
use crate::operator::{HeatKernel, LaplaceBeltrami, voronoi};
use crate::progress::Canceled;
use crate::spectrum::vectors::block::gram;
use crate::spectrum::{Vectors, Weyl};

/// A surface with its operator, and the narrow companion of a kernel operator.
struct Surface {
    points: Points,
    problem: Problem,
    narrow: Option<Sparse>,
    weyl: Weyl,
}

impl Surface {
    fn of(coordinates: Vec<f64>, kernel: bool) -> Self {
        let progress = Progress::new();
        let cloud = PointCloud::new(3, coordinates, NonFinite::Reject).unwrap();
        let points = Points::prepare(&cloud, 2).unwrap();
        let tree = SearchTree::new(&points);
        let nearest = NearestNeighbors::find(&tree, &points, 20, &progress).unwrap();
        let frames = frames(&points, &nearest, 2, &progress).unwrap();
        let survey = Survey { points: &points, tree: &tree, nearest: &nearest, rules: Rules::default() };
        let stars = survey.triangulate(frames, true, &progress).unwrap().stars;
        let cells = stars.cells(&points, &Progress::new()).unwrap();
        let area: f64 = cells.volume.iter().sum();
        let first = 4.0 * std::f64::consts::PI / area;
        let walls = voronoi::stiffness(&cells, &progress).unwrap();
        let t = area / points.len() as f64;
        let kernel = kernel.then_some(HeatKernel {
            t,
            delta: 4.0 * (2.0 * t).sqrt(),
            truncation_compensation: true,
            dimension: 2,
        });
        let inverse: Vec<f64> = cells.volume.iter().map(|a| 1.0 / a.sqrt()).collect();
        let (laplacian, narrow) = match kernel {
            None => (LaplaceBeltrami::narrow(walls, cells.volume), None),
            Some(kernel) => {
                let even = Bandwidth::even(points.len(), 1.0);
                let local = even.of_kernel(kernel);
                let built = pb_mhb::build(
                    &points,
                    &tree,
                    &cells,
                    &Coupling::Ball,
                    local,
                    Some(&Rims::default()),
                    &progress,
                );
                let mut narrow = walls;
                narrow.scale_both_sides(&inverse);
                (built.unwrap(), Some(narrow))
            }
        };
        let weyl = Weyl { first, dimension: 2, t: kernel.map(|kernel| kernel.t) };
        Self { points, problem: Problem::new(laplacian, first, &Progress::new()).unwrap(), narrow, weyl }
    }

    fn request<'a>(&'a self, count: usize, tolerance: f64) -> Request<'a, impl Fn(u32) -> &'a [f64] + Sync> {
        Request {
            count,
            tolerance,
            position: |i: u32| self.points.point(i as usize),
            narrow: self.narrow.as_ref(),
            weyl: Some(self.weyl),
            plateau: self.weyl.t,
            solved_max: usize::MAX,
            saturates: self.weyl.t.is_some(),
        }
    }

    /// Checks pairs against those of block Lanczos.
    fn check(&self, count: usize, own: bool) {
        let progress = Progress::new();
        let request = self.request(count, 2e-5);
        let found = by_factor(&self.problem, &request, own, &progress).unwrap().unwrap();
        assert_eq!((found.method, found.certificates.missed), (Method::CoarseToFine, Some(0)));
        assert!(found.certificates.residual <= 2e-5 && found.certificates.orthogonality < 1e-11);
        let symbolic = Symbolic::by_position(&self.problem.matrix, &request.position, &progress).unwrap();
        let exact = self.request(count + 1, 1e-9);
        let exact = direct::solve(&self.problem, &symbolic, &exact, &progress).unwrap();
        for (found, exact) in found.values.iter().zip(&exact.values) {
            assert!((found - exact).abs() <= 1e-8 * exact, "{found} {exact}");
        }
        // of vectors whose values end a cluster only the span is determined, which may go on
        let cosines = gram(in_double(&exact), in_double(&found));
        let last = exact.values[count];
        for j in (0..count).filter(|&j| found.values[j] < 0.99 * last) {
            let inside = cosines.col(j).squared_norm_l2();
            assert!(1.0 - inside < 1e-7, "{j}: {inside}");
        }
    }
}

fn in_double(solution: &Solution) -> &Block {
    match &solution.vectors {
        Vectors::Double(vectors) => vectors,
        Vectors::Single(_) => panic!("vectors in single precision"),
    }
}

fn sampled(shape: Shape, points: usize, sampling: Sampling) -> Vec<f64> {
    sample(&SampleRequest { sampling, ..SampleRequest::new(shape, points) }).unwrap().coordinates().to_vec()
}

#[test]
fn pairs_of_finite_volumes_are_those_of_lanczos() {
    Surface::of(sampled(Shape::BumpySphere, 8_000, Sampling::Uniform), false).check(20, true);
}

#[test]
fn pairs_of_kernels_are_those_of_lanczos_by_either_factor() {
    let surface = Surface::of(sampled(Shape::BumpySphere, 8_000, Sampling::Uniform), true);
    surface.check(20, true);
    surface.check(20, false);
}

#[test]
fn uneven_samples_are_solved_too() {
    Surface::of(sampled(Shape::Torus, 9_000, Sampling::NonUniform), false).check(12, true);
    Surface::of(sampled(Shape::BumpySphere, 9_000, Sampling::Iid), false).check(20, true);
}

#[test]
fn parts_with_rims_that_nearly_touch_are_solved_together() {
    let cap = |p: &[f64]| p[2] > -0.3;
    let sphere = sampled(Shape::Sphere, 9_000, Sampling::Uniform);
    let open = sphere.chunks_exact(3).filter(|p| cap(p)).flatten().copied();
    let small = sampled(Shape::Sphere, 2_500, Sampling::Uniform);
    let beside = small.chunks_exact(3).flat_map(|p| [0.5 * p[0] + 1.7, 0.5 * p[1], 0.5 * p[2]]);
    let surface = Surface::of(open.chain(beside).collect(), false);
    assert_eq!(surface.problem.zero_modes(), 2);
    surface.check(20, true);
}

#[test]
fn bits_do_not_depend_on_the_number_of_threads_and_a_cancellation_ends_it() {
    let surface = Surface::of(sampled(Shape::BumpySphere, 8_000, Sampling::Uniform), false);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            solve(&surface.problem, &surface.request(20, 1e-4), &Progress::new()).unwrap().unwrap()
        })
    };
    let (one, three) = (on(1), on(3));
    assert_eq!(one.values, three.values);
    assert!((0..8_000).all(|i| in_double(&one).row(i) == in_double(&three).row(i)));
    let canceled = Progress::new();
    canceled.cancel();
    let ended = solve(&surface.problem, &surface.request(20, 1e-4), &canceled);
    assert!(matches!(ended.err(), Some(SpectrumError::Canceled(Canceled))));
}

#[test]
fn what_does_not_thin_out_is_left_to_others() {
    let surface = Surface::of(sampled(Shape::Sphere, 3_000, Sampling::Uniform), false);
    let solved = |count, tolerance| {
        solve(&surface.problem, &surface.request(count, tolerance), &Progress::new()).unwrap().is_some()
    };
    assert!(!solved(20, 1e-4), "too few points");
    let surface = Surface::of(sampled(Shape::Sphere, 8_000, Sampling::Uniform), false);
    let solved = |count, tolerance| {
        solve(&surface.problem, &surface.request(count, tolerance), &Progress::new()).unwrap().is_some()
    };
    assert!(solved(20, 1e-4));
    assert!(!solved(20, 1e-9), "single precision does not reach it");
    assert!(!solved(200, 1e-4), "too many bases");
}
