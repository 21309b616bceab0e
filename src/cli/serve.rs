//! `chladni serve`.

/// Serve the HTTP interface.
#[derive(Debug, clap::Args)]
pub struct ServeArgs {}

/// Serves until it is told to stop.
pub async fn run(_args: ServeArgs) -> Result<(), std::io::Error> {
    Err(std::io::Error::other("this build has no service"))
}
