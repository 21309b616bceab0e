//! What the tables measure: Δf against the truth, and bases.

use chladni::analysis::{Analysis, JobKind, Parameters, analyze};
use chladni::cloud::PointCloud;
use chladni::operator::OperatorKind;
use chladni::progress::Progress;

use crate::cli::Failure;

/// A function of a point.
pub(super) type Function = fn(&[f64]) -> f64;

/// A function with its Laplacian.
pub(super) struct Known {
    pub(super) name: &'static str,
    pub(super) f: Function,
    pub(super) laplacian: Function,
}

/// An operator exactly as the papers define it.
pub(super) fn as_in_paper(operator: OperatorKind) -> Parameters {
    Parameters { operator, paper: true, ..Parameters::default() }
}

/// Builds the operator.
pub(super) fn operator(cloud: &PointCloud, parameters: &Parameters) -> Result<Analysis, Failure> {
    analyze(cloud, JobKind::Operator, parameters, &Progress::new()).map_err(Failure::other)
}

/// Builds the operator and its first bases.
pub(super) fn bases(cloud: &PointCloud, parameters: &Parameters) -> Result<Analysis, Failure> {
    analyze(cloud, JobKind::Eigen, parameters, &Progress::new()).map_err(Failure::other)
}

/// μ, with λ where the operator is corrected.
pub(super) fn eigenvalues(analysis: &Analysis) -> Vec<f64> {
    let spectrum = analysis.report.spectrum.as_ref();
    spectrum.map_or_else(Vec::new, |spectrum| {
        spectrum.eigenvalues.iter().map(|lambda| lambda.unwrap_or(f64::NAN)).collect()
    })
}

/// Values of a function at all points.
pub(super) fn sampled(cloud: &PointCloud, f: Function) -> Vec<f64> {
    (0..cloud.len()).map(|i| f(cloud.point(i))).collect()
}

/// Δf by the operator at all points.
pub(super) fn laplacian(analysis: &Analysis, cloud: &PointCloud, f: Function) -> Vec<f64> {
    analysis.laplacian_of(&sampled(cloud, f)).unwrap_or_default()
}

/// E2 and E∞ of found values.
#[derive(Debug, Clone, Copy)]
pub(super) struct Errors {
    pub(super) l2: f64,
    pub(super) max: f64,
}

/// Normalized errors of `found` against `truth`; rows without a result are left out.
pub(super) fn errors(truth: &[f64], found: &[f64]) -> Errors {
    let (mut difference, mut size, mut worst, mut largest) = (0.0, 0.0, 0.0_f64, 0.0_f64);
    for (u, v) in truth.iter().zip(found).filter(|(_, v)| v.is_finite()) {
        difference += (u - v) * (u - v);
        size += u * u;
        worst = worst.max((u - v).abs());
        largest = largest.max(u.abs());
    }
    Errors { l2: (difference / size).sqrt(), max: worst / largest }
}

/// Errors of Δf for each function.
pub(super) fn errors_of(analysis: &Analysis, cloud: &PointCloud, functions: &[Known]) -> Vec<Errors> {
    functions
        .iter()
        .map(|known| errors(&sampled(cloud, known.laplacian), &laplacian(analysis, cloud, known.f)))
        .collect()
}

/// The value below which a share `q` of the values lies.
pub(super) fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * q).round() as usize]
}

/// The parameters of all tables of [PBMHB]: t = ε² and δ = 5√(2t); for `pcd`, whose simplices count within δ/2, and
/// for the graphs δ = 10ε or what comes next to it. The paper asks for δ ≥ 10ε, and its graph's first eigenvalues are
/// those of that δ.
pub(super) fn point_based_parameters(kind: OperatorKind) -> Parameters {
    let usual = as_in_paper(kind);
    if kind.is_combinatorial() {
        Parameters { delta_factor: Some(10.0), ..usual }
    } else {
        Parameters { t_factor: Some(1.0), delta_factor: kind.is_pcd().then_some(10.0), ..usual }
    }
}
