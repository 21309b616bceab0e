//! What an analysis needs of a cloud, looked at before it begins.

use serde::{Deserialize, Serialize};

use super::{AnalysisError, Parameters};
use crate::cloud::PointCloud;
use crate::geometry::frames::INTRINSIC_MAX;
use crate::geometry::{Curve, Points, Sampling, Span, Triangles};
use crate::spectrum::dense::{DENSE_POINTS_MAX, DENSE_POINTS_MAX_GENERAL};

/// What admission looks at of a cloud: enough distinct points, not in a flat of fewer dimensions than the manifold, enough
/// for the bases, faces where the operator needs them. Costs a sort of the points, so that it is kept with a stored cloud;
/// takes 16 bytes a point beside a cloud without faces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Examined {
    span: Span,
    /// Rows that repeat an earlier position.
    duplicates: usize,
    faces: usize,
    /// Whether one of the faces has an area.
    has_triangles: bool,
}

impl Examined {
    /// Looks at a cloud.
    #[must_use]
    pub fn of(cloud: &PointCloud) -> Self {
        let curve = Curve::of(cloud);
        let span = Span::of(&curve, INTRINSIC_MAX);
        let duplicates = curve.len() - span.distinct;
        let faces = cloud.faces().len();
        let is_sound = faces > 0 && span.check(2).is_ok();
        let has_triangles = is_sound && !Triangles::of(cloud, &Points::along(&curve).normalized()).is_empty();
        Self { span, duplicates, faces, has_triangles }
    }

    /// Rows that repeat an earlier position.
    #[must_use]
    pub fn duplicates(&self) -> usize {
        self.duplicates
    }

    /// Checks that the cloud can be analyzed so.
    ///
    /// # Errors
    /// [`AnalysisError`] that says what is missing.
    pub fn admit(&self, parameters: &Parameters) -> Result<(), AnalysisError> {
        parameters.check()?;
        self.span.check(parameters.dimension)?;
        parameters.check_extent(self.span.extent)?;
        check_bases(parameters, self.span.distinct)?;
        if parameters.operator.needs_faces() {
            check_faces(parameters, self.faces, self.has_triangles)?;
        }
        Ok(())
    }

    /// [`Self::admit`] where nobody named a number of bases: that of `parameters` is lowered to what the cloud's distinct
    /// points allow.
    ///
    /// # Errors
    /// As [`Self::admit`].
    pub fn admit_lowered(&self, parameters: &mut Parameters) -> Result<(), AnalysisError> {
        parameters.check()?;
        self.span.check(parameters.dimension)?;
        parameters.bases = parameters.bases.min(bases_max(parameters, self.span.distinct));
        self.admit(parameters)
    }
}

/// Cheap checks of a cloud before its analysis, those of [`Examined`].
///
/// # Errors
/// [`AnalysisError`] that says what is missing.
pub fn admit(cloud: &PointCloud, parameters: &Parameters) -> Result<(), AnalysisError> {
    parameters.check()?;
    Examined::of(cloud).admit(parameters)
}

/// The cloud's triangles, for operators that need them.
pub(super) fn triangles(
    cloud: &PointCloud,
    points: &Points,
    parameters: &Parameters,
) -> Result<Triangles, AnalysisError> {
    if !parameters.operator.needs_faces() {
        return Ok(Triangles::default());
    }
    let triangles = Triangles::of(cloud, points);
    check_faces(parameters, cloud.faces().len(), !triangles.is_empty())?;
    Ok(triangles)
}

fn check_faces(parameters: &Parameters, faces: usize, has_triangles: bool) -> Result<(), AnalysisError> {
    let name = parameters.operator.name();
    if faces == 0 {
        return Err(AnalysisError::Unsupported(format!(
            "operator `{name}` needs the faces of a mesh, and this cloud has none: upload a PLY, OBJ or OFF file with \
             faces, or choose an operator for points such as `pb-mhb` or `voronoi`"
        )));
    }
    if !has_triangles {
        return Err(AnalysisError::Unsupported(format!(
            "operator `{name}` needs the faces of a mesh, and none of this cloud's {faces} faces has an area"
        )));
    }
    Ok(())
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
            "none of the {cells} Voronoi cells could be measured: no neighborhood looks like a manifold of \
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
    /// Whether this is the most that the distinct points allow.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::NonFinite;
    use crate::operator::OperatorKind;

    fn cloud(coordinates: &[f64]) -> PointCloud {
        PointCloud::new(2, coordinates.to_vec(), NonFinite::Drop).unwrap()
    }

    #[test]
    fn what_was_looked_at_admits_and_refuses_as_the_points_do() {
        let nan = f64::NAN;
        let square =
            [0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.5, 0.5, -0.0, 0.0, 1.0, 1.0, nan, 1.0, 0.5, nan];
        let line = [0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0];
        let far = [0.0, 0.0, 1.0, f64::MAX, 0.0, -f64::MAX, 1.0, 1.0, 0.5, 0.5];
        for rows in [&square[..], &square[..8], &line, &far, &[nan; 10], &[3.0; 20]] {
            let cloud = cloud(rows);
            let examined = Examined::of(&cloud);
            for dimension in 1..=3 {
                let parameters = Parameters { dimension, bases: 5, ..Parameters::default() };
                let prepared = Points::prepare(&cloud, dimension).map(|_| ()).map_err(AnalysisError::from);
                let admitted = examined.admit(&parameters);
                assert_eq!(format!("{admitted:?}"), format!("{prepared:?}"), "{rows:?}");
            }
        }
        assert_eq!(Examined::of(&cloud(&square)).duplicates(), 2);
        assert_eq!(Examined::of(&cloud(&[f64::MAX, 0.0, -f64::MAX, 0.0, f64::MAX, 0.0])).duplicates(), 1);
        let without_faces =
            Parameters { operator: OperatorKind::Cotangent, bases: 5, ..Parameters::default() };
        assert!(matches!(
            Examined::of(&cloud(&square)).admit(&without_faces),
            Err(AnalysisError::Unsupported(_))
        ));
    }

    #[test]
    fn bases_that_nobody_named_are_lowered() {
        let rows: Vec<f64> = (0..20).flat_map(|i| [f64::from(i % 5), f64::from(i / 5)]).collect();
        let mut parameters = Parameters { bases: 50, ..Parameters::default() };
        let examined = Examined::of(&cloud(&rows));
        assert!(examined.admit(&parameters).is_err());
        examined.admit_lowered(&mut parameters).unwrap();
        assert_eq!(parameters.bases, 20);
    }
}
