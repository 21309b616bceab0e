//! Clouds as scanners make them: ties, steps of density, lines, noise, copies.

use std::f64::consts::PI;

use chladni::analysis::{AnalysisError, JobKind, Parameters, analyze, analyze_by};
use chladni::geometry::survey::Rules;
use chladni::operator::OperatorKind::{self, PbMhb, Voronoi};
use chladni::progress::Progress;
use rstest::rstest;

use crate::{cloud, eigen, eigenvalues, fibonacci_sphere, hashed, parameters, worst_error};

/// Eigenvalues of the unit sphere, zero left out, the first levels whole.
fn sphere(levels: usize) -> Vec<f64> {
    (1..=levels).flat_map(|l| std::iter::repeat_n((l * (l + 1)) as f64, 2 * l + 1)).collect()
}

/// Eigenvalues of the unit square with free rims, zero left out.
fn square(count: usize) -> Vec<f64> {
    let mut exact: Vec<f64> =
        (0..400_u32).map(|k| PI * PI * f64::from((k / 20).pow(2) + (k % 20).pow(2))).collect();
    exact.sort_unstable_by(f64::total_cmp);
    exact[1..=count].to_vec()
}

/// `rings` − 1 rings of twice as many points and two poles: every distance occurs many times.
fn latlong(rings: u32) -> Vec<f64> {
    let step = PI / f64::from(rings);
    let mut points: Vec<f64> = (1..rings)
        .flat_map(|i| (0..2 * rings).map(move |j| (step * f64::from(i), step * f64::from(j))))
        .flat_map(|(theta, phi)| [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()])
        .collect();
    points.extend([0.0, 0.0, 1.0, 0.0, 0.0, -1.0]);
    points
}

/// Independent points of the unit sphere.
fn iid_sphere(n: u64) -> Vec<f64> {
    (0..n)
        .flat_map(|i| {
            let (z, angle) = (2.0 * hashed(2 * i) - 1.0, 2.0 * PI * hashed(2 * i + 1));
            let radius = (1.0 - z * z).sqrt();
            [radius * angle.cos(), radius * angle.sin(), z]
        })
        .collect()
}

#[test]
fn equal_distances_put_no_neighbor_twice_into_a_row() {
    for rings in 17..40 {
        let points = cloud(3, latlong(rings));
        let analysis =
            analyze(&points, JobKind::Operator, &parameters(Voronoi, 30), &Progress::new()).unwrap();
        let matrix = analysis.operator_matrix().unwrap();
        assert!(matrix.is_symmetric(), "{rings}");
        for row in matrix.offsets.windows(2) {
            let columns = &matrix.columns[row[0] as usize..row[1] as usize];
            assert!(columns.windows(2).all(|pair| pair[0] < pair[1]), "{rings}");
        }
    }
}

#[rstest]
#[case(Voronoi)]
#[case(PbMhb)]
fn latitudes_and_longitudes_have_the_spectrum_of_the_sphere(#[case] kind: OperatorKind) {
    for rings in [17, 29, 64] {
        let found = eigenvalues(&eigen(&cloud(3, latlong(rings)), &parameters(kind, 26)));
        let bound = 0.08 * (17.0 / f64::from(rings)).powi(2) + 0.015;
        assert!(worst_error(&found, &sphere(4)) < bound, "{rings}: {}", worst_error(&found, &sphere(4)));
    }
}

/// 400 points take the dense solver, 1,500 the iterations.
#[rstest]
#[case(Voronoi, 400)]
#[case(Voronoi, 1_500)]
#[case(PbMhb, 400)]
#[case(PbMhb, 1_500)]
fn eigenvalues_times_squared_lengths_do_not_depend_on_the_unit(#[case] kind: OperatorKind, #[case] n: u64) {
    let points = iid_sphere(n);
    let exact = Parameters { tolerance: 1e-9, ..parameters(kind, 25) };
    let expected = eigenvalues(&eigen(&cloud(3, points.clone()), &exact));
    for scale in [1e-9, 1e-6, 3e-3, 1e5, 1e9] {
        let scaled = cloud(3, points.iter().map(|x| scale * x).collect());
        let analysis = eigen(&scaled, &exact);
        let found: Vec<f64> = eigenvalues(&analysis).iter().map(|value| value * scale * scale).collect();
        assert!(
            worst_error(&found, &expected[1..]) < 1e-10,
            "{scale}: {}",
            worst_error(&found, &expected[1..])
        );
        let area: f64 = analysis.mass().iter().sum();
        assert!((area / (scale * scale) / analysis.report.sampling.area * scale * scale - 1.0).abs() < 1e-12);
    }
}

