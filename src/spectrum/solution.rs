//! What a solver is asked for, and what it answers.

use serde::{Deserialize, Serialize};

use super::certificates::{self, Certificates, Measured, MissedCheck};
use super::dual;
use super::shifted_system::NearInverse;
use super::vectors::block::Block;
use super::vectors::shelf::Shelf;
use super::weyl::Weyl;
use super::{Eigenpairs, Problem, SpectrumError};
use crate::operator::{Sparse, Structure};
use crate::progress::Progress;

/// Eigenvalues with everything that tells how far to trust them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[non_exhaustive]
pub struct Spectrum {
    /// λ in 1/length² (of graph operators without unit), ascending, heat-corrected where the operator is a heat kernel, and with what
    /// the cells lose of the modes where it is `voronoi` on a surface. A value that carries no information (tμ ≥ 1) is absent (null).
    pub eigenvalues: Vec<Option<f64>>,
    /// Relative error to expect of every eigenvalue, from the size of the cells, the walls that points see differently, and
    /// the rims where its mode lives: an estimate, no bound. Present for `voronoi` and `pb-mhb` on surfaces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected_errors: Option<Vec<f64>>,
    /// μ in 1/length², ascending: the eigenvalues of the matrix pencil.
    pub raw_eigenvalues: Vec<f64>,
    /// Imaginary parts of λ, present for an operator whose eigenvalues need not be real; `eigenvalues` and
    /// `raw_eigenvalues` are then the real parts, and the two bases of a conjugate pair are the real and the imaginary
    /// part of its eigenvector.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imaginary_parts: Option<Vec<f64>>,
    /// `‖B^-½(S x − μ B x)‖₂ / (μ + σ)` of every returned pair.
    pub residuals: Vec<f64>,
    /// A bound of ρ = `‖B^-½(S x − μ B x)‖_{(A+σ)⁻¹} / √(μ+σ)` of every returned pair, A = B^-½ S B^-½: some eigenvalue λ of the
    /// matrix pencil has |λ − μ|/(λ+σ) ≤ ρ. Unlike `residuals` it does not grow with the number of points. Absent for operators without symmetry, and
    /// in reports of versions that did not tell it.
    #[serde(default)]
    pub dual_residuals: Option<Vec<f64>>,
    /// Number of points that the eigenproblem was solved on: all that are used, or those of a thinned sample (`method`
    /// `prolonged`). Absent in reports of versions that did not tell it.
    #[serde(default)]
    pub solved_points: Option<usize>,
    /// Index ranges `[first, last]` of eigenvalues that are too close to tell their vectors apart.
    pub clusters: Vec<[usize; 2]>,
    /// Number of connected components, each with one zero eigenvalue.
    pub components: usize,
    /// What was checked.
    pub certificates: Certificates,
    /// How the eigenpairs were computed.
    pub method: Method,
}

/// How eigenpairs were computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Method {
    /// All eigenpairs of the dense matrix.
    Dense,
    /// Block Lanczos on the inverse of the shifted operator.
    ShiftInvert,
    /// From thinned samples of the surface to all of its points, with corrections by the inverse on every level.
    CoarseToFine,
    /// From a thinned sample of the surface, which alone was solved, along the surface to all points, with one to three
    /// corrections and Rayleigh–Ritz steps there.
    Prolonged,
    /// Block Lanczos on the inverse of the shifted operator, made of a polynomial in the operator and the factor of the
    /// finite-volume operator.
    Polynomial,
    /// LOBPCG preconditioned by the finite-volume operator's factor.
    Lobpcg,
    /// The same iteration with a Schur form, for operators that are not symmetric or not definite.
    InvariantSubspace,
}

/// What a solve needs beside the problem.
pub struct Request<'a, P> {
    /// Number of eigenpairs, zero modes included, at most n.
    pub count: usize,
    /// Largest relative residual.
    pub tolerance: f64,
    /// Position of a point, for the elimination order.
    pub position: P,
    /// `B^-½ S B^-½` of a narrow operator on the same points and masses, for kernel operators.
    pub narrow: Option<&'a Sparse>,
    /// Where the eigenvalues are expected; absent where nothing is known of them.
    pub weyl: Option<Weyl>,
    /// `1/μ` at the upper end of the spectrum of operators with long rows: t of a heat kernel.
    pub plateau: Option<f64>,
    /// Most points that are solved on: more are thinned out where they make up a surface in space.
    pub solved_max: usize,
    /// Whether μ beyond a share of `1/plateau` says nothing about λ.
    pub saturates: bool,
}

/// Vectors as a solver holds them.
#[derive(Debug)]
pub enum Vectors {
    /// Eigenvectors `y = B^½ h` of `A`.
    Double(Block),
    /// The functions `h` themselves, in single precision.
    Single(Shelf),
}

