//! Kills the service over and over, at random and at chosen places, and asks what is left.
//!
//! The chosen places need no help from the service: SQLite lets one process write at a time, so a test that holds the
//! write lock sees exactly how far a job's result is stored, and the service can go no further before it is killed.
//!
//! 50 rounds; `CHLADNI_CRASH_ROUNDS=1000` does more, `CHLADNI_CRASH_SEED` repeats a run.

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, SqliteConnection};
use uuid::Uuid;

use crate::process::{Process, number, sphere, submit};

/// Clouds that every round submits.
const SUBMISSIONS: usize = 3;
const BASES: usize = 3;

/// A log that is not written to for so long has nothing more to come.
const QUIET: Duration = Duration::from_millis(200);

/// How far a running job is, as the database tells.
const CLAIMED: &str = "SELECT count(*) FROM jobs WHERE state = 'running'";
const MASS_STORED: &str =
    "SELECT count(*) FROM jobs j JOIN arrays a ON a.job_id = j.id WHERE j.state = 'running'";
const BASES_STORED: &str =
    "SELECT count(*) FROM jobs j JOIN bases b ON b.job_id = j.id WHERE j.state = 'running'";

/// All is stored but the end.
const ALL_STORED: &str =
    "SELECT count(*) FROM jobs j JOIN coefficients c ON c.job_id = j.id WHERE j.state = 'running'";
/// A result is visible.
const FINISHED: &str = "SELECT count(*) FROM jobs WHERE state = 'succeeded'";

