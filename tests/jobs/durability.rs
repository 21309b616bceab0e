//! What survives a crash, and what the file refuses.

use std::os::unix::fs::PermissionsExt;
use std::time::{Duration, Instant};

use chladni::store::{ArrayName, JobState, Numbers, Owner, Store, StoreError};
use futures_util::poll;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};
use uuid::Uuid;

use crate::stage::{
    ATTEMPTS_MAX, Stage, basis, basis_values, bits, cloud, coefficients, complete, mass, submit, succeeded,
};

#[tokio::test]
async fn a_crash_in_the_middle_of_a_result_leaves_none_and_the_job_is_done_again() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = submit(&store, &cloud(50, 1), 3).await.id;
    let dead = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    store.begin_result(&dead).await.unwrap();
    store.put_array(&dead, ArrayName::Mass, Numbers::F64(mass(50))).await.unwrap();
    store.put_bases(&dead, vec![basis_values(50, 0), basis_values(50, 1)]).await.unwrap();
    store.put_coefficients(&dead, vec![coefficients("x", 2)]).await.unwrap();
    drop(store);

    let store = stage.open().await;
    assert!(matches!(store.basis(job, 0).await, Err(StoreError::NoResult)));
    assert!(matches!(store.coefficients(job).await, Err(StoreError::NoResult)));
    assert_eq!(stage.number("SELECT count(*) FROM basis_chunks").await, 2);
    let living = Uuid::now_v7();
    assert_eq!(store.requeue_orphans(living).await.unwrap(), 1);
    assert_eq!(store.job(job).await.unwrap().state, JobState::Queued);
    let left = "SELECT (SELECT count(*) FROM bases) + (SELECT count(*) FROM basis_chunks) + \
                (SELECT count(*) FROM arrays) + (SELECT count(*) FROM array_chunks) + \
                (SELECT count(*) FROM coefficients)";
    assert_eq!(stage.number(left).await, 0);
    assert!(matches!(store.begin_result(&dead).await, Err(StoreError::LostClaim)));

    let claim = store.claim(living).await.unwrap().unwrap();
    assert_eq!((claim.job.id, claim.job.attempt), (job, 2));
    assert_eq!(complete(&store, &claim).await.unwrap(), JobState::Succeeded);
    assert_eq!(bits(&store.basis(job, 2).await.unwrap()), bits(&basis(50, 2)));
    stage.assert_sound().await;
}

#[tokio::test]
async fn an_attempt_that_left_half_a_result_does_not_mix_with_the_next() {
    let stage = Stage::new();
    let store = stage.open().await;
    submit(&store, &cloud(50, 1), 3).await;
    let process = Uuid::now_v7();
    let claim = store.claim(process).await.unwrap().unwrap();
    store.put_bases(&claim, vec![basis_values(50, 0), basis_values(50, 9)]).await.unwrap();
    let retried = chladni::store::JobFailure { code: "internal".to_owned(), detail: "made up".to_owned() };
    store.fail(&claim, retried, Some(0)).await.unwrap();
    let claim = store.claim(process).await.unwrap().unwrap();
    assert_eq!(complete(&store, &claim).await.unwrap(), JobState::Succeeded);
    assert_eq!(stage.number("SELECT count(*) FROM bases").await, 3);
}

#[tokio::test]
async fn a_job_that_kills_its_process_ends_failed_after_exactly_three_attempts() {
    let stage = Stage::new();
    let poisonous = submit(&stage.open().await, &cloud(5, 1), 2).await.id;
    let mut attempts = 0;
    loop {
        let store = stage.open().await;
        let process = Uuid::now_v7();
        store.requeue_orphans(process).await.unwrap();
        let Some(claim) = store.claim(process).await.unwrap() else { break };
        assert_eq!(claim.job.id, poisonous);
        attempts += 1;
        assert!(attempts <= ATTEMPTS_MAX, "it runs for ever");
        drop(store);
    }
    assert_eq!(attempts, ATTEMPTS_MAX);
    let store = stage.open().await;
    let record = store.job(poisonous).await.unwrap();
    assert_eq!((record.state, record.attempt), (JobState::Failed, ATTEMPTS_MAX));
    assert_eq!(record.failure.unwrap().code, "crashed");
    submit(&store, &cloud(5, 2), 2).await;
    assert!(store.claim(Uuid::now_v7()).await.unwrap().is_some(), "the queue goes on");
}

