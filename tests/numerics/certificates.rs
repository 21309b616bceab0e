//! Returned pairs checked from outside, and clouds with several parts.

use chladni::analysis::{AnalysisError, JobKind, Parameters, analyze, analyze_by};
use chladni::geometry::survey::Rules;
use chladni::operator::OperatorKind::{self, PbMhb, Voronoi};
use chladni::progress::{Canceled, Progress};
use chladni::spectrum::Method;
use rstest::rstest;

use crate::{cloud, eigen, fibonacci_sphere, parameters};

fn moved(points: &[f64], by: f64) -> Vec<f64> {
    points.chunks_exact(3).flat_map(|p| [p[0] + by, p[1], p[2]]).collect()
}

/// `max |HᵀBH − I|` and the largest relative residual, from what the caller gets.
#[rstest]
#[case(PbMhb, 300, Method::Dense)]
#[case(PbMhb, 3_000, Method::ShiftInvert)]
#[case(Voronoi, 3_000, Method::ShiftInvert)]
fn pairs_are_orthonormal_and_satisfy_the_eigenproblem(
    #[case] kind: OperatorKind,
    #[case] n: usize,
    #[case] method: Method,
) {
    check_pairs(n, &parameters(kind, 20), method);
}

#[test]
fn pairs_of_a_wide_kernel_are_as_good() {
    check_pairs(3_000, &Parameters { t_factor: Some(6.0), ..parameters(PbMhb, 20) }, Method::Polynomial);
}

fn check_pairs(n: usize, parameters: &Parameters, method: Method) {
    let points = cloud(3, fibonacci_sphere(n));
    // a t that is given is that of all points
    let rules = Rules { widen_kernels: false, ..Rules::default() };
    let analysis = analyze_by(rules, &points, JobKind::Eigen, parameters, &Progress::new()).unwrap();
    // An operator that is to be applied takes another time unless it is told one.
    let same = match analysis.report.heat_kernel {
        Some(kernel) => Parameters {
            t: Some(kernel.t),
            t_factor: None,
            delta: Some(kernel.delta),
            delta_factor: None,
            ..parameters.clone()
        },
        None => parameters.clone(),
    };
    let built = analyze(&points, JobKind::Operator, &same, &Progress::new()).unwrap();
    let (q, mass) = (built.operator_matrix().unwrap(), built.mass());
    let spectrum = analysis.report.spectrum.as_ref().unwrap();
    assert_eq!(spectrum.method, method);
    assert_eq!(spectrum.certificates.missed, Some(0));
    let bases: Vec<Vec<f64>> = (0..20).map(|j| analysis.basis(j)).collect();
    let shift = 0.3 * 4.0 * std::f64::consts::PI / mass.iter().sum::<f64>();
    for (j, h) in bases.iter().enumerate() {
        for (k, other) in bases.iter().enumerate() {
            let product: f64 = (0..n).map(|i| mass[i] * h[i] * other[i]).sum();
            assert!((product - f64::from(u8::from(j == k))).abs() < 1e-9);
        }
        let mu = spectrum.raw_eigenvalues[j];
        let squared: f64 = (0..n)
            .map(|i| {
                let range = q.offsets[i] as usize..q.offsets[i + 1] as usize;
                let qh: f64 = range.map(|k| q.values[k] * h[q.columns[k] as usize]).sum();
                (-qh - mu * mass[i] * h[i]).powi(2) / mass[i]
            })
            .sum();
        let residual = squared.sqrt() / (mu + shift);
        assert!(residual <= 1e-4, "pair {j}: {residual}");
        assert!(
            (residual - spectrum.residuals[j]).abs() < 1e-3 * residual + 1e-9,
            "{residual} {}",
            spectrum.residuals[j]
        );
    }
}

