//! What is known of the bases apart from their values: eigenvalues, and which of them cannot be told apart.

use crate::spectrum::Spectrum;

/// The eigenvalues that a set of bases belongs to, ascending.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::struct_field_names)] // zero modes are what they are called
pub struct Modes {
    /// λ in 1/length², zero modes first. Infinite where the operator's eigenvalue carries no information.
    eigenvalues: Vec<f64>,
    /// Number of zero modes: one per connected component.
    zero_modes: usize,
    /// Index ranges `[first, last]` inside which the choice of bases is arbitrary.
    clusters: Vec<[usize; 2]>,
}

impl Modes {
    /// Takes the eigenvalues of a spectrum; rounding below 0 is cut off.
    #[must_use]
    pub fn of(spectrum: &Spectrum) -> Self {
        let eigenvalues = spectrum.eigenvalues.iter().map(|lambda| lambda.unwrap_or(f64::INFINITY).max(0.0));
        Self {
            eigenvalues: eigenvalues.collect(),
            zero_modes: spectrum.components.min(spectrum.eigenvalues.len()),
            clusters: spectrum.clusters.clone(),
        }
    }

    /// Takes eigenvalues in 1/length², ascending, `zero_modes` of which are zero, no two of them in a cluster.
    #[must_use]
    pub fn new(eigenvalues: Vec<f64>, zero_modes: usize) -> Self {
        Self { eigenvalues, zero_modes, clusters: Vec::new() }
    }

    /// Number of modes k.
    #[must_use]
    pub fn len(&self) -> usize {
        self.eigenvalues.len()
    }

    /// Whether there is no mode at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.eigenvalues.is_empty()
    }

    /// λ in 1/length².
    #[must_use]
    pub fn eigenvalues(&self) -> &[f64] {
        &self.eigenvalues
    }

    /// Number of zero modes.
    #[must_use]
    pub fn zero_modes(&self) -> usize {
        self.zero_modes
    }

    /// Index ranges `[first, last]` inside which the choice of bases is arbitrary.
    #[must_use]
    pub fn clusters(&self) -> &[[usize; 2]] {
        &self.clusters
    }

    /// Frequency √λ of a mode, in 1/length.
    #[must_use]
    pub fn frequency(&self, mode: usize) -> f64 {
        self.eigenvalues[mode].sqrt()
    }

    /// Number of modes below a frequency in 1/length.
    #[must_use]
    pub fn below(&self, frequency: f64) -> usize {
        (0..self.len()).take_while(|&mode| self.frequency(mode) < frequency).count()
    }

    /// The modes that are neither zero nor without information, as far as they are contiguous.
    #[must_use]
    pub fn informative(&self) -> std::ops::Range<usize> {
        let known = self.eigenvalues.iter().take_while(|lambda| lambda.is_finite()).count();
        self.zero_modes.min(known)..known
    }

    /// The clusters in which `gains` differ: what they select there depends on an arbitrary choice.
    #[must_use]
    pub fn divided_clusters(&self, gains: &[f64]) -> Vec<[usize; 2]> {
        let differ = |&[first, last]: &[usize; 2]| {
            gains
                .get(first..=last)
                .is_some_and(|gains| gains.iter().any(|gain| (gain - gains[0]).abs() > 0.0))
        };
        self.clusters.iter().copied().filter(differ).collect()
    }
}
