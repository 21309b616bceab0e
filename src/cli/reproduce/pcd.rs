//! [PCD Tables 2–4]: Δf on spheres and flat tori, PCD Laplace against the weighted graph.

use chladni::analysis::Parameters;
use chladni::cloud::PointCloud;
use chladni::cloud::shapes::{Sampling, Shape};
use chladni::operator::Distance;
use chladni::operator::OperatorKind::{self, PbMhb, Pcd, WeightedGraph};

use super::Extent;
use super::measure::{Known, as_in_paper, errors_of, operator};
use super::samples;
use super::table::{Bound, Table};
use crate::cli::Failure;

/// f = x, x², eˣ on the unit sphere: Δx = −2x, Δx² = 2 − 6x², Δeˣ = eˣ(1 − x² − 2x).
pub(super) const ON_SPHERE: [Known; 3] = [
    Known { name: "x", f: |p| p[0], laplacian: |p| -2.0 * p[0] },
    Known { name: "x²", f: |p| p[0] * p[0], laplacian: |p| 2.0 - 6.0 * p[0] * p[0] },
    Known { name: "eˣ", f: |p| p[0].exp(), laplacian: |p| p[0].exp() * (1.0 - p[0] * p[0] - 2.0 * p[0]) },
];

/// The same on a flat torus, where x = cos α: Δx = −x, Δx² = 2 − 4x², Δeˣ = eˣ(1 − x² − x).
const ON_TORUS: [Known; 3] = [
    Known { name: "x", f: |p| p[0], laplacian: |p| -p[0] },
    Known { name: "x²", f: |p| p[0] * p[0], laplacian: |p| 2.0 - 4.0 * p[0] * p[0] },
    Known { name: "eˣ", f: |p| p[0].exp(), laplacian: |p| p[0].exp() * (1.0 - p[0] * p[0] - p[0]) },
];

/// One t for all sizes of a manifold, as the paper has it: that of 4t = 0.04 on the unit sphere, which is stated for [MESH]
/// by the same authors; four times that in three dimensions, of which the same number of points fills less. With both the
/// weighted graph has the errors that the paper gives for it.
const T: f64 = 0.01;

/// The kernel is cut, by simplices within δ/2, at 5√(2t), as for the other paper: next to nothing is lost.
const DELTA_FACTOR: f64 = 10.0;

/// Bound of `pcd`: other samples than the paper's.
const SAMPLES: Bound = Bound::TimesPaper(1.5);

/// The same on T³, of which few points lie within a kernel.
const SAMPLES_OF_VOLUME: Bound = Bound::TimesPaper(2.5);

fn parameters(kind: OperatorKind, dimension: usize) -> Parameters {
    let t = if dimension == 3 { 4.0 * T } else { T };
    let delta_factor = if kind.is_pcd() { DELTA_FACTOR } else { 0.5 * DELTA_FACTOR };
    Parameters {
        t: Some(t),
        delta_factor: Some(delta_factor),
        dimension,
        distance: kind.is_pcd().then_some(Distance::Projected),
        // δ reaches around the circles of T³, from where the projection is no longer one to one
        sheet_aware: (kind.is_pcd() && dimension == 3).then_some(true),
        ..as_in_paper(kind)
    }
}

const SPHERES: [usize; 5] = [1_000, 2_000, 4_000, 8_000, 16_000];

/// E2 and E∞ by function and size: PCD, then E2 of the weighted graph.
struct Published {
    pcd: [[[f64; 2]; 5]; 3],
    graph: [[f64; 5]; 3],
}

const TABLE_2: Published = Published {
    pcd: [
        [[0.425, 1.116], [0.158, 0.419], [0.070, 0.171], [0.033, 0.086], [0.022, 0.034]],
        [[0.276, 0.566], [0.092, 0.210], [0.039, 0.089], [0.017, 0.030], [0.008, 0.015]],
        [[0.415, 0.578], [0.138, 0.220], [0.062, 0.089], [0.028, 0.034], [0.020, 0.020]],
    ],
    graph: [
        [0.794, 0.641, 0.527, 0.406, 0.285],
        [0.590, 0.426, 0.350, 0.251, 0.179],
        [0.746, 0.603, 0.483, 0.333, 0.237],
    ],
};

const TABLE_3: Published = Published {
    pcd: [
        [[0.466, 1.780], [0.174, 0.722], [0.079, 0.260], [0.041, 0.125], [0.037, 0.077]],
        [[0.268, 0.517], [0.104, 0.274], [0.046, 0.117], [0.020, 0.072], [0.013, 0.019]],
        [[0.398, 0.544], [0.136, 0.224], [0.058, 0.095], [0.036, 0.087], [0.031, 0.028]],
    ],
    graph: [
        [0.931, 0.720, 0.478, 0.362, 0.269],
        [0.550, 0.429, 0.305, 0.205, 0.146],
        [0.820, 0.613, 0.389, 0.308, 0.210],
    ],
};

/// Uniform samples of the sphere.
pub(super) fn table_2(extent: Extent) -> Result<Table, Failure> {
    let draw = |points| samples::shape(Shape::Sphere, points, Sampling::Iid);
    on_spheres("PCD Table 2: Δf on the unit sphere, sampled independently", draw, &TABLE_2, extent)
}

/// Uneven samples of the sphere.
pub(super) fn table_3(extent: Extent) -> Result<Table, Failure> {
    on_spheres(
        "PCD Table 3: Δf on the unit sphere, sampled unevenly",
        |points| samples::uneven(Shape::Sphere, points),
        &TABLE_3,
        extent,
    )
}

