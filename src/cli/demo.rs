//! `chladni demo`.

/// Show what the service does.
#[derive(Debug, clap::Args)]
pub struct DemoArgs {}

/// Runs the demo.
pub async fn run(_args: DemoArgs) -> Result<(), std::io::Error> {
    Err(std::io::Error::other("this build has no service"))
}
