//! The papers' operators: an oracle from outside, closed forms in one and three dimensions, symmetry, definiteness.

use chladni::analysis::{Analysis, AnalysisError, JobKind, Parameters, SparseMatrix, analyze};
use chladni::cloud::reader::{Format, Limits, ReadOptions, read};
use chladni::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
use chladni::cloud::{NonFinite, PointCloud};
use chladni::operator::OperatorKind::{
    self, Cotangent, Graph, Kirchhoff, Mesh, PbMhb, Pcd, PcdSymmetrized, Tutte, Voronoi, WeightedGraph,
};
use chladni::operator::{Distance, Parameterization};
use chladni::progress::Progress;
use nalgebra::DMatrix;
use rstest::rstest;

use crate::{cloud, eigen, eigenvalues, fibonacci_sphere, hashed, parameters, worst_error};

fn built(cloud: &PointCloud, parameters: &Parameters) -> Analysis {
    analyze(cloud, JobKind::Operator, parameters, &Progress::new()).unwrap()
}

/// `Q` and the diagonal of `B`.
fn matrices(cloud: &PointCloud, parameters: &Parameters) -> (SparseMatrix, Vec<f64>) {
    let analysis = built(cloud, parameters);
    (analysis.operator_matrix().unwrap(), analysis.mass())
}

fn dense(matrix: &SparseMatrix) -> DMatrix<f64> {
    let n = matrix.offsets.len() - 1;
    let mut dense = DMatrix::zeros(n, n);
    for i in 0..n {
        for k in matrix.offsets[i] as usize..matrix.offsets[i + 1] as usize {
            dense[(i, matrix.columns[k] as usize)] = matrix.values[k];
        }
    }
    dense
}

/// A sphere or torus with faces, so that all operators can be built.
fn meshed_torus(points: usize) -> PointCloud {
    let request = SampleRequest { sampling: Sampling::Grid, ..SampleRequest::new(Shape::Torus, points) };
    sample(&request).unwrap()
}

#[test]
#[ignore = "needs the scans in ../shared/data: run with --ignored where they are"]
fn pcd_is_that_of_its_authors_own_program_on_48_points_of_a_sphere() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/sphere48.csv");
    let bytes = std::fs::read(path).unwrap();
    let options =
        ReadOptions { policy: NonFinite::Reject, limits: Limits::default(), ..ReadOptions::default() };
    let cloud = read(&bytes, Format::Csv, &options).unwrap();
    let of_authors =
        Parameters { parameterization: Some(Parameterization::NearestTen), ..parameters(Pcd, 10) };
    let (q, mass) = matrices(&cloud, &of_authors);
    // rows and columns 0–2, from that program (version and options in the project's notes on numerics, §5)
    let expected = [
        [-0.869_603_84, 0.099_091_61, 0.010_678_18],
        [0.001_022_83, -0.856_228_93, 0.043_061_36],
        [0.001_975_25, 0.026_412_19, -0.864_485_71],
    ];
    let q = dense(&q);
    for i in 0..3 {
        for j in 0..3 {
            let found = q[(i, j)] / mass[i];
            assert!((found - expected[i][j]).abs() < 1e-8, "({i}, {j}): {found} {}", expected[i][j]);
        }
    }
    assert!((0..3).all(|i| (0..48).all(|j| q[(i, j)] != 0.0)), "all 48 columns are non-zero");
}

