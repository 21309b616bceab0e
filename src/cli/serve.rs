//! `chladni serve`: the service, until it is told to stop.

use std::io::IsTerminal;

use chladni::app::{App, Settings, StartError, told_to_stop};
use tokio::signal::unix::{Signal, SignalKind, signal};

use super::environment;
use super::reporting::print;

/// Serve the HTTP interface.
#[derive(Debug, clap::Args)]
pub(crate) struct ServeArgs {
    #[command(flatten)]
    settings: Settings,

    /// How the log on standard error is written.
    #[arg(long, env = "CHLADNI_LOG_FORMAT", value_enum, default_value_t = LogFormat::Text)]
    log_format: LogFormat,
}

/// How a log is written.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum LogFormat {
    /// A line of text per event.
    Text,
    /// A JSON object per event, for collectors.
    Json,
}

/// Why serving ended early.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ServeError {
    /// It did not start.
    #[error(transparent)]
    Start(#[from] StartError),
    /// It could not be asked to stop.
    #[error("cannot install signal handlers: {0}")]
    Signals(#[from] std::io::Error),
}

/// One line per request and event; `CHLADNI_LOG` takes filters such as `debug` or `chladni::jobs=trace`.
fn log_to_stderr(format: LogFormat) {
    let (filter, complaint) = environment::log_filter();
    let colored = std::io::stderr().is_terminal() && environment::colors();
    let log =
        tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).with_ansi(colored);
    match format {
        LogFormat::Text => log.init(),
        LogFormat::Json => log.json().flatten_event(true).init(),
    }
    for complaint in complaint.into_iter().chain(environment::complaints()) {
        tracing::warn!("{complaint}");
    }
}

/// Serves until SIGTERM or Ctrl-C; SIGHUP reads the API keys again.
///
/// # Errors
/// [`ServeError`].
pub(crate) async fn run(args: ServeArgs) -> Result<(), ServeError> {
    log_to_stderr(args.log_format);
    // Before anything else: by default a process ends at this signal.
    let mut hangups = signal(SignalKind::hangup())?;
    let app = App::start(args.settings).await?;
    let address = app.address();
    if app.listens() {
        say(&format!(
            "chladni serves http://{address}   try: curl -T scan.ply 'http://{address}/clouds?bases=50'"
        ));
    } else {
        say("chladni computes for the nodes that listen");
    }
    let told = tokio::select! {
        told = told_to_stop() => told,
        never = reread_keys(&app, &mut hangups) => never,
    };
    app.shutdown().await;
    told?;
    Ok(())
}

/// The service goes on where nobody reads what it prints.
fn say(line: &str) {
    if let Err(error) = print(line) {
        tracing::warn!(%error, line, "standard output takes nothing");
    }
}

/// Reads the keys again at every signal; never returns.
async fn reread_keys<N>(app: &App, hangups: &mut Signal) -> N {
    while hangups.recv().await.is_some() {
        app.reread_keys().await;
    }
    std::future::pending().await
}
