//! Points lie where they should, as densely as they should, and meshes close as they should.

use super::*;

fn request(shape: Shape, points: usize, sampling: Sampling) -> SampleRequest {
    SampleRequest { sampling, seed: 7, ..SampleRequest::new(shape, points) }
}

fn draw(shape: Shape, points: usize, sampling: Sampling) -> PointCloud {
    sample(&request(shape, points, sampling)).unwrap()
}

/// How far a point is from satisfying the shape's equation.
fn defect(shape: Shape, p: &[f64]) -> f64 {
    match shape {
        Shape::Sphere => p.iter().map(|x| x * x).sum::<f64>() - 1.0,
        Shape::Ellipsoid => p.iter().zip(chart::ELLIPSOID).map(|(x, a)| (x / a).powi(2)).sum::<f64>() - 1.0,
        Shape::BumpySphere => {
            let radius = p.iter().map(|x| x * x).sum::<f64>().sqrt();
            let [x, y, z] = [p[0] / radius, p[1] / radius, p[2] / radius];
            let bumpy = 1.0 + 0.15 * (4.0 * x).sin() * (3.0 * y).cos() + 0.1 * (5.0 * z + 2.0 * x).cos();
            radius - bumpy
        }
        Shape::Torus => (p[0].hypot(p[1]) - 1.0).hypot(p[2]) - 0.4,
        Shape::Cylinder => (p[0].hypot(p[1]) - 1.0).abs() + (p[2].abs() - 1.0).max(0.0),
        Shape::Square => p[2].abs() + p.iter().map(|x| (x - 0.5).abs() - 0.5).fold(0.0, f64::max),
        Shape::TwoHoleTorus => double_torus::value([p[0], p[1], p[2]]),
        Shape::FlatTorus4 | Shape::FlatTorus6 => p.chunks(2).map(|c| (c[0].hypot(c[1]) - 1.0).abs()).sum(),
    }
}

#[test]
fn every_point_of_every_shape_lies_on_it() {
    for shape in Shape::ALL {
        for sampling in Sampling::ALL {
            let cloud = draw(shape, 2500, sampling);
            assert_eq!(cloud.dimension(), shape.ambient_dimension());
            for i in 0..cloud.len() {
                assert!(
                    defect(shape, cloud.point(i)).abs() < 1e-12,
                    "{shape:?} {sampling:?} {:?}",
                    cloud.point(i)
                );
            }
        }
    }
}

#[test]
fn the_number_of_points_is_exact_except_for_grids() {
    for shape in Shape::ALL {
        for sampling in [Sampling::Uniform, Sampling::Iid, Sampling::NonUniform] {
            assert_eq!(draw(shape, 777, sampling).len(), 777);
        }
        let grid = draw(shape, 5000, Sampling::Grid).len() as f64;
        assert!((grid / 5000.0 - 1.0).abs() < 0.05, "{shape:?}: {grid}");
    }
}

#[test]
fn the_same_seed_gives_the_same_cloud_and_another_seed_another() {
    for shape in [Shape::Torus, Shape::TwoHoleTorus, Shape::Sphere, Shape::Square] {
        let even = request(shape, 200, Sampling::Uniform);
        assert_eq!(sample(&even), sample(&even));
        assert_ne!(sample(&even), sample(&SampleRequest { seed: 8, ..even }), "{shape:?}");
        let first = SampleRequest { noise: 0.01, ..request(shape, 200, Sampling::Iid) };
        let other = SampleRequest { seed: 8, ..first };
        assert_eq!(sample(&first), sample(&first));
        assert_ne!(sample(&first), sample(&other));
    }
}

/// χ² per degree of freedom of the counts of bins with these expected shares.
fn chi_square(bins: impl Iterator<Item = usize>, shares: &[f64]) -> f64 {
    let mut counts = vec![0.0; shares.len()];
    bins.for_each(|bin| counts[bin] += 1.0);
    let total: f64 = counts.iter().sum();
    let terms =
        counts.iter().zip(shares).map(|(count, share)| (count - total * share).powi(2) / (total * share));
    terms.sum::<f64>() / (shares.len() - 1) as f64
}

fn bin(share: f64, bins: usize) -> usize {
    ((share * bins as f64) as usize).min(bins - 1)
}

/// Area up to the angle φ around the torus's tube, as a share: (Rφ + r sin φ)/(2πR).
fn torus_share(point: &[f64]) -> f64 {
    let angle = point[2].atan2(point[0].hypot(point[1]) - 1.0).rem_euclid(std::f64::consts::TAU);
    (angle + 0.4 * angle.sin()) / std::f64::consts::TAU
}

// χ² per degree of freedom has mean 1 and, with 49 degrees, standard deviation 0.2: 2 is five of them away.
const CHI_SQUARE_MAX: f64 = 2.0;

