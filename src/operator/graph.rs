//! Operators of the graph whose edges join points within δ of each other: what the papers compare with.

use super::{HeatKernel, LaplaceBeltrami, OperatorKind, Sparse, Structure};
use crate::geometry::{Points, SearchTree};
use crate::progress::{Canceled, Progress};

/// Default δ of the ball graph as a multiple of ε. Every point has a neighbor within 2ε, so that 3 leaves no gaps,
/// with about 20 neighbors a point; the paper draws its graph with 10 (its first eigenvalues, 0.151 on a sphere of
/// 1,000 points, are `δ²/4` at that δ).
pub const DELTA_FACTOR: f64 = 3.0;

/// A graph operator and its companion with narrow rows.
#[derive(Debug)]
pub struct Graph {
    /// The operator.
    pub laplacian: LaplaceBeltrami,
    /// The Laplacian of the subgraph of `walls`, weighted so that both have the same energy on linear functions.
    pub narrow: Sparse,
}

/// `graph`, `kirchhoff` or `tutte` with edges between points at most `delta` apart [PBMHB §5.2].
///
/// With adjacency `A` and degrees `D`: `kirchhoff` is `S = D − A`, `B = I`; `tutte` is `S = D − A`, `B = D`, whose
/// `B⁻¹S = I − D⁻¹A` the paper calls not symmetrizable, though with a symmetric `A` it is; `graph` is
/// `S = I − D^-½ A D^-½`, `B = I`, the same spectrum with bases `D^½` times those of `tutte`.
///
/// # Errors
/// [`Canceled`].
pub fn build(
    kind: OperatorKind,
    points: &Points,
    tree: &SearchTree,
    walls: &Sparse,
    delta: f64,
    progress: &Progress,
) -> Result<Graph, Canceled> {
    let n = points.len();
    let half = |rows: usize| progress.advance(0.5 * rows as f64 / n as f64);
    let kirchhoff = Sparse::stiffness(
        n,
        Vec::new,
        |i, neighbors, row| {
            if progress.is_canceled() {
                return;
            }
            tree.within(points, i, delta, neighbors);
            row.extend(neighbors.iter().map(|q| (q.index, 1.0)));
        },
        half,
    )?;
    let moment = |matrix: &Sparse| -> f64 {
        (0..n).flat_map(|i| matrix.neighbors(i).map(move |j| points.squared_distance(i, j as usize))).sum()
    };
    let weight = moment(&kirchhoff) / moment(walls).max(f64::MIN_POSITIVE);
    let mut narrow = Sparse::stiffness(
        n,
        || (),
        |i, (), row| row.extend(walls.neighbors(i).map(|j| (j, weight))),
        |rows| progress.advance(0.5 + 0.5 * rows as f64 / n as f64),
    )?;
    let degree: Vec<f64> = (0..n).map(|i| kirchhoff.neighbors(i).count() as f64).collect();
    let mean_degree = degree.iter().sum::<f64>() / n as f64;
    let laplacian = match kind {
        OperatorKind::Kirchhoff => LaplaceBeltrami {
            plateau: Some(1.0 / mean_degree.max(1.0)),
            ..LaplaceBeltrami::narrow(kirchhoff, vec![1.0; n])
        },
        OperatorKind::Tutte => {
            LaplaceBeltrami { plateau: Some(1.0), ..LaplaceBeltrami::narrow(kirchhoff, degree) }
        }
        _ => {
            let root: Vec<f64> = degree.iter().map(|d| d.sqrt()).collect();
            // a point without neighbors stays alone, whatever its row is
            let inverse: Vec<f64> = root.iter().map(|r| if *r > 0.0 { 1.0 / r } else { 1.0 }).collect();
            let mut normalized = kirchhoff;
            normalized.scale_both_sides(&inverse);
            narrow.scale_both_sides(&inverse);
            LaplaceBeltrami {
                harmonic: Some(root),
                plateau: Some(1.0),
                ..LaplaceBeltrami::narrow(normalized, vec![1.0; n])
            }
        }
    };
    Ok(Graph { laplacian, narrow })
}