/// One half of the sphere with so many times the points of the other.
#[rstest]
#[case(Voronoi, 16, 0.03)]
#[case(Voronoi, 32, 0.05)]
#[case(PbMhb, 16, 0.03)]
fn a_step_of_density_is_no_hole(#[case] kind: OperatorKind, #[case] ratio: usize, #[case] bound: f64) {
    let (dense, sparse) = (fibonacci_sphere(8_000), fibonacci_sphere(8_000 / ratio));
    let mut points: Vec<f64> = dense.chunks(3).filter(|p| p[2] >= 0.0).flatten().copied().collect();
    points.extend(sparse.chunks(3).filter(|p| p[2] < 0.0).flatten());
    let analysis = eigen(&cloud(3, points), &parameters(kind, 17));
    let found = eigenvalues(&analysis);
    assert_eq!(analysis.report.components, 1);
    assert!(worst_error(&found, &sphere(3)) < bound, "{}", worst_error(&found, &sphere(3)));
}

/// Lines around a cylinder eight times as far apart as the points on them.
#[test]
fn lines_of_a_scanner_are_one_surface() {
    let (lines, along) = (22, 275);
    let points = (0..lines * along)
        .flat_map(|i| {
            let angle = 2.0 * PI * f64::from(i % along) / f64::from(along);
            [angle.cos(), angle.sin(), 2.0 * f64::from(i / along) / f64::from(lines - 1)]
        })
        .collect();
    let mut exact: Vec<f64> = (-9..10)
        .flat_map(|a: i32| (0..9).map(move |b| f64::from(a * a) + (0.5 * PI * f64::from(b)).powi(2)))
        .collect();
    exact.sort_by(f64::total_cmp);
    let analysis = eigen(&cloud(3, points), &parameters(Voronoi, 20));
    assert_eq!(analysis.report.components, 1);
    let found = eigenvalues(&analysis);
    assert!(worst_error(&found, &exact[1..20]) < 0.04, "{}", worst_error(&found, &exact[1..20]));
}

/// A square whose points are twice as far apart in one direction as in the other: λ₁ = λ₂ = π².
#[rstest]
#[case(Voronoi)]
#[case(PbMhb)]
fn a_lattice_of_two_spacings_is_a_square(#[case] kind: OperatorKind) {
    let points =
        (0..57 * 112).flat_map(|i| [f64::from(i % 57) / 56.0, f64::from(i / 57) / 111.0, 0.0]).collect();
    let found = eigenvalues(&eigen(&cloud(3, points), &parameters(kind, 4)));
    let worst = worst_error(&found, &[PI * PI; 2]);
    assert!(worst < 0.01, "{worst} {found:?}");
}

/// The floor around a tripod of 1.5 m, a ring for every degree from 34.38° to 79.38°: rings near the rim are 18 times as far
/// apart as those within, and points of a ring stand 2 to 5 times as dense as rings.
#[rstest]
#[case(Voronoi)]
#[case(PbMhb)]
fn the_floor_around_a_tripod_is_an_annulus(#[case] kind: OperatorKind) {
    let points = (0..46 * 360)
        .flat_map(|i| {
            let radius = 1.5 * (34.38 + f64::from(i / 360)).to_radians().tan();
            let angle = f64::from(i % 360).to_radians();
            [radius * angle.cos(), radius * angle.sin(), 0.0]
        })
        .collect();
    let found = eigenvalues(&eigen(&cloud(3, points), &parameters(kind, 6)));
    // k², the first zero of J₁′(a k) Y₁′(b k) − J₁′(b k) Y₁′(a k) for a = 1.0263, b = 8 (mpmath 1.3.0).
    let worst = worst_error(&found, &[0.049_527_958; 2]);
    assert!(worst < 0.02, "{worst} {found:?}");
}