#[test]
fn independent_points_on_the_torus_are_uniform_by_area() {
    let shares = [0.02; 50];
    let of = |sampling| {
        let cloud = draw(Shape::Torus, 50_000, sampling);
        chi_square((0..cloud.len()).map(|i| bin(torus_share(cloud.point(i)), 50)), &shares)
    };
    assert!(of(Sampling::Iid) < CHI_SQUARE_MAX);
    assert!(of(Sampling::Uniform) < 0.1);
    assert!(of(Sampling::Grid) > 10.0, "the test tells uniform by angle from uniform by area");
}

/// Shares of the area of a fine mesh in slices along an axis, and where the slices begin and end.
fn slices(shape: Shape, axis: usize, bins: usize) -> (Vec<f64>, [f64; 2]) {
    let mesh = draw(shape, 400_000, Sampling::Grid);
    let along = || mesh.coordinates().iter().skip(axis).step_by(3);
    let low = along().fold(f64::INFINITY, |low, &x| low.min(x));
    let high = along().fold(f64::NEG_INFINITY, |high, &x| high.max(x));
    let mut shares = vec![0.0; bins];
    for &[a, b, c] in mesh.faces() {
        let [p, q, r] = [a, b, c].map(|corner| mesh.point(corner as usize));
        let middle = (p[axis] + q[axis] + r[axis]) / 3.0;
        shares[bin((middle - low) / (high - low), bins)] += area(p, q, r);
    }
    let total: f64 = shares.iter().sum();
    for share in &mut shares {
        *share /= total;
    }
    (shares, [low, high])
}

fn area(p: &[f64], q: &[f64], r: &[f64]) -> f64 {
    let (u, v) = ([0, 1, 2].map(|i| q[i] - p[i]), [0, 1, 2].map(|i| r[i] - p[i]));
    (u[1] * v[2] - u[2] * v[1]).hypot(u[2] * v[0] - u[0] * v[2]).hypot(u[0] * v[1] - u[1] * v[0]) / 2.0
}

#[test]
fn independent_points_on_shapes_without_closed_area_follow_the_area_of_a_fine_mesh() {
    for shape in [Shape::Ellipsoid, Shape::BumpySphere, Shape::TwoHoleTorus] {
        for axis in 0..3 {
            let (shares, [low, high]) = slices(shape, axis, 20);
            let cloud = draw(shape, 20_000, Sampling::Iid);
            let chi = chi_square(
                (0..cloud.len()).map(|i| bin((cloud.point(i)[axis] - low) / (high - low), 20)),
                &shares,
            );
            // 19 degrees of freedom: standard deviation 0.32.
            assert!(chi < 2.6, "{shape:?} along {axis}: {chi}");
        }
    }
}

#[test]
fn a_non_uniform_sample_is_ten_times_denser_at_the_far_end() {
    let cloud = draw(Shape::Square, 100_000, Sampling::NonUniform);
    // Density ∝ 10^x: shares of tenths are (10^((i+1)/10) − 10^(i/10))/9.
    let shares: Vec<f64> = (0..10)
        .map(|i| (10_f64.powf(f64::from(i + 1) / 10.0) - 10_f64.powf(f64::from(i) / 10.0)) / 9.0)
        .collect();
    let chi = chi_square((0..cloud.len()).map(|i| bin(cloud.point(i)[0], 10)), &shares);
    assert!(chi < 3.5, "{chi}");
}

/// Least distance between points, over that of a hexagonal lattice of the same density.
fn packing(cloud: &PointCloud, area: f64) -> f64 {
    let mut nearest = f64::INFINITY;
    for i in 0..cloud.len() {
        for j in 0..i {
            let squared: f64 = cloud.point(i).iter().zip(cloud.point(j)).map(|(a, b)| (a - b).powi(2)).sum();
            nearest = nearest.min(squared);
        }
    }
    (nearest / (2.0 / 3.0_f64.sqrt() * area / cloud.len() as f64)).sqrt()
}

#[test]
fn uniform_samples_are_well_spaced() {
    let mesh_area = |shape| {
        let mesh = draw(shape, 50_000, Sampling::Grid);
        mesh.faces()
            .iter()
            .map(|f| {
                let [p, q, r] = f.map(|c| mesh.point(c as usize));
                area(p, q, r)
            })
            .sum::<f64>()
    };
    for shape in Shape::ALL.into_iter().filter(|shape| shape.intrinsic_dimension() == 2) {
        let area = shape.area().unwrap_or_else(|| mesh_area(shape));
        let uniform = packing(&draw(shape, 2000, Sampling::Uniform), area);
        let iid = packing(&draw(shape, 2000, Sampling::Iid), area);
        assert!(uniform > 0.45, "{shape:?}: {uniform}");
        assert!(iid < 0.1, "{shape:?}: {iid}");
    }
}

