//! An app on a free port with a database of its own, and scans to send to it.

use std::fmt::Write as _;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;

use chladni::app::{App, Settings};
use chladni::cloud::PointCloud;
use chladni::cloud::shapes::{SampleRequest, Shape, sample};
use chladni::jobs::{Analyze, default_analysis};
use serde_json::Value;
use tempfile::TempDir;

/// A running app; it ends with the test.
pub(crate) struct Service {
    pub(crate) app: App,
    pub(crate) http: reqwest::Client,
    _directory: TempDir,
}

impl Service {
    pub(crate) async fn start() -> Self {
        Self::with(|_| {}, default_analysis()).await
    }

    pub(crate) async fn with(change: impl FnOnce(&mut Settings), analyze: Arc<Analyze>) -> Self {
        let directory = TempDir::new().unwrap();
        let mut settings = Settings {
            listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 0)),
            database: directory.path().join("test.db").into(),
            grace_seconds: 0,
            ..Settings::default()
        };
        change(&mut settings);
        let app = App::start_with(settings, analyze).await.unwrap();
        Self { app, http: reqwest::Client::new(), _directory: directory }
    }

    pub(crate) fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.app.address())
    }

    pub(crate) async fn json(&self, path: &str) -> Value {
        self.http.get(self.url(path)).send().await.unwrap().error_for_status().unwrap().json().await.unwrap()
    }

    pub(crate) async fn bytes(&self, path: &str) -> Vec<u8> {
        let answer = self.http.get(self.url(path)).send().await.unwrap().error_for_status().unwrap();
        answer.bytes().await.unwrap().to_vec()
    }

    /// Uploads a scan, waits for its job, and gives the job's id.
    pub(crate) async fn job(&self, query: &str, file: impl Into<reqwest::Body>) -> String {
        let answer = self.http.post(self.url(&format!("/clouds?{query}"))).body(file).send().await.unwrap();
        let answer: Value = answer.error_for_status().unwrap().json().await.unwrap();
        let id = answer["job"]["id"].as_str().unwrap().to_owned();
        let job = self.json(&format!("/jobs/{id}?wait=60")).await;
        assert_eq!(job["state"], "succeeded", "{job}");
        id
    }
}

/// A cloud of a torus with two holes, which has no symmetry that leaves modes arbitrary.
pub(crate) fn torus(points: usize) -> PointCloud {
    sample(&SampleRequest::new(Shape::TwoHoleTorus, points)).unwrap()
}

/// Points as lines of text, moved by `by`.
pub(crate) fn text(cloud: &PointCloud, by: [f64; 3]) -> String {
    let mut text = String::new();
    for row in 0..cloud.len() {
        let [x, y, z] = [0, 1, 2].map(|axis| cloud.point(row)[axis] + by[axis]);
        writeln!(text, "{x} {y} {z}").unwrap();
    }
    text
}
