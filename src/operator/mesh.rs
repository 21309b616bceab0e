//! The mesh Laplace operator [MESH eq. 1]: heat kernel weighted by the triangles around every vertex.

use super::{HeatKernel, LaplaceBeltrami, heat_kernel};
use crate::geometry::triangles::{Triangles, area};
use crate::geometry::{Points, SearchTree};
use crate::progress::{Canceled, Progress};

/// Assembles the operator: mass and weight of a vertex are a third of the areas of its triangles [MESH eq. 1, where
/// our t is called h]. The paper sums over the whole mesh; we cut at δ as for the other kernels.
///
/// # Errors
/// [`Canceled`].
pub fn build(
    points: &Points,
    tree: &SearchTree,
    triangles: &Triangles,
    kernel: HeatKernel,
    progress: &Progress,
) -> Result<LaplaceBeltrami, Canceled> {
    let mut weights = vec![0.0; points.len()];
    for corners in triangles.iter() {
        let third = area(points, corners) / 3.0;
        for i in corners {
            weights[i as usize] += third;
        }
    }
    let stiffness = heat_kernel::stiffness(points, tree, &weights, kernel, |_, _| true, progress)?;
    Ok(LaplaceBeltrami::diffusive(stiffness, weights, kernel))
}
