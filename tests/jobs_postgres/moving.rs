//! From a file to a server: everything arrives, once, and as it was.

use chladni::analysis::JobKind;
use chladni::store::{
    ArrayName, DatabaseLock, JobState, NodeSettings, Numbers, Owner, Store, StoreError, StoreSettings,
};
use uuid::Uuid;

use crate::stage::{
    Stage, basis_values, bits, cloud, coefficients, complete, mass, matrix, parameters, report, submit,
    submit_for, vitals,
};

/// A file with a result, an operator's matrix, jobs that wait, ran, failed and were canceled, and two owners.
struct Source {
    folder: tempfile::TempDir,
    finished: Uuid,
    matrix: Uuid,
}

impl Source {
    async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = Self::open(&folder).await;
        let finished = submit(&store, &cloud(9000, 1), 3).await.id;
        let claim = store.claim(store.node()).await.unwrap().unwrap();
        store.begin_result(&claim).await.unwrap();
        store.put_array(&claim, ArrayName::Mass, Numbers::F64(mass(9000))).await.unwrap();
        store.put_bases(&claim, (0..3).map(|j| basis_values(9000, j)).collect()).await.unwrap();
        store.put_coefficients(&claim, vec![coefficients("x", 3)]).await.unwrap();
        store.finish(&claim, &report(9000, 3), &vitals()).await.unwrap();

        let operator = store.submit(&cloud(30, 2), Some((JobKind::Operator, parameters(3)))).await.unwrap();
        let claim = store.claim(store.node()).await.unwrap().unwrap();
        store.begin_result(&claim).await.unwrap();
        store.put_array(&claim, ArrayName::Mass, Numbers::F64(mass(30))).await.unwrap();
        store.put_array(&claim, ArrayName::Offsets, Numbers::U64(matrix(30).offsets)).await.unwrap();
        store.put_array(&claim, ArrayName::Columns, Numbers::U32(matrix(30).columns)).await.unwrap();
        store.put_array(&claim, ArrayName::Values, Numbers::F64(matrix(30).values)).await.unwrap();
        let mut of_operator = report(30, 0);
        of_operator.spectrum = None;
        store.finish(&claim, &of_operator, &vitals()).await.unwrap();

        let canceled = submit(&store, &cloud(20, 3), 2).await.id;
        store.request_cancel(canceled).await.unwrap();
        submit(&store, &cloud(20, 4), 2).await;
        // It was killed while this ran.
        store.claim(Uuid::now_v7()).await.unwrap().unwrap();
        submit_for(&store, &Owner::named("lab"), cloud(20, 5), 2).await.unwrap();
        store.close().await;
        Self { folder, finished, matrix: operator.job.unwrap().id }
    }

    async fn open(folder: &tempfile::TempDir) -> Store {
        Store::open_with(&folder.path().join("source.db"), StoreSettings::default()).await.unwrap()
    }
}

#[tokio::test]
async fn clouds_jobs_and_results_arrive_as_they_were_and_the_queue_goes_on() {
    let source = Source::new().await;
    let stage = Stage::new();
    let (from, to) = (Source::open(&source.folder).await, stage.open().await);
    let lock = DatabaseLock::take(&source.folder.path().join("source.db")).unwrap();
    let mut told = 0;
    let moved = from.move_to(&to, "a file", &lock, |_| told += 1).await.unwrap();
    assert_eq!((moved.clouds, moved.jobs, moved.found, told), (5, 5, 0, 10));
    for owner in [Owner::nobody(), Owner::named("lab")] {
        let clouds = from.clouds(&owner, None, 100).await.unwrap().items;
        assert_eq!(to.clouds(&owner, None, 100).await.unwrap().items, clouds);
        for cloud in clouds {
            assert_eq!(to.load_cloud(cloud.id).await.unwrap(), from.load_cloud(cloud.id).await.unwrap());
        }
        for job in from.jobs(&owner, None, None, None, 100).await.unwrap().items {
            assert_eq!(to.job(job.id).await.unwrap(), from.job(job.id).await.unwrap());
        }
    }
    for index in 0..3 {
        let (old, new) = (
            from.basis(source.finished, index).await.unwrap(),
            to.basis(source.finished, index).await.unwrap(),
        );
        assert_eq!(bits(&new), bits(&old));
    }
    assert_eq!(to.coefficients(source.finished).await.unwrap(), [coefficients("x", 3)]);
    assert_eq!(to.operator_matrix(source.matrix).await.unwrap(), matrix(30));
    // What waited, and what had run, are run now.
    for _ in 0..2 {
        let claim = to.claim(to.node()).await.unwrap().unwrap();
        assert_eq!(complete(&to, &claim).await.unwrap(), JobState::Succeeded);
    }
    assert!(to.claim(to.node()).await.unwrap().is_none());
    let again = from.move_to(&to, "a file", &lock, |_| {}).await;
    assert!(matches!(&again, Err(StoreError::Database(why)) if why.contains("not empty")), "{again:?}");
}

