//! From the results of an analysis to rows of the store.

use std::sync::Arc;

use super::analyses::Results;
use super::attempt_error::AttemptError;
use super::compute::Compute;
use super::own_coefficients::own_coefficients;

use crate::analysis::{AnalysisError, JobKind};
use crate::cloud::PointCloud;
use crate::progress::Progress;
use crate::store::{ArrayName, BasisValues, Claim, Numbers, Store};

/// Bases of one transaction, in bytes. Commits wait for the disk, and every other writer waits for the transaction.
/// Sixteen mebibytes: about 50 ms of writing for one wait.
const BATCH_BYTES: usize = 16 << 20;

/// Stores all arrays of a result under its claim.
pub(super) async fn store_arrays(
    store: &Store,
    compute: &Compute,
    claim: &Claim,
    cloud: &Arc<PointCloud>,
    results: &Arc<dyn Results>,
    progress: &Arc<Progress>,
) -> Result<(), AttemptError> {
    store.begin_result(claim).await?;
    let computed = Arc::clone(results);
    let mass = compute.run(move || computed.mass()).await?;
    store.put_array(claim, ArrayName::Mass, Numbers::F64(mass)).await?;
    if claim.job.kind == JobKind::Operator {
        let computed = Arc::clone(results);
        let matrix = compute.run(move || computed.matrix()).await?;
        let matrix = matrix.ok_or(AttemptError::Inconsistent("an operator job without a matrix"))?;
        store.put_array(claim, ArrayName::Offsets, Numbers::U64(matrix.offsets)).await?;
        store.put_array(claim, ArrayName::Columns, Numbers::U32(matrix.columns)).await?;
        store.put_array(claim, ArrayName::Values, Numbers::F64(matrix.values)).await?;
    }
    let batch = (BATCH_BYTES / (8 * claim.job.points.max(1) as usize)).max(1);
    for first in (0..results.bases()).step_by(batch) {
        let computed = Arc::clone(results);
        let end = results.bases().min(first + batch);
        let basis = move |index| BasisValues { index, values: computed.basis(index) };
        let bases = compute.run(move || (first..end).map(basis).collect()).await?;
        store.put_bases(claim, bases).await?;
    }
    if results.bases() > 0 {
        let (cloud, computed) = (Arc::clone(cloud), Arc::clone(results));
        let (chunk_points, progress) = (claim.job.chunk_points, Arc::clone(progress));
        let own = move || own_coefficients(&cloud, &*computed, chunk_points, &progress);
        let own = compute.run(own).await?.map_err(AnalysisError::from)?;
        store.put_coefficients(claim, own).await?;
    }
    Ok(())
}
