//! In however long chunks the bases are stored, the answers are the same.

use chladni::cloud::reader::Format;
use serde_json::Value;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, SqliteConnection};

use crate::service::{Service, file, sphere};

const POINTS: usize = 300;
/// Rows of a chunk: four chunks and the rest.
const CHUNK: usize = 64;

async fn database(service: &Service) -> SqliteConnection {
    let path = service.directory.path().join("test.db");
    SqliteConnectOptions::new().filename(path).connect().await.unwrap()
}

/// A service and a job whose bases it stored in chunks of [`CHUNK`] rows.
async fn in_short_chunks(query: &str) -> (Service, String) {
    // Another job is in the way of this one until the service stops.
    let service = Service::that_never_finishes().await;
    service.accept("bases=2", file(&sphere(50), Format::Ply)).await;
    let job = service.accept(query, file(&sphere(POINTS), Format::Ply)).await;
    let id = job["job"]["id"].as_str().unwrap().to_owned();
    let shortened = format!("UPDATE jobs SET chunk_points = {CHUNK} WHERE state = 'queued'");
    let changed = sqlx::raw_sql(sqlx::AssertSqlSafe(shortened)).execute(&mut database(&service).await).await;
    assert_eq!(changed.unwrap().rows_affected(), 1);
    let service = service.restart().await;
    assert_eq!(service.finished(&id).await["state"], "succeeded");
    (service, id)
}

#[tokio::test]
async fn results_do_not_depend_on_the_length_of_the_chunks_they_are_stored_in() {
    let query = "bases=12&operator=voronoi";
    let (short, short_job) = in_short_chunks(query).await;
    let long = Service::start().await;
    let long_job = long.succeed(query, file(&sphere(POINTS), Format::Ply)).await;
    let chunks = "SELECT count(*) FROM basis_chunks b JOIN jobs j ON j.id = b.job_id \
                  WHERE json_extract(j.parameters, '$.bases') = 12";
    for (service, count) in [(&short, 12 * 5), (&long, 12)] {
        let stored: i64 = sqlx::query_scalar(chunks).fetch_one(&mut database(service).await).await.unwrap();
        assert_eq!(stored, count);
    }
    // Whatever is made row by row has the same bytes, ranges of it too.
    for result in [
        "bases.npy",
        "bases.npy?first=3&count=4&dtype=f32",
        "bases.ply",
        "bases.npz",
        "bases.csv",
        "bases.json",
        "distances.npy?from=200",
        "signatures.npy",
        "signatures.ply",
    ] {
        let (ours, theirs) = (format!("/jobs/{short_job}/{result}"), format!("/jobs/{long_job}/{result}"));
        let whole = long.get(&theirs).await.bytes().await.unwrap();
        assert!(whole.len() > POINTS, "{result}: {}", String::from_utf8_lossy(&whole));
        assert_eq!(short.get(&ours).await.bytes().await.unwrap(), whole, "{result}");
        let part =
            short.client.get(short.url(&ours)).header("range", "bytes=1000-9000").send().await.unwrap();
        if part.status() == reqwest::StatusCode::PARTIAL_CONTENT {
            assert_eq!(part.bytes().await.unwrap(), whole[1000..whole.len().min(9001)], "{result}");
        }
    }
    // Sums are taken chunk by chunk: the same but for their rounding.
    for result in ["coefficients", "filtered.json?cutoff=5"] {
        let ours = short.json(&format!("/jobs/{short_job}/{result}")).await;
        let theirs = long.json(&format!("/jobs/{long_job}/{result}")).await;
        let (ours, theirs) = (numbers(&ours), numbers(&theirs));
        assert_eq!(ours.len(), theirs.len(), "{result}");
        for (ours, theirs) in ours.iter().zip(&theirs) {
            assert!((ours - theirs).abs() < 1e-9, "{result}: {ours} and {theirs}");
        }
    }
}

/// All numbers of an answer, in their order.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Number(number) => vec![number.as_f64().unwrap()],
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        Value::Object(members) => members.values().flat_map(numbers).collect(),
        _ => Vec::new(),
    }
}