#[tokio::test]
async fn a_living_processes_own_jobs_are_not_orphans() {
    let stage = Stage::new();
    let store = stage.open().await;
    let process = Uuid::now_v7();
    submit(&store, &cloud(5, 1), 2).await;
    let claim = store.claim(process).await.unwrap().unwrap();
    assert_eq!(store.requeue_orphans(process).await.unwrap(), 0);
    assert_eq!(complete(&store, &claim).await.unwrap(), JobState::Succeeded);
}

#[tokio::test]
async fn readers_go_on_while_a_write_transaction_is_open_and_writers_wait_for_it() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = succeeded(&store, 50, 2).await;
    let mut writer = stage.file().await;
    sqlx::query("BEGIN IMMEDIATE").execute(&mut writer).await.unwrap();
    sqlx::query("UPDATE jobs SET progress = 0.0").execute(&mut writer).await.unwrap();

    let record = store.job(job).await.unwrap();
    assert!((record.progress - 1.0).abs() < f64::EPSILON, "what is not committed is not seen");
    assert_eq!(store.basis(job, 1).await.unwrap().len(), 50);
    assert_eq!(store.jobs(&Owner::nobody(), None, None, None, 5).await.unwrap().items.len(), 1);

    let mut cancel = Box::pin(store.request_cancel(job));
    assert!(poll!(&mut cancel).is_pending());
    sqlx::query("ROLLBACK").execute(&mut writer).await.unwrap();
    cancel.await.unwrap();
}

#[tokio::test]
async fn a_backup_holds_everything_and_overwrites_nothing() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = succeeded(&store, 50, 2).await;
    let copy = stage.path().with_file_name("copy.db");
    Store::backup(&stage.path(), &copy).await.unwrap();
    assert!(matches!(Store::backup(&stage.path(), &copy).await, Err(StoreError::Database(_))));
    let restored = Store::open(&copy, 10).await.unwrap();
    assert_eq!(restored.job(job).await.unwrap(), store.job(job).await.unwrap());
    assert_eq!(bits(&restored.basis(job, 1).await.unwrap()), bits(&basis(50, 1)));
}

#[tokio::test]
async fn a_file_that_is_no_database_or_another_applications_is_refused_unchanged() {
    let stage = Stage::new();
    let text = b"this is not a database, however long it may be, and it stays what it is".repeat(20);
    std::fs::write(stage.path(), &text).unwrap();
    let refused = Store::open(&stage.path(), 10).await;
    assert!(matches!(&refused, Err(StoreError::Database(why)) if why.contains("not an SQLite database")));
    assert_eq!(std::fs::read(stage.path()).unwrap(), text);

    let foreign = stage.path().with_file_name("foreign.db");
    let options = SqliteConnectOptions::new().filename(&foreign).create_if_missing(true);
    let mut connection = options.connect().await.unwrap();
    sqlx::query("CREATE TABLE songs (title TEXT)").execute(&mut connection).await.unwrap();
    let refused = Store::open(&foreign, 10).await;
    assert!(matches!(&refused, Err(StoreError::Database(why)) if why.contains("another application")));
    let tables: i64 =
        sqlx::query_scalar("SELECT count(*) FROM sqlite_schema").fetch_one(&mut connection).await.unwrap();
    assert_eq!(tables, 1);
}

#[tokio::test]
async fn a_folder_that_does_not_exist_is_an_error() {
    let stage = Stage::new();
    let path = stage.path().with_file_name("nowhere").join("stage.db");
    let refused = Store::open(&path, 10).await;
    assert!(matches!(&refused, Err(StoreError::Database(why)) if why.contains("does not exist")));
}

#[tokio::test]
async fn a_file_that_a_first_start_left_before_its_first_migration_is_taken_over() {
    let stage = Stage::new();
    let mut file = SqliteConnectOptions::new()
        .filename(stage.path())
        .create_if_missing(true)
        .journal_mode(sqlx::sqlite::SqliteJournalMode::Wal)
        .connect()
        .await
        .unwrap();
    sqlx::query(
        "CREATE TABLE _sqlx_migrations (version BIGINT PRIMARY KEY, description TEXT NOT NULL, \
         installed_on TIMESTAMP NOT NULL DEFAULT CURRENT_TIMESTAMP, success BOOLEAN NOT NULL, \
         checksum BLOB NOT NULL, execution_time BIGINT NOT NULL)",
    )
    .execute(&mut file)
    .await
    .unwrap();
    file.close().await.unwrap();
    let store = stage.open().await;
    submit(&store, &cloud(5, 1), 2).await;

    // With a migration of somebody else's it is somebody else's.
    let foreign = stage.path().with_file_name("foreign.db");
    std::fs::copy(stage.path(), &foreign).unwrap();
    store.close().await;
    std::fs::copy(stage.path(), &foreign).unwrap();
    let mut file = SqliteConnectOptions::new().filename(&foreign).connect().await.unwrap();
    sqlx::query("PRAGMA application_id = 0").execute(&mut file).await.unwrap();
    file.close().await.unwrap();
    let refused = Store::open(&foreign, 10).await;
    assert!(matches!(&refused, Err(StoreError::Database(why)) if why.contains("another application")));
}

