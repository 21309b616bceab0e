//! Many clients against a service whose cores are all computing.
//!
//! Short by default; `CHLADNI_LOAD_SECONDS=180` is the measured run, which also holds the bounds on time: those need a
//! machine that does nothing else.

use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

use reqwest::{Client, StatusCode};
use tokio::sync::Barrier;

use crate::process::{Process, sphere};

const CLIENTS: usize = 64;
/// Between two requests of a client.
const PACE: Duration = Duration::from_millis(200);
/// Of a client's requests, one in so many submits.
const SUBMITS: usize = 10;

#[derive(Default)]
struct Times {
    shown: Vec<Duration>,
    submitted: Vec<Duration>,
}

/// A client that asks for a job, and now and then submits one, until the time is over.
async fn visit(client: Client, address: String, job: String, number: usize, until: Instant) -> Times {
    let mut times = Times::default();
    let mut turn = number;
    while Instant::now() < until {
        let submits = turn.is_multiple_of(SUBMITS);
        let started = Instant::now();
        let answer = if submits {
            let query =
                format!("bases=3&operator=voronoi&tolerance=0.00{:04}", 1 + (number * 131 + turn) % 999);
            client.put(format!("{address}/clouds?{query}")).body(sphere(40 + number)).send().await.unwrap()
        } else {
            client.get(format!("{address}/jobs/{job}")).send().await.unwrap()
        };
        let status = answer.status();
        assert!(!answer.bytes().await.unwrap().is_empty());
        assert!(status.is_success(), "{status}");
        let list = if submits { &mut times.submitted } else { &mut times.shown };
        list.push(started.elapsed());
        turn += 1;
        tokio::time::sleep_until((started + PACE).into()).await;
    }
    times
}

fn quantile(times: &mut [Duration], share: f64) -> f64 {
    times.sort_unstable();
    let place = ((times.len() - 1) as f64 * share).round() as usize;
    times[place].as_secs_f64() * 1e3
}

#[tokio::test(flavor = "multi_thread")]
async fn many_clients_are_served_while_all_cores_compute() {
    let measured = std::env::var("CHLADNI_LOAD_SECONDS").ok();
    let seconds = measured.as_deref().map_or(3, |seconds| seconds.parse().unwrap());
    let directory = tempfile::tempdir().unwrap();
    let process = Process::with(&directory.path().join("load.db"), &["--queue-max", "1000000"], &[]);
    // computes for longer than the clients ask
    let (points, bases) = if measured.is_some() { (200_000, 1_000) } else { (60_000, 300) };
    let busy = process.submit(&format!("bases={bases}"), sphere(points)).await.unwrap();
    while process.json(&format!("/jobs/{busy}?wait=1")).await["state"] == "queued" {}
    let until = Instant::now() + Duration::from_secs(seconds);
    let visits: Vec<_> = (0..CLIENTS)
        .map(|number| {
            let (client, address, job) = (Client::new(), process.address.clone(), busy.clone());
            tokio::spawn(visit(client, address, job, number, until))
        })
        .collect();
    let mut all = Times::default();
    for visit in visits {
        let times = visit.await.unwrap();
        all.shown.extend(times.shown);
        all.submitted.extend(times.submitted);
    }
    let computing = process.json(&format!("/jobs/{busy}")).await["state"] == "running";
    let (shown, submitted) = (quantile(&mut all.shown, 0.99), quantile(&mut all.submitted, 0.99));
    println!(
        "{CLIENTS} clients, {seconds} s, cores {}: {} GET /jobs/{{id}}, median {:.1} ms, p99 {shown:.1} ms; \
         {} PUT /clouds, median {:.1} ms, p99 {submitted:.1} ms; 0 answers other than 2xx",
        if computing { "computing" } else { "computing at first" },
        all.shown.len(),
        quantile(&mut all.shown, 0.5),
        all.submitted.len(),
        quantile(&mut all.submitted, 0.5),
    );
    assert!(all.shown.len() > CLIENTS && !all.submitted.is_empty());
    let log = std::fs::read_to_string(&process.log).unwrap();
    assert!(!log.contains("locked") && !log.contains("ERROR"), "{log}");
    if measured.is_some() {
        assert!(computing, "a longer job is needed");
        assert!(shown < 20.0 && submitted < 50.0);
    }
}

/// What downloads ask for, as text that is compressed.
const TEXTS: [&str; 4] =
    ["bases?format=json&count=5", "bases.csv?count=5", "filtered.csv?cutoff=4", "spectrum.csv"];

/// A client that takes one answer of compressed text after the other until the time is over; the bytes that it took.
async fn download(client: Client, paths: Vec<String>, number: usize, until: Instant) -> usize {
    let (mut taken, mut turn) = (0, number);
    while Instant::now() < until {
        let request = client.get(&paths[turn % paths.len()]).header("accept-encoding", "gzip");
        let mut answer = request.send().await.unwrap();
        assert!(answer.status().is_success(), "{}", answer.status());
        while let Some(piece) = answer.chunk().await.unwrap() {
            taken += piece.len();
            if Instant::now() > until {
                return taken;
            }
        }
        turn += 1;
    }
    taken
}

