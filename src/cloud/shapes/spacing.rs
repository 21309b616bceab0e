//! Well spaced points out of independent ones: darts that keep a distance.

/// Darts thrown per wanted point before the distance shrinks.
const DARTS_PER_ROUND: usize = 2;
/// By how much.
const SHRINKING: f64 = 0.97;

/// Draws until `points` points have a least distance from each other, which shrinks round by round until so many
/// find room (`McCool` and Fiume, "Hierarchical Poisson disk sampling distributions", 1992).
pub(super) fn well_spaced(points: usize, mut draw: impl FnMut() -> [f64; 3]) -> Vec<[f64; 3]> {
    let mut darts = Darts::new(points, &Bounds::of(&mut draw));
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

/// The box of a few draws. Later draws outside it fall into its outermost cells.
struct Bounds {
    low: [f64; 3],
    size: [f64; 3],
}

impl Bounds {
    fn of(draw: &mut impl FnMut() -> [f64; 3]) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for _ in 0..1000 {
            for (axis, x) in draw().into_iter().enumerate() {
                low[axis] = low[axis].min(x);
                high[axis] = high[axis].max(x);
            }
        }
        Self { low, size: [0, 1, 2].map(|axis| high[axis] - low[axis]) }
    }

    /// A distance that `points` points surely do not all keep: a surface in a box has about the box's area, and
    /// every point of a hexagonal packing takes √3/2 · distance² of it. Too large a bound only costs rounds.
    fn distance(&self, points: usize) -> f64 {
        let [a, b, c] = self.size;
        let area = 2.0 * (a * b + b * c + c * a);
        (area * 2.0 / 3.0_f64.sqrt() / points as f64).sqrt()
    }
}

/// Ends a list of points.
const NONE: u32 = u32::MAX;

/// Most cells per point, so that small distances do not need a large grid.
const CELLS_PER_POINT: f64 = 32.0;

struct Darts {
    points: Vec<[f64; 3]>,
    /// Least distance, at most the side of a cell.
    distance: f64,
    low: [f64; 3],
    side: f64,
    /// Cells along each axis.
    cells: [usize; 3],
    /// Last point of every cell, and before every point the one before it in its cell.
    last: Vec<u32>,
    before: Vec<u32>,
}

impl Darts {
    fn new(points: usize, bounds: &Bounds) -> Self {
        let distance = bounds.distance(points);
        let volume: f64 = bounds.size.iter().product();
        let side = distance.max((volume / (CELLS_PER_POINT * points as f64)).cbrt());
        let cells = bounds.size.map(|size| (size / side).ceil().max(1.0) as usize);
        let last = vec![NONE; cells.iter().product()];
        Self {
            points: Vec::with_capacity(points),
            distance,
            low: bounds.low,
            side,
            cells,
            last,
            before: Vec::new(),
        }
    }

    /// Keeps the point if none is nearer than the distance.
    fn throw(&mut self, point: [f64; 3]) {
        // Below 0 the cast saturates.
        let home = [0, 1, 2]
            .map(|axis| (((point[axis] - self.low[axis]) / self.side) as usize).min(self.cells[axis] - 1));
        let near = [0, 1, 2].map(|axis| home[axis].saturating_sub(1)..(home[axis] + 2).min(self.cells[axis]));
        for i in near[0].clone() {
            for j in near[1].clone() {
                for k in near[2].clone() {
                    if self.is_crowded([i, j, k], point) {
                        return;
                    }
                }
            }
        }
        let cell = self.index(home);
        self.before.push(std::mem::replace(&mut self.last[cell], self.points.len() as u32));
        self.points.push(point);
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (i * self.cells[1] + j) * self.cells[2] + k
    }

    /// Whether a point of this cell is nearer than the distance.
    fn is_crowded(&self, cell: [usize; 3], point: [f64; 3]) -> bool {
        let mut other = self.last[self.index(cell)];
        while other != NONE {
            if squared_distance(point, self.points[other as usize]) < self.distance * self.distance {
                return true;
            }
            other = self.before[other as usize];
        }
        false
    }
}

fn squared_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}
