//! Whose a cloud or job is.

use std::sync::Arc;

use super::{Store, StoreError, detached};

/// Whom clouds and jobs belong to: a name, or nobody where no key is asked for. Nobody is an owner like any other:
/// what was stored without a key is out of reach of every key, and the other way round.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Owner(Arc<str>);

impl Owner {
    /// The owner of what is stored where no key is asked for.
    #[must_use]
    pub fn nobody() -> Self {
        Self::named("")
    }

    /// The owner of this name.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self(name.into())
    }

    /// Its name; empty for nobody.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0
    }
}

impl Store {
    /// Gives everything of one owner to another, in one transaction, and tells how many clouds and jobs that were.
    ///
    /// Of content that both have, the jobs go to the cloud of the new owner. A job stays with its old cloud where the new
    /// owner's has the same one, and while it runs; it is the new owner's all the same.
    ///
    /// # Errors
    /// [`StoreError::Database`], [`StoreError::StorageFull`].
    pub async fn adopt(&self, from: &Owner, to: &Owner) -> Result<u64, StoreError> {
        let (store, from, to) = (self.clone(), from.clone(), to.clone());
        detached(async move {
            let mut transaction = store.write().await?;
            let mut changed = 0;
            for statement in ADOPTION {
                let done = sqlx::query(statement).bind(from.name()).bind(to.name());
                changed += done.execute(&mut *transaction).await?.rows_affected();
            }
            for statement in TIDYING {
                let done = sqlx::query(statement).bind(from.name()).bind(to.name());
                done.execute(&mut *transaction).await?;
            }
            transaction.commit().await?;
            if changed > 0 {
                store.announce();
            }
            Ok(changed)
        })
        .await
    }
}

/// What changes hands: `?1` is the old owner, `?2` the new one.
const ADOPTION: [&str; 2] = [
    "UPDATE jobs SET owner = ?2 WHERE owner = ?1",
    "UPDATE clouds SET owner = ?2 \
     WHERE owner = ?1 AND digest NOT IN (SELECT digest FROM clouds WHERE owner = ?2)",
];

/// What is left of the old owner's then.
const TIDYING: [&str; 4] = [
    "UPDATE OR IGNORE jobs SET cloud_id = (\
         SELECT own.id FROM clouds own JOIN clouds old ON old.digest = own.digest \
         WHERE own.owner = ?2 AND old.id = jobs.cloud_id) \
     WHERE state <> 'running' AND cloud_id IN (SELECT id FROM clouds WHERE owner = ?1)",
    "UPDATE OR IGNORE idempotency_keys SET owner = ?2 WHERE owner = ?1",
    "DELETE FROM turns WHERE owner = ?1 AND ?2 <> ?1",
    "DELETE FROM clouds WHERE owner = ?1 AND ?2 <> ?1 AND id NOT IN (SELECT cloud_id FROM jobs)",
];
