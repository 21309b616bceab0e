//! Databases of earlier versions are taken over with everything in them.

use chladni::store::{CHUNK_POINTS, JobState, Owner};
use sqlx::ConnectOptions;
use sqlx::sqlite::{SqliteConnectOptions, SqliteSynchronous};

use uuid::Uuid;

use crate::stage::{Stage, basis, bits, cloud, complete, parameters, submit};

/// A database as the first version left it, with a result of n points, made from one of today: the same rows in the tables
/// of the first migration, all in chunks of the same length.
async fn of_the_first_version(stage: &Stage, n: usize, bases: usize) {
    let store = stage.open().await;
    submit(&store, &cloud(n, 7), bases).await;
    stage.tamper("UPDATE jobs SET chunk_points = 8192").await;
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    complete(&store, &claim).await.unwrap();
    store.close().await;
    let old = stage.path().with_file_name("old.db");
    let options = SqliteConnectOptions::new().filename(&old).create_if_missing(true);
    let mut connection = options.synchronous(SqliteSynchronous::Off).connect().await.unwrap();
    let migrations = sqlx::migrate!("./migrations/sqlite");
    let first = migrations.iter().next().unwrap();
    sqlx::raw_sql(first.sql.clone()).execute(&mut connection).await.unwrap();
    sqlx::query("ATTACH ?1 AS today")
        .bind(stage.path().to_str().unwrap())
        .execute(&mut connection)
        .await
        .unwrap();
    for statement in [
        "CREATE TABLE _sqlx_migrations AS SELECT * FROM today._sqlx_migrations WHERE version = 1",
        "INSERT INTO clouds SELECT id, created, digest, points, dimension, nonfinite, duplicates, bounding_box, \
         coordinate_type, fields, faces FROM today.clouds",
        "INSERT INTO cloud_chunks SELECT * FROM today.cloud_chunks",
        "INSERT INTO jobs SELECT id, cloud_id, created, kind, parameters, state, phase, progress, phase_seconds, attempt, \
         lease, lease_until, process_id, cancel_requested, started, finished, report, failure FROM today.jobs",
        "INSERT INTO bases SELECT job_id, idx, NULL, 0.0, 0.0, digest FROM today.bases",
        "INSERT INTO basis_chunks SELECT * FROM today.basis_chunks",
        "INSERT INTO arrays SELECT * FROM today.arrays",
        "INSERT INTO array_chunks SELECT * FROM today.array_chunks",
        "DETACH today",
    ] {
        sqlx::query(statement).execute(&mut connection).await.unwrap();
    }
    drop(connection);
    std::fs::rename(&old, stage.path()).unwrap();
}

#[tokio::test]
async fn a_database_of_the_first_version_keeps_its_clouds_and_results() {
    let stage = Stage::new();
    of_the_first_version(&stage, 50, 2).await;
    let store = stage.open().await;
    let jobs = store.jobs(&Owner::nobody(), None, None, None, 10).await.unwrap().items;
    assert_eq!(jobs.len(), 1);
    assert_eq!((jobs[0].state, jobs[0].memory), (JobState::Succeeded, 0));
    assert_eq!(bits(&store.basis(jobs[0].id, 1).await.unwrap()), bits(&basis(50, 1)));
    assert_eq!(store.load_cloud(jobs[0].cloud_id).await.unwrap(), cloud(50, 7));
    stage.assert_sound().await;
    // Foreign keys are in force again, also on the connection that migrated.
    let again = store.submit(&cloud(50, 7), Some((jobs[0].kind, parameters(2)))).await.unwrap();
    assert!(!again.cloud_created && !again.job_created);
    store.delete_cloud(jobs[0].cloud_id).await.unwrap();
    assert_eq!(stage.number("SELECT count(*) FROM basis_chunks").await, 0);
}

#[tokio::test]
async fn many_bases_in_the_chunks_of_the_first_version_are_still_read() {
    let (n, bases) = (CHUNK_POINTS + 9, 100);
    let stage = Stage::new();
    of_the_first_version(&stage, n, bases).await;
    let store = stage.open().await;
    let old = store.jobs(&Owner::nobody(), None, None, None, 10).await.unwrap().items.swap_remove(0);
    assert_eq!(old.chunk_points, CHUNK_POINTS);
    assert_eq!(bits(&store.basis(old.id, 99).await.unwrap()), bits(&basis(n, 99)));
    let tail = store.bases_chunk(old.id, 98, 2, 1).await.unwrap();
    assert_eq!(bits(&tail[1]), bits(&basis(n, 99)[CHUNK_POINTS..]));
    let new = submit(&store, &cloud(n, 8), bases).await;
    assert!(new.chunk_points < CHUNK_POINTS, "a new job of as many bases has shorter ones");
}

#[tokio::test]
async fn a_migration_that_a_crash_left_unrecorded_runs_again() {
    let stage = Stage::new();
    of_the_first_version(&stage, 50, 2).await;
    let migrations = sqlx::migrate!("./migrations/sqlite");
    let second = migrations.iter().nth(1).unwrap();
    sqlx::raw_sql(second.sql.clone()).execute(&mut stage.file().await).await.unwrap();
    let store = stage.open().await;
    assert_eq!(store.clouds(&Owner::nobody(), None, 10).await.unwrap().items.len(), 1);
    stage.assert_sound().await;
}
