//! Results come back bit for bit, or not at all.

use chladni::analysis::JobKind;
use chladni::progress::Phase;
use chladni::store::{ArrayName, CHUNK_POINTS, Claim, JobState, Numbers, Owner, Store, StoreError};
use uuid::Uuid;

use crate::stage::{
    Stage, basis, basis_values, bits, cloud, coefficients, complete, mass, matrix, parameters, report,
    submit, succeeded, vitals,
};

const N: usize = 2 * CHUNK_POINTS + 5;

async fn claimed(store: &Store, n: usize, bases: usize) -> Claim {
    submit(store, &cloud(n, 1), bases).await;
    store.claim(Uuid::now_v7()).await.unwrap().unwrap()
}

#[tokio::test]
async fn bases_read_by_column_and_by_chunk_are_the_bits_that_were_stored() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = succeeded(&store, N, 5).await;
    for j in 0..5 {
        assert_eq!(bits(&store.basis(job, j).await.unwrap()), bits(&basis(N, j)));
    }
    for chunk in 0..3 {
        let rows = chunk * CHUNK_POINTS..N.min((chunk + 1) * CHUNK_POINTS);
        let read = store.bases_chunk(job, 1, 3, chunk).await.unwrap();
        assert_eq!(read.len(), 3);
        for (values, j) in read.iter().zip(1..) {
            assert_eq!(bits(values), bits(&basis(N, j)[rows.clone()]));
        }
    }
    assert_eq!(bits(&store.mass(job).await.unwrap()), bits(&mass(N)));
    let record = store.job(job).await.unwrap();
    assert_eq!(record.state, JobState::Succeeded);
    assert_eq!(record.report, Some(report(N, 5)));
    assert_eq!(record.phase_seconds, [(Phase::Eigenpairs, 1.5)]);
    assert!((record.progress - 1.0).abs() < f64::EPSILON);
    stage.assert_sound().await;
}

#[tokio::test]
async fn many_bases_are_stored_in_chunks_of_a_few_megabytes() {
    let (n, count) = (1100, 1000);
    let stage = Stage::new();
    let store = stage.open().await;
    let job = succeeded(&store, n, count).await;
    let rows = store.job(job).await.unwrap().chunk_points;
    assert!(8 * rows * count <= 4 << 20, "{rows} rows of {count} bases");
    let mut values = vec![Vec::new(); 2];
    for chunk in 0..n.div_ceil(rows) {
        let read = store.bases_chunk(job, 998, 2, chunk).await.unwrap();
        values.iter_mut().zip(read).for_each(|(all, part)| all.extend(part));
    }
    for (values, j) in values.iter().zip(998..) {
        assert_eq!(bits(values), bits(&basis(n, j)));
        assert_eq!(bits(&store.basis(job, j).await.unwrap()), bits(values));
    }
    let beyond = store.bases_chunk(job, 0, 1, n.div_ceil(rows)).await;
    assert!(matches!(beyond, Err(StoreError::NoResult)));
    stage.assert_sound().await;
}

#[tokio::test]
async fn what_lies_beyond_the_bases_or_the_points_is_no_result() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = succeeded(&store, N, 2).await;
    assert!(matches!(store.basis(job, 2).await, Err(StoreError::NoResult)));
    assert!(matches!(store.bases_chunk(job, 1, 2, 0).await, Err(StoreError::NoResult)));
    assert!(matches!(store.bases_chunk(job, usize::MAX, 2, 0).await, Err(StoreError::NoResult)));
    assert!(matches!(store.bases_chunk(job, 0, 2, 3).await, Err(StoreError::NoResult)));
    assert_eq!(store.bases_chunk(job, 2, 0, 0).await.unwrap(), Vec::<Vec<f64>>::new());
    assert!(matches!(store.operator_matrix(job).await, Err(StoreError::NoResult)));
    assert!(matches!(store.basis(Uuid::now_v7(), 0).await, Err(StoreError::NotFound)));
}

#[tokio::test]
async fn coefficients_come_back_in_their_order_and_damage_is_found() {
    let stage = Stage::new();
    let store = stage.open().await;
    let claim = claimed(&store, 30, 2).await;
    let stored = vec![coefficients("z", 2), coefficients("intensity", 2)];
    store.put_coefficients(&claim, stored.clone()).await.unwrap();
    complete(&store, &claim).await.unwrap();
    // what an earlier attempt left is gone when a result begins
    assert_eq!(store.coefficients(claim.job.id).await.unwrap(), Vec::new());

    let claim = claimed(&store, 31, 2).await;
    store.put_array(&claim, ArrayName::Mass, Numbers::F64(mass(31))).await.unwrap();
    store.put_bases(&claim, vec![basis_values(31, 0), basis_values(31, 1)]).await.unwrap();
    store.put_coefficients(&claim, stored.clone()).await.unwrap();
    store.finish(&claim, &report(31, 2), &vitals()).await.unwrap();
    assert_eq!(store.coefficients(claim.job.id).await.unwrap(), stored);
    stage.tamper("UPDATE coefficients SET numbers = CAST(zeroblob(16) AS BLOB) WHERE name = 'z'").await;
    assert!(matches!(store.coefficients(claim.job.id).await, Err(StoreError::Damaged(_))));
    stage.assert_sound().await;
}

