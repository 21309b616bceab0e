//! The owner of a cloud or job.

use std::sync::Arc;

use super::{Store, StoreError, detached, postgres};

/// An owner: a name, or nobody on a service without keys. Nobody is an owner like any other:
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
    /// Whoever has clouds or jobs, in the order of their names.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn owners(&self) -> Result<Vec<Owner>, StoreError> {
        let mut reader = self.reader().await?;
        let names = reader.query("SELECT owner FROM clouds UNION SELECT owner FROM jobs ORDER BY owner");
        let names: Vec<String> = names.scalars().await?;
        Ok(names.iter().map(|name| Owner::named(name)).collect())
    }

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
            if let Some(connection) = transaction.postgres() {
                postgres::keep_others_out(connection).await?;
            }
            let mut changed = 0;
            for statement in ADOPTION {
                changed += transaction.query(statement).bind(from.name()).bind(to.name()).execute().await?;
            }
            for (sqlite, postgres) in TIDYING {
                transaction
                    .query_either(sqlite, postgres)
                    .bind(from.name())
                    .bind(to.name())
                    .execute()
                    .await?;
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

/// What changes hands: `$1` is the old owner, `$2` the new one.
const ADOPTION: [&str; 2] = [
    "UPDATE jobs SET owner = $2 WHERE owner = $1",
    "UPDATE clouds SET owner = $2 \
     WHERE owner = $1 AND digest NOT IN (SELECT digest FROM clouds WHERE owner = $2)",
];

/// What is left of the old owner's then, in the words of SQLite and of PostgreSQL, which cannot ignore a row that would be
/// there twice and is asked before.
const TIDYING: [(&str, &str); 4] = [
    (
        "UPDATE OR IGNORE jobs SET cloud_id = (\
             SELECT own.id FROM clouds own JOIN clouds old ON old.digest = own.digest \
             WHERE own.owner = $2 AND old.id = jobs.cloud_id) \
         WHERE state <> 'running' AND cloud_id IN (SELECT id FROM clouds WHERE owner = $1)",
        "UPDATE jobs j SET cloud_id = own.id FROM clouds own JOIN clouds old ON old.digest = own.digest \
         WHERE own.owner = $2 AND old.owner = $1 AND old.id = j.cloud_id AND j.state <> 'running' \
         AND NOT EXISTS (SELECT 1 FROM jobs o WHERE o.cloud_id = own.id AND o.kind = j.kind \
             AND o.parameters = j.parameters AND o.state IN ('queued', 'running', 'succeeded') \
             AND o.cancel_requested = 0 AND j.state IN ('queued', 'succeeded') AND j.cancel_requested = 0)",
    ),
    (
        "UPDATE OR IGNORE idempotency_keys SET owner = $2 WHERE owner = $1",
        "UPDATE idempotency_keys k SET owner = $2 WHERE owner = $1 \
         AND NOT EXISTS (SELECT 1 FROM idempotency_keys o WHERE o.owner = $2 AND o.name = k.name)",
    ),
    ("DELETE FROM turns WHERE owner = $1 AND $2 <> $1", "DELETE FROM turns WHERE owner = $1 AND $2 <> $1"),
    (
        "DELETE FROM clouds WHERE owner = $1 AND $2 <> $1 AND id NOT IN (SELECT cloud_id FROM jobs)",
        "DELETE FROM clouds WHERE owner = $1 AND $2 <> $1 AND id NOT IN (SELECT cloud_id FROM jobs)",
    ),
];
