//! The mesh Laplace operator [MESH eq. 1]: heat kernel weighted by the faces around every vertex.

use super::{HeatKernel, LaplaceBeltrami, heat_kernel};
use crate::geometry::{Points, SearchTree, Triangles};
use crate::progress::{Canceled, Progress};

/// Assembles the operator: mass and weight of a vertex are the shares `Area(t)/#t` of its faces, a third of a triangle, a
/// quarter of a quadrilateral [MESH eq. 1, where our t is called h]. The paper sums over the whole mesh; we cut at δ as
/// for the other kernels.
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
    let weights = triangles.shares().to_vec();
    let stiffness = heat_kernel::stiffness(points, tree, &weights, kernel, |_, _| true, progress)?;
    Ok(LaplaceBeltrami::diffusive(stiffness, weights, kernel))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::reader::{Format, ReadOptions, read};

    /// Two quadrilaterals side by side and a triangle on the first.
    const MESH: &str = "v 0 0 0\nv 1 0 0\nv 3 0 0\nv 3 1 0\nv 1 1 0\nv 0 1 0\nv 0 3 0\n\
                        f 1 2 5 6\nf 2 3 4 5\nf 6 5 7\n";

    #[test]
    fn a_quadrilateral_gives_each_corner_a_quarter_of_its_area_and_a_triangle_a_third() {
        let cloud = read(MESH.as_bytes(), Format::Obj, &ReadOptions::default()).unwrap();
        let points = Points::prepare(&cloud, 2).unwrap();
        let triangles = Triangles::of(&cloud, &points);
        let kernel = HeatKernel { t: 0.25, delta: 10.0, truncation_compensation: false, dimension: 2 };
        let tree = SearchTree::new(&points);
        let laplacian = build(&points, &tree, &triangles, kernel, &Progress::new()).unwrap();
        // by hand: areas 1, 2 and 1
        let (quarter, half, third) = (1.0 / 4.0, 2.0 / 4.0, 1.0 / 3.0);
        let expected = [quarter, quarter + half, half, half, quarter + half + third, quarter + third, third];
        let place = |row: usize| points.of_row(row).unwrap();
        for (row, expected) in expected.into_iter().enumerate() {
            assert!((laplacian.mass[place(row)] - expected).abs() < 1e-15, "{row}");
        }
        // rows 0 and 1 are at distance 1: exp(−1²/4t) = 1/e, 4πt · t = π/4
        let (columns, values) = laplacian.stiffness.row(place(0));
        let entry = columns.iter().position(|&column| column as usize == place(1)).unwrap();
        let weight = 0.25 * 0.75 * (-1.0_f64).exp() * 4.0 / std::f64::consts::PI;
        assert!((values[entry] + weight).abs() < 1e-15, "{} {weight}", values[entry]);
    }

    #[test]
    fn a_polygon_with_a_corner_twice_or_on_a_side_is_shared_by_its_distinct_corners() {
        // (0.5, 0) lies on a side: the triangle with it in the middle has no area, and it is a corner all the same
        let file = "v 0 0 0\nv 0.5 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 0\nf 1 2 3 4 5 6\n";
        let cloud = read(file.as_bytes(), Format::Obj, &ReadOptions::default()).unwrap();
        let points = Points::prepare(&cloud, 2).unwrap();
        let triangles = Triangles::of(&cloud, &points);
        assert_eq!(triangles.iter().count(), 2);
        assert!(triangles.shares().iter().all(|share| (share - 0.2).abs() < 1e-15));
    }
}