/// Half of the clients ask for jobs and submit; the other half take compressed text without a pause.
#[tokio::test(flavor = "multi_thread")]
async fn jobs_are_shown_at_once_beside_downloads_of_compressed_text() {
    let measured = std::env::var("CHLADNI_LOAD_SECONDS").ok();
    let seconds = measured.as_deref().map_or(3, |seconds| seconds.parse().unwrap());
    let directory = tempfile::tempdir().unwrap();
    let process = Process::with(&directory.path().join("texts.db"), &["--queue-max", "1000000"], &[]);
    let points = if measured.is_some() { 60_000 } else { 10_000 };
    let eigen = process.submit("bases=10", sphere(points)).await.unwrap();
    let operator = process.submit("kind=operator", sphere(points)).await.unwrap();
    for job in [&eigen, &operator] {
        assert_eq!(process.ended(job).await["state"], "succeeded");
    }
    let (points, bases) = if measured.is_some() { (200_000, 1_000) } else { (60_000, 300) };
    let busy = process.submit(&format!("bases={bases}"), sphere(points)).await.unwrap();
    while process.json(&format!("/jobs/{busy}?wait=1")).await["state"] == "queued" {}
    let paths: Vec<String> = TEXTS
        .iter()
        .map(|text| format!("{}/jobs/{eigen}/{text}", process.address))
        .chain([format!("{}/jobs/{operator}/operator.mtx", process.address)])
        .collect();
    let until = Instant::now() + Duration::from_secs(seconds);
    let downloads: Vec<_> = (0..CLIENTS / 2)
        .map(|number| tokio::spawn(download(Client::new(), paths.clone(), number, until)))
        .collect();
    let visits: Vec<_> = (0..CLIENTS / 2)
        .map(|number| {
            tokio::spawn(visit(Client::new(), process.address.clone(), busy.clone(), number, until))
        })
        .collect();
    let mut all = Times::default();
    for visit in visits {
        let times = visit.await.unwrap();
        all.shown.extend(times.shown);
        all.submitted.extend(times.submitted);
    }
    let mut taken = 0;
    for download in downloads {
        taken += download.await.unwrap();
    }
    let shown = quantile(&mut all.shown, 0.99);
    println!(
        "{} clients that take {:.1} MB/s of compressed text, {} others, {seconds} s: {} GET /jobs/{{id}}, median {:.1} ms, \
         p99 {shown:.1} ms; {} PUT /clouds, p99 {:.1} ms",
        CLIENTS / 2,
        taken as f64 / seconds as f64 / 1e6,
        CLIENTS / 2,
        all.shown.len(),
        quantile(&mut all.shown, 0.5),
        all.submitted.len(),
        quantile(&mut all.submitted, 0.99),
    );
    assert!(taken > 0 && !all.shown.is_empty() && !all.submitted.is_empty());
    if measured.is_some() {
        assert!(shown < 20.0);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn uploads_at_the_same_time_stay_within_their_memory_and_all_arrive() {
    const UPLOADS: usize = 50;
    const BUDGET: u64 = 40 << 20;
    let directory = tempfile::tempdir().unwrap();
    let flags = ["--body-memory", &BUDGET.to_string()];
    let process = Process::with(&directory.path().join("uploads.db"), &flags, &[]);
    process.json("/readyz").await;
    let before = crate::memory::resident(process.id());
    crate::memory::forget_peak(process.id());
    // A megabyte of text each: all at once they would take six times the budget.
    let together = Arc::new(Barrier::new(UPLOADS));
    let uploads: Vec<_> = (0..UPLOADS)
        .map(|number| {
            let (client, url) =
                (Client::new(), format!("{}/clouds?analyze=false&format=xyz", process.address));
            let together = Arc::clone(&together);
            tokio::spawn(async move {
                let text = (0..90_000).fold(Vec::new(), |mut text, i| {
                    writeln!(text, "{i} {number} {}", i % 97).unwrap();
                    text
                });
                together.wait().await;
                client.post(url).body(text).send().await.unwrap().status()
            })
        })
        .collect();
    for upload in uploads {
        assert_eq!(upload.await.unwrap(), StatusCode::CREATED);
    }
    let growth = crate::memory::peak(process.id()).saturating_sub(before);
    println!(
        "{UPLOADS} uploads at once: resident memory grew by {} MiB of {} MiB",
        growth >> 20,
        BUDGET >> 20
    );
    // Beside the bodies: connections, the database's caches.
    assert!(growth < BUDGET + (64 << 20), "{growth}");
}
