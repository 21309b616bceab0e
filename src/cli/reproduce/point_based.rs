//! [PBMHB Fig. 3 and 5]: Δf on a cylinder and on spheres.

use chladni::operator::OperatorKind::{Graph, PbMhb, Pcd, PcdSymmetrized};

use super::Extent;
use super::measure::{Known, laplacian, operator, point_based_parameters, quantile, sampled};
use super::samples;
use super::table::{Bound, Table};
use crate::cli::Failure;

/// The sampling of the paper's cylinder.
const AROUND: usize = 300;
const ROWS: usize = 301;

/// Why `pcd` is the worse the finer the grid is.
const TIES: &str = "Squares have no Delaunay triangulation of their own: which of their diagonals `pcd` takes is arbitrary, its \
    weights are uneven, and the error grows with the gradient 2v over the spacing (0.11 on 100 × 100 points). With every \
    second row turned by half a spacing, where nothing is arbitrary, `pcd` is off by 0.0024 on 300 × 301 points.";

/// Δv² = 2 on a cylinder, away from its rims.
pub(super) fn figure_3(extent: Extent) -> Result<Table, Failure> {
    let (around, rows) = if extent == Extent::Full { (AROUND, ROWS) } else { (AROUND / 3, ROWS / 3) };
    let cylinder = samples::cylinder(around, rows)?;
    let mut table = Table::new(
        "PBMHB Figure 3: Δv² = 2 on a cylinder",
        format!(
            "{around} × {rows} points, radius 1, height 4; t = ε² and δ = 5√(2t) (10ε in `pcd` and the graph), as for all \
             tables of this paper. Largest |Δv² − 2| over points farther than 10ε from both rims. The paper shows plots: \
             its operator on the line 2, PCD with slight oscillations, the graph at 0, the symmetrized PCD far off."
        ),
    );
    for (kind, bound) in [
        (PbMhb, Bound::AtMost(0.02)),
        (Pcd, Bound::AtMost(0.2)),
        (Graph, Bound::AtLeast(1.9)),
        (PcdSymmetrized, Bound::Shown),
    ] {
        let built = operator(&cylinder, &point_based_parameters(kind))?;
        let margin = 10.0 * built.report.sampling.epsilon;
        let found = laplacian(&built, &cylinder, |p| p[2] * p[2]);
        let inside = |i: &usize| (margin..=4.0 - margin).contains(&cylinder.point(*i)[2]);
        let worst = (0..cylinder.len()).filter(inside).map(|i| (found[i] - 2.0).abs()).fold(0.0, f64::max);
        table.row(kind.name(), None, worst, bound);
    }
    table.remark("The graph's |Δv² − 2| of 2 is the paper's \"constant 0\".");
    table.remark(TIES);
    Ok(table)
}

/// cos θ on the unit sphere, Δ cos θ = −2 cos θ.
const ZONAL: Known = Known { name: "cos θ", f: |p| p[2], laplacian: |p| -2.0 * p[2] };

/// Quantiles of the error of Δ cos θ.
pub(super) fn figure_5(_: Extent) -> Result<Table, Failure> {
    let mut table = Table::new(
        "PBMHB Figure 5: error of Δ cos θ on spheres",
        "t = ε², δ = 5√(2t), PCD δ = 10√(2t). Quantiles of |Δ cos θ + 2 cos θ| with the paper's operator; the column \
         \"paper\" holds PCD's figure of the same sample, because the paper's histograms put its operator below PCD in all \
         three.",
    );
    for (name, cloud) in samples::spheres()? {
        let truth = sampled(&cloud, ZONAL.laplacian);
        let errors = |kind| -> Result<Vec<f64>, Failure> {
            let built = operator(&cloud, &point_based_parameters(kind))?;
            let found = laplacian(&built, &cloud, ZONAL.f);
            Ok(truth.iter().zip(&found).map(|(u, v)| (u - v).abs()).collect())
        };
        let (mut ours, mut pcd) = (errors(PbMhb)?, errors(Pcd)?);
        for q in [0.5, 0.9, 1.0] {
            let what = format!("{name}, {} % quantile", 100.0 * q);
            table.row(what, quantile(&mut pcd, q), quantile(&mut ours, q), Bound::TimesPaper(1.0));
        }
    }
    Ok(table)
}
