//! What part of its time each phase of an analysis takes: a model by points, bases and the width of the operator.

use super::admission::dense_max;
use super::{JobKind, Parameters};
use crate::progress::Durations;

/// Microseconds per point of the phases of an operator: assembly, order and factor, the eigensolver's first factor, each of its
/// bases, each base's certificate. From whole jobs of 90,000 to 1,000,000 points on two cores; only their ratios count.
struct Costs {
    assembly: f64,
    factorization: f64,
    eigensolver: f64,
    base: f64,
    certificate: f64,
}

/// Operators that couple the corners of a triangle.
const NARROW: Costs =
    Costs { assembly: 0.6, factorization: 0.9, eigensolver: 3.0, base: 0.17, certificate: 0.04 };
/// Operators that couple what lies within a radius.
const WIDE: Costs =
    Costs { assembly: 5.3, factorization: 1.7, eigensolver: 10.0, base: 0.28, certificate: 0.05 };

/// Microseconds per point of preparation, neighborhoods and cells.
const GEOMETRY: [f64; 3] = [0.3, 1.4, 1.6];
/// Bases from which on each costs twice as much: what is orthogonalized grows with them.
const BASES_DOUBLED: f64 = 1500.0;
/// Microseconds of a dense eigenproblem, over the cube of the points.
const DENSE: f64 = 1e-2;

/// The expected times of an analysis, in microseconds per point.
pub(super) fn expected(kind: JobKind, parameters: &Parameters, points: usize) -> Durations {
    let costs = if parameters.operator.is_heat_kernel() { WIDE } else { NARROW };
    let [preparation, neighborhoods, cells] = GEOMETRY;
    let geometry = |solving: [f64; 3]| {
        [preparation, neighborhoods, cells, costs.assembly, solving[0], solving[1], solving[2]]
    };
    if kind == JobKind::Operator {
        return geometry([0.0; 3]);
    }
    let bases = parameters.bases as f64;
    if points <= dense_max(parameters) {
        return geometry([0.0, DENSE * (points as f64).powi(2), costs.certificate * bases]);
    }
    let eigenpairs = costs.eigensolver + costs.base * bases * (1.0 + bases / BASES_DOUBLED);
    geometry([costs.factorization, eigenpairs, costs.certificate * bases])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::{Phase, Progress};

    #[test]
    fn the_share_of_the_eigenpairs_grows_with_the_bases_and_an_operator_has_none() {
        let share = |kind, bases| {
            let progress = Progress::new();
            let parameters = Parameters { bases, ..Parameters::default() };
            progress.expect(expected(kind, &parameters, 100_000));
            let span = progress.span(Phase::Eigenpairs);
            span.end - span.start
        };
        let shares: Vec<f64> = [10, 100, 1000].map(|bases| share(JobKind::Eigen, bases)).into();
        assert!(shares.is_sorted() && shares[0] > 0.3 && shares[2] > 0.85, "{shares:?}");
        assert!(share(JobKind::Operator, 100) < 1e-12);
    }
}
