//! Coefficients of a cloud's own functions in a job's bases: part of the result, for they are asked for more often than
//! anything else that takes all bases to compute.

use uuid::Uuid;

use super::arrays::{Checksum, Number, checksum, read_checked, text_checksum};
use super::connection::Row;
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
                let name = transaction.text(&function.name).into_owned();
                let head = head_checksum(&name, function.energy);
                transaction.query(
                    "INSERT INTO coefficients (job_id, place, name, energy, checksum, numbers, head_checksum) \
                     VALUES ($1, $2, $3, $4, $5, $6, $7)",
                )
                .bind(claim.job.id)
                .bind(integer(place))
                .bind(name)
                .bind(function.energy)
                .bind(checksum(place, 0, &bytes).as_slice())
                .bind(bytes)
                .bind(head.as_slice())
                .execute()
                .await?;
            }
            transaction.commit().await
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
        let rows = snapshot.query(
            "SELECT name, energy, checksum, numbers, head_checksum FROM coefficients WHERE job_id = $1 ORDER BY place",
        )
        .bind(job)
        .fetch_all()
        .await?;
        rows.iter().enumerate().map(|(place, row)| stored_coefficients(place, row)).collect()
    }
}

fn stored_coefficients(place: usize, row: &Row) -> Result<StoredCoefficients, StoreError> {
    let mut numbers = Vec::new();
    read_checked((place, 0), row.try_get("checksum")?, row.try_get("numbers")?, &mut numbers)?;
    let (name, energy): (String, f64) = (row.try_get("name")?, row.try_get("energy")?);
    let head: Option<&[u8]> = row.try_get("head_checksum")?;
    if head.is_some_and(|head| head != head_checksum(&name, energy).as_slice()) {
        return Err(StoreError::Damaged(format!(
            "name or energy of function {place} does not match its checksum"
        )));
    }
    Ok(StoredCoefficients { name, energy, numbers })
}

fn head_checksum(name: &str, energy: f64) -> Checksum {
    text_checksum(&[name, &energy.to_bits().to_string()])
}
