//! Whole shapes: invariants, similarity, signatures and distances on bases that the library computes.

use std::f64::consts::PI;
use std::io::Write as _;

use chladni::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
use chladni::harmonics::{Distance, DistanceKind, Signature, SignatureKind, invariants, shape_dna};
use chladni::operator::OperatorKind::{PbMhb, Voronoi};
use rstest::rstest;

use super::Basis;
use crate::{cloud, fibonacci_sphere, hashed, parameters};

fn drawn(shape: Shape, sampling: Sampling, points: usize) -> Basis {
    let cloud = sample(&SampleRequest { sampling, ..SampleRequest::new(shape, points) }).unwrap();
    Basis::of(&cloud, &parameters(PbMhb, 200))
}

/// The papers' areas of the sphere and the torus are off by 4.2 % and 2.3 % from 200 eigenvalues [PCD Table 5].
#[rstest]
#[case(Shape::Sphere, 4_000, 4.0 * PI, 2)]
#[case(Shape::FlatTorus4, 4_000, 4.0 * PI * PI, 0)]
fn closed_surfaces_have_their_area_and_their_characteristic(
    #[case] shape: Shape,
    #[case] points: usize,
    #[case] area: f64,
    #[case] euler: i64,
) {
    let basis = drawn(shape, Sampling::Uniform, points);
    let found = invariants::measure(&basis.modes, &basis.analysis.report.sampling);
    let _ = writeln!(std::io::stderr(), "{}: {found:?}", shape.name());
    let traced = found.heat_trace_area.unwrap();
    assert!((traced.value / area - 1.0).abs() < 0.02, "{found:?}");
    assert!((traced.value - area).abs() <= traced.uncertainty, "{found:?}");
    assert!((found.cell_area / area - 1.0).abs() < 0.005, "{found:?}");
    assert!(!found.is_open && found.boundary_length.is_none());
    assert_eq!(found.euler_characteristic_rounded, Some(euler), "{found:?}");
}

#[test]
fn the_characteristic_of_a_torus_in_space_lies_within_its_uncertainty() {
    let basis = drawn(Shape::Torus, Sampling::Uniform, 4_000);
    let found = invariants::measure(&basis.modes, &basis.analysis.report.sampling);
    let _ = writeln!(std::io::stderr(), "torus: {found:?}");
    let euler = found.euler_characteristic.unwrap();
    assert!(euler.value.abs() <= euler.uncertainty && euler.uncertainty < 1.5, "{found:?}");
}

#[test]
fn the_two_hole_torus_has_a_negative_characteristic() {
    let request =
        SampleRequest { sampling: Sampling::Uniform, ..SampleRequest::new(Shape::TwoHoleTorus, 4_000) };
    let basis = Basis::of(&sample(&request).unwrap(), &parameters(PbMhb, 300));
    let found = invariants::measure(&basis.modes, &basis.analysis.report.sampling);
    let _ = writeln!(std::io::stderr(), "two-hole torus: {found:?}");
    let euler = found.euler_characteristic.unwrap();
    assert!((euler.value + 2.0).abs() <= euler.uncertainty, "{found:?}");
    assert!(euler.value + euler.uncertainty < 0.0, "{found:?}");
}

#[test]
fn the_square_has_a_rim_whose_length_lies_within_its_uncertainty() {
    for operator in [PbMhb, Voronoi] {
        let request = SampleRequest { sampling: Sampling::Grid, ..SampleRequest::new(Shape::Square, 4_000) };
        let basis = Basis::of(&sample(&request).unwrap(), &parameters(operator, 100));
        let found = invariants::measure(&basis.modes, &basis.analysis.report.sampling);
        let _ = writeln!(std::io::stderr(), "square, {}: {found:?}", operator.name());
        assert!(found.is_open);
        let (length, euler) = (found.boundary_length.unwrap(), found.euler_characteristic.unwrap());
        // that of λ is not counted
        assert!((length.value - 4.0).abs() <= 2.0 * length.uncertainty, "{found:?}");
        // 1, and 1/8 for every corner
        assert!((euler.value - 1.5).abs() <= euler.uncertainty, "{found:?}");
    }
}

