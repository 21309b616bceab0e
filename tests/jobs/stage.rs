//! What the tests stand on: a database of their own, a clock that is stepped, small clouds and results.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use chladni::analysis::{Examined, JobKind, Parameters, Report, SparseMatrix};
use chladni::cloud::{NonFinite, PointCloud};
use chladni::progress::Phase;
use chladni::store::{
    ArrayName, BasisValues, Claim, Clock, JobRecord, JobState, Milliseconds, Numbers, Owner, Store,
    StoreError, StoreSettings, StoredCoefficients, Submitted, Vitals,
};
use serde_json::json;
use uuid::Uuid;

use crate::Place;
use crate::SHARES;

pub(crate) const LEASE: Milliseconds = 60_000;
pub(crate) const ATTEMPTS_MAX: u32 = 3;

pub(crate) struct Stage {
    place: Place,
    clock: Arc<AtomicI64>,
}

impl Stage {
    pub(crate) fn new() -> Self {
        Self::at(Place::new())
    }

    pub(crate) fn at(place: Place) -> Self {
        Self { place, clock: Arc::new(AtomicI64::new(1_000_000)) }
    }

    pub(crate) async fn open(&self) -> Store {
        self.open_with(|_| {}).await
    }

    pub(crate) async fn open_with_queue(&self, queue_max: u64) -> Store {
        self.open_with(|settings| settings.queue_max = queue_max).await
    }

    pub(crate) async fn open_with(&self, change: impl FnOnce(&mut StoreSettings)) -> Store {
        let clock = Arc::clone(&self.clock);
        let mut settings = StoreSettings {
            queue_max: 1000,
            attempts_max: ATTEMPTS_MAX,
            lease: LEASE,
            readers: 2,
            clock: Clock::new(move || clock.load(Ordering::SeqCst)),
            ..StoreSettings::default()
        };
        change(&mut settings);
        Store::open_at(&self.place.address(), settings).await.unwrap()
    }

    pub(crate) fn now(&self) -> Milliseconds {
        self.clock.load(Ordering::SeqCst)
    }

    pub(crate) fn advance(&self, by: Milliseconds) {
        self.clock.fetch_add(by, Ordering::SeqCst);
    }

    /// As long as it takes until the claims of a dead process are given up.
    pub(crate) fn outlive_the_dead(&self) {
        if SHARES {
            self.advance(LEASE + 1);
        }
    }

    pub(crate) fn place(&self) -> &Place {
        &self.place
    }

    /// Runs a statement behind the store's back and returns how many rows it changed.
    pub(crate) async fn tamper(&self, statement: impl Into<String>) -> u64 {
        self.place.tamper(statement.into()).await.unwrap()
    }
}

/// The database, behind the store's back.
impl std::ops::Deref for Stage {
    type Target = Place;

    fn deref(&self) -> &Place {
        &self.place
    }
}

/// A cloud of n points whose numbers depend on `seed`.
pub(crate) fn cloud(n: usize, seed: u32) -> PointCloud {
    let coordinates = (0..3 * n).map(|i| (i as f64 * 0.37 + f64::from(seed)).sin()).collect();
    PointCloud::new(3, coordinates, NonFinite::Reject).unwrap()
}

/// Submits for an owner.
pub(crate) async fn submit_for(
    store: &Store,
    owner: &Owner,
    cloud: PointCloud,
    bases: usize,
) -> Result<JobRecord, StoreError> {
    let job = Some((JobKind::Eigen, parameters(bases)));
    Ok(store_for(store, owner, cloud, job).await?.job.unwrap())
}

/// Stores a cloud of an owner, with a job on it or not.
pub(crate) async fn store_for(
    store: &Store,
    owner: &Owner,
    cloud: PointCloud,
    job: Option<(JobKind, Parameters)>,
) -> Result<Submitted, StoreError> {
    let examined = Examined::of(&cloud);
    store.submit_shared(owner, Arc::new(cloud), &examined, job).await
}

pub(crate) fn parameters(bases: usize) -> Parameters {
    Parameters { bases, ..Parameters::default() }
}