#[tokio::test]
async fn an_operator_job_gives_its_matrix_back() {
    let stage = Stage::new();
    let store = stage.open().await;
    store.submit(&cloud(N, 1), Some((JobKind::Operator, parameters(3)))).await.unwrap();
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    let mut report = report(N, 0);
    report.spectrum = None;
    let stored = matrix(N);
    store.begin_result(&claim).await.unwrap();
    store.put_array(&claim, ArrayName::Mass, Numbers::F64(mass(N))).await.unwrap();
    store.put_array(&claim, ArrayName::Offsets, Numbers::U64(stored.offsets.clone())).await.unwrap();
    store.put_array(&claim, ArrayName::Columns, Numbers::U32(stored.columns.clone())).await.unwrap();
    let early = store.finish(&claim, &report, &vitals()).await;
    assert!(matches!(early, Err(StoreError::Damaged(_))), "without its values: {early:?}");
    store.put_array(&claim, ArrayName::Values, Numbers::F64(stored.values.clone())).await.unwrap();
    assert_eq!(store.finish(&claim, &report, &vitals()).await.unwrap(), JobState::Succeeded);
    assert_eq!(store.operator_matrix(claim.job.id).await.unwrap(), stored);
    assert!(matches!(store.basis(claim.job.id, 0).await, Err(StoreError::NoResult)));
}

#[tokio::test]
async fn no_part_of_a_result_is_visible_before_the_job_succeeds() {
    let stage = Stage::new();
    let store = stage.open().await;
    let claim = claimed(&store, 30, 2).await;
    let job = claim.job.id;
    store.begin_result(&claim).await.unwrap();
    store.put_array(&claim, ArrayName::Mass, Numbers::F64(mass(30))).await.unwrap();
    store.put_bases(&claim, vec![basis_values(30, 0), basis_values(30, 1)]).await.unwrap();
    assert!(matches!(store.basis(job, 0).await, Err(StoreError::NoResult)));
    assert!(matches!(store.bases_chunk(job, 0, 1, 0).await, Err(StoreError::NoResult)));
    assert!(matches!(store.mass(job).await, Err(StoreError::NoResult)));
    store.finish(&claim, &report(30, 2), &vitals()).await.unwrap();
    assert!(store.basis(job, 0).await.is_ok());
}

#[tokio::test]
async fn a_result_that_lacks_a_part_is_not_called_whole() {
    let stage = Stage::new();
    let store = stage.open().await;
    let claim = claimed(&store, 30, 2).await;
    store.begin_result(&claim).await.unwrap();
    store.put_bases(&claim, vec![basis_values(30, 0)]).await.unwrap();
    store.put_array(&claim, ArrayName::Mass, Numbers::F64(mass(30))).await.unwrap();
    assert!(matches!(store.finish(&claim, &report(30, 2), &vitals()).await, Err(StoreError::Damaged(_))));
    store.put_bases(&claim, vec![basis_values(30, 2)]).await.unwrap();
    assert!(matches!(store.finish(&claim, &report(30, 2), &vitals()).await, Err(StoreError::Damaged(_))));
    assert_eq!(store.job(claim.job.id).await.unwrap().state, JobState::Running);
    assert_eq!(complete(&store, &claim).await.unwrap(), JobState::Succeeded);
}

#[tokio::test]
async fn a_basis_that_does_not_fit_the_cloud_is_refused() {
    let stage = Stage::new();
    let store = stage.open().await;
    let claim = claimed(&store, 30, 2).await;
    for basis in [basis_values(29, 0), basis_values(31, 0)] {
        assert!(matches!(store.put_bases(&claim, vec![basis]).await, Err(StoreError::Damaged(_))));
    }
}

#[tokio::test]
async fn a_report_that_cannot_be_read_back_is_refused() {
    let stage = Stage::new();
    let store = stage.open().await;
    let claim = claimed(&store, 30, 2).await;
    let mut broken = report(30, 2);
    broken.spectrum.as_mut().unwrap().residuals[1] = f64::NAN;
    assert!(matches!(store.finish(&claim, &broken, &vitals()).await, Err(StoreError::Damaged(_))));
}

#[tokio::test]
async fn damaged_bytes_are_reported_as_damaged_whichever_way_they_are_read() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = succeeded(&store, N, 2).await;
    let changed = stage
        .tamper(
            "UPDATE basis_chunks SET data = CAST(zeroblob(length(data)) AS BLOB) WHERE idx = 1 AND chunk = 1",
        )
        .await;
    assert_eq!(changed, 1);
    assert!(matches!(store.basis(job, 1).await, Err(StoreError::Damaged(_))));
    assert!(matches!(store.bases_chunk(job, 0, 2, 1).await, Err(StoreError::Damaged(_))));
    assert!(store.basis(job, 0).await.is_ok());
    assert!(store.bases_chunk(job, 0, 2, 0).await.is_ok());
}

