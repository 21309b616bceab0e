//! Coefficients of a cloud's own functions in a job's bases: part of the result, for they are asked for more often than
//! anything else that takes all bases to compute.

use uuid::Uuid;

use super::arrays::{Number, checksum, read_checked};
use super::reading::finished;
use super::rows::integer;
use super::{Claim, Store, StoreError, detached};

/// A function's coefficients as they are stored.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredCoefficients {
    /// Name of the coordinate or field.
    pub name: String,
    /// `fᵀBf`.
    pub energy: f64,
    /// One coefficient per basis.
    pub numbers: Vec<f64>,
}

impl Store {
    /// Stores coefficients with a result. They are invisible until [`Store::finish`].
    ///
    /// # Errors
    /// [`StoreError::LostClaim`], [`StoreError::Database`].
    pub async fn put_coefficients(
        &self,
        claim: &Claim,
        functions: Vec<StoredCoefficients>,
    ) -> Result<(), StoreError> {
        let (store, claim) = (self.clone(), claim.clone());
        detached(async move {
            let mut transaction = store.write().await?;
            store.check_claim(&mut transaction, &claim).await?;
            for (place, function) in functions.iter().enumerate() {
                let bytes = f64::write(&function.numbers);
                sqlx::query(
                    "INSERT INTO coefficients (job_id, place, name, energy, checksum, numbers) \
                     VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
                )
                .bind(claim.job.id)
                .bind(integer(place))
                .bind(&function.name)
                .bind(function.energy)
                .bind(checksum(place, 0, &bytes).as_slice())
                .bind(bytes)
                .execute(&mut *transaction)
                .await?;
            }
            Ok(transaction.commit().await?)
        })
        .await
    }

    /// Coefficients that were stored with the result of a job that succeeded; none of jobs from before they were.
    ///
    /// # Errors
    /// [`StoreError::NoResult`], [`StoreError`].
    pub async fn coefficients(&self, job: Uuid) -> Result<Vec<StoredCoefficients>, StoreError> {
        let mut snapshot = self.read().await?;
        finished(&mut snapshot, job).await?;
        let rows: Vec<(String, f64, Vec<u8>, Vec<u8>)> = sqlx::query_as(
            "SELECT name, energy, checksum, numbers FROM coefficients WHERE job_id = ?1 ORDER BY place",
        )
        .bind(job)
        .fetch_all(&mut *snapshot)
        .await?;
        let read = |(place, (name, energy, checksum, bytes)): (usize, (String, f64, Vec<u8>, Vec<u8>))| {
            let mut numbers = Vec::new();
            read_checked((place, 0), &checksum, &bytes, &mut numbers)?;
            Ok(StoredCoefficients { name, energy, numbers })
        };
        rows.into_iter().enumerate().map(read).collect()
    }
}
