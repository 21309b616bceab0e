//! Salient feature points [PBMHB §5.5]: where two consecutive bases have an extremum at the same place.
//!
//! The sign of a basis is arbitrary, so an extremum is a maximum of `|H|` among neighbors of the same sign. On another
//! sampling of the same surface the two extrema of a tip need not fall on one point: they count as one place when they
//! lie within the neighborhoods' radius of each other. The paper takes every extremum; we rank by topological persistence
//! [Edelsbrunner, Letscher, Zomorodian 2002]: by how much `|H|` must fall before the extremum's hill merges with a higher
//! one, or reaches the nodal line.

use std::collections::HashMap;

use rayon::prelude::*;
use serde::Serialize;

use super::Neighborhoods;
use crate::arguments::arguments;
use crate::cloud::writer::{Column, PlyEncoding, PlyHeader, axis_name, encode_rows};
use crate::cloud::{PointCloud, ScalarType};

/// Least persistence of an extremum when nothing is said, as a multiple of a basis' root mean square.
pub const PERSISTENCE_MIN: f64 = 0.1;

/// Radius of the neighborhoods when nothing is said, as a multiple of the covering radius ε.
pub const RADIUS_IN_EPSILON: f64 = 2.0;

arguments! {
    /// Which feature points are looked for.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct FeatureRequest {
        /// Look at this number of the lowest modes only: they are the more stable.
        modes: Option<usize> = integer(2, usize::MAX), absent "all";
        /// Least persistence of an extremum, as a multiple of a basis' root mean square.
        persistence: f64 = nonnegative, default PERSISTENCE_MIN;
        /// Radius of the neighborhoods, in units of the cloud.
        radius: Option<f64> = positive, absent "2ε";
        /// Only this number of the most persistent feature points.
        limit: Option<usize> = integer(1, usize::MAX), absent "all";
    }
}

impl FeatureRequest {
    /// Radius of the neighborhoods on a cloud with covering radius `epsilon`.
    #[must_use]
    pub fn radius(&self, epsilon: f64) -> f64 {
        self.radius.unwrap_or(RADIUS_IN_EPSILON * epsilon)
    }

    /// Number of modes looked at, of `available`.
    #[must_use]
    pub fn modes(&self, available: usize) -> usize {
        self.modes.map_or(available, |modes| modes.min(available))
    }
}

/// A hill of `|H|`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Extremum {
    /// Its summit, a point of the [`Neighborhoods`].
    pub point: u32,
    /// Height above the saddle to a higher hill or the nodal line, as a multiple of the basis' root mean square.
    pub persistence: f64,
}

/// A place where consecutive bases have extrema.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[non_exhaustive]
pub struct Feature {
    /// Row of the upload.
    pub index: usize,
    /// Its coordinates.
    pub position: Vec<f64>,
    /// The consecutive modes `[i, i + 1]` that have an extremum here, most persistent first.
    pub pairs: Vec<[usize; 2]>,
    /// Persistence of the weaker of the two extrema of the best pair, as a multiple of a basis' root mean square.
    pub persistence: f64,
}

/// Extrema of one basis, given row by row of the upload; `area` is the total mass, the square of the basis' inverse root
/// mean square.
#[must_use]
pub fn extrema(basis: &[f64], neighborhoods: &Neighborhoods, area: f64) -> Vec<Extremum> {
    let value: Vec<f64> = (0..neighborhoods.len()).map(|i| basis[neighborhoods.row(i)]).collect();
    let summit = summits(&value, neighborhoods);
    let scale = area.sqrt();
    let mut hills: HashMap<u32, Hill> = HashMap::new();
    for i in 0..summit.len() {
        if summit[i] as usize == i && value[i] != 0.0 && !value[i].is_nan() {
            hills.insert(i as u32, Hill { parent: i as u32, persistence: value[i].abs() * scale });
        }
    }
    for (level, [a, b]) in saddles(&value, &summit, neighborhoods) {
        let (a, b) = (root(&hills, a), root(&hills, b));
        if a != b {
            let (lower, higher) = if is_higher(&value, a, b) { (b, a) } else { (a, b) };
            let persistence = (value[lower as usize].abs() - level) * scale;
            hills.insert(lower, Hill { parent: higher, persistence });
        }
    }
    let mut found: Vec<Extremum> = hills
        .iter()
        .map(|(&point, hill)| Extremum { point, persistence: hill.persistence })
        .filter(|extremum| extremum.persistence > 0.0)
        .collect();
    found.sort_by(|a, b| b.persistence.total_cmp(&a.persistence).then(a.point.cmp(&b.point)));
    found
}

/// A summit and the summit of the higher hill that it has merged with, itself as long as it stands alone.
struct Hill {
    parent: u32,
    persistence: f64,
}

fn root(hills: &HashMap<u32, Hill>, mut hill: u32) -> u32 {
    while hills[&hill].parent != hill {
        hill = hills[&hill].parent;
    }
    hill
}

