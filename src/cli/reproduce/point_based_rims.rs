//! [PBMHB Fig. 12 and 13]: open rims and sharp ridges on a folded square.

use chladni::analysis::Parameters;
use chladni::operator::OperatorKind::{PbMhb, Voronoi};
use chladni::operator::pb_mhb::t_factor;

use super::Extent;
use super::measure::{bases, operator, point_based_parameters};
use super::samples;
use super::table::{Bound, Table};
use crate::cli::Failure;

/// Points along a side, as in the paper.
const SIDE: usize = 101;

/// The paper's folds in degrees.
const ANGLES: [f64; 4] = [0.0, 30.0, 70.0, 120.0];

/// The paper's operator and ours.
fn contenders() -> [(&'static str, Parameters); 3] {
    [
        ("as published", point_based_parameters(PbMhb)),
        // The time that bases take: on a lattice, where no noise is to be smoothed, it is exact.
        ("with our additions", Parameters { t_factor: Some(t_factor(2, true)), ..Parameters::default() }),
        ("`voronoi`", Parameters { operator: Voronoi, ..Parameters::default() }),
    ]
}

/// Whether the bases of the folded square are those of the flat one: folding is isometric.
pub(super) fn figure_12(_: Extent) -> Result<Table, Failure> {
    let mut table = Table::new(
        "PBMHB Figure 12: bases of a folded square",
        format!(
            "Unit square, {SIDE} × {SIDE} points, folded along v = ½. Worst relative error of the first nine non-zero \
             eigenvalues against π²(a² + b²), which no fold changes; the paper shows H₄ drifting with the fold. t = ε², δ = \
             5√(2t) as published; otherwise the defaults."
        ),
    );
    let mut exact: Vec<f64> = (0..16)
        .map(|k| f64::from(k % 4 * (k % 4) + k / 4 * (k / 4)) * std::f64::consts::PI.powi(2))
        .collect();
    exact.sort_by(f64::total_cmp);
    for (name, parameters) in contenders() {
        for angle in ANGLES {
            let (cloud, _) = samples::folded_square(SIDE, angle)?;
            let analysis = bases(&cloud, &Parameters { bases: 10, ..parameters.clone() })?;
            let found = super::measure::eigenvalues(&analysis);
            let worst = (1..10).map(|j| (found[j] / exact[j] - 1.0).abs()).fold(0.0, f64::max);
            let bound = match name {
                "as published" => Bound::Shown,
                "`voronoi`" => Bound::AtMost(0.04),
                _ => Bound::AtMost(0.1),
            };
            table.row(format!("{name}, {angle}°"), None, worst, bound);
        }
    }
    Ok(table)
}

/// Δv = 0 on the folded square: errors along the ridge, at the rims across and along v, and elsewhere.
pub(super) fn figure_13(_: Extent) -> Result<Table, Failure> {
    let mut table = Table::new(
        "PBMHB Figure 13: Δv on a folded square",
        format!(
            "Unit square, {SIDE} × {SIDE} points, folded along v = ½; Δv = 0. Root mean square of Δv in a strip of 5 rows about \
             the ridge, on the rims v = 0 and 1, on the rims u = 0 and 1 (away from the corners), and elsewhere. The paper shows plots: large \
             on the rims across v, negligible on those along it, growing with the fold on the ridge."
        ),
    );
    for (name, parameters) in contenders() {
        for angle in ANGLES {
            let (cloud, uv) = samples::folded_square(SIDE, angle)?;
            let built = operator(&cloud, &parameters)?;
            let v: Vec<f64> = uv.iter().map(|uv| uv[1]).collect();
            let found = built.laplacian_of(&v).unwrap_or_default();
            let mean = |strip: fn([f64; 2]) -> bool| {
                let inside: Vec<f64> =
                    uv.iter().zip(&found).filter(|(uv, _)| strip(**uv)).map(|(_, x)| x * x).collect();
                (inside.iter().sum::<f64>() / inside.len() as f64).sqrt()
            };
            let across = mean(|[_, v]| !(0.005..=0.995).contains(&v));
            let along = mean(|[u, v]| !(0.005..=0.995).contains(&u) && (0.2..0.4).contains(&v));
            let ridge = mean(|[u, v]| (v - 0.5).abs() < 0.025 && (0.2..0.8).contains(&u));
            let inside = mean(|[u, v]| (0.2..0.8).contains(&u) && (0.2..0.4).contains(&v));
            table.row(format!("{name}, {angle}°: rims v = 0, 1"), None, across, Bound::Shown);
            table.row(format!("{name}, {angle}°: rims u = 0, 1"), None, along, Bound::AtMost(1e-6));
            table.row(format!("{name}, {angle}°: ridge"), None, ridge, Bound::Shown);
            table.row(format!("{name}, {angle}°: elsewhere"), None, inside, Bound::AtMost(1e-6));
        }
    }
    table.remark(
        "On a rim across v no operator of this kind gives 0: the rim is natural (Neumann), and v does not satisfy ∂v/∂n = 0; \
         the figure is the boundary term over the width of a cell, and right in the weak sense.",
    );
    Ok(table)
}
