//! Stops and crashes: what was acknowledged is there afterwards.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use chladni::cloud::reader::Format;
use reqwest::StatusCode;
use serde_json::Value;

use crate::service::{Service, file, never_finishing, sphere};

#[tokio::test]
async fn what_was_finished_is_there_after_a_restart() {
    let service = Service::start().await;
    let id = service.succeed("bases=4", file(&sphere(300), Format::Ply)).await;
    let before = service.get(&format!("/jobs/{id}/bases.npy")).await.bytes().await.unwrap();
    let service = service.restart().await;
    let after = service.get(&format!("/jobs/{id}/bases.npy")).await.bytes().await.unwrap();
    assert_eq!(before, after);
}

#[tokio::test]
async fn a_job_that_a_stop_interrupts_runs_again_and_is_not_blamed() {
    let service = Service::that_never_finishes().await;
    let submission = service.accept("bases=4", file(&sphere(300), Format::Ply)).await;
    let id = submission["job"]["id"].as_str().unwrap();
    service.running(id).await;
    let service = service.restart().await;
    let job = service.finished(id).await;
    assert_eq!(job["state"], "succeeded", "{job}");
    assert_eq!(job["attempt"], 1);
}

#[tokio::test]
async fn a_stop_answers_who_waits() {
    let service = Service::start_with(|settings| settings.grace_seconds = 1, never_finishing()).await;
    let submission = service.accept("bases=4", file(&sphere(300), Format::Ply)).await;
    let id = submission["job"]["id"].as_str().unwrap();
    service.running(id).await;
    // The first request is sent before this one, which takes a second.
    let waiting = tokio::spawn(service.client.get(service.url(&format!("/jobs/{id}?wait=60"))).send());
    service.get(&format!("/jobs/{id}?wait=1")).await;
    service.app.shutdown().await;
    assert_eq!(waiting.await.unwrap().unwrap().status(), StatusCode::OK);
}

/// The real binary on a database.
struct Process {
    child: Child,
    address: String,
}

impl Process {
    fn start(database: &Path) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_chladni"))
            .args(["serve", "--listen", "127.0.0.1:0", "--database"])
            .arg(database)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.split_whitespace().find(|word| word.starts_with("http://")).unwrap().to_owned();
        Self { child, address }
    }

    /// Ends at once, as `kill -9` does.
    fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    async fn json(&self, path: &str) -> Value {
        let response = reqwest::get(format!("{}{path}", self.address)).await.unwrap();
        assert!(response.status().is_success(), "{path}: {}", response.status());
        response.json().await.unwrap()
    }

    async fn submit(&self, points: usize, bases: usize) -> String {
        let url = format!("{}/clouds?bases={bases}", self.address);
        let body = file(&sphere(points), Format::Npy);
        let response = reqwest::Client::new().put(url).body(body).send().await.unwrap();
        assert_eq!(response.status(), StatusCode::ACCEPTED);
        response.json::<Value>().await.unwrap()["job"]["id"].as_str().unwrap().to_owned()
    }

    async fn ended(&self, job: &str) -> Value {
        loop {
            let job = self.json(&format!("/jobs/{job}?wait=60")).await;
            if !matches!(job["state"].as_str(), Some("queued" | "running")) {
                return job;
            }
        }
    }
}

#[tokio::test]
async fn a_killed_process_loses_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("test.db");
    let process = Process::start(&database);
    let done = process.submit(300, 4).await;
    assert_eq!(process.ended(&done).await["state"], "succeeded");
    let interrupted = process.submit(30_000, 60).await;
    while process.json(&format!("/jobs/{interrupted}?wait=1")).await["state"] == "queued" {}
    process.kill();

    let process = Process::start(&database);
    let job = process.ended(&interrupted).await;
    assert_eq!(job["state"], "succeeded", "{job}");
    assert_eq!(job["attempt"], 2, "{job}");
    assert_eq!(process.json(&format!("/jobs/{done}/bases")).await["count"], 4);
    process.kill();
}
