//! Clouds come back as they went in, once.

use chladni::analysis::JobKind;
use chladni::cloud::{Grid, NonFinite, PointCloud, ScalarField, ScalarType};
use chladni::store::{CHUNK_POINTS, FieldRecord, Owner, StoreError};
use futures_util::poll;
use uuid::Uuid;

use crate::stage::{Stage, bits, cloud, complete, parameters, submit, succeeded};

const KINDS: [(ScalarType, f64); 8] = [
    (ScalarType::Int8, -128.0),
    (ScalarType::Uint8, 255.0),
    (ScalarType::Int16, -32_768.0),
    (ScalarType::Uint16, 65_535.0),
    (ScalarType::Int32, -2_147_483_648.0),
    (ScalarType::Uint32, 4_294_967_295.0),
    (ScalarType::Float32, 0.5),
    (ScalarType::Float64, 0.1),
];

/// No decimal of 17 digits, and none of fewer.
const GRIDS: [Grid; 3] = [
    Grid { scale: 0.1 + 0.2, offset: 1.0 / 3.0 },
    Grid { scale: -1e-300, offset: 5_200_000.123 },
    Grid { scale: 0.001, offset: -0.0 },
];

/// More than two chunks of points, with a field of every type, faces, and rows without a position.
fn everything() -> PointCloud {
    let n = 2 * CHUNK_POINTS + 17;
    let mut coordinates: Vec<f64> = (0..3 * n).map(|i| f64::from((i as f32 * 0.1).sin())).collect();
    coordinates[3] = f64::NAN;
    coordinates[7] = f64::NEG_INFINITY;
    coordinates[9] = -0.0;
    let extreme = |end: f64| (0..n).map(|i| if i % 2 == 0 { end } else { 1.0 }).collect::<Vec<f64>>();
    let mut fields: Vec<ScalarField> = KINDS
        .iter()
        .map(|&(kind, end)| ScalarField { name: format!("{kind:?}"), kind, values: extreme(end).into() })
        .collect();
    fields[6].values[0] = f64::NAN;
    let mut faces: Vec<[u32; 3]> = (0..n as u32 - 2).map(|i| [i, i + 1, i + 2]).collect();
    // a quadrilateral
    faces.extend([[0, 1, 2], [0, 2, 3]]);
    PointCloud::new(3, coordinates, NonFinite::Drop)
        .unwrap()
        .with_coordinate_type(ScalarType::Float32)
        .with_grids(Some(GRIDS))
        .with_fields(fields)
        .unwrap()
        .with_faces(faces)
        .unwrap()
        .with_polygons(vec![n as u32 - 1])
        .unwrap()
}

/// Chunks are cut and read sixteen at a time.
#[tokio::test]
async fn clouds_of_many_chunks_come_back_bit_for_bit() {
    let stage = Stage::new();
    let store = stage.open().await;
    for points in [16 * CHUNK_POINTS, 32 * CHUNK_POINTS + 1] {
        let numbers: Vec<f64> = (0..points).map(|i| (i as f64).sqrt()).collect();
        let faces: Vec<[u32; 3]> = (0..points as u32 - 2).map(|i| [i, i + 1, i + 2]).collect();
        let field =
            ScalarField { name: "a".to_owned(), kind: ScalarType::Float64, values: numbers.clone().into() };
        let cloud = PointCloud::new(1, numbers, NonFinite::Drop).unwrap().with_faces(faces).unwrap();
        let cloud = cloud.with_fields(vec![field]).unwrap();
        let record = store.submit(&cloud, None).await.unwrap().cloud;
        assert_eq!(record.bounding_box, (vec![0.0], vec![((points - 1) as f64).sqrt()]));
        assert_eq!(store.cloud(record.id).await.unwrap(), record);
        let back = store.load_cloud(record.id).await.unwrap();
        assert_eq!(bits(back.coordinates()), bits(cloud.coordinates()));
        assert_eq!(back.faces(), cloud.faces());
        assert_eq!(bits(&back.fields()[0].values), bits(&cloud.fields()[0].values));
    }
    stage.assert_sound().await;
}

