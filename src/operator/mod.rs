//! Discrete Laplace–Beltrami operators.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The operators that can be asked for by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum OperatorKind {
    /// Symmetrizable Voronoi-weighted heat-kernel operator [PBMHB §3.3–3.4].
    #[default]
    PbMhb,
    /// Finite volumes on tangent-plane Voronoi cells.
    Voronoi,
}
