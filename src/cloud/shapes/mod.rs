//! Sample shapes with known geometry: for tests, benchmarks, and a first look at the service.

mod chart;
mod double_torus;
mod grid;
mod lattice;
mod marching;
mod spacing;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use self::chart::Chart;
use super::{CloudError, NonFinite, PointCloud};
use crate::arguments::words;

/// Most points that are drawn.
pub const POINTS_MAX: usize = 10_000_000;

/// Largest ratio of densities of [`Sampling::NonUniform`].
pub const DENSITY_RATIO: f64 = 10.0;

words! {
    /// A surface, or for the last a 3-manifold.
    #[non_exhaustive]
    pub enum Shape {
        /// Unit sphere.
        Sphere,
        /// Semi-axes 1, 0.8 and 0.6.
        Ellipsoid,
        /// Unit sphere with every point p moved to p·(1 + 0.15 sin 4x cos 3y + 0.1 cos(5z+2x)).
        BumpySphere,
        /// Around the z-axis: radius 1 to the middle of the tube, 0.4 of the tube.
        Torus,
        /// Open cylinder around the z-axis: radius 1, height 2.
        Cylinder,
        /// Unit square, folded along its middle by the request's angle.
        Square,
        /// (x²(1−x²)−y²)² + z² = 0.15²: closed, genus 2.
        TwoHoleTorus,
        /// (cos u, sin u, cos v, sin v) in R⁴ [PCD Table 1].
        FlatTorus4 = "flat-torus-4",
        /// (cos u, sin u, cos v, sin v, cos w, sin w) in R⁶, of intrinsic dimension 3 [PCD Table 1].
        FlatTorus6 = "flat-torus-6",
    }
}

impl Shape {
    /// Dimension of the manifold.
    #[must_use]
    pub const fn intrinsic_dimension(self) -> usize {
        match self {
            Self::FlatTorus6 => 3,
            _ => 2,
        }
    }

    /// Number of coordinates of its points.
    #[must_use]
    pub const fn ambient_dimension(self) -> usize {
        match self {
            Self::FlatTorus4 => 4,
            Self::FlatTorus6 => 6,
            _ => 3,
        }
    }

    /// Area (volume for the 3-manifold) where it has a closed form.
    #[must_use]
    pub fn area(self) -> Option<f64> {
        use std::f64::consts::PI;
        Some(match self {
            Self::Sphere | Self::Cylinder => 4.0 * PI,
            Self::Torus => 4.0 * PI * PI * chart::TORUS_MAJOR * chart::TORUS_MINOR,
            Self::Square => 1.0,
            Self::FlatTorus4 => 4.0 * PI * PI,
            Self::FlatTorus6 => 8.0 * PI * PI * PI,
            Self::Ellipsoid | Self::BumpySphere | Self::TwoHoleTorus => return None,
        })
    }
}

words! {
    /// How points are spread over a shape.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum Sampling {
        /// Well spaced, with equal density by area: a golden lattice, or darts with a least distance on the
        /// two-hole torus. On the bumpy sphere, a golden lattice of the sphere, moved.
        #[default]
        Uniform,
        /// Independent, with equal density by area.
        Iid,
        /// Independent, with a density that grows exponentially along x, tenfold over the shape.
        NonUniform = "nonuniform",
        /// The nodes of a parameter grid, with faces (none on the 3-manifold). Their number is that of the grid
        /// nearest to the wanted number.
        Grid,
    }
}

/// Which sample is wanted. The same request gives the same cloud, bit for bit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleRequest {
    /// The shape.
    pub shape: Shape,
    /// Number of points; exact except for [`Sampling::Grid`].
    pub points: usize,
    /// How they are spread.
    pub sampling: Sampling,
    /// Standard deviation of Gaussian noise along every axis, in units of the shape.
    pub noise: f64,
    /// Seed of the random numbers; it also shifts [`Sampling::Uniform`], 0 by nothing. [`Sampling::Grid`] has none.
    pub seed: u64,
    /// Fold of the square in degrees; 0 is flat.
    pub angle: f64,
}

impl SampleRequest {
    /// A well spaced, exact, unfolded sample.
    #[must_use]
    pub fn new(shape: Shape, points: usize) -> Self {
        Self { shape, points, sampling: Sampling::Uniform, noise: 0.0, seed: 0, angle: 0.0 }
    }
}

/// Why a sample cannot be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SampleError {
    /// Too few or too many points.
    #[error("points={points}: {points_min} to {POINTS_MAX} are possible for this shape and sampling")]
    Points {
        /// Asked for.
        points: usize,
        /// Least number.
        points_min: usize,
    },
    /// Negative or not finite.
    #[error("noise={noise}: a standard deviation is a number from 0")]
    Noise {
        /// Asked for.
        noise: f64,
    },
    /// Folded onto itself, or not a square.
    #[error(
        "angle={angle}: a square can be folded by more than -180 and less than 180 degrees, other shapes not"
    )]
    Angle {
        /// Asked for.
        angle: f64,
    },
    /// Noise beyond the range of floating-point numbers.
    #[error(transparent)]
    Cloud(#[from] CloudError),
}