#[rstest]
#[case(PbMhb)]
#[case(Voronoi)]
fn two_identical_spheres_have_two_zero_modes_and_every_eigenvalue_in_pairs(#[case] kind: OperatorKind) {
    let one = fibonacci_sphere(1_000);
    let both = [one.clone(), moved(&one, 10.0)].concat();
    let single = eigen(&cloud(3, one), &parameters(kind, 9)).report.spectrum.unwrap();
    let analysis = eigen(&cloud(3, both), &parameters(kind, 18));
    assert_eq!(analysis.report.components, 2);
    assert_eq!(analysis.report.spectrum.as_ref().unwrap().certificates.zero_modes, 2);
    let found = analysis.report.spectrum.unwrap();
    for (j, mu) in found.raw_eigenvalues.iter().enumerate() {
        let expected = single.raw_eigenvalues[j / 2];
        assert!((mu - expected).abs() < 1e-6 * (1.0 + mu), "{j}: {mu} {expected}");
        // what λ has beside μ comes from modes, which are less accurate
        let [lambda, expected] = [found.eigenvalues[j], single.eigenvalues[j / 2]].map(Option::unwrap);
        assert!((lambda - expected).abs() < 1e-4 * (1.0 + lambda), "{j}: {lambda} {expected}");
    }
}

#[test]
fn outliers_carry_no_result_and_are_counted() {
    let mut points = fibonacci_sphere(1_000);
    points.extend([50.0, 0.0, 0.0, 0.0, 70.0, 0.0]);
    points.extend([f64::NAN, 0.0, 0.0]);
    points.extend(&fibonacci_sphere(1_000)[..3]);
    let analysis = eigen(&cloud(3, points), &parameters(PbMhb, 10));
    assert_eq!((analysis.report.isolated, analysis.report.nonfinite, analysis.report.duplicates), (2, 1, 1));
    assert_eq!(analysis.report.points_used, 1_000);
    let basis = analysis.basis(3);
    assert!(basis[1_000..1_003].iter().all(|x| x.is_nan()));
    assert_eq!(basis[1_003].to_bits(), basis[0].to_bits());
    assert_eq!(analysis.mass()[1_003].to_bits(), 0.0_f64.to_bits());
    assert!(
        analysis
            .report
            .warnings
            .iter()
            .any(|warning| warning.starts_with("2 points (rows 1000, 1001) lie off"))
    );
}

#[rstest]
#[case(PbMhb)]
#[case(Voronoi)]
fn every_size_from_five_points_upward_gives_as_many_bases_as_points(#[case] kind: OperatorKind) {
    for n in [5, 6, 7, 9, 13, 40] {
        let wide = Parameters { t_factor: Some(4.0), ..parameters(kind, n - 1) };
        let analysis = eigen(&cloud(3, fibonacci_sphere(n)), &wide);
        assert_eq!(analysis.bases(), n - 1, "{n} points");
    }
}

#[test]
fn a_canceled_analysis_says_so() {
    let progress = Progress::new();
    progress.cancel();
    let result = analyze(&cloud(3, fibonacci_sphere(100)), JobKind::Eigen, &parameters(PbMhb, 5), &progress);
    assert_eq!(result.unwrap_err(), AnalysisError::Canceled(Canceled));
}

#[test]
fn more_bases_than_points_and_a_cut_off_that_reaches_everything_are_refused() {
    let points = cloud(3, fibonacci_sphere(16_000));
    let run =
        |parameters: Parameters| analyze(&points, JobKind::Eigen, &parameters, &Progress::new()).unwrap_err();
    assert!(matches!(run(parameters(PbMhb, 16_001)), AnalysisError::Parameter { name: "bases", .. }));
    // With a shorter time the Gaussian is zero long before the cut-off, and nothing is coupled there.
    let wide = Parameters { t: Some(1.0), delta: Some(3.0), ..parameters(PbMhb, 10) };
    assert!(matches!(run(wide), AnalysisError::Parameter { name: "delta", .. }));
}

#[test]
fn a_volume_is_computed_with_the_warning_that_it_is_no_surface() {
    let volume = (0..3 * 2_000).map(crate::hashed).collect();
    let warned = |points| {
        let report = eigen(&cloud(3, points), &parameters(Voronoi, 5)).report;
        report.warnings.iter().any(|warning| warning.starts_with("most neighborhoods look 3-dimensional"))
    };
    assert!(warned(volume));
    assert!(!warned(fibonacci_sphere(2_000)));
}
