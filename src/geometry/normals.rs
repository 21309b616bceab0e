//! Normals of points in space, towards the side on which given ones lie.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use rayon::prelude::*;

use super::{Points, SearchTree};
use crate::cloud::PointCloud;

/// Neighbors through which a plane is laid where there are no faces.
const NEIGHBORS: usize = 12;

/// Bound on the QR sweeps of a 3×3 eigenproblem.
const SWEEPS_MAX: usize = 1_000;

/// Unit normals of a cloud in space, from its faces where it has some, else from the planes through its neighbors, on the
/// side of the normals it had. Rows of which nothing can be said keep theirs.
#[must_use]
pub fn normals(cloud: &PointCloud, before: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let raw = if cloud.faces().is_empty() { of_planes(cloud) } else { of_faces(cloud) };
    raw.iter().zip(before).map(|(raw, before)| towards(*raw, Vector3::from(*before)).into()).collect()
}

/// The unit vector along ±`raw` that lies on the side of `before`; `before` where there is none.
fn towards(raw: Vector3<f64>, before: Vector3<f64>) -> Vector3<f64> {
    match raw.try_normalize(0.0).filter(|unit| unit.iter().all(|x| x.is_finite())) {
        Some(unit) if unit.dot(&before) < 0.0 => -unit,
        Some(unit) => unit,
        None => before,
    }
}

fn at(cloud: &PointCloud, row: u32) -> Vector3<f64> {
    Vector3::from_iterator(cloud.point(row as usize).iter().copied())
}

/// Sums of the face normals around every point, weighted by area.
fn of_faces(cloud: &PointCloud) -> Vec<Vector3<f64>> {
    let mut sums = vec![Vector3::zeros(); cloud.len()];
    for &[a, b, c] in cloud.faces() {
        let (p, q, r) = (at(cloud, a), at(cloud, b), at(cloud, c));
        let normal = (q - p).cross(&(r - p));
        if normal.iter().all(|x| x.is_finite()) {
            for corner in [a, b, c] {
                sums[corner as usize] += normal;
            }
        }
    }
    sums
}

/// Directions of least spread of the nearest neighbors.
fn of_planes(cloud: &PointCloud) -> Vec<Vector3<f64>> {
    let Ok(points) = Points::prepare(cloud, 2) else { return vec![Vector3::zeros(); cloud.len()] };
    let tree = SearchTree::new(&points);
    let of_point: Vec<Vector3<f64>> = (0..points.len())
        .into_par_iter()
        .map_init(Vec::new, |neighbors, i| {
            tree.nearest(&points, i, NEIGHBORS, neighbors);
            let position = |j: usize| Vector3::from_iterator(points.point(j).iter().copied());
            let center = neighbors.iter().map(|q| position(q.index as usize)).sum::<Vector3<f64>>()
                / neighbors.len() as f64;
            let scatter: Matrix3<f64> = neighbors
                .iter()
                .map(|q| position(q.index as usize) - center)
                .map(|offset| offset * offset.transpose())
                .sum();
            let eigen = SymmetricEigen::try_new(scatter / scatter.trace(), f64::EPSILON, SWEEPS_MAX);
            eigen.map_or_else(Vector3::zeros, |eigen| {
                eigen.eigenvectors.column(eigen.eigenvalues.imin()).into()
            })
        })
        .collect();
    (0..cloud.len()).map(|row| points.of_row(row).map_or_else(Vector3::zeros, |i| of_point[i])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::shapes::{SampleRequest, Sampling, Shape, sample};

    /// On the unit sphere the normal is the position; the ones before are tilted and of any length.
    fn check(cloud: &PointCloud, tolerance: f64) {
        let position = |row: usize| Vector3::from_iterator(cloud.point(row).iter().copied());
        let before: Vec<[f64; 3]> =
            (0..cloud.len()).map(|row| (0.3 * position(row) + Vector3::new(0.05, 0.1, 0.0)).into()).collect();
        for (row, normal) in normals(cloud, &before).iter().enumerate() {
            let off = (Vector3::from(*normal) - position(row)).norm();
            assert!(off < tolerance, "{row}: {off}");
        }
    }

    #[test]
    fn normals_of_a_mesh_and_of_a_bare_cloud_are_those_of_the_sphere() {
        let request = SampleRequest { sampling: Sampling::Grid, ..SampleRequest::new(Shape::Sphere, 2_000) };
        let mesh = sample(&request).unwrap();
        assert!(!mesh.faces().is_empty());
        check(&mesh, 0.1);
        check(&sample(&SampleRequest::new(Shape::Sphere, 2_000)).unwrap(), 0.1);
    }

    #[test]
    fn a_point_of_no_face_keeps_its_normal() {
        let flat = vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 5.0, 5.0];
        let cloud = PointCloud::new(3, flat, crate::cloud::NonFinite::Reject).unwrap();
        let cloud = cloud.with_faces(vec![[0, 1, 2]]).unwrap();
        let found = normals(&cloud, &[[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.6, 0.8, 0.0]]);
        assert_eq!(found, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.6, 0.8, 0.0]]);
    }
}
