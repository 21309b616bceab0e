//! The bases as they are used: `H = B^-½ Y`.

use rayon::prelude::*;

use super::vectors::block::Block;
use super::vectors::shelf::{Read, Shelf};
use super::{Problem, SpectrumError, Vectors};
use crate::progress::Progress;

/// Bases that are taken out of the rows of eigenvectors together: as many as lie in a cache line.
const TOGETHER: usize = 8;

/// Rows looked at by one task.
const ROWS_PER_TASK: usize = 65_536;

/// Manifold harmonics on the analyzed points.
#[derive(Debug)]
pub struct Eigenbasis {
    bases: Bases,
}

#[derive(Debug)]
enum Bases {
    /// Basis by basis: eigenvectors are stored point by point, where a basis is spread over all of the memory.
    Double(Vec<Vec<f64>>),
    /// As they were found, where there is no room for them twice, and a factor of every basis.
    Single(Shelf, Vec<f64>),
}

/// One basis.
#[derive(Debug)]
pub struct Basis<'a>(Values<'a>);

#[derive(Debug)]
enum Values<'a> {
    Double(&'a [f64]),
    /// A column of some, times a factor.
    Single(Read<'a>, usize, f64),
}

impl Basis<'_> {
    /// Its value at point `i`, in 1/length; `H_iᵀ B H_j = δ_ij`.
    #[must_use]
    #[inline]
    pub fn at(&self, i: usize) -> f64 {
        match &self.0 {
            Values::Double(basis) => basis[i],
            Values::Single(some, column, factor) => factor * f64::from(some.columns().row(i)[*column]),
        }
    }
}

impl Eigenbasis {
    /// Takes vectors with the imaginary parts of their eigenvalues, if they have any; the sign of every basis is such that its
    /// largest component is positive.
    ///
    /// # Errors
    /// [`SpectrumError::Scratch`], [`SpectrumError::Canceled`].
    pub fn new(
        problem: &Problem,
        vectors: Vectors,
        imaginary: &[f64],
        progress: &Progress,
    ) -> Result<Self, SpectrumError> {
        let bases = match vectors {
            Vectors::Double(vectors) => Bases::Double(functions(problem, &vectors, imaginary)),
            Vectors::Single(functions) => {
                let signs = signs(&functions, progress)?;
                Bases::Single(functions, signs)
            }
        };
        Ok(Self { bases })
    }

    /// Multiplies all bases by `factor`.
    pub fn scale(&mut self, factor: f64) {
        match &mut self.bases {
            Bases::Double(bases) => {
                bases.par_iter_mut().for_each(|basis| basis.iter_mut().for_each(|h| *h *= factor));
            }
            Bases::Single(_, factors) => factors.iter_mut().for_each(|f| *f *= factor),
        }
    }

    /// Number of bases.
    #[must_use]
    #[allow(clippy::len_without_is_empty)] // never empty
    pub fn len(&self) -> usize {
        match &self.bases {
            Bases::Double(bases) => bases.len(),
            Bases::Single(bases, _) => bases.columns(),
        }
    }

    /// Basis `j`.
    ///
    /// # Panics
    /// When the file that it is in cannot be read.
    #[must_use]
    #[expect(clippy::panic, reason = "documented; a disk that loses what was just written")]
    pub fn basis(&self, j: usize) -> Basis<'_> {
        Basis(match &self.bases {
            Bases::Double(bases) => Values::Double(&bases[j]),
            Bases::Single(bases, factors) => match bases.read(j, &Progress::new()) {
                Ok((some, column)) => Values::Single(some, column, factors[j]),
                Err(error) => panic!("eigenvectors cannot be read: {error}"),
            },
        })
    }
}

/// `B^-½ Y`, basis by basis.
fn functions(problem: &Problem, vectors: &Block, imaginary: &[f64]) -> Vec<Vec<f64>> {
    let inverse_root_mass: Vec<f64> = problem.root_mass.iter().map(|m| 1.0 / m).collect();
    let columns = |first: usize| {
        let mut columns: Vec<Vec<f64>> = (first..vectors.columns().min(first + TOGETHER))
            .map(|_| Vec::with_capacity(inverse_root_mass.len()))
            .collect();
        for (i, inverse) in inverse_root_mass.iter().enumerate() {
            for (column, y) in columns.iter_mut().zip(&vectors.row(i)[first..]) {
                column.push(y * inverse);
            }
        }
        columns
    };
    let firsts: Vec<usize> = (0..vectors.columns()).step_by(TOGETHER).collect();
    let mut bases: Vec<Vec<f64>> = firsts.into_par_iter().with_max_len(1).flat_map_iter(columns).collect();
    let mut negative: Vec<bool> = bases.par_iter().map(|basis| largest(basis) < 0.0).collect();
    // the two parts of a complex eigenvector turn together
    for j in 1..negative.len() {
        if imaginary.get(j).is_some_and(|b| *b < 0.0) {
            negative[j] = negative[j - 1];
        }
    }
    let wrong = bases.par_iter_mut().zip(negative).filter(|(_, negative)| *negative);
    wrong.for_each(|(basis, _)| basis.iter_mut().for_each(|h| *h = -*h));
    bases
}

/// For every function 1, or −1 where its component farthest from zero is negative.
fn signs(functions: &Shelf, progress: &Progress) -> Result<Vec<f64>, SpectrumError> {
    let stretches: Vec<usize> = (0..functions.rows()).step_by(ROWS_PER_TASK).collect();
    let mut signs = Vec::with_capacity(functions.columns());
    for group in functions.groups() {
        let (some, _) = functions.read(group.start, progress)?;
        let some = some.columns();
        let largest_of = |&first: &usize| {
            let mut largest = vec![0.0_f32; some.count()];
            for i in first..functions.rows().min(first + ROWS_PER_TASK) {
                let row = largest.iter_mut().zip(some.row(i));
                row.for_each(|(largest, &h)| *largest = farther(*largest, h));
            }
            largest
        };
        let parts: Vec<Vec<f32>> = stretches.par_iter().map(largest_of).collect();
        let largest = |j: usize| parts.iter().map(|part| part[j]).fold(0.0, farther);
        signs.extend((0..some.count()).map(|j| if largest(j) < 0.0 { -1.0 } else { 1.0 }));
    }
    Ok(signs)
}

/// The one that is farther from zero, the first of equals.
fn farther(first: f32, second: f32) -> f32 {
    if second.abs() > first.abs() { second } else { first }
}

/// The component that is farthest from zero: the first of equals, so that the sign is determined.
fn largest(basis: &[f64]) -> f64 {
    basis.iter().fold(0.0, |largest: f64, &h| if h.abs() > largest.abs() { h } else { largest })
}