#[tokio::test]
async fn a_move_that_was_broken_off_goes_on_and_no_other_begins() {
    let source = Source::new().await;
    let stage = Stage::new();
    let (from, to) = (Source::open(&source.folder).await, stage.open().await);
    let lock = DatabaseLock::take(&source.folder.path().join("source.db")).unwrap();
    // The server has no room for the second chunk of the first result.
    stage.refuse_bases().await;
    let broken = from.move_to(&to, "a file", &lock, |_| {}).await;
    assert!(broken.is_err());
    assert_eq!(stage.number("SELECT count(*) FROM clouds").await, 5);
    assert_eq!(stage.number("SELECT count(*) FROM jobs").await, 0, "half a job is none");
    stage.accept_bases().await;
    let other = from.move_to(&to, "another file", &lock, |_| {}).await;
    assert!(matches!(&other, Err(StoreError::Database(why)) if why.contains("a file")), "{other:?}");
    let moved = from.move_to(&to, "a file", &lock, |_| {}).await.unwrap();
    assert_eq!((moved.clouds, moved.jobs, moved.found), (5, 5, 5));
    assert_eq!(bits(&to.basis(source.finished, 2).await.unwrap()), bits(&basis_values(9000, 2).values));
}

#[tokio::test]
async fn a_database_with_something_in_it_or_that_is_served_is_refused() {
    let source = Source::new().await;
    let from = Source::open(&source.folder).await;
    let lock = DatabaseLock::take(&source.folder.path().join("source.db")).unwrap();
    let stage = Stage::new();
    let to = stage.open().await;
    to.submit(&cloud(20, 1), None).await.unwrap();
    let refused = from.move_to(&to, "a file", &lock, |_| {}).await;
    assert!(matches!(&refused, Err(StoreError::Database(why)) if why.contains("not empty")), "{refused:?}");

    let stage = Stage::new();
    let serving = |settings: &mut StoreSettings| settings.node = NodeSettings { threads: 1, workers: 1 };
    let _node = stage.open_with(serving).await;
    let to = stage.open().await;
    let refused = from.move_to(&to, "a file", &lock, |_| {}).await;
    assert!(
        matches!(&refused, Err(StoreError::Database(why)) if why.contains("stop all nodes")),
        "{refused:?}"
    );
}

#[tokio::test]
async fn damage_is_found_before_a_move_is_called_complete() {
    let source = Source::new().await;
    let from = Source::open(&source.folder).await;
    let lock = DatabaseLock::take(&source.folder.path().join("source.db")).unwrap();
    let path = source.folder.path().join("source.db");
    let mut file = sqlx::ConnectOptions::connect(&sqlx::sqlite::SqliteConnectOptions::new().filename(path))
        .await
        .unwrap();
    sqlx::query(
        "UPDATE basis_chunks SET data = CAST(zeroblob(length(data)) AS BLOB) WHERE idx = 1 AND chunk = 0",
    )
    .execute(&mut file)
    .await
    .unwrap();
    let stage = Stage::new();
    let to = stage.open().await;
    for attempt in 0..2 {
        let refused = from.move_to(&to, "a file", &lock, |_| {}).await;
        assert!(matches!(refused, Err(StoreError::Damaged(_))), "{attempt}: {refused:?}");
    }
    assert_eq!(stage.number("SELECT count(*) FROM moves WHERE finished IS NULL").await, 1);
}