/// V − E + F.
fn euler_characteristic(cloud: &PointCloud) -> i64 {
    let sides = cloud.faces().iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let mut edges: Vec<[u32; 2]> = sides.map(|[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    edges.dedup();
    let [v, e, f] = [cloud.len(), edges.len(), cloud.faces().len()].map(|n| i64::try_from(n).unwrap());
    v - e + f
}

#[test]
fn grids_have_the_topology_of_their_shape() {
    let cases = [
        (Shape::Sphere, 2),
        (Shape::Ellipsoid, 2),
        (Shape::BumpySphere, 2),
        (Shape::Torus, 0),
        (Shape::Cylinder, 0),
        (Shape::Square, 1),
        (Shape::TwoHoleTorus, -2),
        (Shape::FlatTorus4, 0),
    ];
    for (shape, characteristic) in cases {
        for points in [2000, 12_345] {
            assert_eq!(
                euler_characteristic(&draw(shape, points, Sampling::Grid)),
                characteristic,
                "{shape:?}"
            );
        }
    }
    assert!(draw(Shape::FlatTorus6, 2000, Sampling::Grid).faces().is_empty());
}

#[test]
fn every_edge_of_a_closed_mesh_is_walked_once_in_each_direction() {
    for shape in [Shape::Sphere, Shape::Torus, Shape::TwoHoleTorus] {
        let mesh = draw(shape, 3000, Sampling::Grid);
        let mut walks: Vec<[u32; 2]> =
            mesh.faces().iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        walks.sort_unstable();
        assert!(walks.windows(2).all(|pair| pair[0] != pair[1]), "{shape:?}");
        assert!(walks.iter().all(|&[a, b]| walks.binary_search(&[b, a]).is_ok()), "{shape:?}");
    }
}

#[test]
fn meshes_have_the_area_of_their_shape() {
    for shape in [Shape::Sphere, Shape::Torus, Shape::Cylinder, Shape::Square] {
        let mesh = draw(shape, 20_000, Sampling::Grid);
        let total: f64 = mesh
            .faces()
            .iter()
            .map(|f| {
                let [p, q, r] = f.map(|c| mesh.point(c as usize));
                area(p, q, r)
            })
            .sum();
        assert!((total / shape.area().unwrap() - 1.0).abs() < 2e-3, "{shape:?}: {total}");
    }
}

#[test]
fn a_folded_square_has_two_flat_halves_at_the_angle() {
    let folded = SampleRequest { angle: 90.0, ..request(Shape::Square, 500, Sampling::Uniform) };
    let cloud = sample(&folded).unwrap();
    let flat = draw(Shape::Square, 500, Sampling::Uniform);
    for i in 0..500 {
        let (folded, flat) = (cloud.point(i), flat.point(i));
        let expected = if flat[1] <= 0.5 { [flat[0], flat[1], 0.0] } else { [flat[0], 0.5, flat[1] - 0.5] };
        assert!(folded.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15));
    }
}

#[test]
fn noise_has_the_wanted_deviation_along_every_axis() {
    let noisy = SampleRequest { noise: 0.05, ..request(Shape::Sphere, 20_000, Sampling::Uniform) };
    let (noisy, exact) = (sample(&noisy).unwrap(), draw(Shape::Sphere, 20_000, Sampling::Uniform));
    for axis in 0..3 {
        let squares = (0..20_000).map(|i| (noisy.point(i)[axis] - exact.point(i)[axis]).powi(2));
        let deviation = (squares.sum::<f64>() / 20_000.0).sqrt();
        assert!((deviation / 0.05 - 1.0).abs() < 0.03, "{deviation}");
    }
}

#[test]
fn requests_out_of_range_are_refused() {
    let good = SampleRequest::new(Shape::Square, 100);
    let refused = |request: SampleRequest| sample(&request).unwrap_err();
    assert_eq!(
        refused(SampleRequest { points: 0, ..good }),
        SampleError::Points { points: 0, points_min: 1 }
    );
    assert!(matches!(refused(SampleRequest { points: POINTS_MAX + 1, ..good }), SampleError::Points { .. }));
    assert!(matches!(
        refused(request(Shape::TwoHoleTorus, 1999, Sampling::Grid)),
        SampleError::Points { points_min: 2000, .. }
    ));
    assert_eq!(refused(SampleRequest { noise: -1.0, ..good }), SampleError::Noise { noise: -1.0 });
    assert!(matches!(refused(SampleRequest { noise: f64::NAN, ..good }), SampleError::Noise { .. }));
    assert_eq!(refused(SampleRequest { angle: 180.0, ..good }), SampleError::Angle { angle: 180.0 });
    assert!(matches!(refused(SampleRequest { angle: f64::NAN, ..good }), SampleError::Angle { .. }));
    assert!(matches!(
        refused(SampleRequest { shape: Shape::Torus, angle: 1.0, ..good }),
        SampleError::Angle { .. }
    ));
}

#[test]
fn every_shape_and_sampling_is_found_by_its_name() {
    for shape in Shape::ALL {
        assert_eq!(Shape::from_name(shape.name()), Some(shape));
    }
    for sampling in Sampling::ALL {
        assert_eq!(Sampling::from_name(sampling.name()), Some(sampling));
    }
    assert_eq!(Shape::from_name("klein-bottle"), None);
}
