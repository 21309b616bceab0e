//! Parameterized shapes: the unit square (cube for the 3-manifold) is mapped onto them.

use std::f64::consts::{PI, TAU};

use super::Shape;

/// Semi-axes of the ellipsoid.
pub(super) const ELLIPSOID: [f64; 3] = [1.0, 0.8, 0.6];
/// Radius to the middle of the torus's tube.
pub(super) const TORUS_MAJOR: f64 = 1.0;
/// Radius of the tube.
pub(super) const TORUS_MINOR: f64 = 0.4;
/// Half of the cylinder's height.
pub(super) const CYLINDER_HALF: f64 = 1.0;
/// 1 + 0.15 + 0.1.
pub(super) const BUMPY_RADIUS_MAX: f64 = 1.25;

/// A shape with a parameterization.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Chart {
    Sphere,
    Ellipsoid,
    BumpySphere,
    Torus,
    Cylinder,
    /// With the fold in radians.
    Square(f64),
    FlatTorus4,
    FlatTorus6,
}

/// How the sides of the parameter square are glued.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Gluing {
    /// The sides u=0 and u=1 are points, v is periodic.
    Globe,
    /// Both are periodic.
    Torus,
    /// v is periodic.
    Tube,
    /// Neither.
    Sheet,
    /// A cube with all three periodic.
    Torus3,
}

/// A point of a shape. Coordinates beyond the shape's dimension are 0.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    pub(super) point: [f64; 6],
    /// Area per parameter area, divided by a bound of it: the probability with which a point with uniform
    /// parameters is kept so that the kept ones are uniform by area.
    pub(super) weight: f64,
}

impl Shape {
    /// The shape's parameterization; the two-hole torus has none here.
    pub(super) fn chart(self, angle: f64) -> Option<Chart> {
        Some(match self {
            Self::Sphere => Chart::Sphere,
            Self::Ellipsoid => Chart::Ellipsoid,
            Self::BumpySphere => Chart::BumpySphere,
            Self::Torus => Chart::Torus,
            Self::Cylinder => Chart::Cylinder,
            Self::Square => Chart::Square(angle.to_radians()),
            Self::FlatTorus4 => Chart::FlatTorus4,
            Self::FlatTorus6 => Chart::FlatTorus6,
            Self::TwoHoleTorus => return None,
        })
    }
}

impl Chart {
    pub(super) fn gluing(self) -> Gluing {
        match self {
            Self::Sphere | Self::Ellipsoid | Self::BumpySphere => Gluing::Globe,
            Self::Torus | Self::FlatTorus4 => Gluing::Torus,
            Self::Cylinder => Gluing::Tube,
            Self::Square(_) => Gluing::Sheet,
            Self::FlatTorus6 => Gluing::Torus3,
        }
    }

    /// Length along u divided by length along v, for grids of roughly square cells.
    pub(super) fn aspect(self) -> f64 {
        match self {
            Self::Sphere | Self::Ellipsoid | Self::BumpySphere => 0.5,
            Self::Torus => TORUS_MINOR / TORUS_MAJOR,
            Self::Cylinder => 2.0 * CYLINDER_HALF / TAU,
            Self::Square(_) | Self::FlatTorus4 | Self::FlatTorus6 => 1.0,
        }
    }

    /// Whether a lattice of parameters must be warped to be uniform by area.
    pub(super) fn is_warped(self) -> bool {
        matches!(self, Self::Torus | Self::Ellipsoid)
    }

