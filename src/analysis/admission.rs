//! What an analysis needs of a cloud, looked at before it begins.

use super::{AnalysisError, Parameters};
use crate::cloud::PointCloud;
use crate::geometry::{Points, Sampling, Triangles};
use crate::spectrum::dense::{DENSE_POINTS_MAX, DENSE_POINTS_MAX_GENERAL};

/// Cheap checks before a cloud is accepted: enough distinct points, not in a flat of fewer dimensions than the manifold,
/// enough for the bases, faces where the operator needs them. Costs a sort of the points. Returns the number of rows that repeat an earlier position.
///
/// # Errors
/// [`AnalysisError`] that says what is missing.
pub fn admit(cloud: &PointCloud, parameters: &Parameters) -> Result<usize, AnalysisError> {
    parameters.check()?;
    admitted(cloud, &Points::prepare(cloud, parameters.dimension)?, parameters)
}

/// [`admit`] where nobody named a number of bases: that of `parameters` is lowered to what the cloud's distinct points
/// allow.
///
/// # Errors
/// As [`admit`].
pub fn admit_lowered(cloud: &PointCloud, parameters: &mut Parameters) -> Result<usize, AnalysisError> {
    parameters.check()?;
    let points = Points::prepare(cloud, parameters.dimension)?;
    parameters.bases = parameters.bases.min(bases_max(parameters, points.len()));
    admitted(cloud, &points, parameters)
}

fn admitted(cloud: &PointCloud, points: &Points, parameters: &Parameters) -> Result<usize, AnalysisError> {
    parameters.check_extent(points.extent())?;
    check_bases(parameters, points.len())?;
    triangles(cloud, points, parameters)?;
    Ok(points.duplicates())
}

/// The cloud's triangles, for operators that need them.
pub(super) fn triangles(
    cloud: &PointCloud,
    points: &Points,
    parameters: &Parameters,
) -> Result<Triangles, AnalysisError> {
    let name = parameters.operator.name();
    if !parameters.operator.needs_faces() {
        return Ok(Triangles::default());
    }
    if cloud.faces().is_empty() {
        return Err(AnalysisError::Unsupported(format!(
            "operator `{name}` needs the faces of a mesh, and this cloud has none: upload a PLY, OBJ or OFF file with \
             faces, or choose an operator for points such as `pb-mhb` or `voronoi`"
        )));
    }
    let triangles = Triangles::of(cloud, points);
    if triangles.is_empty() {
        return Err(AnalysisError::Unsupported(format!(
            "operator `{name}` needs the faces of a mesh, and none of this cloud's {} faces has an area",
            cloud.faces().len()
        )));
    }
    Ok(triangles)
}

/// Larger clouds have at most one base per this number of points.
const BASES_SHARE: usize = 5;

/// Points up to which an operator is solved densely, for all bases.
pub(super) fn dense_max(parameters: &Parameters) -> usize {
    if parameters.operator.is_pcd() { DENSE_POINTS_MAX_GENERAL } else { DENSE_POINTS_MAX }
}

/// The most bases that this number of distinct points allows.
fn bases_max(parameters: &Parameters, points: usize) -> usize {
    if points > dense_max(parameters) { points / BASES_SHARE } else { points }
}

fn check_bases(parameters: &Parameters, points: usize) -> Result<(), AnalysisError> {
    let bases = parameters.bases;
    let refuse = |reason| Err(AnalysisError::Parameter { name: "bases", reason });
    if bases > points {
        return refuse(format!(
            "requested {bases} bases, but {points} distinct points allow at most {points}"
        ));
    }
    let dense_max = dense_max(parameters);
    if bases > bases_max(parameters, points) {
        return refuse(format!(
            "requested {bases} bases of {points} points; above {dense_max} points at most a fifth as many, {}, can be computed",
            points / BASES_SHARE
        ));
    }
    Ok(())
}

/// Refuses a surface of which nothing was measured: its operator would be that of a graph, with made-up areas.
pub(super) fn check_cells(
    parameters: &Parameters,
    sampling: &Sampling,
    cells: usize,
) -> Result<(), AnalysisError> {
    let needs_cells = !parameters.operator.is_combinatorial() && !parameters.operator.needs_faces();
    if needs_cells && sampling.invalid_cells == cells {
        return Err(AnalysisError::Cloud(format!(
            "none of the {cells} Voronoi cells could be measured: around no point do the others lie as on a manifold of \
             dimension {}",
            parameters.dimension
        )));
    }
    Ok(())
}

/// How many bases are computed, and of how many points.
pub(super) struct Bases {
    pub(super) computed: usize,
    asked: usize,
    /// Whether more are not to be had of the distinct points.
    is_most: bool,
    /// Distinct points, by which the number was admitted.
    points: usize,
    /// Those that have a result.
    active: usize,
}

impl Bases {
    /// Points without a result count at admission and not here, so that there may be fewer than were asked for.
    pub(super) fn of(parameters: &Parameters, points: usize, active: usize) -> Self {
        let asked = parameters.bases;
        let is_most = asked == bases_max(parameters, points);
        Self { computed: asked.min(bases_max(parameters, active)), asked, is_most, points, active }
    }

    /// Says why there are fewer than were asked for, or than the default.
    pub(super) fn warning(&self) -> Option<String> {
        let &Self { computed, asked, is_most, points, active } = self;
        if computed < asked {
            return Some(format!(
                "{computed} bases were computed in place of {asked}: of {points} distinct points {active} have a result"
            ));
        }
        let default = Parameters::default().bases;
        (is_most && asked < default).then(|| {
            format!("{asked} bases were computed, the most that {points} distinct points allow; the default is {default}")
        })
    }
}
