//! `chladni serve`: the service, until it is told to stop.

use chladni::app::{App, Settings, StartError, told_to_stop};

/// Serve the HTTP interface.
#[derive(Debug, clap::Args)]
pub(crate) struct ServeArgs {
    #[command(flatten)]
    settings: Settings,
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

/// Serves until SIGTERM or Ctrl-C.
///
/// # Errors
/// [`ServeError`].
#[allow(clippy::print_stdout)] // the address is the command's output
pub(crate) async fn run(args: ServeArgs) -> Result<(), ServeError> {
    let app = App::start(args.settings).await?;
    let address = app.address();
    println!("chladni serves http://{address}   try: curl -T scan.ply 'http://{address}/clouds?bases=50'");
    let told = told_to_stop().await;
    app.shutdown().await;
    Ok(told?)
}