    /// The point with parameters u, v, w in `0..1`.
    pub(super) fn place(self, [u, v, w]: [f64; 3]) -> Placed {
        match self {
            Self::Sphere => plain(&on_sphere(u, v)),
            Self::Ellipsoid => on_ellipsoid(on_sphere(u, v)),
            Self::BumpySphere => on_bumpy_sphere(on_sphere(u, v)),
            Self::Torus => {
                let ((sin_u, cos_u), (sin_v, cos_v)) = ((TAU * u).sin_cos(), (TAU * v).sin_cos());
                let around = TORUS_MAJOR + TORUS_MINOR * cos_u;
                // Area element r(R + r cos u), over its maximum r(R + r).
                let weight = around / (TORUS_MAJOR + TORUS_MINOR);
                Placed { weight, ..plain(&[around * cos_v, around * sin_v, TORUS_MINOR * sin_u]) }
            }
            Self::Cylinder => {
                let (sin, cos) = (TAU * v).sin_cos();
                plain(&[cos, sin, CYLINDER_HALF * (2.0 * u - 1.0)])
            }
            Self::Square(fold) => {
                let beyond = (v - 0.5).max(0.0);
                plain(&[u, v.min(0.5) + beyond * fold.cos(), beyond * fold.sin()])
            }
            Self::FlatTorus4 => {
                let ((sin_u, cos_u), (sin_v, cos_v)) = ((TAU * u).sin_cos(), (TAU * v).sin_cos());
                plain(&[cos_u, sin_u, cos_v, sin_v])
            }
            Self::FlatTorus6 => {
                let ((sin_u, cos_u), (sin_v, cos_v)) = ((TAU * u).sin_cos(), (TAU * v).sin_cos());
                let (sin_w, cos_w) = (TAU * w).sin_cos();
                plain(&[cos_u, sin_u, cos_v, sin_v, cos_w, sin_w])
            }
        }
    }
}

fn plain(coordinates: &[f64]) -> Placed {
    let mut point = [0.0; 6];
    point[..coordinates.len()].copy_from_slice(coordinates);
    Placed { point, weight: 1.0 }
}

/// Archimedes: height and longitude map onto the sphere with constant area element 4π.
fn on_sphere(u: f64, v: f64) -> [f64; 3] {
    let z = 1.0 - 2.0 * u;
    let radius = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (TAU * v).sin_cos();
    [radius * cos, radius * sin, z]
}

/// The linear map diag(a, b, c) multiplies area at the sphere's normal n by `|(bc nₓ, ca n_y, ab n_z)|`.
fn on_ellipsoid(n: [f64; 3]) -> Placed {
    let [a, b, c] = ELLIPSOID;
    let stretch = (b * c * n[0]).hypot(c * a * n[1]).hypot(a * b * n[2]);
    let stretch_max = (b * c).max(c * a).max(a * b);
    Placed { weight: stretch / stretch_max, ..plain(&[a * n[0], b * n[1], c * n[2]]) }
}

/// The radial map p ↦ ρ(p)p multiplies area by ρ√(ρ² + |∇ρ|²), with the gradient along the sphere.
fn on_bumpy_sphere(p: [f64; 3]) -> Placed {
    let [x, y, z] = p;
    let wave = 5.0 * z + 2.0 * x;
    let radius = 1.0 + 0.15 * (4.0 * x).sin() * (3.0 * y).cos() + 0.1 * wave.cos();
    let gradient = [
        0.6 * (4.0 * x).cos() * (3.0 * y).cos() - 0.2 * wave.sin(),
        -0.45 * (4.0 * x).sin() * (3.0 * y).sin(),
        -0.5 * wave.sin(),
    ];
    let outward: f64 = gradient.iter().zip(&p).map(|(g, x)| g * x).sum();
    let along: f64 = gradient.iter().map(|g| g * g).sum::<f64>() - outward * outward;
    let stretch = radius * (radius * radius + along.max(0.0)).sqrt();
    // |∇ρ| ≤ 0.15·4 + 0.1·√29.
    let gradient_max = 0.6 + 0.1 * 29.0_f64.sqrt();
    let stretch_max = BUMPY_RADIUS_MAX * BUMPY_RADIUS_MAX.hypot(gradient_max);
    Placed { weight: stretch / stretch_max, ..plain(&[radius * x, radius * y, radius * z]) }
}

/// Parameter u of the colatitude θ in `0..=π`.
pub(super) fn u_of_colatitude(share: f64) -> f64 {
    (1.0 - (PI * share).cos()) / 2.0
}
