//! Distances along the surface between near points, by unfolding the stars around each point into the plane.
//!
//! A discrete exponential map in the manner of Schmidt, Grimm and Wyvill (2006): breadth first from a point, nearest
//! first, every star is laid into the point's plane with its spokes at their true lengths and angles (those around a
//! closed star stretched to 2π), turned so that the spoke to the star it was reached from fits. On developable
//! surfaces, creases included, the distance in the plane is the geodesic distance.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::TAU;

use rayon::prelude::*;

use super::Sparse;
use super::sheets::Sheets;
use crate::geometry::{Points, Stars, TriangleMetric};
use crate::progress::{Canceled, Progress};

/// A way along spokes this many times the straight way leads around a hole or a tear, not along the surface. Between
/// opposite corners of a square lattice it is √2.
const DETOUR_MAX: f64 = 1.6;

/// No spoke leads back.
const NONE: u32 = u32::MAX;

/// Stars with the direction and length of every spoke, ready to be laid out.
#[derive(Debug)]
pub struct Atlas<'a> {
    points: &'a Points,
    stars: &'a Stars,
    sheets: &'a Sheets,
    /// Offset of every spoke's neighbor in the chart of its star.
    offsets: Vec<[f64; 2]>,
    /// Place of the spoke back in the neighbor's star, or [`NONE`].
    back: Vec<u32>,
}

impl<'a> Atlas<'a> {
    /// Lays out every star by itself; `sheets` must hold the frames that the stars were seen in.
    #[must_use]
    pub fn new(points: &'a Points, stars: &'a Stars, sheets: &'a Sheets) -> Self {
        let chart = |i: usize| chart(points, stars, sheets, i);
        let offsets = (0..stars.len()).into_par_iter().with_min_len(256).flat_map_iter(chart).collect();
        let back = (0..stars.len())
            .into_par_iter()
            .with_min_len(256)
            .flat_map_iter(|i| {
                stars.of(i).iter().map(move |spoke| {
                    let star = stars.of(spoke.neighbor as usize);
                    star.iter().position(|back| back.neighbor as usize == i).map_or(NONE, |k| k as u32)
                })
            })
            .collect();
        Self { points, stars, sheets, offsets, back }
    }

    /// Squared distances along the surface up to the geometric mean of the `radius` of both ends: symmetric, the diagonal
    /// zero. Where the two ends of a pair find different distances, their mean counts.
    ///
    /// # Errors
    /// [`Canceled`].
    pub fn squared_distances(
        &self,
        radius: impl Fn(usize) -> f64 + Sync + Send,
        progress: &Progress,
    ) -> Result<Sparse, Canceled> {
        let n = self.stars.len();
        let seen = Sparse::from_rows(
            n,
            Walk::default,
            |i, walk, row| {
                if progress.is_canceled() {
                    return;
                }
                // a pair's end of the larger radius reaches the other one
                walk.from(self, i, radius(i));
                row.extend(walk.nodes.iter().map(|node| (node.point, node.distance)));
                row.sort_unstable_by_key(|&(j, _)| j);
            },
            |rows| progress.advance(0.6 * rows as f64 / n as f64),
        )?;
        let unseen = seen.seen_from_elsewhere();
        Sparse::from_rows(
            n,
            || (),
            |i, (), row| {
                let (columns, distances) = seen.row(i);
                row.extend(columns.iter().zip(distances).map(|(&j, &there)| {
                    let (back, distances) = seen.row(j as usize);
                    let back = back.binary_search(&(i as u32)).map_or(there, |k| distances[k]);
                    let mean = 0.5 * (there + back);
                    (j, mean * mean)
                }));
                row.extend(unseen[i].iter().map(|&(j, distance)| (j, distance * distance)));
                row.retain(|&(j, squared)| squared <= radius(i) * radius(j as usize));
                row.sort_unstable_by_key(|&(j, _)| j);
            },
            |rows| progress.advance(0.6 + 0.1 * rows as f64 / n as f64),
        )
    }
}

