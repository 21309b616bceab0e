//! [PCD Table 5]: areas from the heat trace of 200 eigenvalues.

use chladni::analysis::Parameters;
use chladni::cloud::PointCloud;
use chladni::cloud::shapes::{Sampling, Shape};
use chladni::harmonics::heat_trace;
use chladni::operator::Distance;
use chladni::operator::OperatorKind::{PbMhb, Pcd};

use super::Extent;
use super::measure::{bases, eigenvalues};
use super::samples;
use super::table::{Bound, Table};
use crate::cli::Failure;

/// Eigenvalues that the paper takes.
const EIGENVALUES: usize = 200;

/// Name, estimate over truth in the paper, sizes.
const TABLE_5: [(&str, f64); 4] = [
    ("S², 8,000 points", 13.10 / 12.57),
    ("T², 10,000 points", 40.41 / 39.49),
    ("eight, 3,070 points", 0.990 / 0.998),
    ("T³, 10,000 points", 277.7 / 248.1),
];

fn model(place: usize) -> Result<(PointCloud, f64), Failure> {
    let drawn = |shape: Shape, points| {
        let cloud = samples::shape(shape, points, Sampling::Iid)?;
        Ok((cloud, shape.area().unwrap_or(f64::NAN)))
    };
    match place {
        0 => drawn(Shape::Sphere, 8_000),
        1 => drawn(Shape::FlatTorus4, 10_000),
        2 => {
            // as in the paper, the truth is the area of a fine mesh's triangles
            let mesh = samples::shape(Shape::TwoHoleTorus, 200_000, Sampling::Grid)?;
            Ok((samples::shape(Shape::TwoHoleTorus, 3_070, Sampling::Uniform)?, mesh_area(&mesh)))
        }
        _ => drawn(Shape::FlatTorus6, 10_000),
    }
}

fn mesh_area(mesh: &PointCloud) -> f64 {
    let side = |from: u32, to: u32| -> [f64; 3] {
        std::array::from_fn(|a| mesh.point(to as usize)[a] - mesh.point(from as usize)[a])
    };
    let area = |&[a, b, c]: &[u32; 3]| {
        let (u, v) = (side(a, b), side(a, c));
        let cross: [f64; 3] =
            std::array::from_fn(|i| u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3]);
        0.5 * cross.iter().map(|x| x * x).sum::<f64>().sqrt()
    };
    mesh.faces().iter().map(area).sum()
}

/// Area over truth.
pub(super) fn table_5(extent: Extent) -> Result<Table, Failure> {
    let mut table = Table::new(
        "PCD Table 5: area from the heat trace",
        format!(
            "|estimate/truth − 1| from the first {EIGENVALUES} eigenvalues, defaults for t and δ, `pcd` with distances in the plane \
             (`distance=projected`) as in its other tables. Samples are independent; that of the eight, in the paper the \
             vertices of a mesh, is well spaced. The paper takes the zero order of the trace; on surfaces ours is the \
             intercept of a fit (`/jobs/{{id}}/spectrum`), on T³ the zero order at the time when the missing eigenvalues \
             would add exp(−8). The paper's genus-3 surface is not published; its eight is the built-in two-hole torus here."
        ),
    );
    for (place, &(name, paper)) in extent.of(&TABLE_5, 1).iter().enumerate() {
        let (cloud, truth) = model(place)?;
        let dimension = if place == 3 { 3 } else { 2 };
        for kind in [Pcd, PbMhb] {
            let parameters = Parameters {
                operator: kind,
                dimension,
                bases: EIGENVALUES,
                distance: kind.is_pcd().then_some(Distance::Projected),
                ..Parameters::default()
            };
            let analysis = bases(&cloud, &parameters)?;
            let lambda: Vec<f64> = eigenvalues(&analysis).into_iter().take_while(|x| x.is_finite()).collect();
            let estimate = if dimension == 2 {
                heat_trace::area(&lambda, analysis.report.sampling.is_open())
                    .map_or(f64::NAN, |estimate| estimate.value)
            } else {
                zero_order(&lambda)
            };
            let ours = (estimate / truth - 1.0).abs();
            table.row(
                format!("{name}: `{}`", kind.name()),
                (paper - 1.0).abs(),
                ours,
                Bound::TimesPaper(1.0),
            );
        }
    }
    table.remark(
        "The eight is not the paper's, but as thin beside its spacing. The same fit of 200 eigenvalues of a mesh of 100,000 \
         vertices gives an area that is 0.3 % too small.",
    );
    Ok(table)
}

/// `(4πτ)^{3/2} Z(τ)` at `τ = 8/λ_max`.
fn zero_order(lambda: &[f64]) -> f64 {
    let tau = 8.0 / lambda.last().copied().unwrap_or(f64::NAN);
    let trace: f64 = lambda.iter().map(|x| (-x * tau).exp()).sum();
    (4.0 * std::f64::consts::PI * tau).powf(1.5) * trace
}
