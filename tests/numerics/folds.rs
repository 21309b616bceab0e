//! Folded plates and open tubes: developable, so that their spectra are those of rectangles and cylinders.

use std::f64::consts::PI;

use chladni::analysis::Parameters;
use chladni::operator::OperatorKind::{self, PbMhb, Voronoi};
use rstest::rstest;

use crate::{cloud, eigen, eigenvalues, hashed, parameters, worst_error};

/// A lattice of spacing `h` on `length × width`, points inside moved by up to a third of the spacing, bent so that
/// `at(u)` is its profile. Points on the `creases` move along them only.
fn bent(length: f64, width: f64, h: f64, creases: &[f64], at: impl Fn(f64) -> [f64; 2]) -> Vec<f64> {
    let (columns, rows) = ((length / h).round() as u64, (width / h).round() as u64);
    let moved = |at: f64, seed: u64| at + h * (hashed(seed) - 0.5) * 2.0 / 3.0;
    (0..=columns)
        .flat_map(|i| (0..=rows).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let (u, v) = (i as f64 * h, j as f64 * h);
            let seed = 2 * (i * (rows + 1) + j);
            let straight = i == 0 || i == columns || creases.iter().any(|c| (c - u).abs() < 0.1 * h);
            let edge = j == 0 || j == rows;
            let [x, z] = at(if straight { u } else { moved(u, seed) });
            [x, if edge { v } else { moved(v, seed + 1) }, z]
        })
        .collect()
}

/// `(πa/length)² + (πb/width)²`, ascending, without the zero: cosines on a rectangle with natural rims.
fn rectangle(length: f64, width: f64, count: usize) -> Vec<f64> {
    let mut all: Vec<f64> = (0..40)
        .flat_map(|a| {
            (0..40).map(move |b| (PI * f64::from(a) / length).powi(2) + (PI * f64::from(b) / width).powi(2))
        })
        .collect();
    all.sort_by(f64::total_cmp);
    all[1..=count].to_vec()
}

fn worst(points: Vec<f64>, parameters: &Parameters, exact: &[f64]) -> f64 {
    worst_error(&eigenvalues(&eigen(&cloud(3, points), parameters)), exact)
}

#[rstest]
#[case(Voronoi, 0.02)]
#[case(PbMhb, 0.03)]
fn a_plate_folded_at_a_right_angle_has_the_spectrum_of_the_flat_one(
    #[case] operator: OperatorKind,
    #[case] bound: f64,
) {
    let points = bent(2.0, 1.0, 0.04, &[1.0], |u| if u <= 1.0 { [u, 0.0] } else { [1.0, u - 1.0] });
    let error = worst(points, &parameters(operator, 22), &rectangle(2.0, 1.0, 20));
    assert!(error <= bound, "{error}");
}

/// Two sheets, three spacings apart, joined at one end: coupled through the gap, the lowest eigenvalue of the
/// unfolded strip would come out four times too large.
#[rstest]
#[case(Voronoi, 0.03)]
#[case(PbMhb, 0.04)]
fn a_strip_folded_onto_itself_keeps_its_length(#[case] operator: OperatorKind, #[case] bound: f64) {
    let (h, end, gap) = (0.04, 1.0, 0.12);
    let points = bent(2.0 * end + gap, 0.8, h, &[end, end + gap], |u| match u {
        u if u <= end => [u, 0.0],
        u if u <= end + gap => [end, u - end],
        u => [2.0 * end + gap - u, gap],
    });
    let error = worst(points, &parameters(operator, 22), &rectangle(2.0 * end + gap, 0.8, 20));
    assert!(error <= bound, "{error}");
}

/// An open tube of radius 0.15 and length 2: `(m/r)² + (πk/length)²`, the m ≠ 0 twice.
#[rstest]
#[case(Voronoi, 0.02)]
#[case(PbMhb, 0.035)]
fn a_thin_open_tube_has_the_spectrum_of_its_cylinder(#[case] operator: OperatorKind, #[case] bound: f64) {
    let (radius, length, around, along) = (0.15, 2.0, 30, 64);
    let points = (0..around * (along + 1))
        .flat_map(|i| {
            let (ring, seat) = (i / around, i % around);
            // every other ring is turned by half a step
            let angle = 2.0 * PI * (f64::from(seat) + 0.5 * f64::from(ring % 2)) / f64::from(around);
            [radius * angle.cos(), radius * angle.sin(), length * f64::from(ring) / f64::from(along)]
        })
        .collect();
    let mut exact: Vec<f64> = (-4..=4_i32)
        .flat_map(|m| {
            (0..20).map(move |k| (f64::from(m) / radius).powi(2) + (PI * f64::from(k) / length).powi(2))
        })
        .collect();
    exact.sort_by(f64::total_cmp);
    let error = worst(points, &parameters(operator, 22), &exact[1..21]);
    assert!(error <= bound, "{error}");
}

#[test]
fn every_addition_for_scans_can_be_switched_off() {
    let points = || bent(1.0, 1.0, 0.05, &[0.5], |u| if u <= 0.5 { [u, 0.0] } else { [0.5, u - 0.5] });
    let first = |change: fn(&mut Parameters)| {
        let mut parameters = parameters(PbMhb, 12);
        change(&mut parameters);
        eigenvalues(&eigen(&cloud(3, points()), &parameters))[1]
    };
    let usual = first(|_| ());
    assert_ne!(usual, first(|p| p.surface_distances = Some(false)));
    assert_ne!(usual, first(|p| p.moment_calibration = Some(false)));
    assert_ne!(usual, first(|p| p.isometric_cells = Some(false)));
    let paper = first(|p| p.paper = true);
    let by_hand = first(|p| {
        p.paper = true;
        p.surface_distances = Some(false);
        p.moment_calibration = Some(false);
    });
    assert_eq!(paper, by_hand);
}