#[rstest]
#[case(PbMhb)]
#[case(Voronoi)]
#[case(Mesh)]
#[case(Cotangent)]
#[case(WeightedGraph)]
#[case(Graph)]
#[case(Kirchhoff)]
#[case(Tutte)]
fn every_symmetrizable_operator_is_symmetric_semidefinite_and_zero_on_its_null_function(
    #[case] kind: OperatorKind,
) {
    let (q, mass) = matrices(&meshed_torus(600), &parameters(kind, 10));
    assert!(q.is_symmetric());
    assert!(mass.iter().all(|&b| b > 0.0));
    let q = dense(&q);
    let n = q.nrows();
    let null: Vec<f64> = match kind {
        // I − D^-½ A D^-½ maps D^½ 1 to zero; its off-diagonals are −1/√(d_i d_j)
        Graph => {
            let kirchhoff = dense(&matrices(&meshed_torus(600), &parameters(Kirchhoff, 10)).0);
            (0..n).map(|i| (-kirchhoff[(i, i)]).sqrt()).collect()
        }
        _ => vec![1.0; n],
    };
    let zero = &q * nalgebra::DVector::from_vec(null);
    assert!(zero.amax() < 1e-11 * q.amax(), "{}", zero.amax());
    let largest = q.symmetric_eigenvalues().max();
    assert!(largest < 1e-11 * (-q.trace()), "−Q has the negative eigenvalue {}", -largest);
}

#[test]
fn pcd_has_zero_row_sums_and_no_symmetry_and_its_symmetric_part_is_the_other_operator() {
    let points = cloud(
        3,
        fibonacci_sphere(400).iter().enumerate().map(|(i, x)| x + 0.02 * hashed(i as u64)).collect(),
    );
    let (q, mass) = matrices(&points, &parameters(Pcd, 10));
    let (symmetrized, ones) = matrices(&points, &parameters(PcdSymmetrized, 10));
    assert!(!q.is_symmetric() && symmetrized.is_symmetric());
    assert!(ones.iter().all(|&b| b == 1.0));
    let mut laplacian = dense(&q);
    for i in 0..400 {
        let row = laplacian.row(i);
        assert!(row.sum().abs() < 1e-12 * row.amax());
        laplacian.row_mut(i).scale_mut(1.0 / mass[i]);
    }
    let half = 0.5 * (&laplacian + laplacian.transpose());
    assert!((half - dense(&symmetrized)).amax() < 1e-12 * laplacian.amax());
}

/// Its parts are thin beside δ: the projection of a whole ball lays the far side between the near one's points.
#[test]
fn pcd_on_one_sheet_has_the_spectrum_of_a_thin_surface_and_on_whole_balls_has_not() {
    let torus = sample(&SampleRequest::new(Shape::TwoHoleTorus, 2_000)).unwrap();
    let expected = eigenvalues(&eigen(&torus, &parameters(Voronoi, 6)));
    let error = |sheet_aware| {
        let distance = Some(Distance::Projected);
        let parameters = Parameters { sheet_aware: Some(sheet_aware), distance, ..parameters(Pcd, 7) };
        worst_error(&eigenvalues(&eigen(&torus, &parameters)), &expected[1..])
    };
    assert!(error(true) < 0.08, "{}", error(true));
    assert!(error(false) > 0.3, "{}", error(false));
}

#[test]
fn pcd_tells_complex_eigenvalues_and_that_its_bases_are_not_orthogonal() {
    // 900 points are solved by iteration, 450 densely
    for n in [450, 900] {
        let points = cloud(
            3,
            fibonacci_sphere(n).iter().enumerate().map(|(i, x)| x + 0.03 * hashed(i as u64)).collect(),
        );
        let analysis = eigen(&points, &Parameters { tolerance: 1e-8, ..parameters(Pcd, 16) });
        let spectrum = analysis.report.spectrum.as_ref().unwrap();
        let parts = spectrum.imaginary_parts.as_ref().unwrap();
        assert_eq!(parts.len(), 16);
        assert!(spectrum.residuals.iter().all(|&r| r < 1e-7), "{:?}", spectrum.residuals);
        // conjugate pairs, unless the last is cut
        assert!(parts[..15].windows(2).all(|pair| pair[0] <= 0.0 || pair[0] == -pair[1]));
        assert!(spectrum.certificates.orthogonality > 1e-9);
        assert!(analysis.report.warnings.iter().any(|warning| warning.contains("not symmetrizable")));
        let exact: Vec<f64> = [2.0; 3].into_iter().chain([6.0; 5]).chain([12.0; 6]).collect();
        let worst = worst_error(&eigenvalues(&analysis), &exact);
        assert!(worst < 0.15, "{worst}");
        let (q, mass) = matrices(&points, &parameters(Pcd, 16));
        let mut pencil = dense(&q);
        (0..n).for_each(|i| pencil.row_mut(i).scale_mut(-1.0 / mass[i]));
        let mut all: Vec<(f64, f64)> =
            pencil.complex_eigenvalues().iter().map(|value| (value.re, value.im.abs())).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (j, &raw) in spectrum.raw_eigenvalues.iter().enumerate() {
            assert!((raw - all[j].0).abs() < 1e-5 * (1.0 + raw.abs()), "n = {n}, {j}: {raw} {:?}", all[j]);
        }
    }
}

