//! `chladni serve`.

/// Serve the HTTP interface.
#[derive(Debug, clap::Args)]
pub(crate) struct ServeArgs {}

/// Serves until it is told to stop.
pub(crate) async fn run(_args: ServeArgs) -> Result<(), std::io::Error> {
    std::future::ready(Err(std::io::Error::other("this build has no service"))).await
}
