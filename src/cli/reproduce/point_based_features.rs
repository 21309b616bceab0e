//! [PBMHB Fig. 10]: feature points on a regular and an irregular sampling of the same shape.

use chladni::analysis::Parameters;
use chladni::cloud::PointCloud;
use chladni::cloud::shapes::{Sampling, Shape};
use chladni::harmonics::features::{Feature, PERSISTENCE_MIN, RADIUS_IN_EPSILON, extrema, features};
use chladni::harmonics::{Modes, Neighborhoods};
use chladni::operator::OperatorKind::{self, Graph, PbMhb};

use super::Extent;
use super::measure::bases;
use super::samples;
use super::table::{Bound, Table};
use crate::cli::Failure;

/// Share of feature points that a second sampling must show again.
const FOUND_AGAIN: f64 = 0.6;

/// Feature points of the two-hole torus.
pub(super) fn figure_10(_: Extent) -> Result<Table, Failure> {
    const MODES: usize = 15;
    let [regular, irregular] = [Sampling::Uniform, Sampling::NonUniform]
        .map(|sampling| samples::shape(Shape::TwoHoleTorus, 5_000, sampling));
    let mut table =
        compare("PBMHB Figure 10: feature points of the two-hole torus", &regular?, &irregular?, MODES)?;
    table.remark("The scan of Figure 11 is not published; the tests do the same with one that is.");
    Ok(table)
}

fn compare(title: &str, one: &PointCloud, other: &PointCloud, modes: usize) -> Result<Table, Failure> {
    let mut table = Table::new(
        title,
        format!(
            "{} points regular, {} irregular, {modes} modes, parameters at their defaults. The share of the feature points of \
             both that have a counterpart in the other within twice the coarser ε. The paper shows pictures.",
            one.len(),
            other.len()
        ),
    );
    let (ours, graph) =
        (share_matched([one, other], PbMhb, modes)?, share_matched([one, other], Graph, modes)?);
    table.row("`pb-mhb`: found again", None, ours, Bound::AtLeast(FOUND_AGAIN));
    table.row("`graph`: found again", None, graph, Bound::Shown);
    Ok(table)
}

fn share_matched(clouds: [&PointCloud; 2], operator: OperatorKind, modes: usize) -> Result<f64, Failure> {
    let [one, other] = clouds.map(|cloud| features_of(cloud, operator, modes));
    let ((one, epsilon), (other, coarser)) = (one?, other?);
    let reach = 2.0 * epsilon.max(coarser);
    let is_near = |p: &Feature, q: &Feature| {
        let squared: f64 = p.position.iter().zip(&q.position).map(|(a, b)| (a - b) * (a - b)).sum();
        squared.sqrt() <= reach
    };
    let matched =
        |from: &[Feature], to: &[Feature]| from.iter().filter(|p| to.iter().any(|q| is_near(p, q))).count();
    Ok((matched(&one, &other) + matched(&other, &one)) as f64 / (one.len() + other.len()) as f64)
}

/// Feature points of a cloud, and its covering radius.
fn features_of(
    cloud: &PointCloud,
    operator: OperatorKind,
    modes: usize,
) -> Result<(Vec<Feature>, f64), Failure> {
    let analysis = bases(cloud, &Parameters { operator, bases: modes, ..Parameters::default() })?;
    let (epsilon, mass) = (analysis.report.sampling.epsilon, analysis.mass());
    let zero_modes = analysis.report.spectrum.as_ref().map_or(0, |spectrum| Modes::of(spectrum).zero_modes());
    let neighborhoods =
        Neighborhoods::find(cloud, &mass, RADIUS_IN_EPSILON * epsilon).map_err(Failure::other)?;
    let area: f64 = mass.iter().filter(|mass| !mass.is_nan()).sum();
    let extrema: Vec<_> =
        (zero_modes..modes).map(|j| extrema(&analysis.basis(j), &neighborhoods, area)).collect();
    let places = features(&extrema, zero_modes, &neighborhoods, PERSISTENCE_MIN);
    Ok((places.iter().map(|place| place.in_cloud(&neighborhoods, cloud)).collect(), epsilon))
}
