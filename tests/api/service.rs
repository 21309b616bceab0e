//! An app on a free port with a database of its own, and files to send to it.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;

use chladni::app::{App, Settings};
use chladni::cloud::reader::Format;
use chladni::cloud::shapes::{SampleRequest, Shape, sample};
use chladni::cloud::writer::write;
use chladni::cloud::{NonFinite, PointCloud};
use chladni::jobs::{Analyze, default_analysis};
use chladni::progress::Phase;
use reqwest::{Response, StatusCode};
use serde_json::Value;
use tempfile::TempDir;

/// A running app; it ends with the test.
pub(crate) struct Service {
    pub(crate) app: App,
    pub(crate) client: reqwest::Client,
    pub(crate) directory: TempDir,
}

impl Service {
    /// With the default settings and the library's analysis.
    pub(crate) async fn start() -> Self {
        Self::start_with(|_| {}, default_analysis()).await
    }

    /// With other settings.
    pub(crate) async fn with_settings(change: impl FnOnce(&mut Settings)) -> Self {
        Self::start_with(change, default_analysis()).await
    }

    /// With an analysis that begins, tells nothing, and ends only when it is canceled.
    pub(crate) async fn that_never_finishes() -> Self {
        Self::start_with(|_| {}, never_finishing()).await
    }

    pub(crate) async fn start_with(change: impl FnOnce(&mut Settings), analyze: Arc<Analyze>) -> Self {
        let directory = TempDir::new().unwrap();
        let mut settings = settings(&directory);
        change(&mut settings);
        let app = App::start_with(settings, analyze).await.unwrap();
        Self { app, client: reqwest::Client::new(), directory }
    }

    /// The same database under a new app.
    pub(crate) async fn restart(self) -> Self {
        self.restart_with(|_| {}).await
    }

    /// The same database under a new app with other settings.
    pub(crate) async fn restart_with(self, change: impl FnOnce(&mut Settings)) -> Self {
        let Self { app, client, directory } = self;
        app.shutdown().await;
        let mut settings = settings(&directory);
        change(&mut settings);
        let app = App::start(settings).await.unwrap();
        Self { app, client, directory }
    }

    pub(crate) fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.app.address())
    }

    pub(crate) async fn get(&self, path: &str) -> Response {
        self.client.get(self.url(path)).send().await.unwrap()
    }

    pub(crate) async fn json(&self, path: &str) -> Value {
        let response = self.get(path).await;
        assert!(response.status().is_success(), "{path}: {}", response.text().await.unwrap());
        response.json().await.unwrap()
    }

    pub(crate) async fn post(&self, path: &str, body: impl Into<reqwest::Body>) -> Response {
        self.client.post(self.url(path)).body(body).send().await.unwrap()
    }

    /// Uploads and expects that it is accepted.
    pub(crate) async fn accept(&self, query: &str, file: Vec<u8>) -> Value {
        let response = self.post(&format!("/clouds?{query}"), file).await;
        let (status, body) = (response.status(), response.text().await.unwrap());
        assert_eq!(status, StatusCode::ACCEPTED, "{body}");
        serde_json::from_str(&body).unwrap()
    }

    /// Waits for the job's end without sleeping.
    pub(crate) async fn finished(&self, job: &str) -> Value {
        loop {
            let job = self.json(&format!("/jobs/{job}?wait=60")).await;
            if !matches!(job["state"].as_str(), Some("queued" | "running")) {
                return job;
            }
        }
    }

    /// Waits until a worker has begun the job.
    pub(crate) async fn running(&self, job: &str) {
        while self.json(&format!("/jobs/{job}?wait=1")).await["state"] == "queued" {}
    }

    /// Uploads, waits, expects success, and returns the job's id.
    pub(crate) async fn succeed(&self, query: &str, file: Vec<u8>) -> String {
        let submission = self.accept(query, file).await;
        let id = submission["job"]["id"].as_str().unwrap().to_owned();
        let job = self.finished(&id).await;
        assert_eq!(job["state"], "succeeded", "{job}");
        id
    }
}

fn settings(directory: &TempDir) -> Settings {
    Settings {
        listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 0)),
        database: directory.path().join("test.db").into(),
        grace_seconds: 0,
        ..Settings::default()
    }
}

/// Enters a phase, then spins at the checkpoint until it is canceled.
pub(crate) fn never_finishing() -> Arc<Analyze> {
    Arc::new(|_, _, _, progress| {
        progress.enter(Phase::Eigenpairs)?;
        loop {
            progress.advance(0.5)?;
            std::thread::yield_now();
        }
    })
}

/// A well spaced sphere.
pub(crate) fn sphere(points: usize) -> PointCloud {
    sample(&SampleRequest::new(Shape::Sphere, points)).unwrap()
}

/// `cloud` as a file.
pub(crate) fn file(cloud: &PointCloud, format: Format) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(cloud, format, &mut bytes).unwrap();
    bytes
}

/// Points as lines of text.
pub(crate) fn lines(points: &[[f64; 3]]) -> Vec<u8> {
    points.iter().flat_map(|[x, y, z]| format!("{x} {y} {z}\n").into_bytes()).collect()
}

/// The sphere's points followed by `more` rows.
pub(crate) fn sphere_and(points: usize, more: &[[f64; 3]]) -> Vec<u8> {
    let sphere = sphere(points);
    let coordinates = sphere.coordinates().iter().copied().chain(more.iter().flatten().copied()).collect();
    let cloud = PointCloud::new(3, coordinates, NonFinite::Drop).unwrap();
    file(&cloud, Format::Xyz)
}

/// The problem of an answer, checked against what every problem has.
pub(crate) async fn problem(response: Response, status: StatusCode, kind: &str) -> Value {
    let headers = response.headers().clone();
    let (actual, body) = (response.status(), response.text().await.unwrap());
    assert_eq!(actual, status, "{body}");
    assert_eq!(headers["content-type"], "application/problem+json");
    let problem: Value = serde_json::from_str(&body).unwrap();
    assert_eq!(problem["type"], format!("/problems/{kind}"), "{body}");
    assert_eq!(problem["status"], status.as_u16());
    assert!(problem["title"].is_string() && problem["instance"].is_string());
    assert_eq!(problem["request_id"].as_str().unwrap(), headers["x-request-id"]);
    problem
}

/// The problem's detail.
pub(crate) fn detail(problem: &Value) -> &str {
    problem["detail"].as_str().unwrap()
}
