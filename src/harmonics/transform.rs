//! The manifold harmonic transform [PBMHB §3.6, eq. 3.10–3.11]: `f̃ = HᵀBf` and back, `f = H f̃`.
//!
//! Both run over blocks of rows: partial sums of the forward transform are added in the order of the blocks, so that
//! the result does not depend on who computed which.

use serde::Serialize;

use super::Block;
use crate::arguments::arguments;

/// Rows of a block that are handled together: their sums stay in the nearest cache while the bases pass by.
const STRIP: usize = 1024;

/// Sums over some rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Partial {
    /// One list of k coefficients per function.
    coefficients: Vec<Vec<f64>>,
    /// `fᵀBf` per function.
    energy: Vec<f64>,
}

/// A function in the bases.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Transformed {
    /// `f̃_i = fᵀ B H_i`, in units of f times length on a surface.
    pub coefficients: Vec<f64>,
    /// `fᵀBf`, the energy of the whole function: by Parseval's identity at least `Σ f̃_i²`.
    pub energy: f64,
}

impl Transformed {
    /// A function in bases that are all in one block; of more blocks, [`total`] adds what [`partial`] sums.
    #[must_use]
    pub fn of<C: AsRef<[f64]>>(function: &[f64], block: &Block<C>, mass: &[f64]) -> Self {
        let Partial { mut coefficients, energy } = partial(block, mass, &[function]);
        Self { coefficients: coefficients.swap_remove(0), energy: energy[0] }
    }
}

/// The sums over one block's rows; functions and mass are indexed by rows of the upload.
///
/// Rows without mass (duplicates: 0, without a result: NaN) add nothing, whatever the function is there.
#[must_use]
pub fn partial<C: AsRef<[f64]>>(block: &Block<C>, mass: &[f64], functions: &[&[f64]]) -> Partial {
    let rows = block.first..block.first + block.rows();
    let mass = &mass[rows.clone()];
    let mut energy = vec![0.0; functions.len()];
    let weighted: Vec<Vec<f64>> = functions
        .iter()
        .zip(&mut energy)
        .map(|(function, energy)| {
            let weigh = |(&mass, &value): (&f64, &f64)| {
                let carries = mass > 0.0;
                *energy += if carries { mass * value * value } else { 0.0 };
                if carries { mass * value } else { 0.0 }
            };
            mass.iter().zip(&function[rows.clone()]).map(weigh).collect()
        })
        .collect();
    let is_whole = (0..block.rows()).all(|row| block.is_used(row));
    let mut coefficients = vec![vec![0.0; block.bases()]; functions.len()];
    for j in 0..block.bases() {
        let column = block.column(j);
        for start in (0..column.len()).step_by(STRIP) {
            let strip = start..(start + STRIP).min(column.len());
            for (weighted, coefficients) in weighted.iter().zip(&mut coefficients) {
                let (weights, values) = (&weighted[strip.clone()], &column[strip.clone()]);
                coefficients[j] +=
                    if is_whole { dot(weights, values) } else { dot_of_numbers(weights, values) };
            }
        }
    }
    Partial { coefficients, energy }
}

/// `Σ w h`, eight sums side by side, for the vector unit.
fn dot(weights: &[f64], values: &[f64]) -> f64 {
    const LANES: usize = 8;
    let (weight_lanes, weight_rest) = weights.as_chunks::<LANES>();
    let (value_lanes, value_rest) = values.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (weights, values) in weight_lanes.iter().zip(value_lanes) {
        for lane in 0..LANES {
            sums[lane] += weights[lane] * values[lane];
        }
    }
    let rest: f64 = weight_rest.iter().zip(value_rest).map(|(w, h)| w * h).sum();
    sums.iter().sum::<f64>() + rest
}

/// `Σ w h` over the rows where h is a number.
fn dot_of_numbers(weights: &[f64], values: &[f64]) -> f64 {
    weights.iter().zip(values).filter(|(_, h)| !h.is_nan()).map(|(w, h)| w * h).sum()
}

/// Adds the sums of all blocks, in their order.
#[must_use]
pub fn total(partials: &[Partial]) -> Vec<Transformed> {
    let Some(first) = partials.first() else { return Vec::new() };
    let functions = 0..first.coefficients.len();
    let transformed = |f: usize| {
        let mut coefficients = vec![0.0; first.coefficients[f].len()];
        for partial in partials {
            for (sum, term) in coefficients.iter_mut().zip(&partial.coefficients[f]) {
                *sum += term;
            }
        }
        Transformed { coefficients, energy: partials.iter().map(|partial| partial.energy[f]).sum() }
    };
    functions.map(transformed).collect()
}

/// The inverse over one block's rows: `Σ_i c_i H_i`, one column per list of coefficients. NaN where the bases are.
///
/// Lists shorter than the number of bases end in zeros.
#[must_use]
pub fn synthesize<C: AsRef<[f64]>>(block: &Block<C>, coefficients: &[&[f64]]) -> Vec<Vec<f64>> {
    let mut columns = vec![vec![0.0; block.rows()]; coefficients.len()];
    for start in (0..block.rows()).step_by(STRIP) {
        let strip = start..(start + STRIP).min(block.rows());
        for j in 0..block.bases() {
            let basis = &block.column(j)[strip.clone()];
            for (column, coefficients) in columns.iter_mut().zip(coefficients) {
                let coefficient = coefficients.get(j).copied().unwrap_or(0.0);
                for (sum, h) in column[strip.clone()].iter_mut().zip(basis) {
                    *sum += coefficient * h;
                }
            }
        }
    }
    columns
}

arguments! {
    /// Into what energies are divided.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub struct Bands {
        /// Number of bands of consecutive modes into which energies are summed.
        bands: usize = integer(1, 1000), default 10;
    }
}

/// How a function's energy `fᵀBf` is spread.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[non_exhaustive]
pub struct Energy {
    /// `fᵀBf`.
    pub total: f64,
    /// `Σ f̃_i²`: what lies in the span of the bases.
    pub inside: f64,
    /// The rest.
    pub outside: f64,
    /// Parts of `inside`, by ascending frequency.
    pub bands: Vec<Band>,
}

/// The energy of consecutive modes.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[non_exhaustive]
pub struct Band {
    /// First mode.
    pub first: usize,
    /// Last mode.
    pub last: usize,
    /// `Σ f̃_i²` over them.
    pub energy: f64,
    /// Its share of the function's whole energy; 0 for a function that is zero.
    pub share: f64,
}

impl Energy {
    /// In `bands` bands of about as many modes each, fewer when there are fewer modes.
    #[must_use]
    pub fn of(function: &Transformed, bands: usize) -> Self {
        let squares: Vec<f64> = function.coefficients.iter().map(|c| c * c).collect();
        let k = squares.len();
        let bands = bands.clamp(1, k.max(1));
        let edges: Vec<usize> = (0..=bands).map(|band| band * k / bands).collect();
        let inside: f64 = squares.iter().sum();
        let band = |edges: &[usize]| {
            let energy: f64 = squares[edges[0]..edges[1]].iter().sum();
            let share = if function.energy > 0.0 { energy / function.energy } else { 0.0 };
            Band { first: edges[0], last: edges[1] - 1, energy, share }
        };
        let bands = if k == 0 { Vec::new() } else { edges.windows(2).map(band).collect() };
        Self { total: function.energy, inside, outside: (function.energy - inside).max(0.0), bands }
    }
}
