//! The cluster of all tests, and a database of it for each.

use std::io::Write;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use chladni::store::{DatabaseAddress, Store, StoreSettings};
use sqlx::{Connection, PgConnection};

use crate::cluster::Cluster;

const TEMPLATE: &str = "template_chladni";

/// What the tests say to damage a database in SQLite's words.
const WORDS_OF_SQLITE: &str = r"
CREATE DOMAIN blob AS bytea;;
CREATE FUNCTION zeroblob(length int) RETURNS bytea LANGUAGE sql AS $$ SELECT decode(repeat('00', length), 'hex') $$;;
CREATE FUNCTION randomblob(length int) RETURNS uuid LANGUAGE sql AS $$ SELECT gen_random_uuid() $$;;
CREATE FUNCTION json_set(document text, path text, value numeric) RETURNS text LANGUAGE sql AS $$
    SELECT jsonb_set(document::jsonb, string_to_array(regexp_replace(substr(path, 3), '\[(\d+)\]', '.\1', 'g'), '.'),
        to_jsonb(value))::text $$;;
CREATE FUNCTION smaller(uuid, uuid) RETURNS uuid LANGUAGE sql STRICT AS $$ SELECT least($1, $2) $$;;
CREATE AGGREGATE min(uuid) (SFUNC = smaller, STYPE = uuid)";

/// The cluster. Where there can be none, the process ends here, and says so: nothing of it is tested.
pub(crate) fn cluster() -> &'static Cluster {
    static CLUSTER: OnceLock<Cluster> = OnceLock::new();
    CLUSTER.get_or_init(|| {
        let cluster = Cluster::start().unwrap_or_else(|why| {
            // Not by a macro, whose output the test harness holds back.
            let _ = writeln!(std::io::stderr(), "SKIPPED: the tests on PostgreSQL, for {why}");
            std::process::exit(0);
        });
        cluster.sql("postgres", &format!("CREATE DATABASE {TEMPLATE}"));
        let address: DatabaseAddress = cluster.address(TEMPLATE).parse().unwrap();
        let migrating = std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
            runtime.block_on(async {
                Store::open_at(&address, StoreSettings::default()).await.unwrap().close().await;
            });
        });
        migrating.join().unwrap();
        cluster.sql(TEMPLATE, WORDS_OF_SQLITE);
        cluster.sql(TEMPLATE, "DELETE FROM nodes");
        cluster
    })
}

/// A database of its own.
pub(crate) struct Place(String);

impl Place {
    pub(crate) fn new() -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let name = format!("stage_{}", NEXT.fetch_add(1, Ordering::SeqCst));
        cluster().sql("postgres", &format!("CREATE DATABASE {name} TEMPLATE {TEMPLATE}"));
        Self(name)
    }

    pub(crate) fn address(&self) -> DatabaseAddress {
        self.text().parse().unwrap()
    }

    pub(crate) fn text(&self) -> String {
        cluster().address(&self.0)
    }

    async fn connection(&self) -> PgConnection {
        PgConnection::connect(&self.text()).await.unwrap()
    }

    pub(crate) async fn tamper(&self, statement: String) -> Result<u64, sqlx::Error> {
        let done = sqlx::query(sqlx::AssertSqlSafe(statement)).execute(&mut self.connection().await).await?;
        Ok(done.rows_affected())
    }

    pub(crate) async fn number(&self, query: &'static str) -> i64 {
        sqlx::query_scalar(query).fetch_one(&mut self.connection().await).await.unwrap()
    }

    /// Foreign keys and checks hold by themselves; that indexes fit their tables, an extension of the server's tells.
    pub(crate) async fn assert_sound(&self) {
        let mut connection = self.connection().await;
        for statement in [
            "CREATE EXTENSION IF NOT EXISTS amcheck",
            "SELECT bt_index_check(c.oid, true) FROM pg_class c JOIN pg_index i ON i.indexrelid = c.oid \
             JOIN pg_namespace n ON n.oid = c.relnamespace WHERE n.nspname = 'public' AND c.relkind = 'i'",
        ] {
            sqlx::raw_sql(statement).execute(&mut connection).await.unwrap();
        }
    }

    /// Whoever writes to a job waits until what this gives is dropped.
    pub(crate) async fn block_writes(&self) -> PgConnection {
        let mut connection = self.connection().await;
        sqlx::raw_sql("BEGIN; LOCK TABLE jobs IN SHARE ROW EXCLUSIVE MODE")
            .execute(&mut connection)
            .await
            .unwrap();
        connection
    }

    /// Makes every insertion of a basis fail.
    pub(crate) async fn refuse_bases(&self) {
        for statement in [
            "CREATE FUNCTION refuse() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN RAISE 'full'; END $$",
            "CREATE TRIGGER full_disk BEFORE INSERT ON bases FOR EACH ROW EXECUTE FUNCTION refuse()",
        ] {
            self.tamper(statement.to_owned()).await.unwrap();
        }
    }

    pub(crate) async fn accept_bases(&self) {
        self.tamper("DROP TRIGGER full_disk ON bases".to_owned()).await.unwrap();
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        cluster().sql("postgres", &format!("DROP DATABASE {} WITH (FORCE)", self.0));
    }
}

/// Nodes that share a database wait for the leases of the dead.
pub(crate) const SHARES: bool = true;
