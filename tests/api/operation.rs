//! What an operator sees of the service.

use std::sync::Arc;

use chladni::analysis::{Report, SparseMatrix};
use chladni::cloud::reader::Format;
use chladni::jobs::Results;
use reqwest::StatusCode;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};

use crate::service::{Service, file, never_finishing, problem, sphere};

async fn metrics(service: &Service) -> String {
    let answer = service.get("/metrics").await;
    assert!(answer.headers()["content-type"].to_str().unwrap().starts_with("application/openmetrics-text"));
    answer.text().await.unwrap()
}

/// The value of a series, 0 when it is not there.
fn value(metrics: &str, series: &str) -> f64 {
    let line = metrics.lines().find_map(|line| line.strip_prefix(series)?.strip_prefix(' '));
    line.map_or(0.0, |value| value.parse().unwrap())
}

#[tokio::test]
async fn metrics_tell_of_jobs_phases_requests_and_bytes() {
    let service = Service::start().await;
    let cloud = file(&sphere(100), Format::Ply);
    let job = service.succeed("bases=3&operator=voronoi", cloud.clone()).await;
    let bases = service.get(&format!("/jobs/{job}/bases.npy")).await.bytes().await.unwrap();
    let missing = service.get("/jobs/no-id").await;
    assert_eq!(missing.status(), StatusCode::NOT_FOUND);
    let strange =
        service.client.request("BREW".parse().unwrap(), service.url("/clouds")).send().await.unwrap();
    assert_eq!(strange.status(), StatusCode::METHOD_NOT_ALLOWED);
    let metrics = metrics(&service).await;
    for (series, least) in [
        ("chladni_jobs{state=\"succeeded\"}", 1.0),
        ("chladni_jobs_ended_total{state=\"succeeded\"}", 1.0),
        ("chladni_job_queue_seconds_count", 1.0),
        ("chladni_job_phase_seconds_count{phase=\"eigenpairs\"}", 1.0),
        ("chladni_http_requests_total{method=\"POST\",route=\"/clouds\",status=\"202\"}", 1.0),
        ("chladni_http_requests_total{method=\"GET\",route=\"/jobs/{id}\",status=\"404\"}", 1.0),
        ("chladni_http_requests_total{method=\"other\",route=\"/clouds\",status=\"405\"}", 1.0),
        ("chladni_http_received_bytes_total", cloud.len() as f64),
        ("chladni_http_sent_bytes_total", bases.len() as f64),
        ("chladni_disk_free_bytes", 1.0),
        ("chladni_database_file_bytes", 1.0),
        ("chladni_database_free_bytes", 0.0),
        ("chladni_job_oldest_queued_seconds", 0.0),
    ] {
        assert!(value(&metrics, series) >= least, "{series}\n{metrics}");
    }
    assert!(metrics.contains("chladni_jobs{state=\"failed\"} 0"), "a state without jobs is told too");
    assert!(!metrics.contains("no-id") && !metrics.contains("BREW"), "clients do not choose labels");
}

#[tokio::test]
async fn metrics_tell_what_running_jobs_are_estimated_to_take() {
    let service = Service::start_with(|_| {}, never_finishing()).await;
    assert!(value(&metrics(&service).await, "chladni_job_memory_bytes").abs() < f64::EPSILON);
    let submission = service.accept("bases=3", file(&sphere(100), Format::Ply)).await;
    service.running(submission["job"]["id"].as_str().unwrap()).await;
    assert!(value(&metrics(&service).await, "chladni_job_memory_bytes") > 1e5);
}

#[tokio::test]
async fn a_service_whose_disk_is_too_full_is_alive_but_not_ready() {
    let service = Service::with_settings(|settings| settings.disk_floor = u64::MAX).await;
    assert_eq!(service.get("/livez").await.status(), StatusCode::OK);
    let refused = problem(service.get("/readyz").await, StatusCode::SERVICE_UNAVAILABLE, "unavailable").await;
    assert_eq!(refused["check"], "disk");
}

