//! What an operator sees of the service.

use chladni::cloud::reader::Format;
use reqwest::StatusCode;

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
