//! Three nodes on one PostgreSQL database while nodes are killed and started, one is stopped for longer than a lease, and
//! the server itself crashes.
//!
//! 20 rounds; `CHLADNI_NODE_ROUNDS=200` does more, `CHLADNI_NODE_SEED` repeats the choices of a run. It takes some minutes,
//! because a lease takes one to run out. With `CHLADNI_OLDER=PROGRAM` the nodes begin as that version and are this one when
//! they start again: a rolling replacement.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use uuid::Uuid;

use crate::cluster::Cluster;
use crate::process::{Process, number, sphere, submit};

const NODES: usize = 3;
/// Jobs of a round: 500 in 20 rounds.
const SUBMISSIONS: usize = 25;
const BASES: usize = 3;

/// Longer than a lease, so that others take up what the stopped node had.
const STOPPED: Duration = Duration::from_mins(2);

/// Every job has ended by then, a lease after the last kill included.
const DRAINED: Duration = Duration::from_mins(10);

/// A cluster and a database, or why there is none.
#[allow(clippy::print_stdout)] // a skipped test must say so
pub(crate) fn cluster() -> Option<(Cluster, String)> {
    match Cluster::start() {
        Ok(cluster) => {
            cluster.sql("postgres", "CREATE DATABASE chladni");
            let address = cluster.address("chladni");
            Some((cluster, address))
        }
        Err(why) => {
            let _ = writeln!(std::io::stderr(), "SKIPPED: the tests of nodes, for {why}");
            None
        }
    }
}

struct Nodes {
    address: String,
    folder: tempfile::TempDir,
    running: Vec<Process>,
}

impl Nodes {
    fn start(address: &str, count: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut nodes = Self { address: address.to_owned(), folder, running: Vec::new() };
        let older = std::env::var("CHLADNI_OLDER");
        let program = older.as_deref().unwrap_or(env!("CARGO_BIN_EXE_chladni"));
        nodes.running = (0..count).map(|place| nodes.node_of(Path::new(program), place, &[])).collect();
        nodes
    }

    fn log(&self, place: usize) -> PathBuf {
        self.folder.path().join(format!("node{place}.log"))
    }

    fn node(&self, place: usize, flags: &[&str]) -> Process {
        self.node_of(Path::new(env!("CARGO_BIN_EXE_chladni")), place, flags)
    }

    fn node_of(&self, program: &Path, place: usize, flags: &[&str]) -> Process {
        let flags = [&["--threads", "1", "--memory-budget", "1GiB"], flags].concat();
        Process::of(program, &self.address, self.log(place), &flags, &[])
    }

    /// How often this node had to leave a job to another.
    fn lost(&self, place: usize) -> usize {
        std::fs::read_to_string(self.log(place)).unwrap().matches("the claim was lost").count()
    }
}

fn signal(process: &Process, name: &str) {
    assert!(Command::new("kill").args([name, &process.id().to_string()]).status().unwrap().success());
}

