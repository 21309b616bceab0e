//! Samples of the papers' shapes, with fixed seeds.

use chladni::cloud::shapes::{SampleRequest, Sampling, Shape, sample};
use chladni::cloud::{NonFinite, PointCloud};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

use crate::cli::Failure;

/// Seed of all random samples.
const SEED: u64 = 1;

/// A sample of one of the built-in shapes.
pub(super) fn shape(shape: Shape, points: usize, sampling: Sampling) -> Result<PointCloud, Failure> {
    let request = SampleRequest { sampling, seed: SEED, ..SampleRequest::new(shape, points) };
    sample(&request).map_err(Failure::other)
}

/// Points drawn for every one that is kept, which on T³ is about every third.
const POOL: usize = 10;

/// Gaussians of the mixture below. Their variance is the intrinsic dimension.
const BUMPS: usize = 2;

/// Independent points that are kept with a probability proportional to a mixture of Gaussians [PCD C.2]. The paper does
/// not publish its mixture; of ours, around random points of the shape, the density varies by a factor of 2 on the sphere,
/// of 4 on T² and of 5 on T³.
pub(super) fn uneven(kind: Shape, points: usize) -> Result<PointCloud, Failure> {
    let drawn = |points, seed| {
        let request = SampleRequest { sampling: Sampling::Iid, seed, ..SampleRequest::new(kind, points) };
        sample(&request).map_err(Failure::other)
    };
    let centers = drawn(BUMPS, SEED + 1)?;
    let variance = kind.intrinsic_dimension() as f64;
    // 1 where all the centers are
    let density = |point: &[f64]| {
        let bump = |center: usize| {
            let squared: f64 = centers.point(center).iter().zip(point).map(|(a, b)| (a - b).powi(2)).sum();
            (-0.5 * squared / variance).exp()
        };
        (0..BUMPS).map(bump).sum::<f64>() / BUMPS as f64
    };
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let pool = drawn(POOL * points, SEED)?;
    let kept = (0..pool.len()).filter(|&i| random.random::<f64>() < density(pool.point(i))).take(points);
    let coordinates: Vec<f64> = kept.flat_map(|i| pool.point(i).to_vec()).collect();
    let dimension = kind.ambient_dimension();
    if coordinates.len() < points * dimension {
        return Err(Failure::other(format!("fewer than {points} of {} points were kept", POOL * points)));
    }
    PointCloud::new(dimension, coordinates, NonFinite::Reject).map_err(Failure::other)
}

fn cloud(coordinates: Vec<f64>) -> Result<PointCloud, Failure> {
    PointCloud::new(3, coordinates, NonFinite::Reject).map_err(Failure::other)
}

/// A shape that is symmetric along an axis, with a resolution of its own on either side: half of a sample of `dense`
/// points on the positive side, half of one of `sparse` points on the other [PBMHB §5.1, Fig. 4c, Fig. 7].
pub(super) fn two_resolutions(
    kind: Shape,
    axis: usize,
    dense: usize,
    sparse: usize,
) -> Result<PointCloud, Failure> {
    let (fine, coarse) = (shape(kind, dense, Sampling::Uniform)?, shape(kind, sparse, Sampling::Uniform)?);
    let above = fine.coordinates().chunks_exact(3).filter(|p| p[axis] > 0.0);
    let below = coarse.coordinates().chunks_exact(3).filter(|p| p[axis] <= 0.0);
    cloud(above.chain(below).flatten().copied().collect())
}

/// The open cylinder of radius 1 and height 4 on a grid of 300 by `rows` points [PBMHB §5.1].
pub(super) fn cylinder(around: usize, rows: usize) -> Result<PointCloud, Failure> {
    let node = |i: usize, j: usize| {
        let angle = std::f64::consts::TAU * i as f64 / around as f64;
        [angle.cos(), angle.sin(), 4.0 * j as f64 / (rows - 1) as f64]
    };
    cloud((0..rows).flat_map(|j| (0..around).flat_map(move |i| node(i, j))).collect())
}

