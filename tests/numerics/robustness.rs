//! Clouds that are hard on an eigensolver: nothing may be lost, and what is returned is certified.

use chladni::analysis::{Analysis, Parameters};
use chladni::cloud::PointCloud;
use chladni::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
use chladni::operator::OperatorKind::{self, PbMhb, Voronoi};
use chladni::spectrum::Method;
use rstest::rstest;

use crate::{cloud, eigen, eigenvalues, fibonacci_sphere, parameters};

/// An analysis whose certificates all hold.
fn certified(cloud: &PointCloud, parameters: &Parameters) -> Analysis {
    let analysis = eigen(cloud, parameters);
    let certificates = &analysis.report.spectrum.as_ref().unwrap().certificates;
    assert_eq!(analysis.bases(), parameters.bases);
    assert_eq!(certificates.missed, Some(0), "{certificates:?}");
    assert!(certificates.residual <= parameters.tolerance, "{certificates:?}");
    assert!(certificates.orthogonality < 1e-10, "{certificates:?}");
    analysis
}

fn moved(points: &[f64], by: [f64; 3]) -> Vec<f64> {
    points.chunks_exact(3).flat_map(|p| [p[0] + by[0], p[1] + by[1], p[2] + by[2]]).collect()
}

/// Degrees 0 to 9 with 2l + 1 eigenvalues each: the hundredth is the last of its degree.
#[rstest]
#[case(PbMhb)]
#[case(Voronoi)]
fn every_multiple_eigenvalue_of_the_sphere_is_there_as_often_as_it_should(#[case] kind: OperatorKind) {
    let analysis = certified(&cloud(3, fibonacci_sphere(4_000)), &parameters(kind, 100));
    let mut found = [0; 10];
    for value in eigenvalues(&analysis) {
        found[(0.5 * ((1.0 + 4.0 * value).sqrt() - 1.0)).round() as usize] += 1;
    }
    assert_eq!(found, [1, 3, 5, 7, 9, 11, 13, 15, 17, 19]);
}

/// Every non-zero eigenvalue is there 150 times, far more often than vectors are iterated together.
#[rstest]
#[case(PbMhb)]
#[case(Voronoi)]
fn fifty_equal_components_and_outliers(#[case] kind: OperatorKind) {
    let one = fibonacci_sphere(60);
    let mut points: Vec<f64> =
        (0..50).flat_map(|k| moved(&one, [5.0 * f64::from(k % 10), 5.0 * f64::from(k / 10), 0.0])).collect();
    points.extend((0..7).flat_map(|k| [300.0 + 50.0 * f64::from(k), 0.0, 0.0]));
    let analysis = certified(&cloud(3, points), &parameters(kind, 220));
    let report = &analysis.report;
    assert_eq!((report.components, report.isolated, report.points_used), (50, 7, 3_000));
    // what λ of `voronoi` has beside μ may change the order of modes, of which the last ones are not all asked for
    let single = eigen(&cloud(3, one), &parameters(kind, 6)).report.spectrum.unwrap().raw_eigenvalues;
    let found = &report.spectrum.as_ref().unwrap().raw_eigenvalues;
    assert_eq!(found.iter().filter(|value| value.abs() < 1e-9).count(), 50);
    for (j, value) in found[50..].iter().enumerate() {
        // the first three non-zero eigenvalues of one sphere, then those of degree two
        let expected = single[1 + j / 50];
        assert!((value / expected - 1.0).abs() < 1e-4, "{j}: {value} {expected}");
    }
}

/// A sphere whose points lie a hundred times as dense at one pole as at the other.
#[rstest]
#[case(PbMhb, 0.2)]
#[case(Voronoi, 0.05)]
fn a_density_that_grows_a_hundredfold(#[case] kind: OperatorKind, #[case] bound: f64) {
    let (n, golden) = (6_000, std::f64::consts::PI * (3.0 - 5.0_f64.sqrt()));
    let growth = 0.5 * 100.0_f64.ln();
    let points = (0..n).flat_map(|i| {
        // density exp(growth · z), by the inverse of its integral
        let share = (f64::from(i) + 0.5) / f64::from(n);
        let z = ((-growth).exp() + share * (growth.exp() - (-growth).exp())).ln() / growth;
        let (radius, angle) = ((1.0 - z * z).max(0.0).sqrt(), golden * f64::from(i));
        [radius * angle.cos(), radius * angle.sin(), z]
    });
    let analysis = certified(&cloud(3, points.collect()), &parameters(kind, 9));
    for (value, exact) in eigenvalues(&analysis)[1..].iter().zip([2.0, 2.0, 2.0, 6.0, 6.0, 6.0, 6.0, 6.0]) {
        assert!((value / exact - 1.0).abs() < bound, "{value} {exact}");
    }
}

