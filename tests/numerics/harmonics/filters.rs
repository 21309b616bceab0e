//! Filters, and the papers' experiments with them [PBMHB §5.4].

use std::io::Write as _;

use chladni::cloud::PointCloud;
use chladni::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
use chladni::harmonics::{Filter, FilterKind, Modes, Scale, Transfer};
use chladni::operator::OperatorKind::{Graph, PbMhb};

use super::Basis;
use crate::{cloud, fibonacci_sphere, hashed, parameters};

fn low_pass(modes: f64) -> Filter {
    Filter { cutoff: Some(modes), ..Filter::default() }
}

/// Root mean square of the distances to the unit sphere, over the points for which `side` holds.
fn radius_error(columns: &[Vec<f64>], side: impl Fn(usize) -> bool) -> f64 {
    let squares: Vec<f64> = (0..columns[0].len())
        .filter(|&i| side(i))
        .map(|i| (columns.iter().map(|c| c[i] * c[i]).sum::<f64>().sqrt() - 1.0).powi(2))
        .collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

fn columns(cloud: &PointCloud) -> Vec<Vec<f64>> {
    (0..3).map(|axis| cloud.coordinates().iter().skip(axis).step_by(3).copied().collect()).collect()
}

/// [PBMHB Fig. 9]: a sphere with noise on its left side, before and after the low-pass filter.
#[test]
fn noise_on_one_side_of_a_sphere_goes_and_the_sphere_stays_a_sphere() {
    let clean = fibonacci_sphere(4_000);
    let noisy: Vec<f64> = clean
        .chunks_exact(3)
        .enumerate()
        .flat_map(|(i, p)| {
            // uniform, of standard deviation 0.02: two thirds of the spacing to either side
            let noise = if p[0] < 0.0 { 0.02 * 12.0_f64.sqrt() * (hashed(i as u64) - 0.5) } else { 0.0 };
            p.iter().map(move |x| x * (1.0 + noise)).collect::<Vec<_>>()
        })
        .collect();
    let is_left = |i: usize| clean[3 * i] < 0.0;
    let noisy = cloud(3, noisy);
    let basis = Basis::of(&noisy, &parameters(PbMhb, 60));
    let filtered = basis.filtered(&noisy, &low_pass(16.0).transfer(&basis.modes).unwrap());
    let before = columns(&noisy);
    let left = (radius_error(&before, is_left), radius_error(&filtered, is_left));
    let right = (radius_error(&before, |i| !is_left(i)), radius_error(&filtered, |i| !is_left(i)));
    let _ = writeln!(std::io::stderr(), "radius error, noisy side {left:?}, clean side {right:?}");
    // what is left is the same on both sides: a sphere
    assert!(left.0 > 0.019 && left.1 < 0.2 * left.0, "{left:?}");
    assert!((right.1 / left.1 - 1.0).abs() < 0.25, "{left:?} {right:?}");
}

/// By how much of its length a shape has moved along x, when it should lie evenly on both sides of 0.
fn asymmetry(columns: &[Vec<f64>]) -> f64 {
    let (low, high) = columns[0].iter().fold((0.0_f64, 0.0_f64), |(low, high), &x| (low.min(x), high.max(x)));
    ((high + low) / (high - low)).abs()
}

/// [PBMHB Fig. 8]: a symmetric shape, ten times as densely sampled on one end as on the other, stays symmetric, where the
/// graph Laplacian shrinks one end more than the other.
#[test]
fn a_symmetric_shape_that_is_unevenly_sampled_stays_symmetric() {
    let request =
        SampleRequest { sampling: Sampling::NonUniform, ..SampleRequest::new(Shape::Ellipsoid, 4_000) };
    let ellipsoid = sample(&request).unwrap();
    let [ours, graph] = [PbMhb, Graph].map(|operator| {
        let basis = Basis::of(&ellipsoid, &parameters(operator, 40));
        asymmetry(&basis.filtered(&ellipsoid, &low_pass(9.0).transfer(&basis.modes).unwrap()))
    });
    let _ = writeln!(
        std::io::stderr(),
        "asymmetry of the filtered ellipsoid: {ours:.4}, by the graph {graph:.4}"
    );
    assert!(ours < 0.01 && graph > 5.0 * ours, "{ours} {graph}");
}

#[test]
fn a_filter_and_its_complement_make_the_whole() {
    let points = cloud(3, fibonacci_sphere(500).iter().map(|x| x + 3.0).collect());
    let basis = Basis::of(&points, &parameters(PbMhb, 20));
    let complements = [
        (FilterKind::LowPass, FilterKind::HighPass, Some(6.0), None),
        (FilterKind::BandPass, FilterKind::BandStop, None, Some([3.0, 11.0])),
    ];
    for (one, other, cutoff, band) in complements {
        let filter = |kind| Filter {
            kind,
            cutoff,
            from: band.map(|band| band[0]),
            to: band.map(|band| band[1]),
            taper: 0.3,
            ..Filter::default()
        };
        let halves =
            [one, other].map(|kind| basis.filtered(&points, &filter(kind).transfer(&basis.modes).unwrap()));
        for axis in 0..3 {
            for i in 0..500 {
                let sum = halves[0][axis][i] + halves[1][axis][i];
                assert!((sum - points.point(i)[axis]).abs() < 1e-9, "{one:?} {axis} {i}: {sum}");
            }
        }
    }
}

#[test]
fn a_filter_that_keeps_everything_changes_nothing_and_an_enhanced_band_is_more() {
    let points = cloud(3, fibonacci_sphere(500));
    let basis = Basis::of(&points, &parameters(PbMhb, 20));
    let identity = Filter { outside: Some(1.0), ..Filter::default() }.transfer(&basis.modes).unwrap();
    for (axis, column) in basis.filtered(&points, &identity).iter().enumerate() {
        assert!((0..500).all(|i| (column[i] - points.point(i)[axis]).abs() < 1e-12));
    }
    // x, y and z are modes 1 to 3
    let doubled = Filter { kind: FilterKind::Enhance, from: Some(1.0), to: Some(4.0), ..Filter::default() };
    let grown = basis.filtered(&points, &doubled.transfer(&basis.modes).unwrap());
    let radius = radius_error(&grown, |_| true) + 1.0;
    assert!((radius - 2.0).abs() < 0.01, "{radius}");
}

#[test]
fn heat_shrinks_the_sphere_by_its_own_law() {
    let points = cloud(3, fibonacci_sphere(2_000));
    let basis = Basis::of(&points, &parameters(PbMhb, 30));
    let heat = Filter { kind: FilterKind::Heat, time: Some(0.25), ..Filter::default() };
    let shrunk = basis.filtered(&points, &heat.transfer(&basis.modes).unwrap());
    // coordinates are eigenfunctions of λ = 2
    let expected = (-0.25_f64 * 2.0).exp();
    let radius = 1.0 - radius_error(&shrunk, |_| true);
    assert!((radius / expected - 1.0).abs() < 0.01, "{radius} {expected}");
}

#[test]
fn edges_by_mode_by_frequency_and_by_wavelength_are_the_same_edges() {
    let modes = Modes::new((0..12).map(|i| f64::from(i * i)).collect(), 1);
    let gains = |filter: Filter| filter.transfer(&modes).unwrap().gains;
    let edge = |by, cutoff| gains(Filter { by, cutoff: Some(cutoff), ..Filter::default() });
    let expected: Vec<f64> = (0..12).map(|i| f64::from(u8::from(i < 5))).collect();
    assert_eq!(edge(Scale::Mode, 5.0), expected);
    assert_eq!(edge(Scale::Frequency, 5.0), expected);
    assert_eq!(edge(Scale::Wavelength, std::f64::consts::TAU / 4.9), expected);
    let band = |by, from, to| {
        gains(Filter { kind: FilterKind::BandPass, by, from: Some(from), to: Some(to), ..Filter::default() })
    };
    let expected: Vec<f64> = (0..12).map(|i| f64::from(u8::from((3..7).contains(&i)))).collect();
    assert_eq!(band(Scale::Mode, 3.0, 7.0), expected);
    assert_eq!(band(Scale::Frequency, 3.0, 7.0), expected);
    let wave = |frequency: f64| std::f64::consts::TAU / frequency;
    assert_eq!(band(Scale::Wavelength, wave(2.9), wave(6.9)), expected);
    assert_eq!(band(Scale::Wavelength, wave(6.9), wave(2.9)), expected);
}

#[test]
fn a_taper_falls_from_one_to_zero_through_a_half_at_the_edge() {
    let modes = Modes::new((0..=20).map(|i| f64::from(i * i)).collect(), 1);
    let filter = Filter { by: Scale::Frequency, cutoff: Some(10.0), taper: 0.4, ..Filter::default() };
    let gains = filter.transfer(&modes).unwrap().gains;
    assert!(gains[..=8].iter().all(|gain| *gain == 1.0) && gains[12..].iter().all(|gain| *gain == 0.0));
    assert!((gains[10] - 0.5).abs() < 1e-12 && gains.is_sorted_by(|a, b| a >= b), "{gains:?}");
}

#[test]
fn arguments_that_mean_nothing_are_refused_by_name() {
    let modes = Modes::new((0..12).map(|i| f64::from(i * i)).collect(), 1);
    let refused = |filter: Filter| filter.transfer(&modes).unwrap_err();
    let some = Some(3.0);
    let by = Scale::Frequency;
    let kind = FilterKind::BandPass;
    for (filter, parameter, told) in [
        (Filter { gain: some, ..Filter::default() }, "gain", "belongs to enhance"),
        (Filter { cutoff: some, kind, ..Filter::default() }, "cutoff", "belongs to low-pass"),
        (Filter { kind, ..Filter::default() }, "from", "where the band lies"),
        (Filter { kind, from: some, to: Some(2.0), ..Filter::default() }, "to", "above `from`"),
        (Filter { kind: FilterKind::Heat, ..Filter::default() }, "time", "or `cutoff`"),
        (Filter { kind: FilterKind::Heat, cutoff: Some(0.0), ..Filter::default() }, "cutoff", "frequency 0"),
        (Filter { cutoff: Some(13.0), ..Filter::default() }, "cutoff", "from 0 to 12"),
        (Filter { cutoff: Some(2.5), ..Filter::default() }, "cutoff", "whole mode number"),
        (Filter { cutoff: Some(f64::NAN), ..Filter::default() }, "cutoff", "a number from 0"),
        (Filter { by, cutoff: Some(11.5), ..Filter::default() }, "cutoff", "reach frequency 11.0"),
        (Filter { by: Scale::Wavelength, cutoff: Some(0.0), ..Filter::default() }, "cutoff", "above 0"),
        (Filter { taper: 1.5, ..Filter::default() }, "taper", "from 0 to 1"),
    ] {
        let error = refused(filter);
        assert_eq!(error.parameter, parameter, "{error}");
        assert!(error.reason.contains(told), "{error}");
    }
    // beyond the bases is allowed to who says what becomes of the rest
    let knowing = Filter { by, cutoff: Some(11.5), outside: Some(1.0), ..Filter::default() };
    assert_eq!(knowing.transfer(&modes).unwrap().gains, [1.0; 12]);
}

#[test]
fn gains_as_given_end_in_what_lies_outside() {
    let modes = Modes::new(vec![0.0, 1.0, 2.0, 3.0], 1);
    let transfer = Transfer::from_gains(vec![1.0, 0.5], 0.25, &modes).unwrap();
    assert_eq!((transfer.gains, transfer.outside), (vec![1.0, 0.5, 0.25, 0.25], 0.25));
    assert!(Transfer::from_gains(vec![1.0; 5], 0.0, &modes).is_err());
    assert!(Transfer::from_gains(vec![f64::NAN], 0.0, &modes).is_err());
}