/// Offsets of the spokes of point `i` in its own plane. Triangles keep their angles, gaps that of the projection;
/// around a closed star they are stretched to 2π.
fn chart(points: &Points, stars: &Stars, sheets: &Sheets, i: usize) -> Vec<[f64; 2]> {
    let star = stars.of(i);
    let flat =
        |k: usize| -> [f64; 2] { sheets.seen_first(points, i, star[k % star.len()].neighbor as usize) };
    let angle = |k: usize| {
        if star[k].filled {
            return TriangleMetric::of(points, stars.triangle(i, k)).angle(0);
        }
        let (a, b) = (flat(k), flat(k + 1));
        (a[0] * b[1] - a[1] * b[0]).atan2(a[0] * b[0] + a[1] * b[1]).rem_euclid(TAU)
    };
    let angles: Vec<f64> = (0..star.len()).map(angle).collect();
    let closed = star.iter().all(|spoke| spoke.filled);
    let stretch = if closed { TAU / angles.iter().sum::<f64>() } else { 1.0 };
    let mut direction = 0.0;
    star.iter()
        .zip(angles)
        .map(|(spoke, angle)| {
            let length = points.squared_distance(i, spoke.neighbor as usize).sqrt();
            let (sine, cosine) = f64::sin_cos(direction);
            direction += stretch * angle;
            [length * cosine, length * sine]
        })
        .collect()
}

/// A point reached.
#[derive(Debug, Clone, Copy)]
struct Node {
    point: u32,
    at: [f64; 2],
    distance: f64,
    /// Length of the way along spokes.
    way: f64,
    /// How its chart lies in the plane: a turn, as a unit complex number, after a reflection if mirrored. None when
    /// the spoke it was reached by does not lead back.
    turn: Option<[f64; 2]>,
    mirrored: bool,
    done: bool,
}

/// Scratch memory of one thread.
#[derive(Debug, Default)]
struct Walk {
    nodes: Vec<Node>,
    queue: BinaryHeap<Reverse<(u64, u32)>>,
    places: Places,
}

impl Walk {
    /// Reaches all points within `radius` of point `i`, itself the first.
    fn from(&mut self, atlas: &Atlas<'_>, i: usize, radius: f64) {
        self.nodes.clear();
        self.places.clear();
        self.queue.clear();
        self.reach(Node {
            point: i as u32,
            at: [0.0; 2],
            distance: 0.0,
            way: 0.0,
            turn: Some([1.0, 0.0]),
            mirrored: false,
            done: false,
        });
        while let Some(Reverse((distance, place))) = self.queue.pop() {
            let node = &mut self.nodes[place as usize];
            // bits of non-negative numbers are ordered like the numbers
            if node.done || node.distance.to_bits() != distance {
                continue;
            }
            node.done = true;
            let node = *node;
            if let Some(turn) = node.turn {
                self.lay_out(atlas, i, node, turn, radius);
            }
        }
    }

