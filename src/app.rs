//! The running service: database, workers and listener, started and stopped in order.

mod backup;
mod listener;
mod machine;
mod secret;
mod settings;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

pub use backup::backup;
pub use secret::Secret;
pub use settings::Settings;

use crate::http::{self, Keys, KeysError, Service};
use crate::jobs::{Analyze, Compute, ComputeError, Jobs, JobsSettings, analyses};
use crate::metrics::Metrics;
use crate::store::{Store, StoreError};

/// Why the service did not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The address is open to others, and nobody is asked for a key.
    #[error(
        "{0} can be reached from other machines, and no API keys are set; give --api-keys FILE, or --allow-public to serve \
         anybody"
    )]
    Public(SocketAddr),
    /// The address cannot be listened on.
    #[error("cannot listen on {address}: {cause}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The file of keys cannot be read.
    #[error("the file of API keys, {path}: {cause}")]
    KeyFile {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The keys, those of the file first, cannot be used.
    #[error("the API keys: {0}")]
    Keys(#[from] KeysError),
    /// The database cannot be used.
    #[error("the database, {path}: {cause}")]
    Database {
        /// Its file.
        path: PathBuf,
        /// Why.
        cause: StoreError,
    },
    /// The compute threads cannot be started.
    #[error("cannot start the compute threads: {0}")]
    Threads(String),
}

/// A service that runs until [`Self::shutdown`].
pub struct App {
    address: SocketAddr,
    stopping: CancellationToken,
    listening: JoinHandle<()>,
    jobs: Arc<Jobs>,
    store: Store,
    grace: Duration,
}

impl App {
    /// Opens the database, starts the workers, and listens.
    ///
    /// # Errors
    /// [`StartError`]; nothing is left running then.
    pub async fn start(settings: Settings) -> Result<Self, StartError> {
        Self::start_with(settings, analyses()).await
    }

    /// As [`Self::start`], with another analysis in place of the library's.
    ///
    /// # Errors
    /// [`StartError`]; nothing is left running then.
    pub async fn start_with(settings: Settings, analyze: Arc<Analyze>) -> Result<Self, StartError> {
        let keys = read_keys(&settings)?;
        if !settings.listen.ip().is_loopback() && keys.is_none() && !settings.allow_public {
            return Err(StartError::Public(settings.listen));
        }
        let refused = |cause| StartError::Listen { address: settings.listen, cause };
        let listener = TcpListener::bind(settings.listen).await.map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let store = open_store(&settings).await?;
        let stopping = CancellationToken::new();
        let threads = |error: ComputeError| StartError::Threads(error.to_string());
        let computing = Compute::in_background("compute", settings.threads()).map_err(threads)?;
        let compute = Compute::new("read", settings.threads()).map_err(threads)?;
        let metrics = Arc::new(Metrics::default());
        let jobs_settings = JobsSettings { metrics: Arc::clone(&metrics), ..settings.jobs() };
        let jobs = Jobs::start(store.clone(), computing, analyze, jobs_settings).await;
        let jobs = Arc::new(jobs.map_err(|cause| unusable_database(&settings, cause))?);
        let limits = settings.limits();
        let service =
            Service::new(store.clone(), compute, Arc::clone(&jobs), limits, keys, metrics, stopping.clone())
                .allowing(settings.cors_origins.clone());
        let serving =
            listener::serve(listener, http::router(service), settings.connections(), stopping.clone());
        let listening = tokio::spawn(serving);
        tracing::info!(%address, "listening");
        Ok(Self { address, stopping, listening, jobs, store, grace: settings.grace() })
    }

    /// The address that is listened on.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Stops in order: no new connections and claims; open answers end and running jobs are given back to the queue,
    /// both within the grace time; then the database is closed.
    pub async fn shutdown(self) {
        tracing::info!("stopping");
        self.stopping.cancel();
        let (ended, ()) = tokio::join!(self.listening, self.jobs.stop(self.grace));
        if let Err(error) = ended {
            tracing::error!(%error, "the listener ended badly");
        }
        self.store.close().await;
        tracing::info!("stopped");
    }
}

async fn open_store(settings: &Settings) -> Result<Store, StartError> {
    Store::open_with(&settings.database, settings.store())
        .await
        .map_err(|cause| unusable_database(settings, cause))
}

fn unusable_database(settings: &Settings, cause: StoreError) -> StartError {
    StartError::Database { path: settings.database.clone(), cause }
}

fn read_keys(settings: &Settings) -> Result<Option<Keys>, StartError> {
    if settings.api_keys.is_none() && settings.keys.is_none() {
        return Ok(None);
    }
    let mut keys = String::new();
    if let Some(path) = &settings.api_keys {
        let unreadable = |cause| StartError::KeyFile { path: path.clone(), cause };
        keys = std::fs::read_to_string(path).map_err(unreadable)?;
    }
    if let Some(more) = &settings.keys {
        keys.push('\n');
        keys.push_str(more.reveal());
    }
    Ok(Some(Keys::parse(&keys)?))
}

/// Returns at the first SIGTERM or Ctrl-C.
///
/// # Errors
/// The system's, when signals cannot be listened to.
pub async fn told_to_stop() -> std::io::Result<()> {
    #[cfg(unix)]
    {
        let mut terminate = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate())?;
        tokio::select! {
            _ = terminate.recv() => Ok(()),
            interrupted = tokio::signal::ctrl_c() => interrupted,
        }
    }
    #[cfg(not(unix))]
    tokio::signal::ctrl_c().await
}
