//! The operators by name, and what each needs.

use crate::arguments::words;

words! {
    /// The operators that can be asked for by name.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum OperatorKind {
        /// Symmetrizable Voronoi-weighted heat-kernel operator [PBMHB §3.3–3.4].
        #[default]
        PbMhb,
        /// Finite volumes on tangent-space Voronoi cells.
        Voronoi,
        /// Heat kernel weighted by the Delaunay simplices of every point's own tangent space [PCD §2.2]; not symmetrizable.
        Pcd,
        /// The symmetric part ½(L+Lᵀ) of `pcd` [PBMHB §3.4, §5.1].
        PcdSymmetrized,
        /// Heat kernel weighted by the areas of the incident faces, each divided equally among its corners [MESH eq. 1]; needs
        /// faces.
        Mesh,
        /// Cotangent weights over mixed Voronoi areas [MESH §5; Meyer et al. 2003]; needs faces.
        Cotangent,
        /// Gaussian weights, density-normalized (α = 1) and row-normalized [PCD §4; Lafon 2004].
        WeightedGraph,
        /// Normalized Laplacian `I − D^-½ A D^-½` of the ball graph [PBMHB §5.2].
        Graph,
        /// `D − A` of the ball graph [PBMHB §5.2].
        Kirchhoff,
        /// `I − D⁻¹A` of the ball graph [PBMHB §5.2].
        Tutte,
    }
}

impl OperatorKind {
    /// Whether the cloud must come with triangles.
    #[must_use]
    pub const fn needs_faces(self) -> bool {
        matches!(self, Self::Mesh | Self::Cotangent)
    }

    /// Whether rows are weighted by a Gaussian of time t.
    #[must_use]
    pub const fn is_heat_kernel(self) -> bool {
        matches!(self, Self::PbMhb | Self::Pcd | Self::PcdSymmetrized | Self::Mesh | Self::WeightedGraph)
    }

    /// Whether it only knows which points are near each other: its eigenvalues have no unit and do not converge to
    /// those of the surface.
    #[must_use]
    pub const fn is_combinatorial(self) -> bool {
        matches!(self, Self::Graph | Self::Kirchhoff | Self::Tutte)
    }

    /// Whether it is made of cells or triangles alone: rows of about seven entries.
    #[must_use]
    pub const fn is_narrow(self) -> bool {
        matches!(self, Self::Voronoi | Self::Cotangent)
    }

    /// Whether it triangulates every point's neighborhood by itself.
    #[must_use]
    pub const fn is_pcd(self) -> bool {
        matches!(self, Self::Pcd | Self::PcdSymmetrized)
    }
}

words! {
    /// Which distance the Gaussian of `pcd` takes.
    #[non_exhaustive]
    pub enum Distance {
        /// Between the points in space [PCD eq. 2.1].
        Ambient,
        /// Between their projections to the tangent space of the row's point [PCD §5].
        Projected,
    }
}

words! {
    /// How `pcd` chooses t, δ and its simplices.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum Parameterization {
        /// t and δ from the covering radius ε, simplices within δ/2 [PCD §2.2].
        #[default]
        CoveringRadius,
        /// That of the authors' own program: `h` is twice the mean distance to the ten nearest (the point itself counted),
        /// `4t = h²`, `δ = 3h`, planes by PCA weighted with `exp(−|·|²/h²)`, all simplices of the Delaunay triangulation.
        NearestTen,
    }
}