#[test]
fn the_symmetrized_pcd_agrees_with_a_dense_solver() {
    let points = cloud(3, fibonacci_sphere(700));
    let found = eigen(&points, &Parameters { tolerance: 1e-8, ..parameters(PcdSymmetrized, 12) });
    let (q, _) = matrices(&points, &parameters(PcdSymmetrized, 12));
    let mut all: Vec<f64> = (-dense(&q)).symmetric_eigenvalues().iter().copied().collect();
    all.sort_by(f64::total_cmp);
    let raw = &found.report.spectrum.as_ref().unwrap().raw_eigenvalues;
    for (j, value) in raw.iter().enumerate() {
        assert!((value - all[j]).abs() < 1e-6 * (1.0 + value.abs()), "{j}: {value} {}", all[j]);
    }
}

#[rstest]
#[case(PbMhb, 0.01)]
#[case(Voronoi, 0.005)]
#[case(Pcd, 0.05)]
fn a_closed_curve_has_the_squares_of_integers_over_its_radius(
    #[case] kind: OperatorKind,
    #[case] bound: f64,
) {
    // a circle of radius 2 in R³, tilted: λ = (l/2)², twice each
    let circle = (0..800).flat_map(|i| {
        let angle = std::f64::consts::TAU * f64::from(i) / 800.0;
        [2.0 * angle.cos(), 1.6 * angle.sin(), 1.2 * angle.sin()]
    });
    let one = Parameters { dimension: 1, ..parameters(kind, 12) };
    let analysis = eigen(&cloud(3, circle.collect()), &one);
    let exact: Vec<f64> = (2..=11).map(|j| f64::from((j / 2) * (j / 2)) / 4.0).collect();
    let worst = worst_error(&eigenvalues(&analysis), &exact);
    assert!(worst < bound, "{worst}");
    assert_eq!(analysis.report.dimension_estimate, 1);
    let length = 4.0 * std::f64::consts::PI;
    assert!((analysis.report.sampling.area / length - 1.0).abs() < 1e-3);
}

#[rstest]
#[case(PbMhb, 0.06)]
#[case(Voronoi, 0.06)]
fn a_flat_torus_in_six_dimensions_has_the_squared_lengths_of_integer_vectors(
    #[case] kind: OperatorKind,
    #[case] bound: f64,
) {
    // λ = |m|², m in Z³: 1 six times, 2 twelve times, 3 eight times
    let torus = sample(&SampleRequest::new(Shape::FlatTorus6, 4_000)).unwrap();
    let three = Parameters { dimension: 3, ..parameters(kind, 22) };
    let analysis = eigen(&torus, &three);
    let exact: Vec<f64> = [1.0; 6].into_iter().chain([2.0; 12]).collect();
    let worst = worst_error(&eigenvalues(&analysis), &exact);
    assert!(worst < bound, "{worst}");
    let volume = std::f64::consts::TAU.powi(3);
    assert!((analysis.report.sampling.area / volume - 1.0).abs() < 0.05, "{}", analysis.report.sampling.area);
    assert_eq!(analysis.report.dimension_estimate, 3);
}

