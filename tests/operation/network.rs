//! A node whose network to the database is cut: nothing arrives any more, and nothing says so.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, UnixStream};
use tokio::sync::watch;

use crate::nodes::cluster;
use crate::process::{Process, sphere};

/// Whatever happens has happened by then: a lease, the node's patience with a silent server, and the job again.
const PATIENCE: Duration = Duration::from_mins(4);

/// Passes connections on to the server's socket, until it is cut: then it holds them open and passes nothing on.
struct Link {
    port: u16,
    /// Connections made at an earlier count are dead.
    cuts: watch::Sender<u64>,
    /// Whether it is cut now.
    is_cut: watch::Sender<bool>,
}

impl Link {
    async fn to(socket: PathBuf) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let (cuts, is_cut) = (watch::Sender::new(0), watch::Sender::new(false));
        let (cut, mended) = (cuts.clone(), is_cut.clone());
        tokio::spawn(async move {
            while let Ok((node, _)) = listener.accept().await {
                let (socket, mut cut, mut mended) = (socket.clone(), cut.subscribe(), mended.subscribe());
                tokio::spawn(async move {
                    let _ = mended.wait_for(|is_cut| !is_cut).await;
                    let server = UnixStream::connect(socket).await.unwrap();
                    let (mut from_node, mut to_node) = node.into_split();
                    let (mut from_server, mut to_server) = server.into_split();
                    tokio::select! {
                        () = pass(&mut from_node, &mut to_server) => {}
                        () = pass(&mut from_server, &mut to_node) => {}
                        // Never again, and nobody is told: both ends stay open.
                        _ = cut.changed() => std::future::pending().await,
                    }
                });
            }
        });
        Self { port, cuts, is_cut }
    }

    fn cut(&self) {
        self.is_cut.send_replace(true);
        self.cuts.send_modify(|count| *count += 1);
    }

    /// New connections work; those that were cut stay dead.
    fn mend(&self) {
        self.is_cut.send_replace(false);
    }
}

async fn pass(from: &mut (impl AsyncReadExt + Unpin), to: &mut (impl AsyncWriteExt + Unpin)) {
    let mut buffer = vec![0; 64 * 1024];
    while let Ok(length @ 1..) = from.read(&mut buffer).await {
        if to.write_all(&buffer[..length]).await.is_err() {
            return;
        }
    }
}

async fn readiness(node: &Process) -> u16 {
    node.get("/readyz").await.status().as_u16()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_cut_off_from_the_server_loses_its_job_and_comes_back_by_itself() {
    let Some((cluster, address)) = cluster() else { return };
    let link = Link::to(cluster.socket()).await;
    let folder = tempfile::tempdir().unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_chladni"));
    let start = |name: &str, address: &str, flags: &[&str]| {
        let flags = [&["--threads", "1"], flags].concat();
        Process::of(program, address, folder.path().join(name), &flags, &[])
    };
    let through = format!("postgres://postgres@127.0.0.1:{}/chladni?sslmode=disable", link.port);
    let far = start("far.log", &through, &[]);
    let near = start("near.log", &address, &["--workers", "0"]);
    let job = near.submit("bases=300&operator=voronoi", sphere(40_000)).await.unwrap();
    let begun = Instant::now();
    while near.json(&format!("/jobs/{job}")).await["state"] != "running" {
        assert!(begun.elapsed() < PATIENCE, "the far node does not take the job");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }

    link.cut();
    let cut = Instant::now();
    // What was asked just before may still be answered.
    while readiness(&far).await != 503 {
        assert!(cut.elapsed() < Duration::from_secs(30), "nobody notices");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    println!("told that it is not ready after {:.1?}", cut.elapsed());
    let other = start("other.log", &address, &[]);
    let ended = tokio::time::timeout(PATIENCE, near.ended(&job)).await.expect("nobody takes the job over");
    println!("another node ended the job {:.1?} after the cut", cut.elapsed());
    assert_eq!((&ended["state"], &ended["attempt"]), (&"succeeded".into(), &2.into()), "{ended}");

    link.mend();
    let mended = Instant::now();
    while readiness(&far).await != 200 {
        assert!(mended.elapsed() < PATIENCE, "the node does not come back");
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
    println!("ready {:.1?} after the network was mended", mended.elapsed());
    let path = format!("/jobs/{job}/bases.npy");
    assert!(far.bytes(&path).await == other.bytes(&path).await, "two nodes serve different bases");
    // It takes jobs again, and the other node's end hears of them.
    let (mut other, next) = (other, far.submit("bases=4", sphere(300)).await.unwrap());
    other.kill();
    let next = tokio::time::timeout(PATIENCE, near.ended(&next)).await.expect("the node takes no jobs");
    assert_eq!(next["state"], "succeeded", "{next}");
    println!("its next job ended {:.1?} after the network was mended", mended.elapsed());
}