/// The weighted graph Laplacian [PCD §4; Lafon 2004, α = 1]: `w_ij = exp(−|p_i−p_j|²/4t)` with `w_ii = 1`, divided by
/// the densities `d_i d_j` (`d = W 1`), then by the new row sums `b`: `L = (B⁻¹W̃ − I)/t`, hence `S = (B − W̃)/t`.
///
/// # Errors
/// [`Canceled`].
pub fn weighted(
    points: &Points,
    tree: &SearchTree,
    kernel: HeatKernel,
    progress: &Progress,
) -> Result<LaplaceBeltrami, Canceled> {
    let n = points.len();
    let exponent = -0.25 / kernel.t;
    let mut gaussian = Sparse::from_rows(
        n,
        Vec::new,
        |i, neighbors, row| {
            if progress.is_canceled() {
                return;
            }
            tree.within(points, i, kernel.delta, neighbors);
            let before = neighbors.partition_point(|q| (q.index as usize) < i);
            row.extend(neighbors.iter().map(|q| (q.index, (exponent * q.squared_distance).exp())));
            row.insert(before, (i as u32, 1.0));
        },
        |rows| progress.advance(0.8 * rows as f64 / n as f64),
    )?;
    let ones = vec![1.0; n];
    let density = gaussian.product(&ones);
    gaussian.scale_both_sides(&density.iter().map(|d| 1.0 / d).collect::<Vec<_>>());
    let mass = gaussian.product(&ones);
    let stiffness = Sparse::stiffness(
        n,
        || (),
        |i, (), row| {
            let (columns, values) = gaussian.row(i);
            let others = columns.iter().zip(values).filter(|(j, _)| **j as usize != i);
            row.extend(others.map(|(&j, w)| (j, w / kernel.t)));
        },
        |rows| progress.advance(0.8 + 0.2 * rows as f64 / n as f64),
    )?;
    Ok(LaplaceBeltrami {
        structure: Structure::SemiDefinite,
        ..LaplaceBeltrami::diffusive(stiffness, mass, kernel)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{NonFinite, PointCloud};

    /// Points 0, 1, 2, 3.5, 10 on the x-axis, 2 apart at most for an edge: the path 0–1–2–3 with 0–2, and 4 alone.
    fn on_a_line() -> (Points, SearchTree, Sparse) {
        let xs = [0.0, 1.0, 2.0, 3.5, 10.0];
        let cloud =
            PointCloud::new(2, xs.iter().flat_map(|&x| [x, 0.0]).collect(), NonFinite::Reject).unwrap();
        let points = Points::prepare(&cloud, 1).unwrap();
        let tree = SearchTree::new(&points);
        let walls = Sparse::stiffness(
            5,
            || (),
            |i, (), row| {
                row.extend([i.wrapping_sub(1), i + 1].iter().filter(|&&j| j < 5).map(|&j| (j as u32, 1.0)));
            },
            |_| Ok::<(), ()>(()),
        )
        .unwrap();
        (points, tree, walls)
    }

    fn dense(matrix: &Sparse, points: &Points) -> Vec<Vec<f64>> {
        let n = matrix.rows();
        let mut rows = vec![vec![0.0; n]; n];
        for i in 0..n {
            let (columns, values) = matrix.row(i);
            for (&j, &value) in columns.iter().zip(values) {
                rows[points.row(i)][points.row(j as usize)] = value;
            }
        }
        rows
    }

    fn assert_near(found: &[Vec<f64>], expected: &[[f64; 5]; 5]) {
        for (found, expected) in found.iter().zip(expected) {
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15), "{found:?} {expected:?}");
        }
    }

    #[test]
    fn the_graph_operators_are_those_worked_out_by_hand() {
        // degrees 2, 2, 3, 1, 0
        let (points, tree, walls) = on_a_line();
        let of = |kind| build(kind, &points, &tree, &walls, 2.0, &Progress::new()).unwrap().laplacian;
        let kirchhoff = [
            [2.0, -1.0, -1.0, 0.0, 0.0],
            [-1.0, 2.0, -1.0, 0.0, 0.0],
            [-1.0, -1.0, 3.0, -1.0, 0.0],
            [0.0, 0.0, -1.0, 1.0, 0.0],
            [0.0; 5],
        ];
        let kind = of(OperatorKind::Kirchhoff);
        assert_near(&dense(&kind.stiffness, &points), &kirchhoff);
        assert_eq!(kind.mass, [1.0; 5]);
        let tutte = of(OperatorKind::Tutte);
        assert_near(&dense(&tutte.stiffness, &points), &kirchhoff);
        let degree: Vec<f64> = (0..5).map(|row| tutte.mass[points.of_row(row).unwrap()]).collect();
        assert_eq!(degree, [2.0, 2.0, 3.0, 1.0, 0.0]);
        let (half, sixth, third) = (-0.5, -(1.0_f64 / 6.0).sqrt(), -(1.0_f64 / 3.0).sqrt());
        let normalized = [
            [1.0, half, sixth, 0.0, 0.0],
            [half, 1.0, sixth, 0.0, 0.0],
            [sixth, sixth, 1.0, third, 0.0],
            [0.0, 0.0, third, 1.0, 0.0],
            [0.0; 5],
        ];
        assert_near(&dense(&of(OperatorKind::Graph).stiffness, &points), &normalized);
    }

    #[test]
    fn the_weighted_graph_is_normalized_as_worked_out_by_hand() {
        // with 4t = 1 and δ = 1.2 only 0–1 and 1–2 are joined, by w = 1/e; densities 1+w, 1+2w, 1+w, 1, 1
        let (points, tree, _) = on_a_line();
        let kernel = HeatKernel { t: 0.25, delta: 1.2, truncation_compensation: false, dimension: 1 };
        let laplacian = weighted(&points, &tree, kernel, &Progress::new()).unwrap();
        let w = (-1.0_f64).exp();
        let (end, middle) = (1.0 + w, 1.0 + 2.0 * w);
        let coupling = w / (end * middle);
        let masses = [1.0 / (end * end) + coupling, 1.0 / (middle * middle) + 2.0 * coupling];
        let rows = dense(&laplacian.stiffness, &points);
        for (found, expected) in [
            (rows[0][1], -coupling / 0.25),
            (rows[1][1], 2.0 * coupling / 0.25),
            (rows[0][2], 0.0),
            (rows[3][3], 0.0),
            (laplacian.mass[points.of_row(0).unwrap()], masses[0]),
            (laplacian.mass[points.of_row(1).unwrap()], masses[1]),
            (laplacian.mass[points.of_row(4).unwrap()], 1.0),
        ] {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }
    }
}