fn rule() -> String {
    format!(
        "t = {T} for all sizes (4t = 0.04, as stated in [MESH]), on T³ four times that, where `pcd` keeps to its sheet (`sheet_aware`); \
         kernels cut at {}√(2t). `pcd` with distances in the plane (`distance=projected`). `pb-mhb` with its additions at the same t \
         and cut. Uneven samples are drawn from a mixture of two Gaussians; the paper does not publish its own.",
        0.5 * DELTA_FACTOR
    )
}

fn on_spheres(
    title: &str,
    draw: impl Fn(usize) -> Result<PointCloud, Failure>,
    published: &Published,
    extent: Extent,
) -> Result<Table, Failure> {
    let mut table = Table::new(title, rule());
    for (size, &points) in extent.of(&SPHERES, 3).iter().enumerate() {
        let cloud = draw(points)?;
        let of = |parameters: Parameters| -> Result<_, Failure> {
            Ok(errors_of(&operator(&cloud, &parameters)?, &cloud, &ON_SPHERE))
        };
        let (pcd, graph) = (of(parameters(Pcd, 2))?, of(parameters(WeightedGraph, 2))?);
        let ours = of(Parameters { paper: false, ..parameters(PbMhb, 2) })?;
        for (f, known) in ON_SPHERE.iter().enumerate() {
            let name = known.name;
            let [l2, max] = published.pcd[f][size];
            table.row(format!("{points}, {name}: `pcd` E2"), l2, pcd[f].l2, SAMPLES);
            table.row(format!("{points}, {name}: `pcd` E∞"), max, pcd[f].max, Bound::Shown);
            table.row(format!("{points}, {name}: `pb-mhb` E2"), l2, ours[f].l2, noise(points));
            let graph_l2 = published.graph[f][size];
            table.row(format!("{points}, {name}: `weighted-graph` E2"), graph_l2, graph[f].l2, Bound::Shown);
        }
    }
    table.remark(EVIDENCE);
    Ok(table)
}

/// Sampling noise decides up to here, beyond it the bias of a fixed t does, which is another for another operator.
const NOISY_MAX: usize = 4_000;

fn noise(points: usize) -> Bound {
    if points <= NOISY_MAX { Bound::TimesPaper(2.5) } else { Bound::Shown }
}

/// Which t, and which distance.
const EVIDENCE: &str = "Neither t nor the distance in the kernel is stated in the paper; its figures tell both. The weighted graph, which \
    is all noise, has its errors at this t. And with one t the error of a large sample is the bias of the definition, which is known \
    as an integral over the sphere: with distances in space, exp(−|p−q|²/4t) over projected areas gives Δx a relative error of \
    −4t and Δx² one of −6t (4 % and 6 %), with distances in the plane of +2t and 0. The paper's 2.2 % and 0.8 % at 16,000 points \
    are those of the plane. `pb-mhb` sums over true areas with distances in space, 0 and −2t.";

/// What of the noise is left on volumes.
const VOLUMES: &str = "On T³ exp(−|p−q|²/4t) in the plane gives Δx a relative error of +1.5t, 6 %, which is what the paper has at 20,000 points; \
    with a cut nearer than where the projection turns back, at δ = 2, simplices that stick out of it take 20 % of the sum \
    at 7,500 points and 10 % at 15,000.";

/// E2 of PCD by function, on T² at 2,500, 7,500, 10,000, 15,000 points and on T³ at 2,500, 7,500, 15,000, 20,000.
const TABLE_4: [[[f64; 4]; 3]; 2] = [
    [[0.927, 0.225, 0.156, 0.090], [0.437, 0.115, 0.078, 0.046], [0.800, 0.208, 0.142, 0.084]],
    [[0.736, 0.145, 0.100, 0.065], [0.468, 0.110, 0.083, 0.061], [0.670, 0.139, 0.101, 0.074]],
];

/// E2 of the weighted graph.
const TABLE_4_GRAPH: [[[f64; 4]; 3]; 2] = [
    [[1.546, 0.858, 0.743, 0.658], [0.739, 0.415, 0.357, 0.314], [1.339, 0.728, 0.646, 0.571]],
    [[1.015, 0.602, 0.420, 0.370], [0.525, 0.312, 0.223, 0.198], [0.847, 0.467, 0.335, 0.296]],
];

/// Uneven samples of flat tori in R⁴ and R⁶.
pub(super) fn table_4(extent: Extent) -> Result<Table, Failure> {
    let mut table = Table::new("PCD Table 4: Δf on flat tori, sampled unevenly", rule());
    let manifolds = [
        ("T²", Shape::FlatTorus4, [2_500, 7_500, 10_000, 15_000], 2),
        ("T³", Shape::FlatTorus6, [2_500, 7_500, 15_000, 20_000], 1),
    ];
    for (place, (manifold, shape, sizes, quick)) in manifolds.into_iter().enumerate() {
        let dimension = shape.intrinsic_dimension();
        for (size, &points) in extent.of(&sizes, quick).iter().enumerate() {
            let cloud = samples::uneven(shape, points)?;
            let of = |kind| -> Result<_, Failure> {
                Ok(errors_of(&operator(&cloud, &parameters(kind, dimension))?, &cloud, &ON_TORUS))
            };
            let (pcd, graph) = (of(Pcd)?, of(WeightedGraph)?);
            for (f, known) in ON_TORUS.iter().enumerate() {
                let what = format!("{manifold} {points}, {}", known.name);
                table.row(
                    format!("{what}: `pcd` E2"),
                    TABLE_4[place][f][size],
                    pcd[f].l2,
                    if dimension == 3 { SAMPLES_OF_VOLUME } else { SAMPLES },
                );
                let graph_l2 = TABLE_4_GRAPH[place][f][size];
                table.row(format!("{what}: `weighted-graph` E2"), graph_l2, graph[f].l2, Bound::Shown);
            }
        }
    }
    table.remark(VOLUMES);
    Ok(table)
}
