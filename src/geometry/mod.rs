//! Geometry of the sampled surface: neighborhoods, tangent frames, Voronoi cells, sampling density.
//!
//! Everything here works on [`Points`]: finite, distinct, recentered, and ordered along a space-filling curve.

pub mod cells;
mod clipper;
pub mod components;
pub mod curve;
pub mod delaunay;
pub mod frames;
mod gaps;
pub mod holes;
mod layers;
pub mod metric;
mod morton;
pub mod near;
pub mod neighborhoods;
pub mod noise;
pub mod normals;
pub mod orientation;
pub mod planes;
pub mod points;
pub mod polytope;
pub mod rims;
pub mod sampling;
pub mod span;
pub mod stars;
pub mod strays;
pub mod survey;
pub mod triangles;
mod votes;

pub use cells::{Cells, cells};
pub use components::{Components, components};
pub use curve::Curve;
pub use frames::{Frames, frames};
pub use metric::TriangleMetric;
pub use neighborhoods::{NearestNeighbors, SearchTree};
pub use normals::normals;
pub use points::{GeometryError, Points};
pub use sampling::Sampling;
pub use span::Span;
pub use stars::Stars;
pub use triangles::Triangles;