#[test]
fn a_flat_torus_in_four_dimensions_has_the_squared_lengths_of_integer_vectors_of_the_plane() {
    let torus = sample(&SampleRequest::new(Shape::FlatTorus4, 4_000)).unwrap();
    let exact: Vec<f64> = [1.0; 4].into_iter().chain([2.0; 4]).chain([4.0; 4]).chain([5.0; 8]).collect();
    for (kind, bound) in [(PbMhb, 0.02), (Voronoi, 0.01)] {
        let worst = worst_error(&eigenvalues(&eigen(&torus, &parameters(kind, 24))), &exact);
        assert!(worst < bound, "{kind:?}: {worst}");
    }
}

#[test]
fn mesh_operators_have_the_spectrum_of_the_sphere_on_its_own_mesh() {
    let request = SampleRequest { sampling: Sampling::Grid, ..SampleRequest::new(Shape::Sphere, 4_000) };
    let sphere = sample(&request).unwrap();
    let exact: Vec<f64> = [2.0; 3].into_iter().chain([6.0; 5]).collect();
    for (kind, bound) in [(Cotangent, 0.01), (Mesh, 0.02)] {
        let worst = worst_error(&eigenvalues(&eigen(&sphere, &parameters(kind, 12))), &exact);
        assert!(worst < bound, "{kind:?}: {worst}");
    }
}

#[test]
fn tutte_and_graph_share_their_spectrum_and_the_weighted_graph_has_that_of_the_sphere() {
    let sphere = cloud(3, fibonacci_sphere(2_000));
    let of = |kind| eigenvalues(&eigen(&sphere, &Parameters { tolerance: 1e-9, ..parameters(kind, 10) }));
    let (graph, tutte) = (of(Graph), of(Tutte));
    assert!(graph.iter().zip(&tutte).all(|(a, b)| (a - b).abs() < 1e-7 * (1.0 + a)));
    let worst = worst_error(&of(WeightedGraph), &[2.0, 2.0, 2.0, 6.0, 6.0, 6.0, 6.0, 6.0]);
    assert!(worst < 0.1, "{worst}");
}

#[test]
fn an_operator_that_needs_faces_says_so() {
    let points = cloud(3, fibonacci_sphere(100));
    for kind in [Mesh, Cotangent] {
        let refused = analyze(&points, JobKind::Eigen, &parameters(kind, 5), &Progress::new()).unwrap_err();
        assert!(
            matches!(&refused, AnalysisError::Unsupported(text) if text.contains("needs the faces")),
            "{refused}"
        );
    }
}

#[test]
fn three_dimensions_of_flat_data_are_refused_and_one_of_a_surface_is_warned_about() {
    let flat: Vec<f64> = (0..400).flat_map(|i| [f64::from(i % 20), f64::from(i / 20), 3.0]).collect();
    let three = Parameters { dimension: 3, ..parameters(PbMhb, 5) };
    let refused = analyze(&cloud(3, flat), JobKind::Eigen, &three, &Progress::new()).unwrap_err();
    assert!(refused.to_string().contains("on a plane"), "{refused}");
    let one = Parameters { dimension: 1, delta: Some(0.5), ..parameters(Kirchhoff, 5) };
    let warned = built(&cloud(3, fibonacci_sphere(500)), &one);
    assert_eq!(warned.report.dimension_estimate, 2);
    assert!(warned.report.warnings.iter().any(|warning| warning.contains("look 2-dimensional")));
}

#[test]
fn a_curve_that_is_taken_for_a_surface_is_refused_with_what_it_looks_like() {
    let turn = |i: i32| 0.1 * f64::from(i);
    let curve: Vec<f64> = (0..300).flat_map(|i| [turn(i).cos(), turn(i).sin(), turn(i)]).collect();
    let refused = analyze(&cloud(3, curve), JobKind::Eigen, &parameters(PbMhb, 5), &Progress::new());
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("connected") && refused.contains("look 1-dimensional"), "{refused}");
}

