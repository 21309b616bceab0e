//! The running service: database, workers and listener, started and stopped in order.

mod copies;
mod key_file;
mod keys;
mod listener;
mod machine;
mod secret;
mod settings;
mod values;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

pub use copies::{backup, compact};
pub use key_file::{KeyEntry, KeyFile, KeyFileError};
pub use secret::Secret;
pub use settings::Settings;
pub use values::{address, bytes};

use crate::http::{self, Hosts, Keys, KeysError, Pools, Service};
use crate::jobs::{Analyze, Compute, ComputeError, Jobs, JobsSettings, Urgency, analyses};
use crate::metrics::Metrics;
use crate::store::{DatabaseLock, Store, StoreError};

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
    Threads(#[from] ComputeError),
}

/// A service that runs until [`Self::shutdown`].
pub struct App {
    address: SocketAddr,
    stopping: CancellationToken,
    listening: JoinHandle<()>,
    jobs: Arc<Jobs>,
    store: Store,
    keys: Option<Keys>,
    settings: Settings,
    /// Held until the database is closed.
    _lock: DatabaseLock,
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
        let keys = keys::read(&settings)?;
        if !settings.listen.ip().is_loopback() && keys.is_none() && !settings.allow_public {
            return Err(StartError::Public(settings.listen));
        }
        let refused = |cause| StartError::Listen { address: settings.listen, cause };
        let listener = TcpListener::bind(settings.listen).await.map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let lock =
            DatabaseLock::take(&settings.database).map_err(|cause| unusable_database(&settings, cause))?;
        let store = open_store(&settings).await?;
        if let Some(keys) = &keys {
            keys::adopt(keys, &store).await.map_err(|cause| unusable_database(&settings, cause))?;
        }
        let stopping = CancellationToken::new();
        let pool = |name, urgency| Compute::with_urgency(name, settings.threads(), urgency);
        let computing = pool("compute", Urgency::Background)?;
        let pools = Pools {
            reading: pool("read", Urgency::Prompt)?,
            answering: pool("answer", Urgency::Answers)?,
            compressing: pool("compress", Urgency::Answers)?,
        };
        let metrics = Arc::new(Metrics::default());
        let jobs_settings = JobsSettings { metrics: Arc::clone(&metrics), ..settings.jobs() };
        let jobs = Jobs::start(store.clone(), computing, analyze, jobs_settings).await;
        let jobs = Arc::new(jobs.map_err(|cause| unusable_database(&settings, cause))?);
        let limits = settings.limits();
        let accepted = keys.clone();
        let hosts = Hosts::new(address.ip(), &settings.allowed_hosts);
        let service = Service::new(
            store.clone(),
            pools,
            Arc::clone(&jobs),
            limits,
            accepted,
            metrics,
            stopping.clone(),
        )
        .allowing(settings.cors_origins.clone(), hosts);
        let serving =
            listener::serve(listener, http::router(service), settings.connections(), stopping.clone());
        let listening = tokio::spawn(serving);
        tracing::info!(%address, "listening");
        Ok(Self { address, stopping, listening, jobs, store, keys, settings, _lock: lock })
    }

    /// The address that is listened on.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Reads the API keys again: those that are new are accepted from now on, those that are gone no longer. Keys that
    /// cannot be read leave everything as it is.
    pub async fn reread_keys(&self) {
        let Some(accepted) = &self.keys else {
            tracing::warn!("there are no API keys to read again; they are set at the start, with --api-keys");
            return;
        };
        let keys = match keys::read(&self.settings) {
            Ok(Some(keys)) => keys,
            Ok(None) => return,
            Err(error) => {
                tracing::error!(%error, "the API keys stay as they were");
                return;
            }
        };
        if let Err(error) = keys::adopt(&keys, &self.store).await {
            tracing::error!(%error, "the API keys stay as they were");
            return;
        }
        accepted.replace(&keys);
        tracing::info!(keys = keys.count(), "the API keys were read again");
    }

    /// Stops in order: no new connections and claims; open answers end and running jobs are given back to the queue,
    /// both within the grace time; then the database is closed.
    pub async fn shutdown(self) {
        tracing::info!("stopping");
        self.stopping.cancel();
        let (ended, ()) = tokio::join!(self.listening, self.jobs.stop(self.settings.grace()));
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
