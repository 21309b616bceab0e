//! The transform: there and back, Parseval's identity, and rows that carry nothing.

use std::sync::LazyLock;

use chladni::cloud::{NonFinite, PointCloud};
use chladni::harmonics::Energy;
use chladni::operator::OperatorKind::{PbMhb, Voronoi};
use proptest::prelude::*;

use super::{Basis, function};
use crate::{cloud, fibonacci_sphere, hashed, parameters};

/// 400 points of a sphere, then an outlier, a row that is not finite, and repetitions of the first five rows.
static SCARRED: LazyLock<(PointCloud, Basis)> = LazyLock::new(|| {
    let mut points = fibonacci_sphere(400);
    points.extend([9.0, 9.0, 9.0, f64::NAN, 0.0, 0.0]);
    points.extend_from_within(..15);
    let cloud = PointCloud::new(3, points, NonFinite::Drop).unwrap();
    let basis = Basis::of(&cloud, &parameters(PbMhb, 30));
    (cloud, basis)
});

/// As many bases as points: they span everything.
static COMPLETE: LazyLock<Basis> =
    LazyLock::new(|| Basis::of(&cloud(3, fibonacci_sphere(90)), &parameters(Voronoi, 90)));

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn coefficients_come_back_from_the_function_that_they_make(
        coefficients in prop::collection::vec(-1e3..1e3, 30)
    ) {
        let (_, basis) = &*SCARRED;
        let made = basis.synthesize(&coefficients);
        let back = basis.transform(&[function(made)]).remove(0);
        for (there, back) in coefficients.iter().zip(&back.coefficients) {
            prop_assert!((there - back).abs() < 1e-6, "{} {}", there, back);
        }
        let squares: f64 = coefficients.iter().map(|c| c * c).sum();
        prop_assert!((back.energy - squares).abs() < 1e-9 * squares.max(1.0));
    }

    #[test]
    fn a_complete_basis_gives_every_function_back_with_all_its_energy(
        values in prop::collection::vec(-1e3..1e3, 90)
    ) {
        let found = COMPLETE.transform(&[function(values.clone())]).remove(0);
        let back = COMPLETE.synthesize(&found.coefficients);
        for (there, back) in values.iter().zip(&back) {
            prop_assert!((there - back).abs() < 1e-6, "{} {}", there, back);
        }
        let energy = Energy::of(&found, 7);
        prop_assert!((energy.inside - energy.total).abs() < 1e-9 * energy.total);
    }

    #[test]
    fn what_is_inside_and_what_is_outside_is_all_the_energy(
        values in prop::collection::vec(-1e3..1e3, 407), bands in 1_usize..60
    ) {
        let (_, basis) = &*SCARRED;
        let found = basis.transform(&[function(values.clone())]).remove(0);
        let total: f64 =
            values.iter().zip(&basis.mass).filter(|(_, m)| **m > 0.0).map(|(f, m)| m * f * f).sum();
        let energy = Energy::of(&found, bands);
        prop_assert!((energy.total - total).abs() < 1e-9 * total);
        prop_assert!((energy.inside + energy.outside - total).abs() < 1e-9 * total);
        prop_assert!(energy.inside <= total);
        // the bands are all modes, each once
        prop_assert_eq!(energy.bands.len(), bands.min(30));
        prop_assert_eq!(energy.bands[0].first, 0);
        prop_assert_eq!(energy.bands.last().unwrap().last, 29);
        prop_assert!(energy.bands.windows(2).all(|pair| pair[1].first == pair[0].last + 1));
        let banded: f64 = energy.bands.iter().map(|band| band.energy).sum();
        prop_assert!((banded - energy.inside).abs() < 1e-9 * total);
    }
}

#[test]
fn rows_without_mass_do_not_matter_and_rows_without_a_result_stay_so() {
    let (_, basis) = &*SCARRED;
    let values: Vec<f64> = (0..407).map(hashed).collect();
    let mut other = values.clone();
    other[400] = 1e9;
    other[401] = f64::NAN;
    other[402..].fill(f64::INFINITY);
    let [one, two] = [values, other].map(|values| basis.transform(&[function(values)]).remove(0));
    assert_eq!(one, two);
    let made = basis.synthesize(&one.coefficients);
    assert!(made[400].is_nan() && made[401].is_nan());
    for repeated in 0..5 {
        assert_eq!(made[402 + repeated].to_bits(), made[repeated].to_bits());
    }
}

#[test]
fn coordinates_of_the_sphere_are_three_modes() {
    let basis = Basis::of(&cloud(3, fibonacci_sphere(2_000)), &parameters(PbMhb, 25));
    let points = fibonacci_sphere(2_000);
    let x = function(points.iter().step_by(3).copied().collect());
    let energy = Energy::of(&basis.transform(&[x]).remove(0), 25);
    // ∫ x² over the unit sphere is 4π/3, all of it in l = 1
    assert!((energy.total / (4.0 * std::f64::consts::PI / 3.0) - 1.0).abs() < 3e-3, "{energy:?}");
    let first: f64 = energy.bands[1..4].iter().map(|band| band.share).sum();
    assert!(first > 0.9999, "{first}");
}
