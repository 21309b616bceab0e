//! Feature points: found again on another sampling of the same shape [PBMHB §5.5, Fig. 10, 11].

use std::collections::HashMap;
use std::io::Write as _;

use chladni::cloud::reader::{Format, ReadOptions, read};
use chladni::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
use chladni::cloud::{NonFinite, PointCloud};
use chladni::harmonics::Neighborhoods;
use chladni::harmonics::features::{self, Feature, PERSISTENCE_MIN, RADIUS_IN_EPSILON};
use chladni::operator::OperatorKind::{self, Graph, PbMhb};

use super::Basis;
use crate::{hashed, parameters};

/// Feature points of a cloud, and its covering radius.
fn features_of(cloud: &PointCloud, basis: &Basis) -> (Vec<Feature>, f64) {
    let epsilon = basis.analysis.report.sampling.epsilon;
    let neighborhoods = Neighborhoods::find(cloud, &basis.mass, RADIUS_IN_EPSILON * epsilon).unwrap();
    let area: f64 = basis.mass.iter().filter(|mass| !mass.is_nan()).sum();
    let first = basis.modes.zero_modes();
    let extrema: Vec<_> =
        basis.columns[first..].iter().map(|h| features::extrema(h, &neighborhoods, area)).collect();
    let places = features::features(&extrema, first, &neighborhoods, PERSISTENCE_MIN);
    (places.iter().map(|place| place.in_cloud(&neighborhoods, cloud)).collect(), epsilon)
}

fn distance(p: &[f64], q: &[f64]) -> f64 {
    p.iter().zip(q).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// How many feature points of both clouds have a counterpart in the other within twice the coarser ε, and how many there are.
fn matched(clouds: [&PointCloud; 2], operator: OperatorKind, modes: usize) -> [usize; 2] {
    let [(one, epsilon), (other, coarser)] = clouds.map(|cloud| {
        let basis = Basis::of(cloud, &parameters(operator, modes));
        features_of(cloud, &basis)
    });
    let reach = 2.0 * epsilon.max(coarser);
    let matched = |from: &[Feature], to: &[Feature]| {
        from.iter().filter(|p| to.iter().any(|q| distance(&p.position, &q.position) <= reach)).count()
    };
    [matched(&one, &other) + matched(&other, &one), one.len() + other.len()]
}

/// The two-hole torus, regularly and irregularly sampled [PBMHB Fig. 10].
#[test]
fn feature_points_of_the_two_hole_torus_are_found_on_both_samplings() {
    let drawn = |sampling| {
        sample(&SampleRequest { sampling, ..SampleRequest::new(Shape::TwoHoleTorus, 5_000) }).unwrap()
    };
    let clouds = [drawn(Sampling::Uniform), drawn(Sampling::NonUniform)];
    let [ours, graph] = shares("two-hole torus", &[clouds], 15);
    assert!(ours >= 0.6 && graph < 0.5 * ours, "{ours} {graph}");
}

/// The shares of feature points that are found again on the other cloud of their pair, by our bases and by those of the graph.
fn shares(name: &str, pairs: &[[PointCloud; 2]], modes: usize) -> [f64; 2] {
    [PbMhb, Graph].map(|operator| {
        let counts = pairs.iter().map(|[one, other]| matched([one, other], operator, modes));
        let [found, all] = counts.fold([0, 0], |sum, count| [sum[0] + count[0], sum[1] + count[1]]);
        let _ = writeln!(std::io::stderr(), "{name}, {}: {found} of {all} found again", operator.name());
        found as f64 / all as f64
    })
}

/// The scan without what is within the radius of a point that was kept before, in an order of chance.
fn thinned(scan: &PointCloud, radius: impl Fn(&[f64]) -> f64, seed: u64) -> PointCloud {
    let mut order: Vec<usize> = (0..scan.len()).collect();
    order.sort_by(|&i, &j| hashed(seed + i as u64).total_cmp(&hashed(seed + j as u64)));
    let cell = (0..scan.len()).map(|i| radius(scan.point(i))).fold(0.0, f64::max);
    let place = |p: &[f64]| [0, 1, 2].map(|axis| (p[axis] / cell).floor() as i64);
    let mut kept: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    for i in order {
        let (p, [x, y, z]) = (scan.point(i), place(scan.point(i)));
        let cells = (0..27).map(|k| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1]);
        let mut near = cells.filter_map(|cell| kept.get(&cell)).flatten();
        if !near.any(|&j| distance(p, scan.point(j)) <= radius(scan.point(j))) {
            kept.entry(place(p)).or_default().push(i);
        }
    }
    let mut rows: Vec<usize> = kept.into_values().flatten().collect();
    rows.sort_unstable();
    PointCloud::new(3, rows.iter().flat_map(|&i| scan.point(i).to_vec()).collect(), NonFinite::Reject)
        .unwrap()
}

/// A scan, thinned evenly and by a density that grows fivefold along its longest axis. One pair has about ten features of
/// 60 modes, too few to tell by.
#[test]
#[ignore = "needs the scans in ../shared/data: run with --ignored where they are"]
fn feature_points_of_a_scan_are_found_on_both_samplings() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/igea.ply");
    let bytes = std::fs::read(path).unwrap();
    let scan = read(&bytes, Format::Ply, &ReadOptions::default()).unwrap();
    let (low, high) = scan.bounding_box().unwrap();
    let height = high[1] - low[1];
    let pairs: Vec<_> = (0..4)
        .map(|pair| {
            let even = thinned(&scan, |_| 0.0136 * height, pair << 40);
            let graded = |p: &[f64]| 0.02 * height * 5.0_f64.powf(-0.5 * (p[1] - low[1]) / height);
            [even, thinned(&scan, graded, (pair << 40) + (1 << 30))]
        })
        .collect();
    let [ours, graph] = shares("Igea", &pairs, 60);
    assert!(ours > 0.3 && graph < 0.5 * ours, "{ours} {graph}");
}

#[test]
fn feature_points_are_rows_of_the_upload_ranked_by_persistence_and_farther_apart_than_the_radius() {
    let torus = sample(&SampleRequest::new(Shape::TwoHoleTorus, 2_000)).unwrap();
    let basis = Basis::of(&torus, &parameters(PbMhb, 30));
    let (found, epsilon) = features_of(&torus, &basis);
    assert!(found.len() >= 4, "{found:?}");
    for (i, feature) in found.iter().enumerate() {
        assert_eq!(feature.position, torus.point(feature.index));
        assert!(feature.pairs.iter().all(|[i, j]| i + 1 == *j && *i >= 1 && *j < 30));
        let near =
            |other: &Feature| distance(&feature.position, &other.position) <= RADIUS_IN_EPSILON * epsilon;
        assert!(!found[..i].iter().any(near), "{found:?}");
    }
    assert!(found.is_sorted_by(|a, b| a.persistence >= b.persistence));
}

/// Every basis may come with the other sign: the feature points are the same.
#[test]
fn feature_points_do_not_depend_on_the_signs_of_bases() {
    let torus = sample(&SampleRequest::new(Shape::TwoHoleTorus, 2_000)).unwrap();
    let mut basis = Basis::of(&torus, &parameters(PbMhb, 30));
    let found = features_of(&torus, &basis).0;
    for column in basis.columns.iter_mut().step_by(3) {
        for h in column.iter_mut() {
            *h = -*h;
        }
    }
    assert_eq!(features_of(&torus, &basis).0, found);
}
