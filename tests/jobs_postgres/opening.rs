//! A database that cannot be used ends the start with one line that says what to do, and never with a password in it.

use std::time::Duration;

use chladni::store::{DatabaseAddress, Owner, Store, StoreSettings};

use crate::shared::{Place, cluster};
use crate::stage::cloud;

/// Why the database at this address is refused.
async fn refusal(address: &str) -> String {
    let address: DatabaseAddress = address.parse().unwrap();
    let refused =
        tokio::time::timeout(Duration::from_secs(30), Store::open_at(&address, StoreSettings::default()));
    let why = refused.await.expect("it waits").expect_err("it opens").to_string();
    assert!(!why.contains('\n'), "more than one line: {why}");
    why
}

#[tokio::test]
async fn a_wrong_password_is_told_without_it() {
    let place = Place::new();
    cluster().sql(
        "postgres",
        "DO $$ BEGIN CREATE ROLE guarded LOGIN PASSWORD 'right'; EXCEPTION WHEN duplicate_object THEN END $$",
    );
    let address = place.text().replace("user=postgres", "user=guarded&password=s3cret");
    let why = refusal(&address).await;
    assert!(why.contains("refuses user guarded") && why.contains("password"), "{why}");
    assert!(!why.contains("s3cret"), "{why}");
}

#[tokio::test]
async fn a_host_that_cannot_be_reached_is_named() {
    let why = refusal("postgres://kim:s3cret@127.0.0.1:1/chladni").await;
    assert!(why.contains("127.0.0.1:1 cannot be reached") && !why.contains("s3cret"), "{why}");
    let why = refusal("postgres://kim:s3cret@host:port/chladni").await;
    assert!(why.contains("not an address such as") && !why.contains("s3cret"), "{why}");
    let why = refusal("postgresql:///chladni?host=/no/such/folder").await;
    assert!(why.contains("/no/such/folder cannot be reached"), "{why}");
}

#[tokio::test]
async fn a_database_that_is_not_there_is_told_how_to_make() {
    let why = refusal(&cluster().address("nowhere")).await;
    assert!(why.contains("createdb --owner postgres nowhere"), "{why}");
}

#[tokio::test]
async fn a_user_who_may_not_make_tables_is_told_how_to_be_allowed() {
    cluster().sql(
        "postgres",
        "DO $$ BEGIN CREATE ROLE visitor LOGIN; EXCEPTION WHEN duplicate_object THEN END $$;;\
         CREATE DATABASE not_the_visitors",
    );
    let why = refusal(&cluster().address_as("visitor", "not_the_visitors")).await;
    assert!(why.contains("ALTER DATABASE not_the_visitors OWNER TO visitor"), "{why}");
    // Nor one who finds tables that are another's.
    let place = Place::new();
    let why = refusal(&place.text().replace("user=postgres", "user=visitor")).await;
    assert!(why.contains("OWNER TO visitor"), "{why}");
    cluster().sql("postgres", "DROP DATABASE not_the_visitors");
}

#[tokio::test]
async fn a_schema_newer_than_the_program_is_refused_and_so_is_another_builds() {
    let place = Place::new();
    let newer = "INSERT INTO _sqlx_migrations SELECT 9999, description, installed_on, success, checksum, execution_time \
                 FROM _sqlx_migrations LIMIT 1";
    place.tamper(newer.to_owned()).await.unwrap();
    let why = refusal(&place.text()).await;
    assert!(why.contains("newer chladni") && why.contains("9999"), "{why}");
    place.tamper("DELETE FROM _sqlx_migrations WHERE version = 9999".to_owned()).await.unwrap();
    place.tamper("UPDATE _sqlx_migrations SET checksum = '\\x00'".to_owned()).await.unwrap();
    let why = refusal(&place.text()).await;
    assert!(why.contains("another build"), "{why}");
}

#[tokio::test]
async fn the_database_of_another_application_is_left_alone() {
    cluster().sql("postgres", "CREATE DATABASE songs");
    cluster().sql("songs", "CREATE TABLE jobs (title TEXT)");
    let why = refusal(&cluster().address("songs")).await;
    assert!(why.contains("another application"), "{why}");
    let tables = "SELECT count(*) FROM information_schema.tables WHERE table_schema = 'public'";
    assert_eq!(cluster().sql("songs", tables), "1");
    cluster().sql("postgres", "DROP DATABASE songs");
}

#[tokio::test]
async fn an_encoding_that_cannot_hold_every_name_is_refused() {
    let other = "CREATE DATABASE latin ENCODING 'LATIN1' TEMPLATE template0 LC_COLLATE 'C' LC_CTYPE 'C'";
    cluster().sql("postgres", other);
    let why = refusal(&cluster().address("latin")).await;
    assert!(why.contains("LATIN1") && why.contains("--encoding UTF8"), "{why}");
    cluster().sql("postgres", "DROP DATABASE latin");
}

#[tokio::test]
async fn nodes_that_start_together_on_an_empty_database_make_its_tables_once() {
    cluster().sql("postgres", "CREATE DATABASE empty");
    let address: DatabaseAddress = cluster().address("empty").parse().unwrap();
    let starts = (0..4).map(|_| Store::open_at(&address, StoreSettings::default()));
    let stores = futures_util::future::join_all(starts).await;
    let stores: Vec<Store> = stores.into_iter().map(Result::unwrap).collect();
    let stored = stores[0].submit(&cloud(20, 1), None).await.unwrap().cloud;
    for store in &stores {
        assert_eq!(
            store.clouds(&Owner::nobody(), None, 10).await.unwrap().items,
            std::slice::from_ref(&stored)
        );
    }
    for store in stores {
        store.close().await;
    }
    cluster().sql("postgres", "DROP DATABASE empty WITH (FORCE)");
}