#[tokio::test]
async fn a_cloud_comes_back_bit_for_bit_with_every_type_of_field_faces_and_missing_rows() {
    let stage = Stage::new();
    let cloud = everything();
    let store = stage.open().await;
    let record = store.submit(&cloud, None).await.unwrap().cloud;
    store.close().await;

    let store = stage.open().await;
    assert_eq!(store.cloud(record.id).await.unwrap(), record);
    let back = store.load_cloud(record.id).await.unwrap();
    assert_eq!(bits(back.coordinates()), bits(cloud.coordinates()));
    assert_eq!(back.coordinate_type(), ScalarType::Float32);
    assert_eq!(back.grids(), Some(GRIDS));
    assert_eq!(back.faces(), cloud.faces());
    assert_eq!(back.continued(), cloud.continued());
    assert_eq!(back.nonfinite(), 2);
    assert_eq!(back.fields().len(), KINDS.len());
    for (back, field) in back.fields().iter().zip(cloud.fields()) {
        assert_eq!((&back.name, back.kind), (&field.name, field.kind));
        assert_eq!(bits(&back.values), bits(&field.values));
    }
    stage.assert_sound().await;
}

#[tokio::test]
async fn a_record_says_what_the_cloud_holds() {
    let stage = Stage::new();
    let store = stage.open().await;
    let coordinates = vec![0.0, 2.0, 1.0, -3.0, 0.0, 2.0, f64::NAN, 0.0];
    let field = ScalarField { name: "red".to_owned(), kind: ScalarType::Uint8, values: vec![1.0; 4].into() };
    let cloud = PointCloud::new(2, coordinates, NonFinite::Drop).unwrap().with_fields(vec![field]).unwrap();
    let submitted = store.submit(&cloud.with_faces(vec![[0, 1, 2]]).unwrap(), None).await.unwrap();
    let record = submitted.cloud;
    assert_eq!((record.points, record.dimension, record.faces), (4, 2, 1));
    assert_eq!((record.nonfinite, record.duplicates), (1, 1));
    assert_eq!(record.bounding_box, (vec![0.0, -3.0], vec![1.0, 2.0]));
    assert_eq!(record.fields, [FieldRecord { name: "red".to_owned(), kind: ScalarType::Uint8 }]);
    assert_eq!(record.created, stage.now());
    assert_eq!(record.digest.len(), 64);
    assert!(submitted.cloud_created && submitted.job.is_none() && !submitted.job_created);
}

