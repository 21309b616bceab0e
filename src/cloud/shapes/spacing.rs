//! Well spaced points out of independent ones: darts that keep a distance.

use std::collections::HashMap;

/// Darts thrown per wanted point before the distance shrinks.
const DARTS_PER_ROUND: usize = 2;
/// By how much.
const SHRINKING: f64 = 0.97;

/// Draws until `points` points have a least distance from each other, which shrinks round by round until so many
/// find room (McCool and Fiume, "Hierarchical Poisson disk sampling distributions", 1992).
pub(super) fn well_spaced(points: usize, mut draw: impl FnMut() -> [f64; 3]) -> Vec<[f64; 3]> {
    let mut darts = Darts::new(distance_bound(points, &mut draw));
    while darts.points.len() < points {
        for _ in 0..(DARTS_PER_ROUND * points) {
            if darts.points.len() == points {
                break;
            }
            darts.throw(draw());
        }
        darts.distance *= SHRINKING;
    }
    darts.points
}

/// A distance that `points` points surely do not all keep, from the box of a few draws: a surface in a box has
/// about its area, and every point of a hexagonal packing takes √3/2 · distance² of it. Too large a bound only
/// costs rounds.
fn distance_bound(points: usize, draw: &mut impl FnMut() -> [f64; 3]) -> f64 {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for _ in 0..1000 {
        for (axis, x) in draw().into_iter().enumerate() {
            low[axis] = low[axis].min(x);
            high[axis] = high[axis].max(x);
        }
    }
    let [a, b, c] = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    let area = 2.0 * (a * b + b * c + c * a);
    (area * 2.0 / 3.0_f64.sqrt() / points as f64).sqrt()
}

struct Darts {
    points: Vec<[f64; 3]>,
    /// Least distance, at most the side of a cell.
    distance: f64,
    side: f64,
    cells: HashMap<[i64; 3], Vec<u32>>,
}

impl Darts {
    fn new(distance: f64) -> Self {
        Self { points: Vec::new(), distance, side: distance, cells: HashMap::new() }
    }

    /// Keeps the point if none is nearer than the distance.
    fn throw(&mut self, point: [f64; 3]) {
        let [x, y, z] = point.map(|x| (x / self.side).floor() as i64);
        let around =
            (-1..=1).flat_map(|i| (-1..=1).flat_map(move |j| (-1..=1).map(move |k| [x + i, y + j, z + k])));
        let mut near = around.filter_map(|cell| self.cells.get(&cell)).flatten();
        if near.any(|&other| squared_distance(point, self.points[other as usize]) < self.distance.powi(2)) {
            return;
        }
        self.cells.entry([x, y, z]).or_default().push(self.points.len() as u32);
        self.points.push(point);
    }
}

fn squared_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}