#[tokio::test]
async fn missing_and_misplaced_chunks_are_damage() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = succeeded(&store, N, 3).await;
    stage.tamper("DELETE FROM basis_chunks WHERE idx = 0 AND chunk = 2").await;
    assert!(matches!(store.basis(job, 0).await, Err(StoreError::Damaged(_))));
    assert!(matches!(store.bases_chunk(job, 0, 3, 2).await, Err(StoreError::Damaged(_))));
    stage.tamper("UPDATE basis_chunks SET chunk = chunk + 10 WHERE idx = 1").await;
    stage.tamper("UPDATE basis_chunks SET chunk = (12 - chunk) % 3 WHERE idx = 1").await;
    assert!(matches!(store.basis(job, 1).await, Err(StoreError::Damaged(_))));
    stage.tamper("UPDATE bases SET digest = zeroblob(32) WHERE idx = 2").await;
    assert!(matches!(store.basis(job, 2).await, Err(StoreError::Damaged(_))));
}

#[tokio::test]
async fn bases_take_little_more_of_the_file_than_their_numbers_however_many_there_are() {
    for (n, bases) in [(40_000, 30), (16_328, 100), (8_140, 200), (6_072, 300), (3_000, 600)] {
        let stage = Stage::new();
        let store = stage.open().await;
        let claim = claimed(&store, n, bases).await;
        let before = store.space().await.unwrap().file;
        for first in (0..bases).step_by(50) {
            let batch = (first..bases.min(first + 50)).map(|j| basis_values(n, j)).collect();
            store.put_bases(&claim, batch).await.unwrap();
        }
        let taken = store.space().await.unwrap().file - before;
        let ratio = taken as f64 / (8 * n * bases) as f64;
        println!("{n} points, {bases} bases: {ratio:.3} times their numbers");
        assert!(ratio < 1.15, "{n} points, {bases} bases: {ratio}");
    }
}

#[tokio::test]
async fn changed_numbers_outside_of_the_arrays_are_damage() {
    let stage = Stage::new();
    let store = stage.open().await;
    let claim = claimed(&store, 30, 2).await;
    store.begin_result(&claim).await.unwrap();
    store.put_array(&claim, ArrayName::Mass, Numbers::F64(mass(30))).await.unwrap();
    store.put_bases(&claim, vec![basis_values(30, 0), basis_values(30, 1)]).await.unwrap();
    store.put_coefficients(&claim, vec![coefficients("x", 2)]).await.unwrap();
    store.finish(&claim, &report(30, 2), &vitals()).await.unwrap();
    let (job, cloud) = (claim.job.id, claim.job.cloud_id);
    assert_eq!(store.coefficients(job).await.unwrap().len(), 1);

    stage.tamper("UPDATE coefficients SET energy = energy + 1").await;
    assert!(matches!(store.coefficients(job).await, Err(StoreError::Damaged(_))));
    stage.tamper("UPDATE jobs SET report = json_set(report, '$.spectrum.eigenvalues[1]', 7.5)").await;
    let shown = store.job(job).await.unwrap();
    assert_eq!((shown.state, shown.report), (JobState::Failed, None));
    assert!(shown.failure.unwrap().detail.contains("checksum"));
    for change in ["bounding_box = '[[0.0,0.0,0.0],[9.0,9.0,9.0]]'", "points = points + 1", "nonfinite = 3"] {
        let stage = Stage::new();
        let store = stage.open().await;
        let cloud = store.submit(&self::cloud(30, 1), None).await.unwrap().cloud.id;
        stage.tamper(format!("UPDATE clouds SET {change}")).await;
        assert!(matches!(store.cloud(cloud).await, Err(StoreError::Damaged(_))), "{change}");
        let listed = store.clouds(&Owner::nobody(), None, 10).await.unwrap();
        assert_eq!(listed.items.len(), 0, "one bad row does not hide the others");
    }
    assert!(store.cloud(cloud).await.is_ok());
}

#[tokio::test]
async fn damaged_masses_and_clouds_are_reported_too() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = succeeded(&store, N, 1).await;
    stage.tamper("UPDATE array_chunks SET data = substr(data, 2) WHERE chunk = 0").await;
    assert!(matches!(store.mass(job).await, Err(StoreError::Damaged(_))));

    let cloud = store.job(job).await.unwrap().cloud_id;
    stage.tamper("UPDATE cloud_chunks SET data = zeroblob(length(data)) WHERE chunk = 2").await;
    assert!(matches!(store.load_cloud(cloud).await, Err(StoreError::Damaged(_))));
    stage.tamper("UPDATE cloud_chunks SET data = substr(data, 2) WHERE chunk = 2").await;
    assert!(matches!(store.load_cloud(cloud).await, Err(StoreError::Damaged(_))));
    stage.tamper("DELETE FROM cloud_chunks").await;
    assert!(matches!(store.load_cloud(cloud).await, Err(StoreError::Damaged(_))));
}
