//! The transform of a cloud's own coordinates and fields, made while a result is stored: everybody asks for it, and later
//! it would take all bases from the disk.

use rayon::prelude::*;

use super::analyses::Results;
use crate::cloud::PointCloud;
use crate::harmonics::filtered::Target;
use crate::harmonics::{Block, Function, Transformed, transform};
use crate::progress::{Canceled, Progress};
use crate::store::StoredCoefficients;

/// Largest batch of bases held in memory, as a count and in bytes.
const BATCH: usize = 16;
const BATCH_BYTES: usize = 128 << 20;

/// Coefficients of the coordinates and of every field without numbers that are not finite; in blocks of as many rows as the
/// bases are stored in, and so with the same bits as those that are computed from stored bases.
///
/// # Errors
/// [`Canceled`].
pub(super) fn own_coefficients(
    cloud: &PointCloud,
    results: &dyn Results,
    chunk_points: usize,
    progress: &Progress,
) -> Result<Vec<StoredCoefficients>, Canceled> {
    let mass = results.mass();
    let targets = std::iter::once(Target::Coordinates)
        .chain((0..cloud.fields().len()).map(|place| Target::Fields(vec![place])));
    let functions: Vec<Function> =
        targets.filter_map(|target| target.functions(cloud, &mass).ok()).flatten().collect();
    let values: Vec<&[f64]> = functions.iter().map(|function| function.values.as_slice()).collect();
    let mut all: Vec<Transformed> = Vec::new();
    let batch = (BATCH_BYTES / (size_of::<f64>() * cloud.len())).clamp(1, BATCH);
    for first in (0..results.bases()).step_by(batch) {
        progress.checkpoint()?;
        let end = results.bases().min(first + batch);
        let bases: Vec<Vec<f64>> = (first..end).into_par_iter().map(|j| results.basis(j)).collect();
        let starts: Vec<usize> = (0..cloud.len()).step_by(chunk_points).collect();
        let partials: Vec<_> = starts
            .into_par_iter()
            .map(|first| {
                let rows = first..cloud.len().min(first + chunk_points);
                let columns = bases.iter().map(|basis| &basis[rows.clone()]).collect();
                transform::partial(&Block { first, columns }, &mass, &values)
            })
            .collect();
        let found = transform::total(&partials);
        if all.is_empty() {
            all = found;
        } else {
            for (all, found) in all.iter_mut().zip(found) {
                all.coefficients.extend(found.coefficients);
            }
        }
    }
    let named = functions.into_iter().zip(all);
    Ok(named
        .map(|(function, Transformed { coefficients, energy })| StoredCoefficients {
            name: function.name,
            energy,
            numbers: coefficients,
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::{JobKind, Parameters, analyze};
    use crate::cloud::shapes::{SampleRequest, Shape, sample};

    #[test]
    fn fields_are_transformed_until_the_job_is_canceled() {
        let cloud = sample(&SampleRequest::new(Shape::Sphere, 200)).unwrap();
        let (parameters, progress) = (Parameters { bases: 4, ..Parameters::default() }, Progress::new());
        let results = analyze(&cloud, JobKind::Eigen, &parameters, &progress).unwrap();
        let own = |progress: &Progress| own_coefficients(&cloud, &results, 64, progress);
        assert_eq!(own(&progress).unwrap().len(), 3);
        progress.cancel();
        assert_eq!(own(&progress).err(), Some(Canceled));
    }
}