/// Noise along the normals, as a share of the spacing, lengthens distances; smoothed it does not.
#[rstest]
#[case(Voronoi, 0.25, 0.03)]
#[case(PbMhb, 0.25, 0.03)]
#[case(Voronoi, 0.5, 0.06)]
fn noise_is_told_and_taken_out_of_lengths(
    #[case] kind: OperatorKind,
    #[case] share: f64,
    #[case] bound: f64,
) {
    let n = 6_000;
    let spacing = (4.0 * PI / f64::from(n)).sqrt();
    let mut points = fibonacci_sphere(n as usize);
    for (i, p) in points.chunks_mut(3).enumerate() {
        // a sum of twelve uniform numbers is nearly normal
        let normal: f64 = (0..12).map(|k| hashed(12 * i as u64 + k)).sum::<f64>() - 6.0;
        for x in p.iter_mut() {
            *x *= 1.0 + share * spacing * normal;
        }
    }
    let analysis = eigen(&cloud(3, points), &parameters(kind, 17));
    let found = eigenvalues(&analysis);
    assert!(worst_error(&found, &sphere(3)) < bound, "{}", worst_error(&found, &sphere(3)));
    let noise = analysis.report.fidelity.unwrap().noise;
    assert!((noise / share - 1.0).abs() < 0.25, "{noise}");
    assert!(analysis.report.warnings.iter().any(|warning| warning.contains("scatter")));
}

/// A copy in single precision, and five frames with a jitter of a thousandth of the spacing.
#[rstest]
#[case(Voronoi)]
#[case(PbMhb)]
fn repetitions_are_one_point_and_every_row_has_its_result(#[case] kind: OperatorKind) {
    let points = fibonacci_sphere(2_000);
    let mut copied = points.clone();
    copied.extend(points.iter().map(|&x| f64::from(x as f32)));
    let jittered: Vec<f64> =
        (0..5 * points.len()).map(|k| points[k % points.len()] + 8e-5 * (hashed(k as u64) - 0.5)).collect();
    let expected = eigenvalues(&eigen(&cloud(3, points), &parameters(kind, 10)));
    for (repeated, merged) in [(copied, 2_000), (jittered, 8_000)] {
        let analysis = eigen(&cloud(3, repeated), &parameters(kind, 10));
        assert_eq!(analysis.report.fidelity.unwrap().merged, merged);
        assert!((analysis.report.sampling.area / (4.0 * PI) - 1.0).abs() < 0.01);
        assert!(worst_error(&eigenvalues(&analysis), &expected[1..]) < 0.002);
        assert!(analysis.basis(3).iter().all(|x| x.is_finite()));
        assert!((analysis.mass().iter().sum::<f64>() / analysis.report.sampling.area - 1.0).abs() < 1e-12);
    }
}

#[test]
fn lengths_beyond_all_sense_are_refused_before_any_work() {
    let points = cloud(3, fibonacci_sphere(200));
    let default = || parameters(PbMhb, 10);
    for (name, beyond) in [
        ("t", Parameters { t: Some(1e308), ..default() }),
        ("t", Parameters { t: Some(1e-308), ..default() }),
        ("epsilon", Parameters { epsilon: Some(1e308), ..default() }),
        ("delta", Parameters { delta: Some(1e308), ..default() }),
        ("t_factor", Parameters { t_factor: Some(1e308), ..default() }),
        ("delta_factor", Parameters { delta_factor: Some(1e308), ..default() }),
    ] {
        let error = analyze(&points, JobKind::Eigen, &beyond, &Progress::new()).unwrap_err();
        assert!(matches!(error, AnalysisError::Parameter { name: found, .. } if found == name), "{error}");
    }
}

/// `Δz = −2z` on the unit sphere: the error falls as there are more points.
#[test]
fn an_applied_operator_converges_on_independent_points() {
    let errors = [1_000, 8_000].map(|n| {
        let points = iid_sphere(n);
        let z: Vec<f64> = points.chunks(3).map(|p| p[2]).collect();
        let analysis =
            analyze(&cloud(3, points), JobKind::Operator, &parameters(PbMhb, 10), &Progress::new()).unwrap();
        let found = analysis.laplacian_of(&z).unwrap();
        let squares = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>();
        let off = squares(&mut found.iter().zip(&z).map(|(found, z)| found + 2.0 * z));
        (off / squares(&mut z.iter().map(|z| 2.0 * z))).sqrt()
    });
    assert!(errors[1] < 0.1 && errors[1] < errors[0], "{errors:?}");
}

#[rstest]
#[case(Voronoi)]
#[case(PbMhb)]
fn a_random_square_ends_where_it_ends(#[case] operator: OperatorKind) {
    let points = cloud(3, (0..4_000).flat_map(|i| [hashed(2 * i), hashed(2 * i + 1), 0.0]).collect());
    let worst = |extend_rims| {
        let rules = Rules { extend_rims, ..Rules::default() };
        let found =
            analyze_by(rules, &points, JobKind::Eigen, &parameters(operator, 30), &Progress::new()).unwrap();
        worst_error(&eigenvalues(&found), &square(29))
    };
    let (without, with) = (worst(false), worst(true));
    assert!(with < 0.03 && with < 0.7 * without, "{without} {with}");
}