pub(crate) async fn submit(store: &Store, cloud: &PointCloud, bases: usize) -> JobRecord {
    store.submit(cloud, Some((JobKind::Eigen, parameters(bases)))).await.unwrap().job.unwrap()
}

pub(crate) fn report(points: usize, bases: usize) -> Report {
    let list = |scale: f64| (0..bases).map(|j| j as f64 * scale).collect::<Vec<f64>>();
    let report = json!({
        "operator": "voronoi",
        "rows": points,
        "ambient_dimension": 3,
        "dimension": 2,
        "dimension_estimate": 2,
        "points_used": points,
        "duplicates": 0,
        "nonfinite": 0,
        "isolated": 0,
        "components": 1,
        "sampling": {
            "epsilon": 0.5,
            "zeta": 0.1,
            "spacing": 0.3,
            "density_ratio": 2.0,
            "area": 4.0,
            "rim_cells": 0,
            "invalid_cells": 0,
        },
        "heat_kernel": null,
        "additions": parameters(bases).additions(),
        "nonzeros": 7 * points,
        "neighbors": 6.0,
        "warnings": ["made up"],
        "fidelity": null,
        "spectrum": {
            "eigenvalues": list(1.1),
            "raw_eigenvalues": list(1.0),
            "residuals": list(1e-9),
            "clusters": [],
            "components": 1,
            "certificates": {
                "orthogonality": 1e-14,
                "residual": 1e-9,
                "zero_modes": 1,
                "missed": 0,
                "missed_check": "inertia",
                "saturation": null,
            },
            "method": "shift-invert",
        },
    });
    serde_json::from_value(report).unwrap()
}

/// Basis `j` of a cloud of n points; its row 1 has no result.
pub(crate) fn basis(n: usize, j: usize) -> Vec<f64> {
    (0..n).map(|i| if i == 1 { f64::NAN } else { ((i + 1) as f64 * (j + 1) as f64).sqrt() }).collect()
}

/// Coefficients of a function of this name in so many bases.
pub(crate) fn coefficients(name: &str, bases: usize) -> StoredCoefficients {
    let numbers = (0..bases).map(|j| (j as f64 + name.len() as f64).sqrt()).collect();
    StoredCoefficients { name: name.to_owned(), energy: 0.1, numbers }
}

pub(crate) fn mass(n: usize) -> Vec<f64> {
    (0..n).map(|i| 1.0 / (i + 1) as f64).collect()
}

pub(crate) fn matrix(n: usize) -> SparseMatrix {
    SparseMatrix {
        offsets: (0..=n as u64).collect(),
        columns: (0..n as u32).rev().collect(),
        values: (0..n).map(|i| -(i as f64)).collect(),
    }
}

pub(crate) fn vitals() -> Vitals {
    let phase_seconds = vec![(Phase::Eigenpairs, 1.5)];
    Vitals { phase: Phase::Certificates, progress: 0.97, phase_seconds, memory: 0 }
}

pub(crate) fn basis_values(n: usize, j: usize) -> BasisValues {
    BasisValues { index: j, values: basis(n, j) }
}

/// Stores what a worker would store for this claim, and ends it.
pub(crate) async fn complete(store: &Store, claim: &Claim) -> Result<JobState, StoreError> {
    let (n, bases) = (claim.job.points as usize, claim.job.parameters.bases);
    store.begin_result(claim).await?;
    store.put_array(claim, ArrayName::Mass, Numbers::F64(mass(n))).await?;
    store.put_bases(claim, (0..bases).map(|j| basis_values(n, j)).collect()).await?;
    store.finish(claim, &report(n, bases), &vitals()).await
}

/// A job that has succeeded, on a cloud of n points.
pub(crate) async fn succeeded(store: &Store, n: usize, bases: usize) -> Uuid {
    let job = submit(store, &cloud(n, 7), bases).await;
    let claim = store.claim(Uuid::now_v7()).await.unwrap().unwrap();
    assert_eq!(claim.job.id, job.id);
    assert_eq!(complete(store, &claim).await.unwrap(), JobState::Succeeded);
    job.id
}

pub(crate) fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}
