//! The running service: database, workers and listener, started and stopped in order.

mod copies;
mod key_file;
mod keys;
mod listener;
mod machine;
mod moving;
mod secret;
mod settings;
mod values;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

pub use copies::{backup, compact};
pub use key_file::{KeyEntry, KeyFile, KeyFileError};
pub use moving::migrate;
pub use secret::Secret;
pub use settings::Settings;
pub use values::{address, bytes, threads};

use crate::http::{self, Hosts, Keys, KeysError, Pools, Service};
use crate::jobs::{Analyze, Compute, ComputeError, Jobs, JobsSettings, Urgency, default_analysis};
use crate::metrics::Metrics;
use crate::store::{DatabaseLock, Store, StoreError};

pub use crate::store::{DatabaseAddress, Moved};

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
    #[error("the database, {address}: {cause}")]
    Database {
        /// Its file or address.
        address: DatabaseAddress,
        /// Why.
        cause: StoreError,
    },
    /// The settings ask for a node among others, on a database of one process.
    #[error(
        "{flag} is for nodes that share a PostgreSQL database; give its address with --database postgres://…"
    )]
    Alone {
        /// The flag.
        flag: &'static str,
    },
    /// It would neither answer nor compute.
    #[error("with --no-listen and --workers 0 there is nothing to do; leave one of them out")]
    Idle,
    /// The compute threads cannot be started.
    #[error("cannot start the compute threads: {0}")]
    Threads(#[from] ComputeError),
}

/// A service that runs until [`Self::shutdown`].
pub struct App {
    address: SocketAddr,
    stopping: CancellationToken,
    listening: Option<JoinHandle<()>>,
    jobs: Arc<Jobs>,
    store: Store,
    keys: Option<Keys>,
    settings: Settings,
    /// Held until the database is closed; of a file only.
    _lock: Option<DatabaseLock>,
}

impl App {
    /// Opens the database, starts the workers, and listens.
    ///
    /// # Errors
    /// [`StartError`]; nothing is left running then.
    pub async fn start(settings: Settings) -> Result<Self, StartError> {
        Self::start_with(settings, default_analysis()).await
    }

    /// As [`Self::start`], with another analysis in place of the library's.
    ///
    /// # Errors
    /// [`StartError`]; nothing is left running then.
    pub async fn start_with(settings: Settings, analyze: Arc<Analyze>) -> Result<Self, StartError> {
        check_company(&settings)?;
        let keys = keys::read(&settings)?;
        if !settings.no_listen
            && !settings.listen.ip().is_loopback()
            && keys.is_none()
            && !settings.allow_public
        {
            return Err(StartError::Public(settings.listen));
        }
        let listener = if settings.no_listen { None } else { Some(listen(settings.listen).await?) };
        let address = listener.as_ref().map_or(settings.listen, |(_, address)| *address);
        let lock = settings.database.path().map(DatabaseLock::take).transpose();
        let lock = lock.map_err(|cause| unusable_database(&settings, cause))?;
        let store = open_store(&settings).await?;
        if let Some(keys) = &keys {
            keys::adopt(keys, &store).await.map_err(|cause| unusable_database(&settings, cause))?;
            let told = keys::warn_of_unreachable(keys, &store).await;
            told.map_err(|cause| unusable_database(&settings, cause))?;
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
        let listening = listener.map(|(listener, address)| {
            let hosts = Hosts::new(address.ip(), &settings.allowed_hosts);
            let (limits, accepted) = (settings.limits(), keys.clone());
            let (store, jobs, stopping) = (store.clone(), Arc::clone(&jobs), stopping.clone());
            let service = Service::new(store, pools, jobs, limits, accepted, metrics, stopping.clone())
                .allowing(settings.cors_origins.clone(), hosts);
            tracing::info!(%address, "listening");
            let router = http::router(service);
            tokio::spawn(listener::serve(listener, router, settings.connections(), stopping))
        });
        // do not log local paths
        let server = settings.database.path().is_none().then(|| settings.database.to_string());
        tracing::info!(node = %store.node(), database = server.as_deref(), "started");
        Ok(Self { address, stopping, listening, jobs, store, keys, settings, _lock: lock })
    }

    /// The address that is listened on, or would be by a node that listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Whether requests are answered.
    #[must_use]
    pub fn listens(&self) -> bool {
        self.listening.is_some()
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
        if let Err(error) = keys::warn_of_unreachable(&keys, &self.store).await {
            tracing::error!(%error, "whose clouds and jobs have no key could not be read");
        }
    }

    /// Stops in order: no new connections and claims; open answers end and running jobs are given back to the queue,
    /// both within the grace time; then the database is closed.
    pub async fn shutdown(self) {
        tracing::info!("stopping");
        self.stopping.cancel();
        let listening = async {
            if let Some(Err(error)) = futures_util::future::OptionFuture::from(self.listening).await {
                tracing::error!(%error, "the listener ended badly");
            }
        };
        tokio::join!(listening, self.jobs.stop(self.settings.grace()));
        self.store.close().await;
        tracing::info!("stopped");
    }
}

/// Refuses what makes no sense for a process that has the database to itself.
fn check_company(settings: &Settings) -> Result<(), StartError> {
    let flag = match (settings.no_listen, settings.jobs_at_once) {
        (true, 0) => return Err(StartError::Idle),
        (true, _) => "--no-listen",
        (false, 0) => "--workers 0",
        (false, _) => return Ok(()),
    };
    match settings.database.path() {
        Some(_) => Err(StartError::Alone { flag }),
        None => Ok(()),
    }
}

async fn listen(address: SocketAddr) -> Result<(TcpListener, SocketAddr), StartError> {
    let refused = |cause| StartError::Listen { address, cause };
    let listener = TcpListener::bind(address).await.map_err(refused)?;
    let address = listener.local_addr().map_err(refused)?;
    Ok((listener, address))
}

async fn open_store(settings: &Settings) -> Result<Store, StartError> {
    Store::open_at(&settings.database, settings.store())
        .await
        .map_err(|cause| unusable_database(settings, cause))
}

fn unusable_database(settings: &Settings, cause: StoreError) -> StartError {
    StartError::Database { address: settings.database.clone(), cause }
}

/// Returns at the first SIGTERM or Ctrl-C, with the number of the signal.
///
/// # Errors
/// The system's, when signals cannot be listened to.
pub async fn told_to_stop() -> std::io::Result<i32> {
    let mut terminate = signal(SignalKind::terminate())?;
    let mut interrupt = signal(SignalKind::interrupt())?;
    Ok(tokio::select! {
        _ = terminate.recv() => SignalKind::terminate(),
        _ = interrupt.recv() => SignalKind::interrupt(),
    }
    .as_raw_value())
}