/// Of equal heights the lower index is the higher, so that a plateau has one summit.
fn is_higher(value: &[f64], i: u32, j: u32) -> bool {
    let (a, b) = (value[i as usize].abs(), value[j as usize].abs());
    a > b || (a >= b && i < j)
}

fn same_sign(value: &[f64], i: u32, j: u32) -> bool {
    value[i as usize] * value[j as usize] > 0.0
}

/// Where the steepest way up from every point ends, on its side of the nodal line.
fn summits(value: &[f64], neighborhoods: &Neighborhoods) -> Vec<u32> {
    let mut upward: Vec<u32> = (0..value.len() as u32)
        .map(|i| {
            let around = neighborhoods.of(i as usize).iter().copied().filter(|&q| same_sign(value, i, q));
            around.fold(i, |best, q| if is_higher(value, q, best) { q } else { best })
        })
        .collect();
    let mut path = Vec::new();
    for i in 0..upward.len() as u32 {
        let mut end = i;
        while upward[end as usize] != end {
            path.push(end);
            end = upward[end as usize];
        }
        path.drain(..).for_each(|passed| upward[passed as usize] = end);
    }
    upward
}

/// The highest pass between every two hills that touch, highest first.
fn saddles(value: &[f64], summit: &[u32], neighborhoods: &Neighborhoods) -> Vec<(f64, [u32; 2])> {
    let mut highest: HashMap<[u32; 2], f64> = HashMap::new();
    for i in 0..value.len() as u32 {
        for &q in neighborhoods.of(i as usize) {
            let (a, b) = (summit[i as usize], summit[q as usize]);
            if a != b && same_sign(value, i, q) {
                let level = value[i as usize].abs().min(value[q as usize].abs());
                let pass = highest.entry([a.min(b), a.max(b)]).or_insert(level);
                *pass = pass.max(level);
            }
        }
    }
    let mut passes: Vec<(f64, [u32; 2])> = highest.into_iter().map(|(pair, level)| (level, pair)).collect();
    passes.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    passes
}

/// Joins the extrema of consecutive modes, the first of which is mode `first`, into places.
///
/// Extrema below `persistence_min` do not count. Two extrema, and two places, within the neighborhoods' radius of each
/// other are one place, at the most persistent of the extrema. Most persistent first.
#[must_use]
pub fn features(
    extrema: &[Vec<Extremum>],
    first: usize,
    neighborhoods: &Neighborhoods,
    persistence_min: f64,
) -> Vec<Place> {
    let strong = |extremum: &&Extremum| extremum.persistence >= persistence_min;
    let pairs = extrema.par_windows(2).enumerate().flat_map_iter(|(offset, modes)| {
        let (here, there) = (&modes[0], &modes[1]);
        here.iter().filter(strong).flat_map(move |a| {
            let near = move |b: &&Extremum| neighborhoods.are_near(a.point as usize, b.point as usize);
            there.iter().filter(strong).filter(near).map(move |b| {
                let (stronger, weaker) = if a.persistence >= b.persistence { (a, b) } else { (b, a) };
                (weaker.persistence, stronger.point, first + offset)
            })
        })
    });
    let mut pairs: Vec<(f64, u32, usize)> = pairs.collect();
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.2.cmp(&b.2)).then(a.1.cmp(&b.1)));
    let mut places: Vec<Place> = Vec::new();
    for (persistence, point, mode) in pairs {
        let known =
            places.iter_mut().find(|place| neighborhoods.are_near(place.point as usize, point as usize));
        match known {
            None => places.push(Place { point, persistence, modes: vec![mode] }),
            Some(place) if place.modes.contains(&mode) => {}
            Some(place) => place.modes.push(mode),
        }
    }
    places
}

/// A feature before it is placed in the upload.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Place {
    /// A point of the [`Neighborhoods`].
    pub point: u32,
    /// As in [`Feature`].
    pub persistence: f64,
    /// The first modes of its pairs.
    pub modes: Vec<usize>,
}

impl Place {
    /// In rows and coordinates of the upload.
    #[must_use]
    pub fn in_cloud(&self, neighborhoods: &Neighborhoods, cloud: &PointCloud) -> Feature {
        let index = neighborhoods.row(self.point as usize);
        Feature {
            index,
            position: cloud.point(index).to_vec(),
            pairs: self.modes.iter().map(|&mode| [mode, mode + 1]).collect(),
            persistence: self.persistence,
        }
    }
}

