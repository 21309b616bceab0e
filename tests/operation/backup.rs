//! A copy made while the service works is a database to serve from.

use std::process::{Command, Output};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::process::{Process, sphere, submit};

fn backup(arguments: &[&std::path::Path]) -> Output {
    let database = arguments[0];
    Command::new(env!("CARGO_BIN_EXE_chladni"))
        .arg("backup")
        .args(&arguments[1..])
        .arg("--database")
        .arg(database)
        .output()
        .unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_copy_made_under_load_holds_all_that_was_acknowledged_before_and_serves_it() {
    let directory = tempfile::tempdir().unwrap();
    let (database, copy) = (directory.path().join("live.db"), directory.path().join("copy.db"));
    let live = Process::start(&database);
    let query = "bases=3&operator=voronoi";
    let done = live.submit(query, sphere(60)).await.unwrap();
    assert_eq!(live.ended(&done).await["state"], "succeeded");
    let mut before = vec![done.clone()];
    for points in 61..66 {
        before.push(live.submit(query, sphere(points)).await.unwrap());
    }
    // Jobs run and clouds come in while it is copied.
    let enough = Arc::new(AtomicBool::new(false));
    let (client, address, stop) = (live.client.clone(), live.address.clone(), Arc::clone(&enough));
    let loading = tokio::spawn(async move {
        let mut sent = 0;
        while !stop.load(Ordering::SeqCst) {
            submit(&client, &address, query, sphere(70 + sent)).await.unwrap();
            sent += 1;
        }
        sent
    });
    let made = tokio::task::spawn_blocking({
        let (database, copy) = (database.clone(), copy.clone());
        move || backup(&[&database, &copy])
    });
    let made = made.await.unwrap();
    enough.store(true, Ordering::SeqCst);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    assert!(loading.await.unwrap() > 0, "the service went on");

    let restored = Process::start(&copy);
    for job in &before {
        assert_eq!(restored.ended(job).await["state"], "succeeded", "what was queued is done from the copy");
        assert_eq!(live.ended(job).await["state"], "succeeded");
        let path = format!("/jobs/{job}/bases.npy");
        assert_eq!(restored.bytes(&path).await, live.bytes(&path).await);
    }
}

#[tokio::test]
async fn a_copy_overwrites_nothing_and_needs_a_database() {
    let directory = tempfile::tempdir().unwrap();
    let (database, copy) = (directory.path().join("live.db"), directory.path().join("copy.db"));
    let refused = backup(&[&database, &copy]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(!database.exists() && !copy.exists(), "nothing is made");
    let mut process = Process::start(&database);
    process.kill();
    std::fs::write(&copy, "precious").unwrap();
    let refused = backup(&[&database, &copy]);
    assert_eq!(refused.status.code(), Some(2));
    assert_eq!(std::fs::read(&copy).unwrap(), b"precious");
    std::fs::write(directory.path().join("text.db"), "no database").unwrap();
    let refused = backup(&[&directory.path().join("text.db"), &directory.path().join("other.db")]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(!directory.path().join("other.db").exists());
}
