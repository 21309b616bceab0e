//! `chladni demo`.

/// Show what the service does.
#[derive(Debug, clap::Args)]
pub(crate) struct DemoArgs {}

/// Runs the demo.
pub(crate) async fn run(_args: DemoArgs) -> Result<(), std::io::Error> {
    std::future::ready(Err(std::io::Error::other("this build has no service"))).await
}
