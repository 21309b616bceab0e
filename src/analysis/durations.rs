//! What part of its time each phase of an analysis takes: a model by points, bases and the width of the operator. What has been
//! done tells how fast this machine is, and so how long the rest takes.

use std::ops::Range;

use super::admission::dense_max;
use super::{JobKind, Parameters};
use crate::progress::{Durations, Phase};

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

/// Microseconds per number of a result that is stored once it is computed.
const STORING: f64 = 0.04;
/// Numbers of a row of an operator's matrix with their places, by its width.
const ROW: [f64; 2] = [12.0, 90.0];

/// Seconds until an analysis has ended and its result is stored, of one that has done `progress` of its work and spent so many
/// seconds in its phases up to `phase`. `None` when nothing is known yet, or when the last phase takes longer than was foreseen:
/// it does not say how far it is.
#[must_use]
pub fn seconds_left(
    (kind, parameters, points): (JobKind, &Parameters, usize),
    phase: Phase,
    progress: f64,
    spent: &[(Phase, f64)],
) -> Option<f64> {
    let durations = expected(kind, parameters, points);
    let sum =
        |phases: Range<Phase>| durations[phases.start as usize..phases.end as usize].iter().sum::<f64>();
    let seconds = |phases: Range<Phase>| {
        let within = spent.iter().filter(|(known, _)| phases.contains(known));
        within.map(|(_, seconds)| seconds).sum::<f64>()
    };
    let numbers = match kind {
        JobKind::Eigen => parameters.bases as f64,
        JobKind::Operator => ROW[usize::from(parameters.operator.is_heat_kernel())],
    };
    let before_last = sum(Phase::Preparation..Phase::Certificates);
    let last = durations[Phase::Certificates as usize];
    let done = (progress * (before_last + last)).min(before_last);
    let pace = seconds(Phase::Preparation..Phase::Certificates) / done;
    // How many steps the eigensolver takes is not foreseen: what follows is judged by the phases before it.
    let speed = match phase {
        Phase::Eigenpairs | Phase::Certificates => {
            seconds(Phase::Preparation..Phase::Eigenpairs) / sum(Phase::Preparation..Phase::Eigenpairs)
        }
        _ => pace,
    };
    let ahead = if phase == Phase::Certificates { 0.0 } else { pace * (before_last - done) };
    let inside =
        spent.iter().find(|(known, _)| *known == Phase::Certificates).map_or(0.0, |(_, seconds)| *seconds);
    let left = ahead + speed * (last + STORING * numbers) - inside;
    // also false where nothing was done
    (left > 0.0 && left.is_finite()).then_some(left)
}

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
    use crate::progress::Progress;

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

    /// A job that takes as long as the model says, on a machine of any speed, ends when it was told to end.
    #[test]
    fn what_is_left_is_told_rightly_of_a_job_that_the_model_describes() {
        let parameters = Parameters { bases: 100, ..Parameters::default() };
        let job = (JobKind::Eigen, &parameters, 100_000);
        let durations = expected(job.0, job.1, job.2);
        let all: f64 = durations.iter().sum();
        for speed in [0.02, 0.1, 3.0] {
            let end = speed * (all + STORING * 100.0);
            for phase in Phase::ALL {
                for share in [0.1, 0.5, 0.9] {
                    let mut spent: Vec<(Phase, f64)> =
                        Phase::ALL.map(|phase| (phase, speed * durations[phase as usize])).into();
                    spent.truncate(phase as usize + 1);
                    spent[phase as usize].1 *= share;
                    let seconds: f64 = spent.iter().map(|(_, seconds)| seconds).sum();
                    let left = seconds_left(job, phase, seconds / speed / all, &spent).unwrap();
                    assert!(
                        (left - (end - seconds)).abs() < 1e-6 * end,
                        "{phase:?} {share}: {left} {}",
                        end - seconds
                    );
                }
            }
        }
    }

    #[test]
    fn an_eigensolver_that_takes_ten_times_as_long_tells_nothing_of_what_follows() {
        let parameters = Parameters { bases: 100, ..Parameters::default() };
        let job = (JobKind::Eigen, &parameters, 100_000);
        let durations = expected(job.0, job.1, job.2);
        let all: f64 = durations.iter().sum();
        let (before, last) = (durations[..5].iter().sum::<f64>(), durations[6] + STORING * 100.0);
        let left = |share: f64| {
            let mut spent: Vec<(Phase, f64)> =
                Phase::ALL.map(|phase| (phase, durations[phase as usize])).into();
            spent.pop();
            spent[5].1 = 10.0 * share * durations[5];
            seconds_left(job, Phase::Eigenpairs, (before + share * durations[5]) / all, &spent).unwrap()
        };
        let end = 10.0 * durations[5] + last;
        for share in [0.5, 0.9, 1.0] {
            let truth = end - 10.0 * share * durations[5];
            assert!((left(share) / truth - 1.0).abs() < 0.3, "{share}: {} {truth}", left(share));
        }
    }

    #[test]
    fn the_last_phase_counts_down_by_the_clock_and_says_nothing_when_it_is_overdue() {
        let parameters = Parameters { bases: 100, ..Parameters::default() };
        let job = (JobKind::Eigen, &parameters, 100_000);
        let durations = expected(job.0, job.1, job.2);
        let left = |inside: f64| {
            let mut spent: Vec<(Phase, f64)> =
                Phase::ALL.map(|phase| (phase, durations[phase as usize])).into();
            spent[Phase::Certificates as usize].1 = inside;
            // by then the extrapolated progress is all but whole
            seconds_left(job, Phase::Certificates, 0.9999, &spent)
        };
        let due = durations[Phase::Certificates as usize] + STORING * 100.0;
        assert!(
            (left(0.0).unwrap() - due).abs() < 1e-9 && (left(0.75 * due).unwrap() - 0.25 * due).abs() < 1e-9
        );
        assert_eq!(left(1.01 * due), None);
        assert_eq!(seconds_left(job, Phase::Preparation, 0.0, &[(Phase::Preparation, 1.0)]), None);
        assert_eq!(seconds_left(job, Phase::Preparation, 0.0, &[]), None);
    }
}