#[tokio::test(flavor = "multi_thread")]
async fn whatever_nodes_and_server_do_every_acknowledged_job_ends_once() {
    let Some((cluster, address)) = cluster() else { return };
    let (rounds, seed) =
        (number("CHLADNI_NODE_ROUNDS", 20), number("CHLADNI_NODE_SEED", Uuid::now_v7().as_u64_pair().1));
    println!("{rounds} rounds from CHLADNI_NODE_SEED={seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut nodes = Nodes::start(&address, NODES);
    // The last node is only ever stopped, the others are only ever killed.
    let last = NODES - 1;
    let (mut acknowledged, mut stopped, mut restarts) = (Vec::new(), None, 0);
    for round in 0..rounds {
        if round == rounds / 4 {
            signal(&nodes.running[last], "-STOP");
            stopped = Some(Instant::now());
        }
        let answering = if stopped.is_some() { last } else { NODES };
        for _ in 0..SUBMISSIONS {
            let node = &nodes.running[random.random_range(0..answering)];
            let query = format!("bases={BASES}&operator=voronoi&tolerance=1.{round:03}e-{}", 3 + round % 8);
            let cloud = sphere(random.random_range(30..130));
            // What is not acknowledged may be lost.
            if let Ok(job) = submit(&node.client, &node.address, &query, cloud).await {
                acknowledged.push(job);
            }
        }
        if round == rounds / 2 {
            cluster.restart();
            restarts += 1;
        }
        tokio::time::sleep(Duration::from_millis(random.random_range(0..300))).await;
        let victim = random.random_range(0..last);
        nodes.running[victim].kill();
        nodes.running[victim] = nodes.node(victim, &[]);
    }
    acknowledged.sort_unstable();
    acknowledged.dedup();
    let until = Instant::now() + DRAINED;
    // Asked of the database: hundreds of jobs, asked for one by one, would keep the nodes from computing.
    let open = "SELECT count(*) FROM jobs WHERE state IN ('queued', 'running')";
    while stopped.is_some() || cluster.sql("chladni", open) != "0" {
        assert!(Instant::now() < until, "{} jobs do not end", cluster.sql("chladni", open));
        if stopped.is_some_and(|since| since.elapsed() > STOPPED) {
            signal(&nodes.running[last], "-CONT");
            stopped = None;
        }
        tokio::time::sleep(Duration::from_millis(500)).await;
    }
    let mut ends = [0; 2];
    for (place, job) in acknowledged.iter().enumerate() {
        let ended = nodes.running[place % NODES].json(&format!("/jobs/{job}")).await;
        if ended["state"] == "succeeded" {
            ends[0] += 1;
        } else {
            // It happened to run at three kills.
            assert_eq!(
                (&ended["error"]["code"], &ended["attempt"]),
                (&"crashed".into(), &3.into()),
                "{ended}"
            );
            ends[1] += 1;
        }
    }
    println!(
        "{} jobs acknowledged: {} succeeded, {} failed after three attempts",
        acknowledged.len(),
        ends[0],
        ends[1]
    );
    assert!(acknowledged.len() as u64 > rounds * SUBMISSIONS as u64 / 2, "hardly anything was acknowledged");
    assert_whole(&cluster);
    // Those that were killed leave nothing behind them; whoever was alive kept its jobs, but for one whose end was
    // acknowledged by a server that crashed before it could say so.
    for place in 0..last {
        assert!(nodes.lost(place) <= restarts, "node {place} lost jobs that were its own");
    }
    println!("the stopped node lost {} jobs to others", nodes.lost(last));
    // The same bytes from all, the one that was stopped included.
    for job in acknowledged.iter().step_by(acknowledged.len() / 5 + 1) {
        let path = format!("/jobs/{job}/bases.npy");
        let [first, second, third] = [0, 1, 2].map(|place| nodes.running[place].get(&path));
        let (first, second, third) = (first.await, second.await, third.await);
        let status = first.status();
        let first = first.bytes().await.unwrap();
        assert_eq!((status, &first), (second.status(), &second.bytes().await.unwrap()));
        assert_eq!((status, &first), (third.status(), &third.bytes().await.unwrap()));
    }
}

/// Results are whole, and nothing is left of attempts that did not come to an end.
fn assert_whole(cluster: &Cluster) {
    let partial = "SELECT count(*) FROM jobs j WHERE state = 'succeeded' AND (\
        (SELECT count(*) FROM bases b WHERE b.job_id = j.id) <> (parameters::json ->> 'bases')::int OR \
        (SELECT count(*) FROM basis_chunks b WHERE b.job_id = j.id) <> (parameters::json ->> 'bases')::int OR \
        (SELECT count(*) FROM array_chunks a WHERE a.job_id = j.id) <> 1)";
    assert_eq!(cluster.sql("chladni", partial), "0", "a result is visible in part");
    let twice = "SELECT count(*) FROM (SELECT 1 FROM jobs WHERE state = 'succeeded' \
        GROUP BY cloud_id, kind, parameters HAVING count(*) > 1) t";
    assert_eq!(cluster.sql("chladni", twice), "0", "an analysis is stored twice");
}

#[tokio::test(flavor = "multi_thread")]
async fn one_node_takes_a_job_another_computes_it_a_third_tells_of_it_and_a_fourth_cancels_it() {
    let Some((_cluster, address)) = cluster() else { return };
    let mut nodes = Nodes::start(&address, 0);
    for place in 0..3 {
        nodes.running.push(nodes.node(place, &["--workers", "0"]));
    }
    let job = nodes.running[0].submit("bases=300&operator=voronoi", sphere(40_000)).await.unwrap();
    let mut events = nodes.running[1].get(&format!("/jobs/{job}/events")).await;
    assert_eq!(
        nodes.running[2].json(&format!("/jobs/{job}")).await["state"],
        "queued",
        "nobody computes yet"
    );
    let mut computing = Command::new(env!("CARGO_BIN_EXE_chladni"))
        .args(["serve", "--no-listen", "--threads", "1", "--database", &address])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let mut told = String::new();
    let mut canceled = None;
    let until = Instant::now() + Duration::from_mins(2);
    while !told.contains("\"canceled\"") && Instant::now() < until {
        let next = tokio::time::timeout(Duration::from_mins(1), events.chunk()).await;
        let Ok(Ok(Some(chunk))) = next else { break };
        told.push_str(&String::from_utf8_lossy(&chunk));
        if canceled.is_none() && told.contains("\"running\"") {
            let url = format!("{}/jobs/{job}/cancel", nodes.running[2].address);
            let answer = nodes.running[2].client.post(url).send().await.unwrap();
            assert!(answer.status().is_success(), "{}", answer.status());
            canceled = Some(Instant::now());
        }
    }
    println!("canceled at another node after {:?}", canceled.map(|at| at.elapsed()));
    let _ = computing.kill();
    let _ = computing.wait();
    assert!(told.contains("\"canceled\""), "{told}");
}