/// Independent points of the unit sphere, a hundred times as dense at one pole as at the other.
fn uneven_sphere(n: usize) -> Vec<f64> {
    let mut kept = Vec::new();
    for i in 0_u64.. {
        let (z, angle) = (2.0 * hashed(3 * i) - 1.0, 2.0 * PI * hashed(3 * i + 1));
        if hashed(3 * i + 2) < 100.0_f64.powf(-0.5 * (z + 1.0)) {
            let radius = (1.0 - z * z).sqrt();
            kept.extend([radius * angle.cos(), radius * angle.sin(), z]);
        }
        if kept.len() == 3 * n {
            break;
        }
    }
    kept
}

#[test]
fn times_follow_the_spacing_where_the_modes_that_are_asked_for_allow_it() {
    let points = cloud(3, uneven_sphere(8_000));
    let found = |bases, local_bandwidth| {
        let parameters = Parameters { local_bandwidth, ..parameters(PbMhb, bases) };
        let analysis = eigen(&points, &parameters);
        (
            analysis.report.additions.local_bandwidth,
            worst_error(&eigenvalues(&analysis), &sphere(10)[..bases - 1]),
        )
    };
    let (few, many, forced) = (found(30, None), found(100, None), found(100, Some(true)));
    let of_one = found(30, Some(false));
    assert!(few.0 && few.1 < 0.6 * of_one.1, "{few:?} {of_one:?}");
    assert!(!many.0 && many.1 < 0.25, "{many:?}");
    // each time as long as the spacing asks for: 390 %
    assert!(forced.0 && forced.1 < 0.4, "{forced:?}");
}

/// By hand: what a mean over all directions adds is a strip of 0.27 √(2t), 0.8 % of a square of 61 × 61 points.
#[test]
fn kernels_are_right_along_rims() {
    let points: Vec<f64> =
        (0..61 * 61).flat_map(|i| [f64::from(i % 61) / 60.0, f64::from(i / 61) / 60.0, 0.0]).collect();
    let [without, with] = [false, true].map(|calibrate_rims| {
        let rules = Rules { calibrate_rims, ..Rules::default() };
        let parameters = parameters(PbMhb, 26);
        let found =
            analyze_by(rules, &cloud(3, points.clone()), JobKind::Eigen, &parameters, &Progress::new());
        worst_error(&eigenvalues(&found.unwrap()), &square(25))
    });
    assert!(with < 0.005 && with < 0.5 * without, "{without} {with}");
}

/// A cap of a sphere whose points are fewer than a hundredth of all and three times as far apart.
#[test]
fn kernels_reach_beyond_the_cells_of_a_sparse_part() {
    let all = fibonacci_sphere(8_000);
    let kept = all.chunks_exact(3).enumerate().filter(|(i, p)| p[2] < 0.92 || i % 9 == 0);
    let points: Vec<f64> = kept.flat_map(|(_, p)| p.to_vec()).collect();
    let analyzed = |widen_kernels, parameters: &Parameters| {
        let rules = Rules { widen_kernels, ..Rules::default() };
        analyze_by(rules, &cloud(3, points.clone()), JobKind::Eigen, parameters, &Progress::new()).unwrap()
    };
    let asked = parameters(PbMhb, 30);
    let [without, with] = [false, true].map(|widen_kernels| analyzed(widen_kernels, &asked));
    let [narrow, wide] = [&without, &with].map(|found| worst_error(&eigenvalues(found), &sphere(4)));
    assert!(wide < 0.8 * narrow, "{narrow} {wide}");
    assert!(with.report.neighbors <= 2.1 * without.report.neighbors, "{}", with.report.neighbors);
    let told = [&without, &with].map(|found| found.report.additions);
    assert!(told.iter().all(|additions| !additions.local_bandwidth));
    assert_eq!(told.map(|additions| additions.wide_kernels), [false, true]);
    // the parameters that the report calls used make the same of it again
    let again = analyzed(true, &asked.as_used(&with.report));
    assert_eq!(eigenvalues(&again), eigenvalues(&with));
    // a cut-off that was chosen is that of all points
    let delta = with.report.heat_kernel.map(|kernel| kernel.delta);
    let chosen = analyzed(true, &Parameters { delta, ..asked });
    assert!(!chosen.report.additions.wide_kernels);
}
