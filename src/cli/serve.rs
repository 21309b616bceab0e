//! `chladni serve`: the service, until it is told to stop.

use std::io::IsTerminal;

use chladni::app::{App, Settings, StartError, told_to_stop};
use tracing_subscriber::EnvFilter;

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
    /// It could not be told to stop.
    #[error("cannot listen to signals: {0}")]
    Signals(#[from] std::io::Error),
}

/// One line per request and event; `CHLADNI_LOG` takes filters such as `debug` or `chladni::jobs=trace`.
fn log_to_stderr(format: LogFormat) {
    let filter = EnvFilter::try_from_env("CHLADNI_LOG").unwrap_or_else(|_| EnvFilter::new("info"));
    let colored = std::io::stderr().is_terminal();
    let log =
        tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).with_ansi(colored);
    match format {
        LogFormat::Text => log.init(),
        LogFormat::Json => log.json().flatten_event(true).init(),
    }
}

/// Serves until SIGTERM or Ctrl-C.
///
/// # Errors
/// [`ServeError`].
#[allow(clippy::print_stdout)] // the address is the command's output
pub(crate) async fn run(args: ServeArgs) -> Result<(), ServeError> {
    log_to_stderr(args.log_format);
    let app = App::start(args.settings).await?;
    let address = app.address();
    println!("chladni serves http://{address}   try: curl -T scan.ply 'http://{address}/clouds?bases=50'");
    let told = told_to_stop().await;
    app.shutdown().await;
    Ok(told?)
}
