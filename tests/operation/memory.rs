//! A large result is streamed: it never stands in memory.
//!
//! 128 MiB by default; `CHLADNI_LOAD_BYTES=1073741824` is the measured run.

use chladni::analysis::JobKind;
use chladni::store::{ArrayName, Numbers, Store};
use futures_util::StreamExt;
use uuid::Uuid;

use crate::process::{Process, sphere};
use crate::stage::{basis_values, cloud, mass, parameters, report, vitals};

fn status(process: u32, field: &str) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let line = status.lines().find(|line| line.starts_with(field)).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() << 10
}

/// Bytes of memory that a process has now.
pub(crate) fn resident(process: u32) -> u64 {
    status(process, "VmRSS:")
}

/// The most it has had since it was told to forget.
pub(crate) fn peak(process: u32) -> u64 {
    status(process, "VmHWM:")
}

pub(crate) fn forget_peak(process: u32) {
    std::fs::write(format!("/proc/{process}/clear_refs"), "5").unwrap();
}

/// Bases stored in one transaction.
const BATCH: usize = 16;

/// Stores a job whose bases take so many bytes, as a worker would; its id and the cloud's points.
async fn stored(database: &std::path::Path, bytes: usize, bases: usize) -> (Uuid, usize) {
    let n = bytes / (8 * bases);
    let store = Store::open(database, 10).await.unwrap();
    let submitted = store.submit(&cloud(n, 1), Some((JobKind::Eigen, parameters(bases)))).await.unwrap();
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    store.begin_result(&claim).await.unwrap();
    store.put_array(&claim, ArrayName::Mass, Numbers::F64(mass(n))).await.unwrap();
    for first in (0..bases).step_by(BATCH) {
        let batch = (first..bases.min(first + BATCH)).map(|j| basis_values(n, j)).collect();
        store.put_bases(&claim, batch).await.unwrap();
    }
    store.finish(&claim, &report(n, bases), &vitals()).await.unwrap();
    store.close().await;
    (submitted.job.unwrap().id, n)
}

/// Most that serving may take, of whatever size: blocks on their way, and what the allocator keeps for a while.
const GROWTH_MAX: u64 = 96 << 20;

/// Stores a result of so many bases, takes all of it and a part of it, and tells what that took.
async fn served_with_little_memory(bases: usize) -> String {
    let bytes = std::env::var("CHLADNI_LOAD_BYTES").map_or(128 << 20, |bytes| bytes.parse().unwrap());
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("large.db");
    let (job, n) = stored(&database, bytes, bases).await;
    let process = Process::start(&database);
    process.json("/readyz").await;
    let mut told = Vec::new();
    for (file, numbers) in
        [("bases.npy", 8 * n * bases), ("bases.npy?dtype=f32&first=1", 4 * n * (bases - 1))]
    {
        let before = resident(process.id());
        forget_peak(process.id());
        let mut answer = process.get(&format!("/jobs/{job}/{file}")).await.bytes_stream();
        let mut served = 0;
        while let Some(chunk) = answer.next().await {
            served += chunk.unwrap().len();
        }
        let growth = peak(process.id()).saturating_sub(before);
        told.push(format!("{} MiB of {file}: {} MiB", served >> 20, growth >> 20));
        assert_eq!(served % 64, numbers % 64, "header and numbers");
        assert!(served > numbers);
        assert!(growth < GROWTH_MAX, "{growth}");
    }
    format!("{bases} bases, served and resident memory grown by: {}", told.join("; "))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_large_result_is_served_with_little_memory() {
    println!("{}", served_with_little_memory(32).await);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_large_result_of_many_bases_is_served_with_little_memory() {
    println!("{}", served_with_little_memory(1000).await);
}

#[tokio::test(flavor = "multi_thread")]
async fn posted_numbers_take_a_few_times_their_text() {
    const BYTES: usize = 32 << 20;
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("posted.db");
    let (job, _) = stored(&database, 1 << 20, 32).await;
    let process = Process::with(&database, &["--body-memory", &(6 * BYTES).to_string()], &[]);
    process.json("/readyz").await;
    let before = resident(process.id());
    forget_peak(process.id());
    let text = format!("[{}1]", "1,".repeat(BYTES / 2 - 2));
    let url = format!("{}/jobs/{job}/synthesis", process.address);
    let refused = process.client.post(url).body(text).send().await.unwrap();
    assert_eq!(refused.status(), reqwest::StatusCode::UNPROCESSABLE_ENTITY, "there are not so many modes");
    let growth = peak(process.id()).saturating_sub(before) as usize;
    println!("{} MiB of JSON posted: resident memory grew by {} MiB", BYTES >> 20, growth >> 20);
    assert!(growth < 5 * BYTES + (64 << 20), "{growth}");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_takes_what_is_reserved_for_it() {
    const POINTS: u64 = 4_000_000;
    let directory = tempfile::tempdir().unwrap();
    let process = Process::start(&directory.path().join("upload.db"));
    process.json("/readyz").await;
    let mut file = format!("ply\nformat binary_little_endian 1.0\nelement vertex {POINTS}\n").into_bytes();
    file.extend(b"property float x\nproperty float y\nproperty float z\nend_header\n");
    // a generator of all residues (Knuth 1997, 3.2.1.2): no point repeats another
    let numbers =
        std::iter::successors(Some(1_u32), |x| Some(x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223)));
    file.extend(numbers.take(3 * POINTS as usize).flat_map(|x| (x as f32).to_le_bytes()));
    let bytes = file.len() as u64;
    let before = resident(process.id());
    forget_peak(process.id());
    let stored = process.client.put(format!("{}/clouds/scan.ply?analyze=false", process.address));
    assert_eq!(stored.body(file).send().await.unwrap().status(), reqwest::StatusCode::CREATED);
    let growth = peak(process.id()).saturating_sub(before);
    println!("{} MiB of PLY uploaded: resident memory grew by {} MiB", bytes >> 20, growth >> 20);
    assert!(growth < 5 * bytes + (16 << 20), "{growth}");
}

/// What the service reserves for a pixel of a picture (`http/results/view.rs`).
const PIXEL_BYTES: u64 = 124;

#[tokio::test(flavor = "multi_thread")]
async fn a_picture_takes_what_is_reserved_for_it() {
    const SIDE: u64 = 2048;
    let directory = tempfile::tempdir().unwrap();
    let process = Process::start(&directory.path().join("picture.db"));
    let job = process.submit("bases=4&operator=voronoi", sphere(4_000)).await.unwrap();
    assert_eq!(process.ended(&job).await["state"], "succeeded");
    let before = resident(process.id());
    forget_peak(process.id());
    let picture = process.bytes(&format!("/jobs/{job}/bases/3/image.png?width={SIDE}&height={SIDE}")).await;
    let growth = peak(process.id()).saturating_sub(before);
    println!("{} KiB of picture: resident memory grew by {} MiB", picture.len() >> 10, growth >> 20);
    assert!(growth < SIDE * SIDE * PIXEL_BYTES + (32 << 20), "{growth}");
}
