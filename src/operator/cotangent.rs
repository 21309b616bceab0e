//! The cotangent scheme [MESH §5; Pinkall and Polthier 1993; Meyer et al. 2003], from edge lengths alone, so that it
//! works in any ambient dimension.

use super::{LaplaceBeltrami, Sparse};
use crate::geometry::{Points, TriangleMetric, Triangles};
use crate::progress::{Canceled, Progress};

/// Assembles the operator: stiffness `−½(cot α + cot β)` per edge (positive off-diagonals where angles are obtuse,
/// still positive semi-definite), mass the mixed Voronoi areas of Meyer et al.
///
/// # Errors
/// [`Canceled`].
pub fn build(
    points: &Points,
    triangles: &Triangles,
    progress: &Progress,
) -> Result<LaplaceBeltrami, Canceled> {
    let mass = mixed_areas(points, triangles);
    Ok(LaplaceBeltrami::narrow(stiffness(points, triangles, progress)?, mass))
}

/// Stiffness of linear finite elements: symmetric positive semi-definite, zero row sums.
///
/// # Errors
/// [`Canceled`].
pub fn stiffness(points: &Points, triangles: &Triangles, progress: &Progress) -> Result<Sparse, Canceled> {
    let n = points.len();
    let mut rows: Vec<Vec<(u32, f64)>> = vec![Vec::new(); n];
    for corners in triangles.iter() {
        let triangle = TriangleMetric::accurate(points, corners);
        for corner in 0..3 {
            let (i, j) = (corners[(corner + 1) % 3], corners[(corner + 2) % 3]);
            let half = 0.5 * triangle.cotangent(corner);
            rows[i as usize].push((j, half));
            rows[j as usize].push((i, half));
        }
    }
    Sparse::stiffness(
        n,
        || (),
        |i, (), row| {
            // both triangles at an edge name it; the assembly adds them up
            row.extend_from_slice(&rows[i]);
        },
        |done| progress.advance(done as f64 / n as f64),
    )
}

/// Mixed Voronoi areas (Meyer et al. 2003, §3.3).
fn mixed_areas(points: &Points, triangles: &Triangles) -> Vec<f64> {
    let mut mass = vec![0.0; points.len()];
    for corners in triangles.iter() {
        let triangle = TriangleMetric::accurate(points, corners);
        for (i, &corner) in corners.iter().enumerate() {
            mass[corner as usize] += triangle.mixed_area(i);
        }
    }
    mass
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // exact by construction
mod tests {
    use super::*;
    use crate::cloud::{NonFinite, PointCloud};

    /// A unit square of two triangles with a fifth point below, which no face uses.
    fn square() -> (Points, Triangles) {
        let cloud = PointCloud::new(
            3,
            vec![0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0., 0.5, 0.5, -1.],
            NonFinite::Reject,
        )
        .unwrap()
        .with_faces(vec![[0, 1, 2], [0, 2, 3]])
        .unwrap();
        let points = Points::prepare(&cloud, 2).unwrap();
        let triangles = Triangles::of(&cloud, &points);
        (points, triangles)
    }

    #[test]
    fn on_a_square_of_two_triangles_sides_weigh_a_half_and_the_diagonal_nothing() {
        // by hand: the right angles face the diagonal (cot 90° = 0), the sides are faced by 45° (½·cot = ½)
        let (points, triangles) = square();
        let laplacian = build(&points, &triangles, &Progress::new()).unwrap();
        let at = |a: usize, b: usize| {
            let (i, j) = (points.of_row(a).unwrap(), points.of_row(b).unwrap() as u32);
            let (columns, values) = laplacian.stiffness.row(i);
            columns.iter().position(|&c| c == j).map_or(0.0, |k| values[k])
        };
        for (a, b, expected) in
            [(0, 1, -0.5), (1, 2, -0.5), (2, 3, -0.5), (3, 0, -0.5), (0, 2, 0.0), (0, 0, 1.0)]
        {
            assert!((at(a, b) - expected).abs() < 1e-15, "{a} {b}: {}", at(a, b));
        }
        // a right-angled triangle's Voronoi areas: half to the right angle, a quarter to each other
        let mass = |row: usize| laplacian.mass[points.of_row(row).unwrap()];
        assert!((0..4).all(|row| (mass(row) - 0.25).abs() < 1e-15));
        assert_eq!(mass(4), 0.0);
    }
}
