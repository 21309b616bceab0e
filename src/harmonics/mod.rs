//! What the eigenbasis of a surface is good for: transform, filters, feature points, invariants, signatures, distances.
//!
//! All of it needs eigenpairs and masses only. Bases come in [`Block`]s of rows or, for extrema, one by one; the caller
//! decides how many are in memory at once. Arrays are indexed by rows of the upload: mass is 0 for a duplicate of an
//! earlier row and NaN for a row without a result, and bases are NaN there.

mod block;
pub mod collapse;
pub mod distances;
pub mod features;
pub mod filter;
pub mod filtered;
pub mod functions;
pub mod heat_trace;
pub mod invariants;
mod modes;
mod neighborhoods;
pub mod shape_dna;
pub mod signatures;
pub mod transform;

pub use block::Block;
pub use distances::{Distance, DistanceKind, DistanceRequest};
pub use features::{Feature, FeatureRequest};
pub use filter::{Filter, FilterError, FilterKind, Scale, Transfer};
pub use functions::Function;
pub use modes::Modes;
pub use neighborhoods::Neighborhoods;
pub use signatures::{Signature, SignatureKind, SignatureRequest};
pub use transform::{Bands, Energy, Transformed};
