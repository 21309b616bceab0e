//! The binary, running on a database; and what is asked of it.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use chladni::cloud::reader::Format;
use chladni::cloud::shapes::{SampleRequest, Shape, sample};
use chladni::cloud::writer::write;
use reqwest::{Client, Response, StatusCode};
use serde_json::Value;

/// A running service; it is killed when the test ends.
pub(crate) struct Process {
    child: Child,
    pub(crate) address: String,
    pub(crate) client: Client,
    /// Its standard error.
    pub(crate) log: PathBuf,
}

impl Process {
    pub(crate) fn start(database: &Path) -> Self {
        Self::with(database, &[], &[])
    }

    /// With further flags and environment.
    pub(crate) fn with(database: &Path, flags: &[&str], environment: &[(&str, &str)]) -> Self {
        let address = database.to_str().unwrap();
        Self::at(address, database.with_extension("log"), flags, environment)
    }

    /// On the database at a file or an address.
    pub(crate) fn at(database: &str, log: PathBuf, flags: &[&str], environment: &[(&str, &str)]) -> Self {
        Self::of(Path::new(env!("CARGO_BIN_EXE_chladni")), database, log, flags, environment)
    }

    /// The same of another binary.
    pub(crate) fn of(
        program: &Path,
        database: &str,
        log: PathBuf,
        flags: &[&str],
        environment: &[(&str, &str)],
    ) -> Self {
        let mut child = Command::new(program)
            .args(["serve", "--listen", "127.0.0.1:0", "--disk-floor", "0", "--database"])
            .arg(database)
            .args(flags)
            .envs(environment.iter().copied())
            .stdout(Stdio::piped())
            .stderr(File::options().create(true).append(true).open(&log).unwrap())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.split_whitespace().find(|word| word.starts_with("http://"));
        let address = address.expect("it did not start; its log says why").to_owned();
        Self { child, address, client: Client::new(), log }
    }

    /// Ends it at once, as `kill -9` does.
    pub(crate) fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    pub(crate) async fn get(&self, path: &str) -> Response {
        self.client.get(format!("{}{path}", self.address)).send().await.unwrap()
    }

    pub(crate) async fn json(&self, path: &str) -> Value {
        let response = self.get(path).await;
        assert!(response.status().is_success(), "{path}: {}", response.status());
        response.json().await.unwrap()
    }

    pub(crate) async fn bytes(&self, path: &str) -> Vec<u8> {
        let response = self.get(path).await;
        assert_eq!(response.status(), StatusCode::OK, "{path}");
        response.bytes().await.unwrap().to_vec()
    }

    /// The id of the job, once it is acknowledged.
    pub(crate) async fn submit(&self, query: &str, cloud: Vec<u8>) -> Result<String, reqwest::Error> {
        submit(&self.client, &self.address, query, cloud).await
    }

    /// The job once it has ended.
    pub(crate) async fn ended(&self, job: &str) -> Value {
        loop {
            let job = self.json(&format!("/jobs/{job}?wait=60")).await;
            if !matches!(job["state"].as_str(), Some("queued" | "running")) {
                return job;
            }
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Submits a cloud; the id of its job, once that is acknowledged.
pub(crate) async fn submit(
    client: &Client,
    address: &str,
    query: &str,
    cloud: Vec<u8>,
) -> Result<String, reqwest::Error> {
    let answer = client.put(format!("{address}/clouds?{query}")).body(cloud).send().await?;
    let answer: Value = answer.error_for_status()?.json().await?;
    Ok(answer["job"]["id"].as_str().unwrap().to_owned())
}

/// A sphere as a file.
pub(crate) fn sphere(points: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let cloud = sample(&SampleRequest::new(Shape::Sphere, points)).unwrap();
    write(&cloud, Format::Npy, &mut bytes).unwrap();
    bytes
}

/// A number from the environment.
pub(crate) fn number(variable: &str, otherwise: u64) -> u64 {
    std::env::var(variable).map_or(otherwise, |text| text.parse().unwrap())
}
