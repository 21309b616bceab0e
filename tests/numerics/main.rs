//! The operators and their spectra against closed forms, oracles and their own invariances.
#![allow(clippy::unwrap_used)] // a test that cannot go on has failed
#![allow(clippy::float_cmp)] // where numbers must be the same to the last bit
#![allow(clippy::needless_range_loop)] // matrices are written by their indices

mod certificates;
mod closed_forms;
mod folds;
mod harmonics;
mod invariances;
mod operators;
mod prolonged;
mod robustness;
mod sampling;
mod scans;

use chladni::analysis::{Analysis, JobKind, Parameters, analyze};
use chladni::cloud::{NonFinite, PointCloud};
use chladni::operator::OperatorKind;
use chladni::progress::Progress;

fn cloud(dimension: usize, coordinates: Vec<f64>) -> PointCloud {
    PointCloud::new(dimension, coordinates, NonFinite::Drop).unwrap()
}

fn parameters(operator: OperatorKind, bases: usize) -> Parameters {
    Parameters { operator, bases, ..Parameters::default() }
}

fn eigen(cloud: &PointCloud, parameters: &Parameters) -> Analysis {
    analyze(cloud, JobKind::Eigen, parameters, &Progress::new()).unwrap()
}

/// λ of all pairs; every one must carry information.
fn eigenvalues(analysis: &Analysis) -> Vec<f64> {
    analysis.report.spectrum.as_ref().unwrap().eigenvalues.iter().map(|lambda| lambda.unwrap()).collect()
}

/// Largest relative deviation of the first non-zero eigenvalues, as many as there are in `exact`.
fn worst_error(found: &[f64], exact: &[f64]) -> f64 {
    assert!(found.len() > exact.len());
    found[1..].iter().zip(exact).map(|(found, exact)| (found / exact - 1.0).abs()).fold(0.0, f64::max)
}

/// The Fibonacci lattice on the unit sphere.
fn fibonacci_sphere(n: usize) -> Vec<f64> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..n)
        .flat_map(|i| {
            let z = 1.0 - (2 * i + 1) as f64 / n as f64;
            let (radius, angle) = ((1.0 - z * z).sqrt(), golden * i as f64);
            [radius * angle.cos(), radius * angle.sin(), z]
        })
        .collect()
}

/// A number in [0, 1) from a hash, so that tests repeat.
fn hashed(seed: u64) -> f64 {
    let mut z = seed.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}