    /// Reaches the neighbors of `node`.
    fn lay_out(&mut self, atlas: &Atlas<'_>, i: usize, node: Node, turn: [f64; 2], radius: f64) {
        let q = node.point as usize;
        let start = atlas.stars.offsets()[q];
        for (k, spoke) in atlas.stars.of(q).iter().enumerate() {
            let known = self.places.get(spoke.neighbor);
            if known.is_some_and(|place| {
                let node = &self.nodes[place as usize];
                node.done || node.turn.is_some()
            }) {
                continue;
            }
            let offset = atlas.offsets[start + k];
            let length = offset[0].hypot(offset[1]);
            let step = times(turn, reflected(offset, node.mirrored));
            let at = [node.at[0] + step[0], node.at[1] + step[1]];
            // no way along the surface is shorter than the straight one through space
            let chord = atlas.points.squared_distance(i, spoke.neighbor as usize).sqrt();
            let distance = at[0].hypot(at[1]).max(chord);
            let way = node.way + length;
            let back = atlas.back[start + k];
            if distance > radius || way > DETOUR_MAX * distance || (known.is_some() && back == NONE) {
                continue;
            }
            let mirrored = node.mirrored ^ atlas.sheets.mirrored(q, spoke.neighbor as usize);
            let turn = (back != NONE).then(|| {
                let place = atlas.stars.offsets()[spoke.neighbor as usize] + back as usize;
                let back = reflected(atlas.offsets[place], mirrored);
                // the turn that lays the spoke back onto the spoke here, reversed
                let turn = times([-step[0], -step[1]], [back[0], -back[1]]);
                let size = turn[0].hypot(turn[1]);
                turn.map(|x| x / size)
            });
            let reached = Node { point: spoke.neighbor, at, distance, way, turn, mirrored, done: false };
            match known {
                Some(place) => {
                    self.nodes[place as usize] = reached;
                    self.queue.push(Reverse((distance.to_bits(), place)));
                }
                None => self.reach(reached),
            }
        }
    }

    fn reach(&mut self, node: Node) {
        let place = self.nodes.len() as u32;
        self.places.insert(node.point, place);
        self.nodes.push(node);
        self.queue.push(Reverse((node.distance.to_bits(), place)));
    }
}