#[test]
fn points_away_from_the_surface_change_neither_its_area_nor_what_it_is_like() {
    let sphere = fibonacci_sphere(2_000);
    // in a box a thousand times as large as the sphere
    let strays = (0..300).map(|i| 1e3 * (2.0 * hashed(i) - 1.0));
    let with_strays = cloud(3, sphere.iter().copied().chain(strays).collect());
    let [plain, strayed] =
        [cloud(3, sphere), with_strays].map(|cloud| Basis::of(&cloud, &parameters(PbMhb, 100)));
    let found = invariants::measure(&strayed.modes, &strayed.analysis.report.sampling);
    assert!((found.cell_area / (4.0 * PI) - 1.0).abs() < 0.01, "{found:?}");
    assert!(!found.is_open && found.boundary_length.is_none(), "{found:?}");
    assert_eq!(found.euler_characteristic_rounded, Some(2), "{found:?}");
    assert_eq!(found.reasons.keys().copied().collect::<Vec<_>>(), ["boundary_length"]);
    let areas = [&plain, &strayed].map(|basis| basis.analysis.report.sampling.area);
    let alike = shape_dna::compare([&plain.modes, &strayed.modes], areas, false, 50).unwrap();
    assert!(alike.distance < 0.01, "{}", alike.distance);
}

#[test]
fn a_shape_is_nearer_to_itself_sampled_otherwise_than_to_another_shape() {
    let of = |shape, sampling, points| {
        let cloud = sample(&SampleRequest { sampling, ..SampleRequest::new(shape, points) }).unwrap();
        Basis::of(&cloud, &parameters(PbMhb, 40))
    };
    let shapes = [Shape::Sphere, Shape::Ellipsoid, Shape::BumpySphere, Shape::Torus];
    let even: Vec<_> = shapes.iter().map(|&shape| of(shape, Sampling::Uniform, 3_000)).collect();
    let uneven: Vec<_> = shapes.iter().map(|&shape| of(shape, Sampling::NonUniform, 4_000)).collect();
    let distance = |a: &Basis, b: &Basis| {
        let areas = [a, b].map(|basis| basis.analysis.report.sampling.area);
        shape_dna::compare([&a.modes, &b.modes], areas, false, 30).unwrap().distance
    };
    for (i, one) in even.iter().enumerate() {
        let distances: Vec<f64> = uneven.iter().map(|other| distance(one, other)).collect();
        let _ = writeln!(std::io::stderr(), "{}: {distances:.4?}", shapes[i].name());
        let nearest = (0..shapes.len()).min_by(|&a, &b| distances[a].total_cmp(&distances[b]));
        assert_eq!(nearest, Some(i), "{distances:?}");
    }
}

/// On the sphere every point is like every other, and what is far is far all around.
#[test]
fn signatures_and_distances_on_the_sphere_have_its_symmetry() {
    let points = fibonacci_sphere(3_000);
    // l ≤ 5: whole clusters, so that the choice of bases inside does not matter
    let basis = Basis::of(&cloud(3, points.clone()), &parameters(PbMhb, 36));
    let block = basis.blocks(3_000).remove(0);
    for kind in [SignatureKind::Hks, SignatureKind::Wks] {
        let signature = Signature::new(kind, 6, &basis.modes).unwrap();
        for (scale, column) in signature.values(&block).iter().enumerate() {
            let mean = column.iter().sum::<f64>() / 3_000.0;
            let worst = column.iter().map(|x| (x / mean - 1.0).abs()).fold(0.0, f64::max);
            assert!(worst < 0.02, "{kind:?} at scale {scale}: {worst}");
        }
    }
    for kind in [DistanceKind::Biharmonic, DistanceKind::Diffusion] {
        let origin = basis.columns.iter().map(|column| column[0]).collect();
        let found = Distance::from(kind, origin, None, &basis.modes).unwrap().values(&block);
        assert!(found[0] == 0.0);
        // sorted by the angle to the origin, the distances are sorted too, but for the noise of the bases
        let angle = |i: usize| {
            points[3 * i..3 * i + 3]
                .iter()
                .zip(&points)
                .map(|(a, b)| a * b)
                .sum::<f64>()
                .clamp(-1.0, 1.0)
                .acos()
        };
        let mut order: Vec<usize> = (0..3_000).collect();
        order.sort_by(|&a, &b| angle(a).total_cmp(&angle(b)));
        let top = found.iter().copied().fold(0.0, f64::max);
        assert!(order.windows(100).all(|few| found[few[99]] > found[few[0]] - 0.02 * top), "{kind:?}");
    }
}

#[test]
fn the_biharmonic_distance_to_another_component_is_infinite() {
    let sphere = fibonacci_sphere(300);
    let both = sphere.iter().copied().chain(sphere.chunks_exact(3).flat_map(|p| [p[0] + 9.0, p[1], p[2]]));
    let basis = Basis::of(&cloud(3, both.collect()), &parameters(PbMhb, 20));
    let block = basis.blocks(600).remove(0);
    let origin: Vec<f64> = basis.columns.iter().map(|column| column[7]).collect();
    let found = Distance::from(DistanceKind::Biharmonic, origin, None, &basis.modes).unwrap().values(&block);
    assert!(found[..300].iter().all(|d| d.is_finite()) && found[300..].iter().all(|d| d.is_infinite()));
}
