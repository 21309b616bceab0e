//! What the tests stand on: a database in a folder of its own, a clock that is stepped, small clouds and results.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use chladni::analysis::{JobKind, Parameters, Report, SparseMatrix};
use chladni::cloud::{NonFinite, PointCloud};
use chladni::progress::Phase;
use chladni::spectrum::Spectrum;
use chladni::store::{
    ArrayName, BasisValues, Claim, Clock, JobRecord, JobState, Milliseconds, Numbers, Store, StoreError,
    StoreSettings, Vitals,
};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, SqliteConnection};
use tempfile::TempDir;
use uuid::Uuid;

pub const LEASE: Milliseconds = 60_000;
pub const ATTEMPTS_MAX: u32 = 3;

pub struct Stage {
    folder: TempDir,
    clock: Arc<AtomicI64>,
}

impl Stage {
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap(), clock: Arc::new(AtomicI64::new(1_000_000)) }
    }

    pub fn path(&self) -> std::path::PathBuf {
        self.folder.path().join("stage.db")
    }

    pub async fn open(&self) -> Store {
        self.open_with_queue(1000).await
    }

    pub async fn open_with_queue(&self, queue_max: u64) -> Store {
        let clock = Arc::clone(&self.clock);
        let settings = StoreSettings {
            queue_max,
            attempts_max: ATTEMPTS_MAX,
            lease: LEASE,
            readers: 2,
            clock: Clock::new(move || clock.load(Ordering::SeqCst)),
        };
        Store::open_with(&self.path(), settings).await.unwrap()
    }

    pub fn now(&self) -> Milliseconds {
        self.clock.load(Ordering::SeqCst)
    }

    pub fn advance(&self, by: Milliseconds) {
        self.clock.fetch_add(by, Ordering::SeqCst);
    }

    /// The file itself, behind the store's back.
    pub async fn file(&self) -> SqliteConnection {
        SqliteConnectOptions::new().filename(self.path()).foreign_keys(true).connect().await.unwrap()
    }

    /// Runs a statement on the file and returns how many rows it changed.
    pub async fn tamper(&self, statement: &'static str) -> u64 {
        sqlx::query(statement).execute(&mut self.file().await).await.unwrap().rows_affected()
    }

    pub async fn number(&self, query: &'static str) -> i64 {
        sqlx::query_scalar(query).fetch_one(&mut self.file().await).await.unwrap()
    }

    pub async fn assert_sound(&self) {
        let mut file = self.file().await;
        let verdict: Vec<String> =
            sqlx::query_scalar("PRAGMA integrity_check").fetch_all(&mut file).await.unwrap();
        assert_eq!(verdict, ["ok"]);
        let dangling = sqlx::query("PRAGMA foreign_key_check").fetch_all(&mut file).await.unwrap();
        assert_eq!(dangling.len(), 0);
    }
}

/// A cloud of n points whose numbers depend on `seed`.
pub fn cloud(n: usize, seed: u32) -> PointCloud {
    let coordinates = (0..3 * n).map(|i| (i as f64 * 0.37 + f64::from(seed)).sin()).collect();
    PointCloud::new(3, coordinates, NonFinite::Reject).unwrap()
}

pub fn parameters(bases: usize) -> Parameters {
    Parameters { bases, ..Parameters::default() }
}

pub async fn submit(store: &Store, cloud: &PointCloud, bases: usize) -> JobRecord {
    store.submit(cloud, Some((JobKind::Eigen, parameters(bases)))).await.unwrap().job.unwrap()
}

pub fn report(points: usize, bases: usize) -> Report {
    let list = |scale: f64| (0..bases).map(|j| j as f64 * scale).collect::<Vec<f64>>();
    Report {
        rows: points,
        points_used: points,
        duplicates: 0,
        nonfinite: 0,
        warnings: vec!["made up".to_owned()],
        spectrum: Some(Spectrum {
            eigenvalues: list(1.1),
            raw_eigenvalues: list(1.0),
            residuals: list(1e-9),
            clusters: Vec::new(),
        }),
    }
}

/// Basis `j` of a cloud of n points; its row 1 has no result.
pub fn basis(n: usize, j: usize) -> Vec<f64> {
    (0..n).map(|i| if i == 1 { f64::NAN } else { ((i + 1) as f64 * (j + 1) as f64).sqrt() }).collect()
}

pub fn mass(n: usize) -> Vec<f64> {
    (0..n).map(|i| 1.0 / (i + 1) as f64).collect()
}

pub fn matrix(n: usize) -> SparseMatrix {
    SparseMatrix {
        offsets: (0..=n as u64).collect(),
        columns: (0..n as u32).rev().collect(),
        values: (0..n).map(|i| -(i as f64)).collect(),
    }
}

pub fn vitals() -> Vitals {
    Vitals { phase: Phase::Certificates, progress: 0.97, phase_seconds: vec![(Phase::Eigenpairs, 1.5)] }
}

pub fn basis_values(n: usize, j: usize) -> BasisValues {
    BasisValues {
        index: j,
        eigenvalue: j as f64 * 1.1,
        raw_eigenvalue: j as f64,
        residual: j as f64 * 1e-9,
        values: basis(n, j),
    }
}

/// Stores what a worker would store for this claim, and ends it.
pub async fn complete(store: &Store, claim: &Claim) -> Result<JobState, StoreError> {
    let (n, bases) = (claim.job.points as usize, claim.job.parameters.bases);
    store.begin_result(claim).await?;
    store.put_array(claim, ArrayName::Mass, Numbers::F64(mass(n))).await?;
    store.put_bases(claim, (0..bases).map(|j| basis_values(n, j)).collect()).await?;
    store.finish(claim, &report(n, bases), &vitals()).await
}

/// A job that has succeeded, on a cloud of n points.
pub async fn succeeded(store: &Store, n: usize, bases: usize) -> Uuid {
    let job = submit(store, &cloud(n, 7), bases).await;
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    assert_eq!(claim.job.id, job.id);
    assert_eq!(complete(store, &claim).await.unwrap(), JobState::Succeeded);
    job.id
}

pub fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}
