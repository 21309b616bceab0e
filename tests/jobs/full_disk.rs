//! Writes that meet a full disk or a full file fail in words, and once there is room again all goes on: with the same
//! store, every time, whatever was being written.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use chladni::analysis::JobKind;
use chladni::store::{ArrayName, Claim, JobState, Numbers, Store, StoreError};
use uuid::Uuid;

use crate::Place;
use crate::admission::start;
use crate::stage::{Stage, basis_values, cloud, complete, mass, parameters, submit, vitals};
use crate::workers::{PATIENCE, quick};

const ROUNDS: u32 = 20;
/// Points of a cloud of which a few fill the small disk.
const LARGE: usize = 40_000;

/// A small disk of its own, if this process may mount one.
struct SmallDisk(PathBuf);

impl SmallDisk {
    #[allow(clippy::print_stdout)] // a skipped test must say so
    fn mount(folder: &Path, bytes: u64) -> Option<Self> {
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={bytes}"), "tmpfs"])
            .arg(folder)
            .output()
            .is_ok_and(|output| output.status.success());
        if !mounted {
            println!("skipped: only root can mount a small disk");
        }
        mounted.then(|| Self(folder.to_path_buf()))
    }

    /// Leaves no byte free. Deleting the file makes room again.
    fn fill(&self) -> PathBuf {
        let path = self.0.join("ballast");
        let mut file = File::create(&path).unwrap();
        let block = vec![1; 1 << 16];
        for size in [1 << 16, 4096, 1] {
            while file.write(&block[..size]).is_ok_and(|written| written > 0) {}
        }
        path
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.0).output();
    }
}

/// Something that is written while the disk is full.
#[derive(Debug, Clone, Copy)]
enum Deed {
    Upload,
    Cancel,
    Claim,
    Beat,
    Result,
}

const DEEDS: [Deed; 5] = [Deed::Upload, Deed::Cancel, Deed::Claim, Deed::Beat, Deed::Result];

/// What a deed needs: a job that waits, and one that runs.
struct Scene {
    round: u32,
    waiting: Uuid,
    running: Claim,
}

impl Scene {
    async fn set(store: &Store, round: u32) -> Self {
        submit(store, &cloud(2000, 2 * round), 2).await;
        let running = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
        let waiting = submit(store, &cloud(50, 2 * round + 1), 2).await.id;
        Self { round, waiting, running }
    }

    async fn act(&self, store: &Store, deed: Deed) -> Result<(), StoreError> {
        match deed {
            Deed::Upload => store.submit(&cloud(2000, 1000 + self.round), None).await.map(|_| ()),
            Deed::Cancel => store.request_cancel(self.waiting).await.map(|_| ()),
            Deed::Claim => {
                let claim = store.claim(Uuid::now_v7()).await?.unwrap();
                store.release(&claim).await.map(|_| ())
            }
            Deed::Beat => store.heartbeat(&self.running, &vitals()).await.map(|_| ()),
            Deed::Result => {
                store.begin_result(&self.running).await?;
                store.put_array(&self.running, ArrayName::Mass, Numbers::F64(mass(2000))).await?;
                store.put_bases(&self.running, (0..2).map(|j| basis_values(2000, j)).collect()).await
            }
        }
    }

    /// Everything works, and leaves the queue empty.
    async fn end(&self, store: &Store) {
        assert_eq!(complete(store, &self.running).await.unwrap(), JobState::Succeeded);
        store.request_cancel(self.waiting).await.unwrap();
        for job in [self.running.job.id, self.waiting] {
            let record = store.job(job).await.unwrap();
            store.delete_cloud(record.cloud_id).await.unwrap();
        }
    }
}

#[tokio::test]
async fn a_full_disk_ends_nothing_for_good_whatever_is_being_written() {
    let folder = tempfile::tempdir().unwrap();
    let Some(disk) = SmallDisk::mount(folder.path(), 24 << 20) else { return };
    let stage = Stage::at(Place::within(folder));
    let mut recovered = 0;
    for floor in [0, 1 << 20] {
        let store = stage.open_with(|settings| settings.disk_floor = floor).await;
        for round in 0..ROUNDS / 2 {
            let deed = DEEDS[round as usize % DEEDS.len()];
            let scene = Scene::set(&store, round).await;
            // Without a log to write over, whatever is written needs room.
            stage.tamper("PRAGMA wal_checkpoint(TRUNCATE)").await;
            let ballast = disk.fill();
            for _ in 0..2 {
                let refused = scene.act(&store, deed).await;
                assert!(matches!(refused, Err(StoreError::StorageFull)), "{deed:?}, {floor}: {refused:?}");
            }
            assert!(store.job(scene.waiting).await.is_ok(), "what is there is read");
            assert!(store.probe().await.is_err(), "it calls itself ready: {deed:?}, {floor}");
            std::fs::remove_file(ballast).unwrap();
            store.probe().await.unwrap();
            scene.act(&store, deed).await.unwrap();
            scene.end(&store).await;
            recovered += 1;
        }
        store.close().await;
    }
    println!("{recovered} of {ROUNDS} full disks recovered from");
    assert_eq!(recovered, ROUNDS);
    stage.assert_sound().await;
}