#[test]
fn parameters_that_another_operator_has_no_use_for_are_refused() {
    let points = cloud(3, fibonacci_sphere(100));
    let refused = |parameters: Parameters| {
        analyze(&points, JobKind::Eigen, &parameters, &Progress::new()).unwrap_err().to_string()
    };
    let with_distance = Parameters { distance: Some(Distance::Projected), ..parameters(PbMhb, 5) };
    assert!(refused(with_distance).contains("`distance`"));
    let nearest = Parameters {
        parameterization: Some(Parameterization::NearestTen),
        t: Some(0.1),
        ..parameters(Pcd, 5)
    };
    assert!(refused(nearest).contains("`parameterization`"));
    assert!(refused(Parameters { dimension: 3, ..parameters(Mesh, 5) }).contains("`dimension`"));
}

/// The torus turned, moved, scaled by `scale`, and its rows in another order, faces with them.
fn moved(torus: &PointCloud, scale: f64) -> PointCloud {
    let (sine, cosine) = 0.7_f64.sin_cos();
    let n = torus.len();
    let mut order: Vec<u64> = (0..n as u64).collect();
    order.sort_by(|&a, &b| hashed(a).total_cmp(&hashed(b)));
    let mut place = vec![0; n];
    order.iter().enumerate().for_each(|(new, &old)| place[old as usize] = new as u32);
    let coordinates = order.iter().flat_map(|&i| {
        let p = torus.point(i as usize);
        [cosine * p[0] - sine * p[2] + 5.0, p[1] - 3.0, sine * p[0] + cosine * p[2] + 1.0].map(|x| scale * x)
    });
    let faces = torus.faces().iter().map(|face| face.map(|i| place[i as usize])).collect();
    PointCloud::new(3, coordinates.collect(), NonFinite::Reject).unwrap().with_faces(faces).unwrap()
}

#[rstest]
#[case(Mesh)]
#[case(Cotangent)]
#[case(WeightedGraph)]
fn a_motion_and_a_shuffle_leave_the_spectrum_of_a_mesh_and_a_scale_divides_it_by_its_square(
    #[case] kind: OperatorKind,
) {
    let torus = meshed_torus(1_200);
    let parameters = Parameters { tolerance: 1e-8, ..parameters(kind, 12) };
    let expected = eigenvalues(&eigen(&torus, &parameters));
    for scale in [1.0, 1e-4, 1e5] {
        let found = eigenvalues(&eigen(&moved(&torus, scale), &parameters));
        for (j, (a, b)) in found.iter().zip(&expected).enumerate() {
            assert!((a * scale * scale - b).abs() < 1e-6 * (1.0 + b), "{j}: {a} {b} at scale {scale}");
        }
    }
}

#[rstest]
// of the kernel ε is that of the equator, and poles are dense
#[case(Mesh, 0.8)]
#[case(Cotangent, 1.5)]
fn on_a_grid_of_the_sphere_errors_fall_with_the_spacing(#[case] kind: OperatorKind, #[case] order: f64) {
    // four sizes, each four times the last, halve the spacing three times
    let exact: Vec<f64> = [2.0; 3].into_iter().chain([6.0; 5]).collect();
    let errors: Vec<f64> = [500, 2_000, 8_000, 32_000]
        .into_iter()
        .map(|n| {
            let request = SampleRequest { sampling: Sampling::Grid, ..SampleRequest::new(Shape::Sphere, n) };
            let sphere = sample(&request).unwrap();
            worst_error(
                &eigenvalues(&eigen(&sphere, &Parameters { tolerance: 1e-8, ..parameters(kind, 12) })),
                &exact,
            )
        })
        .collect();
    let measured = (errors[0] / errors[3]).log2() / 3.0;
    assert!(measured > order, "{kind:?}: order {measured:.2}, errors {errors:?}");
}
