//! Bases of a part of the points, brought to all rows.

use chladni::Method;
use chladni::analysis::{AnalysisError, JobKind, Parameters, analyze};
use chladni::cloud::shapes::{SampleRequest, Shape, sample};
use chladni::operator::OperatorKind;
use chladni::progress::Progress;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{cloud, eigen, parameters};

#[test]
fn rows_keep_their_points_whatever_was_solved() {
    let n = 12_000;
    let mut rows = sample(&SampleRequest::new(Shape::BumpySphere, n)).unwrap().coordinates().to_vec();
    rows.extend_from_within(3 * 70..3 * 80);
    rows.extend([f64::NAN, 0.0, 0.0]);
    let cloud = cloud(3, rows);
    for operator in [OperatorKind::Voronoi, OperatorKind::PbMhb] {
        let exact = eigen(&cloud, &parameters(operator, 12));
        let thinned = Parameters { solved_points: Some(3_000), ..parameters(operator, 12) };
        let found = eigen(&cloud, &thinned);
        let spectrum = |of: &chladni::Analysis| of.report.spectrum.clone().unwrap();
        let (exact_spectrum, found_spectrum) = (spectrum(&exact), spectrum(&found));
        assert_eq!(found_spectrum.method, Method::Prolonged);
        assert!(found_spectrum.solved_points.unwrap() < 3_000);
        assert_eq!(exact_spectrum.solved_points, Some(n));
        for (one, other) in exact_spectrum.raw_eigenvalues.iter().zip(&found_spectrum.raw_eigenvalues) {
            assert!((one - other).abs() <= 1e-3 * one + 1e-9, "{one} {other}");
        }
        assert_eq!(exact.mass().len(), found.mass().len());
        let short = Progress::new().within(1_000_000);
        let in_file = analyze(&cloud, JobKind::Eigen, &thinned, &short).unwrap();
        let refused =
            Progress::new().within(1_000_000).scratch_by(|_| Err(std::io::ErrorKind::StorageFull.into()));
        let refused = analyze(&cloud, JobKind::Eigen, &thinned, &refused);
        assert!(matches!(refused.err(), Some(AnalysisError::Scratch(_))), "{operator:?}: it asks for a file");
        assert_eq!(in_file.report, found.report);
        for j in [0, 11] {
            let bits = |of: &chladni::Analysis| of.basis(j).into_iter().map(f64::to_bits).collect::<Vec<_>>();
            assert_eq!(bits(&in_file), bits(&found), "from a file");
        }
        let mass = exact.mass();
        for j in 0..12 {
            let (one, other) = (exact.basis(j), found.basis(j));
            assert_eq!(other.len(), n + 11);
            assert!(other[n + 10].is_nan() && (0..10).all(|i| other[n + i] == other[70 + i]));
            let along: f64 = (0..n).map(|i| mass[i] * one[i] * other[i]).sum();
            // also of the last ones, although the seven of the sphere's next degree go on behind them
            assert!((along.abs() - 1.0).abs() < 1e-2, "{operator:?} {j}: {along}");
        }
    }
}

/// At rims, and most of all where the points are random, the weights of a sample extrapolate.
#[test]
fn random_surfaces_with_rims_can_be_thinned_out() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut rows = |of: &dyn Fn([f64; 2]) -> [f64; 3]| -> Vec<f64> {
        (0..16_000).flat_map(|_| of([random.random(), random.random()])).collect()
    };
    let square = rows(&|[x, y]| [x, y, 0.0]);
    let uneven_cylinder = rows(&|[a, z]| {
        let (sine, cosine) = (std::f64::consts::TAU * a).sin_cos();
        [cosine, sine, 3.0 * z.powf(1.5)]
    });
    for rows in [square, uneven_cylinder] {
        let cloud = cloud(3, rows);
        for operator in [OperatorKind::Voronoi, OperatorKind::PbMhb] {
            let exact = eigen(&cloud, &parameters(operator, 12)).report.spectrum.unwrap();
            let thinned = Parameters { solved_points: Some(4_000), ..parameters(operator, 12) };
            let found = eigen(&cloud, &thinned).report.spectrum.unwrap();
            assert_eq!(found.method, Method::Prolonged);
            assert!(found.certificates.dual_residual.unwrap() < 1e-2, "{:?}", found.dual_residuals);
            for (one, other) in exact.raw_eigenvalues.iter().zip(&found.raw_eigenvalues) {
                assert!((one - other).abs() <= 1e-3 * one + 1e-9, "{operator:?}: {one} {other}");
            }
        }
    }
}

#[test]
fn exact_results_have_bounds_too_and_they_are_small() {
    let cloud = sample(&SampleRequest::new(Shape::Torus, 4_000)).unwrap();
    for operator in [OperatorKind::Voronoi, OperatorKind::PbMhb, OperatorKind::WeightedGraph] {
        let spectrum = eigen(&cloud, &parameters(operator, 20)).report.spectrum.unwrap();
        let bounds = spectrum.dual_residuals.unwrap();
        assert_eq!(bounds.len(), 20);
        assert!(bounds.iter().all(|bound| (0.0..2e-4).contains(bound)), "{operator:?}: {bounds:?}");
        assert_eq!(spectrum.certificates.dual_residual, bounds.iter().copied().reduce(f64::max));
    }
    let spectrum = eigen(&cloud, &parameters(OperatorKind::Pcd, 8)).report.spectrum.unwrap();
    assert_eq!((spectrum.dual_residuals, spectrum.certificates.dual_residual), (None, None));
}

#[test]
fn what_cannot_be_thinned_out_is_solved_whole_and_says_so() {
    let sphere = sample(&SampleRequest::new(Shape::Sphere, 3_000)).unwrap();
    let few = Parameters { solved_points: Some(1_000), ..parameters(OperatorKind::Voronoi, 100) };
    let report = eigen(&sphere, &few).report;
    assert_eq!(report.spectrum.unwrap().solved_points, Some(3_000));
    assert!(report.warnings.iter().any(|warning| warning.contains("could not be thinned out")));
    let both = Parameters { exact: true, ..few };
    let refused = analyze(&sphere, JobKind::Eigen, &both, &Progress::new());
    assert!(matches!(refused, Err(AnalysisError::Parameter { name: "solved_points", .. })));
}
