//! What must not change a spectrum, and how it must change.

use chladni::analysis::{JobKind, SparseMatrix, analyze};
use chladni::operator::OperatorKind::{
    self, Graph, Kirchhoff, PbMhb, Pcd, PcdSymmetrized, Tutte, Voronoi, WeightedGraph,
};
use chladni::progress::Progress;
use rstest::rstest;

use crate::{cloud, eigen, eigenvalues, fibonacci_sphere, hashed, parameters};

/// An unevenly sampled ellipsoid without symmetries of its own.
fn shape(n: usize) -> Vec<f64> {
    fibonacci_sphere(n)
        .chunks_exact(3)
        .flat_map(|p| [p[0] * (1.0 + 0.2 * p[2]), 0.8 * p[1] + 0.1 * p[0] * p[0], 0.6 * p[2]])
        .collect()
}

fn operator(points: Vec<f64>, kind: OperatorKind) -> (SparseMatrix, Vec<f64>) {
    let analysis =
        analyze(&cloud(3, points), JobKind::Operator, &parameters(kind, 10), &Progress::new()).unwrap();
    (analysis.operator_matrix().unwrap(), analysis.mass())
}

fn row(matrix: &SparseMatrix, i: usize) -> impl Iterator<Item = (usize, f64)> {
    let range = matrix.offsets[i] as usize..matrix.offsets[i + 1] as usize;
    matrix.columns[range.clone()].iter().map(|&j| j as usize).zip(matrix.values[range].iter().copied())
}

fn assert_close(found: &[f64], expected: &[f64], tolerance: f64) {
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= tolerance * (1.0 + b.abs()), "eigenvalue {i}: {a} {b}");
    }
}

#[rstest]
#[case(PbMhb)]
#[case(Voronoi)]
fn the_operator_is_symmetric_with_zero_row_sums_and_nonnegative_couplings(#[case] kind: OperatorKind) {
    let (q, mass) = operator(shape(1_500), kind);
    assert!(mass.iter().all(|&b| b > 0.0));
    for i in 0..1_500 {
        let (mut sum, mut size) = (0.0, 0.0);
        for (j, value) in row(&q, i) {
            assert!(if i == j { value < 0.0 } else { value >= 0.0 });
            let back = row(&q, j).find(|&(k, _)| k == i).unwrap().1;
            assert_eq!(value.to_bits(), back.to_bits());
            sum += value;
            size += value.abs();
        }
        assert!(sum.abs() < 1e-13 * size);
    }
}

#[rstest]
#[case(PbMhb)]
#[case(Voronoi)]
#[case(WeightedGraph)]
#[case(Graph)]
#[case(Kirchhoff)]
#[case(Tutte)]
#[case(PcdSymmetrized)]
#[case(Pcd)]
fn a_rigid_motion_and_a_shuffle_leave_the_spectrum(#[case] kind: OperatorKind) {
    let points = shape(1_200);
    let expected = eigenvalues(&eigen(&cloud(3, points.clone()), &parameters(kind, 12)));
    let (sine, cosine) = 0.7_f64.sin_cos();
    let moved: Vec<f64> = points
        .chunks_exact(3)
        .flat_map(|p| [cosine * p[0] - sine * p[2] + 5.0, p[1] - 3.0, sine * p[0] + cosine * p[2] + 1.0])
        .collect();
    assert_close(&eigenvalues(&eigen(&cloud(3, moved), &parameters(kind, 12))), &expected, 1e-6);
    let mut order: Vec<u64> = (0..1_200).collect();
    order.sort_by(|&a, &b| hashed(a).total_cmp(&hashed(b)));
    let shuffled = order.iter().flat_map(|&i| points[3 * i as usize..3 * i as usize + 3].to_vec()).collect();
    assert_close(&eigenvalues(&eigen(&cloud(3, shuffled), &parameters(kind, 12))), &expected, 1e-9);
}

#[rstest]
#[case(PbMhb, 1e-6)]
#[case(PbMhb, 1e6)]
#[case(Voronoi, 1e-6)]
#[case(Voronoi, 1e6)]
#[case(WeightedGraph, 1e-6)]
#[case(Pcd, 1e6)]
fn scaling_the_cloud_by_s_divides_eigenvalues_by_s_squared(#[case] kind: OperatorKind, #[case] scale: f64) {
    let points = shape(1_200);
    let expected = eigenvalues(&eigen(&cloud(3, points.clone()), &parameters(kind, 12)));
    let scaled = points.iter().map(|x| scale * x).collect();
    let found: Vec<f64> = eigenvalues(&eigen(&cloud(3, scaled), &parameters(kind, 12)))
        .iter()
        .map(|x| x * scale * scale)
        .collect();
    assert_close(&found, &expected, 1e-8);
}

#[rstest]
#[case(PbMhb)]
#[case(Voronoi)]
fn the_bits_of_a_result_do_not_depend_on_the_number_of_threads(#[case] kind: OperatorKind) {
    let points = cloud(3, shape(3_000));
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| eigen(&points, &parameters(kind, 20)).basis(7))
    };
    let bits = |values: Vec<f64>| values.into_iter().map(f64::to_bits).collect::<Vec<_>>();
    assert_eq!(bits(on(1)), bits(on(3)));
}

#[rstest]
#[case(Graph)]
#[case(Kirchhoff)]
fn a_graphs_eigenvalues_have_no_unit(#[case] kind: OperatorKind) {
    let points = shape(1_200);
    let expected = eigenvalues(&eigen(&cloud(3, points.clone()), &parameters(kind, 8)));
    let scaled = points.iter().map(|x| 1e3 * x).collect();
    assert_close(&eigenvalues(&eigen(&cloud(3, scaled), &parameters(kind, 8))), &expected, 1e-8);
}