#[tokio::test]
async fn a_cloud_without_any_position_has_an_empty_bounding_box() {
    let stage = Stage::new();
    let store = stage.open().await;
    let cloud = PointCloud::new(2, vec![f64::NAN; 4], NonFinite::Drop).unwrap();
    let record = store.submit(&cloud, None).await.unwrap().cloud;
    assert_eq!(record.bounding_box, (vec![], vec![]));
    assert_eq!(store.load_cloud(record.id).await.unwrap().nonfinite(), 2);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_same_content_submitted_at_once_from_many_sides_gives_one_cloud_and_one_job() {
    let stage = Stage::new();
    let store = stage.open().await;
    let cloud = cloud(500, 1);
    let submissions = (0..8).map(|_| {
        let (store, cloud) = (store.clone(), cloud.clone());
        tokio::spawn(
            async move { store.submit(&cloud, Some((JobKind::Eigen, parameters(3)))).await.unwrap() },
        )
    });
    let submitted: Vec<_> =
        futures_util::future::join_all(submissions).await.into_iter().map(Result::unwrap).collect();
    assert_eq!(submitted.iter().filter(|s| s.cloud_created).count(), 1);
    assert_eq!(submitted.iter().filter(|s| s.job_created).count(), 1);
    let first = &submitted[0];
    assert!(submitted.iter().all(|s| s.cloud == first.cloud));
    assert!(submitted.iter().all(|s| s.job.as_ref().map(|j| j.id) == first.job.as_ref().map(|j| j.id)));
    assert_eq!(store.clouds(&Owner::nobody(), None, 10).await.unwrap().items.len(), 1);
    assert_eq!(store.jobs(&Owner::nobody(), None, None, None, 10).await.unwrap().items.len(), 1);
}

#[tokio::test]
async fn a_write_whose_caller_went_away_runs_to_its_end() {
    let stage = Stage::new();
    let store = stage.open().await;
    let mut changes = store.changes();
    let (cloud, job) = (cloud(100, 1), Some((JobKind::Eigen, parameters(3))));
    {
        let mut submission = Box::pin(store.submit(&cloud, job));
        assert!(poll!(&mut submission).is_pending());
    }
    // Nodes that share a database are woken now and then for nothing.
    while store.clouds(&Owner::nobody(), None, 10).await.unwrap().items.is_empty() {
        changes.changed().await.unwrap();
    }
    assert_eq!(store.jobs(&Owner::nobody(), None, None, None, 10).await.unwrap().items.len(), 1);
}

#[tokio::test]
async fn a_full_queue_refuses_the_cloud_with_its_job_but_not_an_analysis_that_is_there() {
    let stage = Stage::new();
    let store = stage.open_with_queue(1).await;
    let first = submit(&store, &cloud(10, 1), 3).await;
    let refused = store.submit(&cloud(10, 2), Some((JobKind::Eigen, parameters(3)))).await;
    assert!(matches!(refused, Err(StoreError::QueueFull { limit: 1 })), "{refused:?}");
    assert_eq!(store.clouds(&Owner::nobody(), None, 10).await.unwrap().items.len(), 1);
    assert!(matches!(
        store.submit_job(first.cloud_id, JobKind::Operator, parameters(3)).await,
        Err(StoreError::QueueFull { limit: 1 })
    ));
    assert_eq!(submit(&store, &cloud(10, 1), 3).await.id, first.id);
    assert!(store.submit(&cloud(10, 2), None).await.unwrap().cloud_created);
}

#[tokio::test]
async fn clouds_are_listed_newest_first_in_pages() {
    let stage = Stage::new();
    let store = stage.open().await;
    let mut ids = Vec::new();
    for seed in 0..5 {
        ids.insert(0, store.submit(&cloud(4, seed), None).await.unwrap().cloud.id);
    }
    let first = store.clouds(&Owner::nobody(), None, 2).await.unwrap();
    let second = store.clouds(&Owner::nobody(), first.next, 2).await.unwrap();
    // A cursor stays good when what it points at is deleted.
    store.delete_cloud(second.next.unwrap()).await.unwrap();
    let third = store.clouds(&Owner::nobody(), second.next, 2).await.unwrap();
    assert_eq!(third.next, None);
    let listed: Vec<Uuid> = [first, second, third].into_iter().flat_map(|p| p.items).map(|c| c.id).collect();
    assert_eq!(listed, ids);
}

#[tokio::test]
async fn a_cloud_with_a_live_job_is_not_deleted_and_one_without_takes_its_results_along() {
    let stage = Stage::new();
    let store = stage.open().await;
    let job = succeeded(&store, 20, 2).await;
    let cloud = store.job(job).await.unwrap().cloud_id;
    store.submit_job(cloud, JobKind::Eigen, parameters(4)).await.unwrap();
    assert!(matches!(store.delete_cloud(cloud).await, Err(StoreError::CloudInUse)));
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    assert!(matches!(store.delete_cloud(cloud).await, Err(StoreError::CloudInUse)));
    complete(&store, &claim).await.unwrap();

    store.delete_cloud(cloud).await.unwrap();
    assert!(matches!(store.cloud(cloud).await, Err(StoreError::NotFound)));
    assert!(matches!(store.load_cloud(cloud).await, Err(StoreError::NotFound)));
    assert!(matches!(store.job(job).await, Err(StoreError::NotFound)));
    assert!(matches!(store.basis(job, 0).await, Err(StoreError::NotFound)));
    assert!(matches!(store.delete_cloud(cloud).await, Err(StoreError::NotFound)));
    let left = "SELECT (SELECT count(*) FROM cloud_chunks) + (SELECT count(*) FROM jobs) + \
                (SELECT count(*) FROM bases) + (SELECT count(*) FROM basis_chunks) + \
                (SELECT count(*) FROM arrays) + (SELECT count(*) FROM array_chunks) + \
                (SELECT count(*) FROM coefficients)";
    assert_eq!(stage.number(left).await, 0);
    stage.assert_sound().await;
}

#[tokio::test]
async fn a_job_on_an_unknown_cloud_is_refused() {
    let stage = Stage::new();
    let store = stage.open().await;
    let refused = store.submit_job(Uuid::now_v7(), JobKind::Eigen, parameters(3)).await;
    assert!(matches!(refused, Err(StoreError::NotFound)));
}