/// Product of complex numbers.
fn times(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

fn reflected(a: [f64; 2], mirrored: bool) -> [f64; 2] {
    if mirrored { [a[0], -a[1]] } else { a }
}

/// Where a point stands in a short list: open addressing, emptied at the cost of what is in it.
#[derive(Debug, Default)]
struct Places {
    slots: Vec<(u32, u32)>,
    used: Vec<u32>,
}

impl Places {
    const EMPTY: (u32, u32) = (u32::MAX, 0);

    fn clear(&mut self) {
        for slot in self.used.drain(..) {
            self.slots[slot as usize] = Self::EMPTY;
        }
    }

    fn slot(&self, point: u32) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = (point.wrapping_mul(0x9E37_79B9) >> 7) as usize & mask;
        while self.slots[slot].0 != point && self.slots[slot] != Self::EMPTY {
            slot = (slot + 1) & mask;
        }
        slot
    }

    fn get(&self, point: u32) -> Option<u32> {
        if self.slots.is_empty() {
            return None;
        }
        let found = self.slots[self.slot(point)];
        (found.0 == point).then_some(found.1)
    }

    /// `point` must not be there yet.
    fn insert(&mut self, point: u32, place: u32) {
        if 2 * (self.used.len() + 1) > self.slots.len() {
            let wider = vec![Self::EMPTY; (2 * self.slots.len()).max(256)];
            let old = std::mem::replace(&mut self.slots, wider);
            self.used.clear();
            for entry in old.into_iter().filter(|&entry| entry != Self::EMPTY) {
                self.put(entry);
            }
        }
        self.put((point, place));
    }

    fn put(&mut self, entry: (u32, u32)) {
        let slot = self.slot(entry.0);
        self.slots[slot] = entry;
        self.used.push(slot as u32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::stars::tests::stars_of;
    use crate::operator::voronoi;

    /// All distances up to `radius` between rows, NaN where there is none.
    fn distances(rows: &[[f64; 3]], radius: f64) -> impl Fn(usize, usize) -> f64 {
        let (points, frames, stars) = stars_of(rows);
        let cells = stars.cells(&points, &Progress::new()).unwrap();
        let walls = voronoi::stiffness(&cells, &Progress::new()).unwrap();
        let sheets = Sheets::orient(frames, &walls, &Progress::new()).unwrap();
        let squared =
            Atlas::new(&points, &stars, &sheets).squared_distances(|_| radius, &Progress::new()).unwrap();
        move |a, b| {
            let (i, j) = (points.of_row(a).unwrap(), points.of_row(b).unwrap() as u32);
            let (columns, values) = squared.row(i);
            columns.binary_search(&j).map_or(f64::NAN, |k| values[k].sqrt())
        }
    }

    /// A strip of `length` by 12 unit squares, bent so that `at(u)` is its profile.
    fn strip(length: i32, at: impl Fn(f64) -> [f64; 2]) -> Vec<[f64; 3]> {
        (0..(length + 1) * 13)
            .map(|i| (f64::from(i / 13), f64::from(i % 13)))
            .map(|(u, v)| {
                let [x, z] = at(u);
                [x, v, z]
            })
            .collect()
    }

    #[test]
    fn across_a_right_angled_fold_the_distance_is_that_of_the_unfolded_strip() {
        let rows = strip(20, |u| if u <= 10.0 { [u, 0.0] } else { [10.0, u - 10.0] });
        let distance = distances(&rows, 4.6);
        for (a, b) in
            [([8_i32, 6_i32], [12_i32, 6_i32]), ([9, 4], [12, 7]), ([10, 6], [13, 8]), ([10, 3], [10, 7])]
        {
            let row = |[u, v]: [i32; 2]| (13 * u + v) as usize;
            let flat = f64::from((a[0] - b[0]).pow(2) + (a[1] - b[1]).pow(2)).sqrt();
            let found = distance(row(a), row(b));
            assert!((found - flat).abs() < 1e-9 * flat, "{a:?} {b:?}: {found} {flat}");
        }
        // through space it is shorter: 2√2 instead of 4
        assert!(distance(13 * 8 + 6, 13 * 12 + 6) > 1.4 * 8.0_f64.sqrt());
    }

    #[test]
    fn the_opposite_side_of_a_thin_plate_is_not_near() {
        // a strip folded twice: two sheets, 2 apart, joined at one end
        let rows = strip(32, |u| match u {
            u if u <= 15.0 => [u, 0.0],
            u if u <= 17.0 => [15.0, u - 15.0],
            u => [32.0 - u, 2.0],
        });
        let distance = distances(&rows, 4.0);
        let row = |u: usize, v: usize| 13 * u + v;
        assert!(distance(row(5, 6), row(27, 6)).is_nan());
        assert!((distance(row(5, 6), row(8, 6)) - 3.0).abs() < 1e-9);
        // around the fold
        assert!((distance(row(15, 6), row(17, 6)) - 2.0).abs() < 1e-9);
    }

    #[test]
    fn distances_are_symmetric_and_never_shorter_than_through_space() {
        let rows = strip(40, |u| {
            let (sine, cosine) = f64::sin_cos(std::f64::consts::PI * u / 40.0);
            [12.0 * cosine, 12.0 * sine]
        });
        let distance = distances(&rows, 3.0);
        let arc = 2.0 * std::f64::consts::PI * 12.0 / 80.0 * 3.0;
        let (a, b) = (13 * 20 + 6, 13 * 23 + 6);
        assert!((distance(a, b) / arc - 1.0).abs() < 2e-3, "{} {arc}", distance(a, b));
        for (a, b) in [(13 * 20 + 6, 13 * 22 + 8), (13 * 3 + 1, 13 * 5), (0, 14)] {
            let chord: f64 = (0..3).map(|axis| (rows[a][axis] - rows[b][axis]).powi(2)).sum();
            assert_eq!(distance(a, b).to_bits(), distance(b, a).to_bits());
            assert!(distance(a, b) >= chord.sqrt() * (1.0 - 1e-12));
        }
    }

    #[test]
    fn places_are_found_after_the_table_has_grown_and_forgotten_when_cleared() {
        let mut places = Places::default();
        for point in 0..1_000 {
            assert_eq!(places.get(7 * point), None);
            places.insert(7 * point, point);
        }
        assert!((0..1_000).all(|point| places.get(7 * point) == Some(point)));
        places.clear();
        assert!((0..1_000).all(|point| places.get(7 * point).is_none()));
    }
}