impl Vectors {
    /// Writes the eigenvectors at point `i`, the root of whose mass is given. Neighboring points are best asked for one after the
    /// other.
    ///
    /// # Panics
    /// When the file that they are in cannot be read.
    #[expect(clippy::panic, reason = "documented; a disk that loses what was just written")]
    pub fn write_row(&self, i: usize, root_mass: f64, out: &mut [f64]) {
        match self {
            Self::Double(vectors) => out.copy_from_slice(vectors.row(i)),
            Self::Single(functions) => {
                let write = |row: &[f32]| {
                    out.iter_mut().zip(row).for_each(|(out, &h)| *out = root_mass * f64::from(h));
                };
                if let Err(error) = functions.with_row(i, write) {
                    panic!("eigenvectors cannot be read: {error}");
                }
            }
        }
    }
}

/// Eigenpairs with their certificates.
pub struct Solution {
    /// μ, or its real part.
    pub values: Vec<f64>,
    /// Imaginary parts of μ, as in [`Eigenpairs`].
    pub imaginary: Vec<f64>,
    /// One column each.
    pub vectors: Vectors,
    /// Their residuals.
    pub residuals: Vec<f64>,
    /// Bounds of their ρ; none for operators without symmetry.
    pub dual_residuals: Option<Vec<f64>>,
    /// Points that were solved on.
    pub solved_points: usize,
    /// The checks.
    pub certificates: Certificates,
    /// How they were computed.
    pub method: Method,
}

impl Solution {
    /// Keeps the first `count` pairs.
    pub(super) fn truncate(&mut self, count: usize) {
        self.values.truncate(count);
        self.imaginary.truncate(count);
        self.residuals.truncate(count);
        if let Some(all) = &mut self.dual_residuals {
            all.truncate(count);
        }
        match &mut self.vectors {
            Vectors::Double(vectors) => vectors.set_columns(count),
            Vectors::Single(vectors) => vectors.set_columns(count),
        }
    }
}

/// Null vectors first, then the pairs found beside them.
pub(super) fn with_null_space(problem: &Problem, found: Option<&Eigenpairs>, count: usize) -> Eigenpairs {
    let zeros = problem.zero_modes().min(count);
    let mut vectors = Block::zeros(problem.size(), count);
    problem.write_null_vectors(&mut vectors, 0..zeros);
    let mut values = vec![0.0; zeros];
    if let Some(found) = found {
        vectors.copy_columns(zeros, &found.vectors, 0, count - zeros);
        values.extend_from_slice(&found.values[..count - zeros]);
    }
    Eigenpairs::real(values, vectors)
}

/// Pairs with what is checked about them; `inverse` nearly solves with the shifted matrix.
pub(super) fn certified<P>(
    problem: &Problem,
    pairs: Eigenpairs,
    request: &Request<'_, P>,
    method: Method,
    missed: (Option<usize>, MissedCheck),
    inverse: Option<&mut dyn NearInverse>,
    progress: &Progress,
) -> Result<Solution, SpectrumError> {
    let (measured, dual) = match problem.structure {
        Structure::SemiDefinite => {
            let judged = dual::bounds(problem, &pairs.values, &pairs.vectors, inverse, progress)?;
            let relative = judged.norms.iter().zip(&pairs.values).map(|(r, mu)| r / (mu + problem.shift));
            let orthogonality = certificates::orthogonality(&pairs.vectors, progress)?;
            (Measured { residuals: relative.collect(), orthogonality }, Some(judged.bounds))
        }
        _ => (certificates::measure(problem, &pairs, progress)?, None),
    };
    Ok(certified_by(problem, pairs, (measured, dual), request, method, missed))
}

/// The same of pairs that were measured, with the bounds of their ρ.
pub(super) fn certified_by<P>(
    problem: &Problem,
    pairs: Eigenpairs,
    (measured, dual_residuals): (Measured, Option<Vec<f64>>),
    request: &Request<'_, P>,
    method: Method,
    (missed, missed_check): (Option<usize>, MissedCheck),
) -> Solution {
    let certificates = Certificates {
        orthogonality: measured.orthogonality,
        residual: measured.residual(),
        dual_residual: dual_residuals.as_ref().map(|all| all.iter().copied().fold(0.0, f64::max)),
        zero_modes: match problem.structure {
            Structure::SemiDefinite => problem.zero_modes().min(request.count),
            _ => pairs.values.iter().filter(|value| value.abs() <= request.tolerance * problem.shift).count(),
        },
        missed,
        missed_check,
        saturation: saturation(request, &pairs.values),
    };
    let Eigenpairs { values, imaginary, vectors } = pairs;
    Solution {
        values,
        imaginary,
        vectors: Vectors::Double(vectors),
        residuals: measured.residuals,
        dual_residuals,
        solved_points: problem.size(),
        certificates,
        method,
    }
}

/// The share of a heat kernel's spectrum up to which these values reach; none of other operators.
pub(super) fn saturation<P>(request: &Request<'_, P>, values: &[f64]) -> Option<f64> {
    let plateau = request.plateau.filter(|_| request.saturates);
    plateau.map(|t| t * values.last().copied().unwrap_or(0.0))
}
