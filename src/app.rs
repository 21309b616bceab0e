//! The running service: database, workers and listener, started and stopped in order.

mod listener;
mod settings;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

pub use settings::Settings;

use crate::http::{self, Keys, Service};
use crate::jobs::{Analyze, Compute, ComputeError, Jobs, analyses};
use crate::store::{Store, StoreError, StoreSettings};

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
    /// The file of keys cannot be used.
    #[error("the file of API keys, {path}: {reason}")]
    Keys {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
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
        let computing = Compute::new("compute", settings.threads()).map_err(threads)?;
        let compute = Compute::new("read", settings.threads()).map_err(threads)?;
        let jobs = Jobs::start(store.clone(), computing, analyze, settings.jobs()).await;
        let jobs = Arc::new(jobs.map_err(|cause| unusable_database(&settings, cause))?);
        let service = Service {
            store: store.clone(),
            compute,
            jobs: Arc::clone(&jobs),
            limits: settings.limits(),
            origins: settings.cors_origins.clone(),
            keys,
            stopping: stopping.clone(),
        };
        let serving =
            listener::serve(listener, http::router(service), settings.connections(), stopping.clone());
        let listening = tokio::spawn(serving);
        tracing::info!(%address, database = %settings.database.display(), "listening");
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
    let store_settings = StoreSettings { queue_max: settings.queue_max, ..StoreSettings::default() };
    Store::open_with(&settings.database, store_settings)
        .await
        .map_err(|cause| unusable_database(settings, cause))
}

fn unusable_database(settings: &Settings, cause: StoreError) -> StartError {
    StartError::Database { path: settings.database.clone(), cause }
}

fn read_keys(settings: &Settings) -> Result<Option<Keys>, StartError> {
    let Some(path) = &settings.api_keys else { return Ok(None) };
    let unusable = |reason: String| StartError::Keys { path: path.clone(), reason };
    let text = std::fs::read_to_string(path).map_err(|error| unusable(error.to_string()))?;
    Keys::parse(&text).map(Some).ok_or_else(|| unusable("there is no key in it".to_owned()))
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
