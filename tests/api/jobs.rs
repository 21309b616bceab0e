//! The life of a job: waiting, canceling, deleting, failing.

use std::sync::Arc;
use std::time::{Duration, Instant};

use chladni::analysis::AnalysisError;
use chladni::cloud::reader::Format;
use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::service::{Service, detail, file, problem, sphere};

async fn submitted(service: &Service) -> String {
    let submission = service.accept("bases=5", file(&sphere(100), Format::Ply)).await;
    submission["job"]["id"].as_str().unwrap().to_owned()
}

#[tokio::test]
async fn a_finished_job_tells_what_it_used_and_how_long_it_took() {
    let service = Service::start().await;
    let id = service.succeed("bases=5", file(&sphere(300), Format::Ply)).await;
    let response = service.get(&format!("/jobs/{id}")).await;
    assert!(!response.headers().contains_key("retry-after"));
    let job: Value = response.json().await.unwrap();
    assert_eq!(job["progress"], 1.0);
    assert_eq!(job["attempt"], 1);
    assert_eq!(job["parameters"]["operator"], "pb-mhb");
    for derived in ["t", "delta", "epsilon"] {
        assert!(job["parameters"][derived].as_f64().unwrap() > 0.0, "{derived}: {job}");
    }
    for phase in ["preparation", "eigenpairs", "certificates"] {
        assert!(job["phase_seconds"][phase].as_f64().unwrap() >= 0.0, "{job}");
    }
    for time in ["created", "started", "finished"] {
        job[time].as_str().unwrap().parse::<jiff::Timestamp>().unwrap();
    }
    assert!(job["error"].is_null() && job["eta_seconds"].is_null() && job["queue_position"].is_null());
    for link in [
        "cloud",
        "bases",
        "spectrum",
        "operator",
        "coefficients",
        "filtered",
        "features",
        "signatures",
        "distances",
        "self",
    ] {
        let path = job["links"][link].as_str().unwrap();
        assert_eq!(service.get(path).await.status(), StatusCode::OK, "{path}");
    }
}

#[tokio::test]
async fn a_running_job_is_canceled_and_has_no_results() {
    let service = Service::that_never_finishes().await;
    let id = submitted(&service).await;
    service.running(&id).await;
    let asked = service.post(&format!("/jobs/{id}/cancel"), "").await;
    assert_eq!(asked.status(), StatusCode::ACCEPTED);
    assert_eq!(service.finished(&id).await["state"], "canceled");
    assert_eq!(service.post(&format!("/jobs/{id}/cancel"), "").await.status(), StatusCode::OK);
    let refused =
        problem(service.get(&format!("/jobs/{id}/bases")).await, StatusCode::CONFLICT, "job-canceled").await;
    assert_eq!(refused["state"], "canceled");
}

#[tokio::test]
async fn a_queued_job_is_canceled_at_once() {
    let service = Service::that_never_finishes().await;
    let first = submitted(&service).await;
    service.running(&first).await;
    let second = service.accept("bases=6", file(&sphere(100), Format::Ply)).await["job"].clone();
    assert_eq!(second["queue_position"], 0, "{second}");
    let path = format!("/jobs/{}/cancel", second["id"].as_str().unwrap());
    let canceled = service.post(&path, "").await;
    assert_eq!(canceled.status(), StatusCode::OK);
    assert_eq!(canceled.json::<Value>().await.unwrap()["state"], "canceled");
}

