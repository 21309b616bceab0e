//! The database file in the hands of its operator: served once, killed in its first start, compacted.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use uuid::Uuid;

use crate::process::{Process, number, sphere};

fn run(command: &str, database: &Path) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_chladni"));
    program.arg(command).arg("--database").arg(database);
    if command == "serve" {
        program.args(["--listen", "127.0.0.1:0"]);
    }
    program.output().unwrap()
}

fn words(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_service_on_the_same_file_is_refused_and_the_first_keeps_its_job() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("one.db");
    let mut first = Process::start(&database);
    let job = first.submit("bases=100&operator=voronoi", sphere(8000)).await.unwrap();
    for command in ["serve", "compact"] {
        let refused = run(command, &database);
        assert!(!refused.status.success(), "{command}");
        let expected = format!("in use by another chladni (process {})", first.id());
        assert!(words(&refused).contains(&expected), "{command}: {}", words(&refused));
    }
    let ended = first.ended(&job).await;
    assert_eq!((&ended["state"], &ended["attempt"]), (&"succeeded".into(), &1.into()), "{ended}");
    first.kill();
    let again = Process::start(&database);
    assert_eq!(again.json(&format!("/jobs/{job}")).await["state"], "succeeded");
}

#[tokio::test(flavor = "multi_thread")]
async fn compacting_gives_the_space_of_deleted_data_back_and_keeps_the_rest() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("large.db");
    let size = || std::fs::metadata(&database).unwrap().len();
    let mut service = Process::start(&database);
    let kept = service.submit("bases=3&operator=voronoi", sphere(60)).await.unwrap();
    assert_eq!(service.ended(&kept).await["state"], "succeeded");
    let bases = service.bytes(&format!("/jobs/{kept}/bases.npy")).await;
    let stored =
        service.client.put(format!("{}/clouds?analyze=false", service.address)).body(sphere(200_000));
    let stored: serde_json::Value = stored.send().await.unwrap().json().await.unwrap();
    let cloud = stored["cloud"]["id"].as_str().unwrap();
    let deleted = service.client.delete(format!("{}/clouds/{cloud}", service.address)).send().await.unwrap();
    assert!(deleted.status().is_success());
    service.kill();

    let compacted = run("compact", &database);
    assert!(compacted.status.success(), "{}", words(&compacted));
    assert!(size() < 1 << 20, "{}", size());
    let files: Vec<_> =
        std::fs::read_dir(directory.path()).unwrap().map(|file| file.unwrap().file_name()).collect();
    assert!(!files.iter().any(|name| name.to_str().unwrap().contains("compact")), "{files:?}");
    let service = Process::start(&database);
    assert_eq!(service.bytes(&format!("/jobs/{kept}/bases.npy")).await, bases);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_file_shrinks_by_itself_while_it_is_served() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("shrinking.db");
    let service = Process::start(&database);
    let stored =
        service.client.put(format!("{}/clouds?analyze=false", service.address)).body(sphere(2_000_000));
    let stored: serde_json::Value = stored.send().await.unwrap().json().await.unwrap();
    let cloud = stored["cloud"]["id"].as_str().unwrap();
    assert!(gauge(&service, "chladni_database_file_bytes").await > 40e6);
    let deleted = service.client.delete(format!("{}/clouds/{cloud}", service.address)).send().await.unwrap();
    assert!(deleted.status().is_success());
    assert!(gauge(&service, "chladni_database_free_bytes").await > 40e6);
    while gauge(&service, "chladni_database_file_bytes").await > 20e6 {
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

async fn gauge(service: &Process, name: &str) -> f64 {
    let text = service.get("/metrics").await.text().await.unwrap();
    let line = text.lines().find(|line| line.starts_with(&format!("{name} "))).unwrap();
    line.split(' ').nth(1).unwrap().parse().unwrap()
}

/// 30 rounds; `CHLADNI_CRASH_ROUNDS` does more.
#[tokio::test(flavor = "multi_thread")]
async fn a_first_start_that_is_killed_leaves_a_file_that_starts() {
    let rounds = number("CHLADNI_CRASH_ROUNDS", 30);
    let seed = number("CHLADNI_CRASH_SEED", Uuid::now_v7().as_u64_pair().1);
    println!("{rounds} first starts killed, from CHLADNI_CRASH_SEED={seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for round in 0..rounds {
        let directory = tempfile::tempdir().unwrap();
        let database = directory.path().join("first.db");
        let mut child = Command::new(env!("CARGO_BIN_EXE_chladni"))
            .args(["serve", "--listen", "127.0.0.1:0", "--database"])
            .arg(&database)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        while !database.exists() {
            tokio::task::yield_now().await;
        }
        tokio::time::sleep(Duration::from_micros(random.random_range(0..60_000))).await;
        child.kill().unwrap();
        child.wait().unwrap();
        let process = Process::start(&database);
        assert_eq!(process.get("/readyz").await.status(), 200, "round {round}");
    }
    println!("0 of them never start");
}