/// The unit square on a grid of `side²` points, folded along v = ½ by `degrees` [PBMHB §5.6]; beside it u and v.
pub(super) fn folded_square(side: usize, degrees: f64) -> Result<(PointCloud, Vec<[f64; 2]>), Failure> {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    let step = 1.0 / (side - 1) as f64;
    let parameters: Vec<[f64; 2]> =
        (0..side * side).map(|k| [(k % side) as f64 * step, (k / side) as f64 * step]).collect();
    let place = |&[u, v]: &[f64; 2]| {
        let beyond = (v - 0.5).max(0.0);
        [u, v.min(0.5) + cosine * beyond, sine * beyond]
    };
    Ok((cloud(parameters.iter().flat_map(place).collect())?, parameters))
}

/// A point of the plane with its place in the list.
struct Vertex {
    at: Point2<f64>,
    index: u32,
}

impl HasPosition for Vertex {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        self.at
    }
}

fn delaunay(points: impl Iterator<Item = (u32, [f64; 2])>) -> Result<DelaunayTriangulation<Vertex>, Failure> {
    let vertices = points.map(|(index, [x, y])| Vertex { at: Point2::new(x, y), index }).collect();
    DelaunayTriangulation::bulk_load(vertices).map_err(Failure::other)
}

/// The square [-1, 1]² sampled independently, with its Delaunay triangulation [MESH §5].
pub(super) fn planar_mesh(points: usize) -> Result<PointCloud, Failure> {
    let square = shape(Shape::Square, points, Sampling::Iid)?;
    let at: Vec<[f64; 2]> =
        (0..points).map(|i| [2.0 * square.point(i)[0] - 1.0, 2.0 * square.point(i)[1] - 1.0]).collect();
    let triangulation = delaunay((0..).zip(at.iter().copied()))?;
    let faces = triangulation.inner_faces().map(|face| face.vertices().map(|vertex| vertex.data().index));
    let faces = faces.collect();
    cloud(at.iter().flat_map(|&[x, y]| [x, y, 0.0]).collect())?.with_faces(faces).map_err(Failure::other)
}

/// A sample of the unit sphere with its Delaunay triangulation (the convex hull), moved by noise afterwards.
///
/// Stereographic projection from one of the points takes circles on the sphere to circles in the plane, and with
/// them the triangulation; that point is joined to the border.
pub(super) fn spherical_mesh(points: usize, sampling: Sampling, noise: f64) -> Result<PointCloud, Failure> {
    let sphere = shape(Shape::Sphere, points, sampling)?;
    let pole = sphere.point(0).to_vec();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    // any two axes across the pole
    let least = (0..3).min_by(|&a, &b| pole[a].abs().total_cmp(&pole[b].abs())).unwrap_or(0);
    let mut across: Vec<f64> =
        (0..3).map(|axis| f64::from(u8::from(axis == least)) - pole[least] * pole[axis]).collect();
    let length = dot(&across, &across).sqrt();
    for x in &mut across {
        *x /= length;
    }
    let third: Vec<f64> = (0..3)
        .map(|a| pole[(a + 1) % 3] * across[(a + 2) % 3] - pole[(a + 2) % 3] * across[(a + 1) % 3])
        .collect();
    let projected = |i: usize| {
        let p = sphere.point(i);
        let away = 1.0 - dot(p, &pole);
        [dot(p, &across) / away, dot(p, &third) / away]
    };
    let triangulation = delaunay((1..points).map(|i| (i as u32, projected(i))))?;
    let inner = triangulation.inner_faces().map(|face| face.vertices().map(|vertex| vertex.data().index));
    let border =
        triangulation.convex_hull().map(|edge| [0, edge.from().data().index, edge.to().data().index]);
    let faces: Vec<[u32; 3]> = inner.chain(border).collect();
    let moved = SampleRequest { sampling, noise, seed: SEED, ..SampleRequest::new(Shape::Sphere, points) };
    sample(&moved).map_err(Failure::other)?.with_faces(faces).map_err(Failure::other)
}

/// The three spheres of [PBMHB Fig. 4].
pub(super) fn spheres() -> Result<[(&'static str, PointCloud); 3], Failure> {
    Ok([
        ("1,000 points", shape(Shape::Sphere, 1_000, Sampling::Uniform)?),
        ("2,475 points, uneven", two_resolutions(Shape::Sphere, 2, 3_180, 1_770)?),
        ("3,994 points", shape(Shape::Sphere, 3_994, Sampling::Uniform)?),
    ])
}