#[tokio::test]
async fn a_wait_ends_after_its_seconds_and_is_bounded() {
    let service = Service::that_never_finishes().await;
    let id = submitted(&service).await;
    service.running(&id).await;
    let begun = Instant::now();
    let response = service.get(&format!("/jobs/{id}?wait=1")).await;
    assert!(begun.elapsed() >= Duration::from_secs(1));
    assert!(response.headers().contains_key("retry-after"));
    let job: Value = response.json().await.unwrap();
    assert_eq!(job["state"], "running");
    assert_eq!(job["phase"], "eigenpairs");
    let refused = service.get(&format!("/jobs/{id}?wait=61")).await;
    let refused = problem(refused, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
    assert!(detail(&refused).contains("0 to 60"), "{refused}");
}

#[tokio::test]
async fn an_upload_can_prefer_to_wait_for_the_result() {
    let service = Service::start().await;
    let request = service.client.post(service.url("/clouds?bases=4")).header("prefer", "wait=60");
    let response = request.body(file(&sphere(300), Format::Ply)).send().await.unwrap();
    assert_eq!(response.status(), StatusCode::ACCEPTED);
    assert!(response.headers().contains_key("preference-applied"));
    assert_eq!(response.json::<Value>().await.unwrap()["job"]["state"], "succeeded");
}

#[tokio::test]
async fn results_of_an_unfinished_job_are_a_conflict_that_tells_its_state() {
    let service = Service::that_never_finishes().await;
    let id = submitted(&service).await;
    service.running(&id).await;
    for result in ["bases", "bases.npy", "spectrum", "spectrum.csv", "operator", "operator.mtx"] {
        let response = service.get(&format!("/jobs/{id}/{result}")).await;
        assert!(response.headers().contains_key("retry-after"));
        let refused = problem(response, StatusCode::CONFLICT, "not-finished").await;
        assert_eq!(refused["state"], "running", "{result}");
    }
}

#[tokio::test]
async fn a_failed_job_tells_why_in_the_job_and_for_its_results() {
    let service = Service::start_with(
        |_| {},
        Arc::new(|_, _, _, _| Err(AnalysisError::Unsupported("the surface has holes".into()))),
    )
    .await;
    let id = submitted(&service).await;
    let job = service.finished(&id).await;
    assert_eq!(job["state"], "failed");
    assert_eq!(job["error"]["type"], "/problems/job-failed");
    assert_eq!(job["error"]["detail"], "the surface has holes");
    let refused =
        problem(service.get(&format!("/jobs/{id}/spectrum")).await, StatusCode::CONFLICT, "job-failed").await;
    assert!(detail(&refused).contains("the surface has holes"));
}

#[tokio::test]
async fn an_analysis_that_panics_fails_its_job_and_the_service_goes_on() {
    let service = Service::start_with(|_| {}, Arc::new(|_, _, _, _| panic!("a bug with secret words"))).await;
    let id = submitted(&service).await;
    let job = service.finished(&id).await;
    assert_eq!(job["state"], "failed");
    assert!(!job.to_string().contains("secret words"), "{job}");
    assert_eq!(service.get("/readyz").await.status(), StatusCode::OK);
}

#[tokio::test]
async fn an_unchanged_job_is_not_sent_again() {
    let service = Service::that_never_finishes().await;
    let id = submitted(&service).await;
    service.post(&format!("/jobs/{id}/cancel"), "").await;
    service.finished(&id).await;
    let path = format!("/jobs/{id}");
    let etag = service.get(&path).await.headers()["etag"].clone();
    let again = service.client.get(service.url(&path)).header("if-none-match", etag).send().await.unwrap();
    assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    assert!(again.bytes().await.unwrap().is_empty());
}

#[tokio::test]
async fn deleting_a_running_job_cancels_it_and_it_goes_by_itself() {
    let service = Service::that_never_finishes().await;
    let id = submitted(&service).await;
    service.running(&id).await;
    let url = service.url(&format!("/jobs/{id}"));
    assert_eq!(service.client.delete(&url).send().await.unwrap().status(), StatusCode::ACCEPTED);
    while service.get(&format!("/jobs/{id}?wait=60")).await.status() == StatusCode::OK {}
    problem(service.get(&format!("/jobs/{id}")).await, StatusCode::NOT_FOUND, "not-found").await;
}

#[tokio::test]
async fn a_cloud_with_live_jobs_stays() {
    let service = Service::that_never_finishes().await;
    let submission = service.accept("bases=5", file(&sphere(100), Format::Ply)).await;
    let url = service.url(submission["links"]["cloud"].as_str().unwrap());
    let refused = service.client.delete(&url).send().await.unwrap();
    problem(refused, StatusCode::CONFLICT, "cloud-in-use").await;
    let id = submission["job"]["id"].as_str().unwrap();
    service.post(&format!("/jobs/{id}/cancel"), "").await;
    service.finished(id).await;
    assert_eq!(service.client.delete(&url).send().await.unwrap().status(), StatusCode::NO_CONTENT);
    problem(service.client.get(&url).send().await.unwrap(), StatusCode::NOT_FOUND, "not-found").await;
}

#[tokio::test]
async fn a_stored_cloud_takes_further_jobs() {
    let service = Service::that_never_finishes().await;
    let created: Value =
        service.post("/clouds?analyze=false", file(&sphere(100), Format::Ply)).await.json().await.unwrap();
    let path = format!("{}/jobs", created["links"]["cloud"].as_str().unwrap());
    let body = json!({"bases": 7, "operator": "voronoi", "tol": 1e-3}).to_string();
    let response = service.post(&path, body.clone()).await;
    assert_eq!(response.status(), StatusCode::ACCEPTED);
    let submission: Value = response.json().await.unwrap();
    assert_eq!(submission["job"]["parameters"]["bases"], 7);
    assert_eq!(submission["job"]["parameters"]["tolerance"], 1e-3);
    assert_eq!(submission["job"]["parameters"]["operator"], "voronoi");
    assert_eq!(service.post(&path, body).await.status(), StatusCode::OK);
    let defaults: Value = service.post(&path, "").await.json().await.unwrap();
    assert_eq!(defaults["job"]["parameters"]["bases"], 100, "{defaults}");
}

#[tokio::test]
async fn a_listing_by_the_id_of_a_job_says_so() {
    let service = Service::that_never_finishes().await;
    let created: Value =
        service.post("/clouds?bases=3", file(&sphere(100), Format::Ply)).await.json().await.unwrap();
    let (cloud, job) = (created["cloud"]["id"].as_str().unwrap(), created["job"]["id"].as_str().unwrap());
    let listed = async |id: &str| service.get(&format!("/jobs?cloud={id}")).await;
    let refused = problem(listed(job).await, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
    let meant = format!("/jobs?cloud={cloud}");
    assert_eq!((&refused["parameter"], &refused["near"]), (&"cloud".into(), &json!([meant])), "{refused}");
    let jobs: Value = service.get(&meant).await.json().await.unwrap();
    assert_eq!(jobs["jobs"].as_array().unwrap().len(), 1);
    // a cloud without jobs of this state, and an id that is nobody's
    assert_eq!(service.get(&format!("{meant}&state=failed")).await.status(), StatusCode::OK);
    assert_eq!(listed(&uuid::Uuid::now_v7().to_string()).await.status(), StatusCode::OK);
}

#[tokio::test]
async fn malformed_job_requests_are_refused() {
    let service = Service::that_never_finishes().await;
    let created: Value =
        service.post("/clouds?analyze=false", file(&sphere(100), Format::Ply)).await.json().await.unwrap();
    let path = format!("{}/jobs", created["links"]["cloud"].as_str().unwrap());
    problem(service.post(&path, "{").await, StatusCode::BAD_REQUEST, "malformed-request").await;
    problem(service.post(&path, "[1]").await, StatusCode::BAD_REQUEST, "malformed-request").await;
    let body = json!({"bases": "7"}).to_string();
    problem(service.post(&path, body).await, StatusCode::UNPROCESSABLE_ENTITY, "invalid-parameter").await;
    let body = json!({"basis": 7}).to_string();
    let refused =
        problem(service.post(&path, body).await, StatusCode::UNPROCESSABLE_ENTITY, "unknown-parameter").await;
    assert_eq!(refused["nearest"], "bases");
    let nowhere = format!("/clouds/{}/jobs", uuid::Uuid::now_v7());
    problem(service.post(&nowhere, "").await, StatusCode::NOT_FOUND, "not-found").await;
}