/// Rows of hundreds of neighbors, irregular ones at that. With a small t the kernel's operator is far from the one that
/// stands in for it, and a polynomial would take too many steps.
#[rstest]
#[case(1.5, None, Method::Polynomial)]
#[case(0.2, Some(10.0), Method::Lobpcg)]
fn independent_samples_with_wide_kernels(
    #[case] t_factor: f64,
    #[case] delta_factor: Option<f64>,
    #[case] method: Method,
) {
    let request = SampleRequest { sampling: Sampling::Iid, ..SampleRequest::new(Shape::Sphere, 4_000) };
    let wide = Parameters { t_factor: Some(t_factor), delta_factor, ..parameters(PbMhb, 30) };
    let analysis = certified(&sample(&request).unwrap(), &wide);
    assert!(analysis.report.neighbors > 200.0, "{}", analysis.report.neighbors);
    assert_eq!(analysis.report.spectrum.as_ref().unwrap().method, method);
}

/// Four points on a circle everywhere: every Delaunay triangulation is as good as another.
#[rstest]
#[case(PbMhb)]
#[case(Voronoi)]
fn a_flat_grid_full_of_ties(#[case] kind: OperatorKind) {
    let points = (0..1_600).flat_map(|i| [f64::from(i % 40), f64::from(i / 40), 0.0]).collect();
    let found = eigenvalues(&certified(&cloud(3, points), &parameters(kind, 12)));
    // cosines on a square of 39 spacings and the half cells around it: π²(a² + b²)/39²
    let unit = (std::f64::consts::PI / 39.0).powi(2);
    for (value, squares) in found[1..].iter().zip([1.0, 1.0, 2.0, 4.0, 4.0, 5.0, 5.0, 8.0, 9.0, 9.0, 10.0]) {
        assert!((value / (squares * unit) - 1.0).abs() < 0.03, "{value} {squares}");
    }
}

/// As georeferenced scans are: a million units from the origin.
#[rstest]
#[case(PbMhb, 1e-6)]
#[case(PbMhb, 1e6)]
#[case(Voronoi, 1e-6)]
#[case(Voronoi, 1e6)]
fn scaled_and_far_from_the_origin(#[case] kind: OperatorKind, #[case] scale: f64) {
    let points = fibonacci_sphere(1_500);
    let expected = eigenvalues(&certified(&cloud(3, points.clone()), &parameters(kind, 12)));
    let far: Vec<f64> = moved(&points, [1e6, -1e6, 2e6]).iter().map(|x| scale * x).collect();
    let found = eigenvalues(&certified(&cloud(3, far), &parameters(kind, 12)));
    for (value, expected) in found[1..].iter().zip(&expected[1..]) {
        assert!((value * scale * scale / expected - 1.0).abs() < 1e-5, "{value} {expected}");
    }
}

/// As many bases as there are points but one, dense and iterated.
#[rstest]
#[case(PbMhb, 40, 39)]
#[case(Voronoi, 300, 299)]
#[case(Voronoi, 700, 139)]
fn nearly_all_bases(#[case] kind: OperatorKind, #[case] n: usize, #[case] bases: usize) {
    let wide = Parameters { t_factor: Some(4.0), ..parameters(kind, bases) };
    let analysis = eigen(&cloud(3, fibonacci_sphere(n)), &wide);
    assert_eq!(analysis.bases(), bases);
    let certificates = &analysis.report.spectrum.as_ref().unwrap().certificates;
    assert!(certificates.residual <= wide.tolerance && certificates.missed == Some(0), "{certificates:?}");
}