#[tokio::test]
async fn a_disk_that_is_too_full_takes_no_clouds_and_no_jobs_and_gives_what_it_has() {
    let stage = Stage::new();
    let roomy = stage.open().await;
    let stored = roomy.submit(&cloud(20, 1), None).await.unwrap().cloud;
    let waiting = submit(&roomy, &cloud(20, 2), 2).await;
    let full = stage.open_with(|settings| settings.disk_floor = u64::MAX).await;
    assert!(matches!(full.submit(&cloud(20, 3), None).await, Err(StoreError::StorageFull)));
    let refused = full.submit_job(stored.id, JobKind::Eigen, parameters(2)).await;
    assert!(matches!(refused, Err(StoreError::StorageFull)));
    assert!(matches!(full.refuse_when_disk_full().await, Err(StoreError::StorageFull)));
    assert_eq!(full.load_cloud(stored.id).await.unwrap(), cloud(20, 1));

    let jobs = start(&full, quick()).await;
    jobs.wake();
    jobs.stop(PATIENCE).await;
    let job = full.job(waiting.id).await.unwrap();
    assert_eq!((job.state, job.attempt), (JobState::Queued, 0), "it waits for room without an attempt");
}

#[tokio::test]
async fn a_file_that_may_not_grow_takes_again_what_fits_once_something_was_deleted() {
    let stage = Stage::new();
    let store = stage.open_with(|settings| settings.file_bytes_max = 6 << 20).await;
    let mut recovered = 0;
    for round in 0..ROUNDS {
        let mut stored = Vec::new();
        let refused = loop {
            match store.submit(&cloud(LARGE, 100 * round + stored.len() as u32), None).await {
                Ok(submitted) => stored.push(submitted.cloud.id),
                Err(error) => break error,
            }
        };
        assert!(matches!(refused, StoreError::StorageFull), "{refused}");
        assert!(!stored.is_empty(), "the first fits");
        store.delete_cloud(stored.pop().unwrap()).await.unwrap();
        let again = store.submit(&cloud(LARGE, 100 * round + 99), None).await.unwrap();
        stored.push(again.cloud.id);
        for cloud in stored {
            store.delete_cloud(cloud).await.unwrap();
        }
        recovered += 1;
    }
    assert_eq!(recovered, ROUNDS);
    assert!(std::fs::metadata(stage.path()).unwrap().len() <= 6 << 20);
    stage.assert_sound().await;
}

/// Fills the file up to its last pages, with clouds that get smaller. Gives what was stored.
async fn fill_up(store: &Store) -> Vec<Uuid> {
    let mut stored = Vec::new();
    for points in [LARGE, 2_000, 100, 5] {
        let refused = loop {
            match store.submit(&cloud(points, 10_000 + stored.len() as u32), None).await {
                Ok(submitted) => stored.push(submitted.cloud.id),
                Err(error) => break error,
            }
        };
        assert!(matches!(refused, StoreError::StorageFull), "{refused}");
    }
    stored
}

#[tokio::test]
async fn a_file_that_may_not_grow_ends_nothing_for_good_whatever_is_being_written() {
    let stage = Stage::new();
    let store = stage.open_with(|settings| settings.file_bytes_max = 4 << 20).await;
    for (round, deed) in (0..).zip(DEEDS) {
        let scene = Scene::set(&store, round).await;
        let stored = fill_up(&store).await;
        // What changes a row in place needs no page, and is done also in a full file.
        let needs_room = matches!(deed, Deed::Upload | Deed::Result);
        for _ in 0..2 {
            let done = scene.act(&store, deed).await;
            let is_refused = matches!(done, Err(StoreError::StorageFull));
            assert!(if needs_room { is_refused } else { done.is_ok() }, "{deed:?}: {done:?}");
        }
        assert!(store.job(scene.waiting).await.is_ok(), "what is there is read");
        for cloud in stored {
            store.delete_cloud(cloud).await.unwrap();
        }
        store.probe().await.unwrap();
        if needs_room {
            scene.act(&store, deed).await.unwrap();
        }
        scene.end(&store).await;
        assert!(std::fs::metadata(stage.path()).unwrap().len() <= 4 << 20, "{deed:?}");
    }
    stage.assert_sound().await;
}

#[tokio::test]
async fn free_pages_of_the_file_are_room_on_a_disk_that_is_nearly_full() {
    const FLOOR: u64 = 12 << 20;
    let folder = tempfile::tempdir().unwrap();
    let Some(_disk) = SmallDisk::mount(folder.path(), 32 << 20) else { return };
    let stage = Stage::at(Place::within(folder));
    let store = stage.open_with(|settings| settings.disk_floor = FLOOR).await;
    let mut stored = Vec::new();
    while store.space().await.unwrap().disk_free >= Some(FLOOR) {
        stored.push(store.submit(&cloud(LARGE, stored.len() as u32), None).await.unwrap().cloud.id);
    }
    assert!(matches!(store.submit(&cloud(5, 1), None).await, Err(StoreError::StorageFull)));
    for cloud in stored {
        store.delete_cloud(cloud).await.unwrap();
    }
    let space = store.space().await.unwrap();
    assert!(space.disk_free < Some(FLOOR) && space.room() >= FLOOR, "{space:?}");
    store.submit(&cloud(5, 1), None).await.unwrap();
    while store.space().await.unwrap().free_pages > 0 {
        store.shrink(64).await.unwrap();
    }
    stage.tamper("PRAGMA wal_checkpoint(TRUNCATE)").await;
    let space = store.space().await.unwrap();
    assert!(space.disk_free >= Some(FLOOR) && space.file < 1 << 20, "{space:?}");
    stage.assert_sound().await;
}