#[tokio::test]
async fn a_database_of_a_newer_version_is_refused_with_what_to_do() {
    let stage = Stage::new();
    stage.open().await.close().await;
    stage
        .tamper(
            "INSERT INTO _sqlx_migrations SELECT 9999, description, installed_on, success, checksum, execution_time \
             FROM _sqlx_migrations LIMIT 1",
        )
        .await;
    let Err(StoreError::Database(why)) = Store::open(&stage.path(), 10).await else {
        panic!("it was opened")
    };
    assert!(why.contains("newer chladni") && why.contains("restore a backup"), "{why}");
}

#[tokio::test]
async fn another_process_that_holds_the_write_lock_for_long_makes_writers_busy_and_readers_go_on() {
    let stage = Stage::new();
    let store = stage.open_with(|settings| settings.busy = Duration::from_millis(50)).await;
    let job = submit(&store, &cloud(5, 1), 2).await.id;
    let mut writer = stage.file().await;
    sqlx::query("BEGIN EXCLUSIVE").execute(&mut writer).await.unwrap();
    for _ in 0..3 {
        assert!(matches!(store.request_cancel(job).await, Err(StoreError::Busy)));
    }
    assert_eq!(store.job(job).await.unwrap().state, JobState::Queued);
    sqlx::query("ROLLBACK").execute(&mut writer).await.unwrap();
    assert_eq!(store.request_cancel(job).await.unwrap().state, JobState::Canceled);
}

#[tokio::test]
async fn writes_that_wait_behind_each_other_for_a_locked_file_are_refused_at_once() {
    const WRITES: usize = 20;
    let busy = Duration::from_secs(1);
    let stage = Stage::new();
    let store = stage.open_with(|settings| settings.busy = busy).await;
    let job = submit(&store, &cloud(5, 1), 2).await.id;
    let mut writer = stage.file().await;
    sqlx::query("BEGIN EXCLUSIVE").execute(&mut writer).await.unwrap();
    let began = Instant::now();
    let waiting = (0..WRITES).map(|_| store.request_cancel(job));
    let answers = futures_util::future::join_all(waiting).await;
    assert!(answers.iter().all(|answer| matches!(answer, Err(StoreError::Busy))), "{answers:?}");
    let elapsed = began.elapsed();
    assert!(
        elapsed >= busy && elapsed < 5 * busy,
        "one after the other they take {WRITES} times as long: {elapsed:?}"
    );
    // a lock that is released in time is waited for, by all
    let waiting = (0..WRITES).map(|_| store.request_cancel(job));
    let released = async {
        tokio::time::sleep(busy / 4).await;
        sqlx::query("ROLLBACK").execute(&mut writer).await.unwrap();
    };
    let (answers, ()) = tokio::join!(futures_util::future::join_all(waiting), released);
    assert!(answers.iter().all(Result::is_ok), "{answers:?}");
}

#[tokio::test]
async fn the_file_is_set_up_to_lose_nothing() {
    let stage = Stage::new();
    let store = stage.open().await;
    store.probe().await.unwrap();
    let mut file = stage.file().await;
    let mode: String = sqlx::query_scalar("PRAGMA journal_mode").fetch_one(&mut file).await.unwrap();
    assert_eq!(mode, "wal");
    assert_eq!(stage.number("PRAGMA page_size").await, 16_384);
    store.probe().await.unwrap();
    assert_eq!(stage.number("SELECT beats FROM probes").await, 1, "a write of a moment ago is proof enough");
    assert_eq!(stage.number("PRAGMA auto_vacuum").await, 2, "incremental");
    for file in ["stage.db", "stage.db-wal"] {
        let mode = std::fs::metadata(stage.path().with_file_name(file)).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600, "{file}");
    }
}