/// When to kill.
#[derive(Debug, Clone, Copy)]
enum Moment {
    After(Duration),
    /// As soon as this counts more than it did before, or nothing is left to do: between two transactions.
    When(&'static str, i64),
    /// As soon as the write-ahead log has been written to so often, or has not for a while: within a transaction, or while
    /// it is committed.
    Writing(usize),
}

async fn open(database: &Path) -> SqliteConnection {
    SqliteConnectOptions::new().filename(database).connect().await.unwrap()
}

async fn count(file: &mut SqliteConnection, query: &'static str) -> i64 {
    sqlx::query_scalar(query).fetch_one(file).await.unwrap()
}

/// Kills the process at its moment. What it was doing then, it holds no lock for.
async fn kill_at(process: &mut Process, database: &Path, moment: Moment) {
    match moment {
        Moment::After(pause) => {
            tokio::time::sleep(pause).await;
            process.kill();
        }
        Moment::When(reached, before) => {
            let mut file = open(database).await;
            loop {
                sqlx::query("BEGIN IMMEDIATE").execute(&mut file).await.unwrap();
                let idle = count(
                    &mut file,
                    "SELECT NOT EXISTS (SELECT 1 FROM jobs WHERE state IN ('queued', 'running'))",
                )
                .await;
                if idle == 1 || count(&mut file, reached).await > before {
                    process.kill();
                    break;
                }
                sqlx::query("ROLLBACK").execute(&mut file).await.unwrap();
            }
        }
        Moment::Writing(times) => {
            let log = database.with_extension("db-wal");
            let written = || std::fs::metadata(&log).map(|log| (log.len(), log.modified().unwrap())).ok();
            let (mut last, mut seen, mut quiet) = (written(), 0, Instant::now());
            while seen < times && quiet.elapsed() < QUIET {
                let now = written();
                if now != last {
                    (last, seen, quiet) = (now, seen + 1, Instant::now());
                }
                tokio::task::yield_now().await;
            }
            process.kill();
        }
    }
}

/// What must hold at any moment, whatever was killed.
async fn assert_sound(database: &Path, acknowledged: &[String]) {
    let mut file = open(database).await;
    let verdict: Vec<String> =
        sqlx::query_scalar("PRAGMA integrity_check").fetch_all(&mut file).await.unwrap();
    assert_eq!(verdict, ["ok"]);
    assert_eq!(sqlx::query("PRAGMA foreign_key_check").fetch_all(&mut file).await.unwrap().len(), 0);
    for job in acknowledged {
        let id: Uuid = job.parse().unwrap();
        let stored: i64 = sqlx::query_scalar("SELECT count(*) FROM jobs WHERE id = ?1")
            .bind(id)
            .fetch_one(&mut file)
            .await
            .unwrap();
        assert_eq!(stored, 1, "job {job} was acknowledged and is lost");
    }
    // A result is whole as soon as it is visible.
    let partial = "SELECT count(*) FROM jobs j WHERE state = 'succeeded' AND (\
        (SELECT count(*) FROM bases b WHERE b.job_id = j.id) <> json_extract(parameters, '$.bases') OR \
        (SELECT count(*) FROM basis_chunks b WHERE b.job_id = j.id) <> json_extract(parameters, '$.bases') OR \
        (SELECT count(*) FROM array_chunks a WHERE a.job_id = j.id) <> 1)";
    assert_eq!(count(&mut file, partial).await, 0, "a result is visible in part");
}

#[tokio::test(flavor = "multi_thread")]
async fn whatever_is_killed_when_no_acknowledged_job_is_lost_and_no_result_is_partial() {
    let (rounds, seed) =
        (number("CHLADNI_CRASH_ROUNDS", 50), number("CHLADNI_CRASH_SEED", Uuid::now_v7().as_u64_pair().1));
    println!("{rounds} rounds from CHLADNI_CRASH_SEED={seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("crash.db");
    let acknowledged = Arc::new(Mutex::new(Vec::new()));
    for round in 0..rounds {
        let mut process = Process::start(&database);
        let finished = count(&mut open(&database).await, FINISHED).await;
        let clouds: Vec<_> = (0..SUBMISSIONS).map(|_| sphere(random.random_range(30..130))).collect();
        let (client, address, told) =
            (process.client.clone(), process.address.clone(), Arc::clone(&acknowledged));
        let submitting = tokio::spawn(async move {
            for cloud in clouds {
                // Another tolerance: another job, also on a cloud that is there already.
                let query =
                    format!("bases={BASES}&operator=voronoi&tolerance=1.{round:03}e-{}", 3 + round % 8);
                let Ok(job) = submit(&client, &address, &query, cloud).await else { return };
                told.lock().unwrap().push(job);
            }
        });
        let moment = match random.random_range(0..10) {
            0 => Moment::When(CLAIMED, 0),
            1 => Moment::When(MASS_STORED, 0),
            2 => Moment::When(BASES_STORED, 0),
            3 => Moment::When(ALL_STORED, 0),
            4 => Moment::When(FINISHED, finished),
            5 | 6 => Moment::Writing(random.random_range(1..30)),
            _ => Moment::After(Duration::from_millis(random.random_range(0..150))),
        };
        if matches!(moment, Moment::When(..)) {
            // There is something to wait for.
            while acknowledged.lock().unwrap().is_empty() && !submitting.is_finished() {
                tokio::task::yield_now().await;
            }
        }
        kill_at(&mut process, &database, moment).await;
        submitting.await.unwrap();
        let known = acknowledged.lock().unwrap().clone();
        assert_sound(&database, &known).await;
    }

    let process = Process::start(&database);
    let known = acknowledged.lock().unwrap().clone();
    let mut ends = [0; 2];
    for id in &known {
        let job = process.ended(id).await;
        if job["state"] == "succeeded" {
            ends[0] += 1;
            let bases = process.json(&format!("/jobs/{id}/bases")).await;
            assert_eq!(bases["bases"].as_array().unwrap().len(), BASES);
        } else {
            // It happened to run when the process was killed, three times.
            assert_eq!((&job["state"], &job["attempt"]), (&"failed".into(), &3.into()), "{job}");
            assert_eq!(job["error"]["code"], "crashed");
            ends[1] += 1;
        }
    }
    println!(
        "{} jobs acknowledged: {} succeeded, {} failed after three attempts",
        known.len(),
        ends[0],
        ends[1]
    );
    assert!(known.len() as u64 > rounds / 2, "hardly anything was acknowledged: nothing was tried");
    assert_sound(&database, &known).await;
    let mut file = open(&database).await;
    let left = "SELECT count(*) FROM bases b JOIN jobs j ON j.id = b.job_id WHERE j.state <> 'succeeded'";
    assert_eq!(count(&mut file, left).await, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_kills_the_process_ends_failed_after_three_attempts_and_others_finish() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("poison.db");
    let mut poisonous = String::new();
    let mut innocent = Vec::new();
    let mut killed = 0;
    loop {
        let mut process = Process::start(&database);
        if killed == 0 {
            // Long enough that it cannot end before the test looks.
            poisonous = process.submit("bases=100&operator=voronoi", sphere(20_000)).await.unwrap();
            for points in 51..54 {
                innocent.push(process.submit("bases=3&operator=voronoi", sphere(points)).await.unwrap());
            }
        }
        // The test stands in for the job: whenever it runs, the process dies.
        let mut file = open(&database).await;
        let id: Uuid = poisonous.parse().unwrap();
        let state = loop {
            sqlx::query("BEGIN IMMEDIATE").execute(&mut file).await.unwrap();
            let state: String = sqlx::query_scalar("SELECT state FROM jobs WHERE id = ?1")
                .bind(id)
                .fetch_one(&mut file)
                .await
                .unwrap();
            if state != "queued" {
                break state;
            }
            sqlx::query("ROLLBACK").execute(&mut file).await.unwrap();
        };
        if state == "running" {
            process.kill();
            killed += 1;
            assert!(killed <= 3, "it runs for ever");
            continue;
        }
        sqlx::query("ROLLBACK").execute(&mut file).await.unwrap();
        let job = process.ended(&poisonous).await;
        assert_eq!((&job["state"], &job["attempt"]), (&"failed".into(), &3.into()), "{job}");
        assert_eq!(job["error"]["code"], "crashed");
        for id in &innocent {
            assert_eq!(process.ended(id).await["state"], "succeeded");
        }
        break;
    }
    assert_eq!(killed, 3);
}