/// The feature points as a binary PLY of their own: position, `index`, `persistence`, number of `pairs`.
#[must_use]
pub fn as_ply(features: &[Feature], cloud: &PointCloud) -> Vec<u8> {
    let axes = cloud.dimension().max(3);
    let coordinate = |axis: usize| features.iter().map(move |f| f.position.get(axis).copied().unwrap_or(0.0));
    let mut columns: Vec<(String, ScalarType, Vec<f64>)> = (0..axes)
        .map(|axis| (axis_name(axis), cloud.coordinate_type(), coordinate(axis).collect()))
        .collect();
    let index = features.iter().map(|feature| feature.index as f64).collect();
    columns.push(("index".to_owned(), ScalarType::Uint32, index));
    let persistence = features.iter().map(|feature| feature.persistence).collect();
    columns.push(("persistence".to_owned(), ScalarType::Float32, persistence));
    let pairs = features.iter().map(|feature| feature.pairs.len() as f64).collect();
    columns.push(("pairs".to_owned(), ScalarType::Uint16, pairs));
    let header = PlyHeader {
        encoding: PlyEncoding::Binary,
        points: features.len(),
        properties: columns.iter().map(|(name, kind, _)| (name.clone(), *kind)).collect(),
        faces: 0,
    };
    let encoded: Vec<Column<'_>> =
        columns.iter().map(|(_, kind, values)| Column { values, stride: 1, kind: *kind }).collect();
    [header.to_bytes(), encode_rows(&encoded, features.len())].concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{NonFinite, PointCloud};

    /// A 30×30 grid of unit spacing.
    fn grid() -> (PointCloud, Neighborhoods) {
        let points = (0..900).flat_map(|i| [f64::from(i % 30), f64::from(i / 30), 0.0]).collect();
        let cloud = PointCloud::new(3, points, NonFinite::Reject).unwrap();
        let neighborhoods = Neighborhoods::find(&cloud, &[1.0; 900], 1.5).unwrap();
        (cloud, neighborhoods)
    }

    /// Two hills of heights 3 and 2, whose pass is at 1, and a hollow of depth 4.
    fn landscape(cloud: &PointCloud) -> Vec<f64> {
        let cone = |x: f64, y: f64, p: &[f64], height: f64| height - 0.5 * (p[0] - x).hypot(p[1] - y);
        (0..900)
            .map(|row| {
                let p = cloud.point(row);
                let hills = cone(6.0, 8.0, p, 3.0).max(cone(12.0, 8.0, p, 2.0));
                let hollow = cone(22.0, 22.0, p, 4.0);
                if hollow > 0.0 { -hollow } else { hills.max(1e-3) }
            })
            .collect()
    }

    #[test]
    fn a_hill_persists_down_to_its_pass_and_the_highest_down_to_the_nodal_line() {
        let (cloud, neighborhoods) = grid();
        let found = extrema(&landscape(&cloud), &neighborhoods, 1.0);
        let rows: Vec<usize> = found.iter().map(|e| neighborhoods.row(e.point as usize)).collect();
        assert_eq!(rows[..3], [22 * 30 + 22, 8 * 30 + 6, 8 * 30 + 12]);
        let persistence: Vec<f64> = found.iter().map(|e| e.persistence).collect();
        assert!(
            (persistence[0] - 4.0).abs() < 1e-12 && (persistence[1] - 3.0).abs() < 1e-12,
            "{persistence:?}"
        );
        // the pass lies between the cones, where both have fallen to 1
        assert!((persistence[2] - 1.0).abs() < 1e-12, "{persistence:?}");
    }

    #[test]
    fn the_sign_of_a_basis_changes_nothing() {
        let (cloud, neighborhoods) = grid();
        let one = landscape(&cloud);
        let other: Vec<f64> = one.iter().map(|h| -h).collect();
        assert_eq!(extrema(&one, &neighborhoods, 2.0), extrema(&other, &neighborhoods, 2.0));
    }

    #[test]
    fn extrema_of_two_modes_within_the_radius_are_one_place_and_others_none() {
        let (_, neighborhoods) = grid();
        let point = |row: usize| (0..900).find(|&i| neighborhoods.row(i) == row).unwrap() as u32;
        let extremum = |row, persistence| Extremum { point: point(row), persistence };
        let modes = [
            vec![extremum(100, 2.0), extremum(500, 1.0), extremum(700, 0.05)],
            vec![extremum(101, 3.0), extremum(700, 0.05)],
            vec![extremum(100, 0.5), extremum(505, 1.0)],
        ];
        let places = features(&modes, 4, &neighborhoods, 0.1);
        assert_eq!(places, [Place { point: point(101), persistence: 2.0, modes: vec![4, 5] }]);
    }

    #[test]
    fn rows_without_a_result_are_no_extrema_and_no_neighbors() {
        let (cloud, _) = grid();
        let mut mass = [1.0; 900];
        mass[8 * 30 + 6] = f64::NAN;
        let neighborhoods = Neighborhoods::find(&cloud, &mass, 1.5).unwrap();
        let mut basis = landscape(&cloud);
        basis[8 * 30 + 6] = f64::NAN;
        let found = extrema(&basis, &neighborhoods, 1.0);
        assert!(
            found
                .iter()
                .all(|e| neighborhoods.row(e.point as usize) != 8 * 30 + 6 && e.persistence.is_finite())
        );
    }
}