/// Draws a sample.
///
/// # Errors
/// [`SampleError`] when the request is out of range.
pub fn sample(request: &SampleRequest) -> Result<PointCloud, SampleError> {
    check(request)?;
    let mut random = ChaCha8Rng::seed_from_u64(request.seed);
    let (mut coordinates, faces) = match request.shape.chart(request.angle) {
        Some(chart) => of_chart(chart, request, &mut random),
        None => of_double_torus(request, &mut random),
    };
    if request.noise > 0.0 {
        for x in &mut coordinates {
            *x += request.noise * gaussian(&mut random);
        }
    }
    let cloud = PointCloud::new(request.shape.ambient_dimension(), coordinates, NonFinite::Reject)?;
    Ok(cloud.with_faces(faces)?)
}

type Sample = (Vec<f64>, Vec<[u32; 3]>);

fn of_chart(chart: Chart, request: &SampleRequest, random: &mut ChaCha8Rng) -> Sample {
    let dimension = request.shape.ambient_dimension();
    let mut coordinates = Vec::with_capacity(request.points * dimension);
    match request.sampling {
        Sampling::Grid => return grid::nodes(chart, request.points, dimension),
        Sampling::Uniform => {
            // Seed 0 is the lattice itself.
            let shift = if request.seed == 0 { [0.0; 3] } else { random.random() };
            for parameter in lattice::golden(chart, request.points, shift) {
                coordinates.extend_from_slice(&chart.place(parameter).point[..dimension]);
            }
        }
        Sampling::Iid | Sampling::NonUniform => {
            while coordinates.len() < request.points * dimension {
                let placed = chart.place(random.random());
                if random.random::<f64>() < placed.weight && is_kept(request, &placed.point, random) {
                    coordinates.extend_from_slice(&placed.point[..dimension]);
                }
            }
        }
    }
    (coordinates, Vec::new())
}

fn of_double_torus(request: &SampleRequest, random: &mut ChaCha8Rng) -> Sample {
    let points = match request.sampling {
        Sampling::Grid => return marching::double_torus(request.points),
        Sampling::Uniform => spacing::well_spaced(request.points, || double_torus::draw(random)),
        Sampling::Iid | Sampling::NonUniform => {
            let mut points = Vec::with_capacity(request.points);
            while points.len() < request.points {
                let point = double_torus::draw(random);
                if is_kept(request, &point, random) {
                    points.push(point);
                }
            }
            points
        }
    };
    (points.concat(), Vec::new())
}

/// Thins independent points to the wanted density: `10^s / 10` with s from 0 to 1 along x.
fn is_kept(request: &SampleRequest, point: &[f64], random: &mut ChaCha8Rng) -> bool {
    if request.sampling != Sampling::NonUniform {
        return true;
    }
    let (low, high) = request.shape.extent_along_x();
    let along = (point[0] - low) / (high - low);
    random.random::<f64>() < DENSITY_RATIO.powf(along - 1.0)
}

impl Shape {
    fn extent_along_x(self) -> (f64, f64) {
        let half = match self {
            Self::Square => return (0.0, 1.0),
            Self::Torus => chart::TORUS_MAJOR + chart::TORUS_MINOR,
            Self::BumpySphere => chart::BUMPY_RADIUS_MAX,
            Self::TwoHoleTorus => double_torus::half_extent()[0],
            _ => 1.0,
        };
        (-half, half)
    }
}

fn check(request: &SampleRequest) -> Result<(), SampleError> {
    let &SampleRequest { shape, points, sampling, noise, angle, .. } = request;
    let points_min = match (sampling, shape) {
        (Sampling::Grid, Shape::TwoHoleTorus) => marching::POINTS_MIN,
        (Sampling::Grid, _) => grid::POINTS_MIN,
        _ => 1,
    };
    if !(points_min..=POINTS_MAX).contains(&points) {
        return Err(SampleError::Points { points, points_min });
    }
    if !(noise.is_finite() && noise >= 0.0) {
        return Err(SampleError::Noise { noise });
    }
    let is_foldable = shape == Shape::Square && angle.abs() < 180.0;
    if angle != 0.0 && !is_foldable {
        return Err(SampleError::Angle { angle });
    }
    Ok(())
}

/// A standard normal number, after Box and Muller (1958).
fn gaussian(random: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * random.random::<f64>()).cos()
}

#[cfg(test)]
mod tests;
