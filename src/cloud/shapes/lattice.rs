//! Golden lattices: well spaced under every stretching along the axes, hence on every chart.

use super::chart::{Chart, Gluing};

/// 1/φ: no number is approximated worse by fractions, so that no two points of the lattice come close, however
/// the axes are scaled.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Solution of s⁴ = s + 1: its powers −1, −2, −3 make the analogous sequence in the cube
/// (M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
const SUPERGOLDEN: f64 = 1.220_744_084_605_759_5;

/// Parameters of `points` points that are uniform by area. `shift` (from 0 to 1 along every axis) moves the lattice along
/// the axes on which it closes, and along the second one always: another sample of the same evenness (Cranley and Patterson,
/// "Randomization of number theoretic methods for multiple integration", SIAM J. Numer. Anal. 13, 1976).
pub(super) fn golden(chart: Chart, points: usize, shift: [f64; 3]) -> impl Iterator<Item = [f64; 3]> {
    let n = points as f64;
    let gluing = chart.gluing();
    // On a torus the lattice must close at u=1: the step along v is the nearest whole number of n-ths.
    let step = if gluing == Gluing::Torus { (n * GOLDEN).round() / n } else { GOLDEN };
    let warp = chart.is_warped().then(|| Warp::new(chart));
    (0..points).map(move |i| {
        let i = i as f64;
        if gluing == Gluing::Torus3 {
            return [1, 2, 3]
                .map(|axis| (0.5 + shift[axis as usize - 1] + i * SUPERGOLDEN.powi(-axis)).fract());
        }
        // Where the first axis does not close, its rows move within their own width.
        let u = if gluing == Gluing::Torus { ((i + 0.5) / n + shift[0]).fract() } else { (i + 0.5) / n };
        let [u, v] = [u, (i * step + shift[1]).fract()];
        let [u, v] = warp.as_ref().map_or([u, v], |warp| warp.apply(u, v));
        [u, v, 0.0]
    })
}

/// Cells along each axis of the warp's table.
const CELLS: usize = 512;

/// Maps the unit square onto itself so that the chart behind it is uniform by area: the marginal distribution
/// of the area along u is inverted, then the conditional one along v (Rosenblatt, 1952).
///
/// Both are tabulated; within a cell the density counts as constant.
struct Warp {
    /// Area up to every cell boundary along u, ending in 1.
    marginal: Vec<f64>,
    /// The same along v, for every cell along u.
    conditional: Vec<Vec<f64>>,
}

impl Warp {
    fn new(chart: Chart) -> Self {
        let middle = |cell: usize| (cell as f64 + 0.5) / CELLS as f64;
        let rows: Vec<Vec<f64>> = (0..CELLS)
            .map(|i| (0..CELLS).map(|j| chart.place([middle(i), middle(j), 0.0]).weight).collect())
            .collect();
        let sums: Vec<f64> = rows.iter().map(|row| row.iter().sum()).collect();
        Self { marginal: cumulated(&sums), conditional: rows.iter().map(|row| cumulated(row)).collect() }
    }

    fn apply(&self, u: f64, v: f64) -> [f64; 2] {
        let u = inverted(&self.marginal, u);
        let row = ((u * CELLS as f64) as usize).min(CELLS - 1);
        [u, inverted(&self.conditional[row], v)]
    }
}

fn cumulated(weights: &[f64]) -> Vec<f64> {
    let total: f64 = weights.iter().sum();
    let mut sum = 0.0;
    let parts = weights.iter().map(|weight| {
        sum += weight;
        sum / total
    });
    std::iter::once(0.0).chain(parts).collect()
}

/// Where in `0..1` a cumulated distribution takes the value.
fn inverted(cumulated: &[f64], value: f64) -> f64 {
    let cells = cumulated.len() - 1;
    let cell = cumulated.partition_point(|&sum| sum <= value).clamp(1, cells) - 1;
    let (low, high) = (cumulated[cell], cumulated[cell + 1]);
    (cell as f64 + (value - low) / (high - low)) / cells as f64
}