#[tokio::test]
async fn a_service_that_could_store_a_job_is_ready() {
    let service = Service::start().await;
    assert_eq!(service.json("/readyz").await["status"], "ok");
}

/// A result that takes the worker with it that wants to store it: no analysis does, for all that is known.
struct Deadly;

impl Results for Deadly {
    fn report(&self) -> &Report {
        unreachable!("asked for after the bases")
    }

    fn mass(&self) -> Vec<f64> {
        vec![1.0; 100]
    }

    fn bases(&self) -> usize {
        unreachable!("on purpose, on the thread of the worker")
    }

    fn basis(&self, _: usize) -> Vec<f64> {
        unreachable!("there are none")
    }

    fn matrix(&self) -> Option<SparseMatrix> {
        None
    }
}

#[tokio::test]
async fn a_service_whose_worker_died_is_not_ready() {
    let service = Service::start_with(|_| {}, Arc::new(|_, _, _, _| Ok(Box::new(Deadly)))).await;
    assert_eq!(service.get("/readyz").await.status(), StatusCode::OK);
    service.accept("bases=3", file(&sphere(100), Format::Ply)).await;
    while service.get("/readyz").await.status() == StatusCode::OK {}
    let refused = problem(service.get("/readyz").await, StatusCode::SERVICE_UNAVAILABLE, "unavailable").await;
    assert_eq!(refused["check"], "workers");
    assert_eq!(service.get("/livez").await.status(), StatusCode::OK);
}

#[tokio::test]
async fn a_service_whose_database_takes_no_writes_is_not_ready_until_it_does() {
    let service = Service::start().await;
    let database = SqliteConnectOptions::new().filename(service.directory.path().join("test.db"));
    let mut other = database.connect().await.unwrap();
    sqlx::raw_sql("BEGIN IMMEDIATE").execute(&mut other).await.unwrap();
    // The writes of its start answer for the first seconds.
    let asked = std::time::Instant::now();
    while service.get("/readyz").await.status() == StatusCode::OK {
        assert!(asked.elapsed().as_secs() < 30, "it calls itself ready while no write succeeds");
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    }
    let refused = problem(service.get("/readyz").await, StatusCode::SERVICE_UNAVAILABLE, "unavailable").await;
    assert_eq!(refused["check"], "database");
    assert_eq!(service.get("/clouds").await.status(), StatusCode::OK, "reading goes on");
    other.close().await.unwrap();
    assert_eq!(service.get("/readyz").await.status(), StatusCode::OK);
}

#[tokio::test]
async fn jobs_and_clouds_are_deleted_after_the_days_of_the_settings() {
    let service = Service::start().await;
    let alone = service.post("/clouds?analyze=false", file(&sphere(99), Format::Ply)).await;
    assert_eq!(alone.status(), StatusCode::CREATED);
    let job = service.succeed("bases=3&operator=voronoi", file(&sphere(100), Format::Ply)).await;
    let count = async |service: &Service, of: &str| {
        service.json(&format!("/{of}")).await[of].as_array().unwrap().len()
    };

    let keeping = |jobs, clouds| {
        move |settings: &mut chladni::app::Settings| {
            (settings.keep_jobs_days, settings.keep_clouds_days) = (jobs, clouds);
        }
    };
    // Jobs are looked at before clouds: when the cloud has gone, the job has been spared.
    let service = service.restart_with(keeping(Some(1), Some(0))).await;
    while count(&service, "clouds").await > 1 {}
    assert_eq!(service.get(&format!("/jobs/{job}/bases.npy")).await.status(), StatusCode::OK);

    let service = service.restart_with(keeping(Some(0), None)).await;
    while count(&service, "jobs").await > 0 {}
    assert_eq!(service.get(&format!("/jobs/{job}/bases.npy")).await.status(), StatusCode::NOT_FOUND);
    assert_eq!(count(&service, "clouds").await, 1, "its cloud is kept");
}
