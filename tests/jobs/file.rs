//! A database in a file of a folder of its own.

use chladni::store::DatabaseAddress;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, SqliteConnection};
use tempfile::TempDir;

/// Where a stage has its database.
pub(crate) struct Place(TempDir);

impl Place {
    pub(crate) fn new() -> Self {
        Self::within(tempfile::tempdir().unwrap())
    }

    pub(crate) fn within(folder: TempDir) -> Self {
        Self(folder)
    }

    pub(crate) fn path(&self) -> std::path::PathBuf {
        self.0.path().join("stage.db")
    }

    pub(crate) fn address(&self) -> DatabaseAddress {
        self.path().into()
    }

    pub(crate) async fn file(&self) -> SqliteConnection {
        SqliteConnectOptions::new().filename(self.path()).foreign_keys(true).connect().await.unwrap()
    }

    pub(crate) async fn tamper(&self, statement: String) -> Result<u64, sqlx::Error> {
        let done = sqlx::query(sqlx::AssertSqlSafe(statement)).execute(&mut self.file().await).await?;
        Ok(done.rows_affected())
    }

    pub(crate) async fn number(&self, query: &'static str) -> i64 {
        sqlx::query_scalar(query).fetch_one(&mut self.file().await).await.unwrap()
    }

    pub(crate) async fn assert_sound(&self) {
        let mut file = self.file().await;
        let verdict: Vec<String> =
            sqlx::query_scalar("PRAGMA integrity_check").fetch_all(&mut file).await.unwrap();
        assert_eq!(verdict, ["ok"]);
        let dangling = sqlx::query("PRAGMA foreign_key_check").fetch_all(&mut file).await.unwrap();
        assert_eq!(dangling.len(), 0);
    }

    /// Whoever writes waits until what this gives is dropped.
    pub(crate) async fn block_writes(&self) -> SqliteConnection {
        let mut file = self.file().await;
        sqlx::query("BEGIN IMMEDIATE").execute(&mut file).await.unwrap();
        file
    }

    /// Makes every insertion of a basis fail.
    pub(crate) async fn refuse_bases(&self) {
        let trigger = "CREATE TRIGGER full BEFORE INSERT ON bases BEGIN SELECT RAISE(ABORT, 'full'); END";
        self.tamper(trigger.to_owned()).await.unwrap();
    }

    pub(crate) async fn accept_bases(&self) {
        self.tamper("DROP TRIGGER full".to_owned()).await.unwrap();
    }
}

/// One process has the file to itself: whoever held a claim before its start is dead.
pub(crate) const SHARES: bool = false;
