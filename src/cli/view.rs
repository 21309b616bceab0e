//! `chladni view`: a scan in the browser, with a service of its own.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use chladni::app::{App, DatabaseAddress, Settings, address, told_to_stop};
use hyper::{Method, StatusCode};
use serde_json::Value;
use tempfile::TempDir;

use super::Failure;
use super::client::{Client, ClientError};
use super::interrupt::die_of;
use super::reporting::{note, print};

/// Show a scan and its modes in a browser.
///
/// Starts a service on a free port of this machine, uploads the scan, prints the address of the page and opens it where
/// there is a display. Ctrl-C ends it; without `--directory` nothing is kept.
#[derive(Debug, clap::Args)]
pub(crate) struct ViewArgs {
    /// Point cloud in any format that the service reads
    scan: PathBuf,

    /// Number of modes
    #[arg(long, short = 'k', value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=1000))]
    bases: u64,

    /// Discrete Laplace-Beltrami operator
    #[arg(long, value_name = "NAME", default_value = "pb-mhb")]
    operator: String,

    /// Directory that keeps the scan and its modes for another time
    #[arg(long, value_name = "DIRECTORY")]
    directory: Option<PathBuf>,

    /// Address and port, of loopback; port 0 is any free one
    #[arg(long, value_name = "ADDRESS", value_parser = address, default_value_t = SocketAddr::from((Ipv4Addr::LOCALHOST, 0)))]
    listen: SocketAddr,

    /// Print the address and leave the browser alone
    #[arg(long)]
    no_open: bool,
}

/// Serves until it is told to stop.
///
/// # Errors
/// [`Failure`].
pub(crate) async fn run(args: ViewArgs) -> Result<(), Failure> {
    let file = std::fs::read(&args.scan)
        .map_err(|error| Failure::Input(format!("{}: {error}", args.scan.display())))?;
    let temporary = TempDir::new().map_err(Failure::other)?;
    let directory = args.directory.as_deref().unwrap_or(temporary.path());
    std::fs::create_dir_all(directory)
        .map_err(|error| Failure::Input(format!("{}: {error}", directory.display())))?;
    let settings = Settings {
        listen: args.listen,
        database: DatabaseAddress::file(directory.join("chladni.db")),
        ..Settings::default()
    };
    let app = App::start(settings).await.map_err(Failure::other)?;
    let outcome = tokio::select! {
        shown = show(&app, &args, file) => shown.map(|()| None),
        told = told_to_stop() => told.map(Some).map_err(Failure::other),
    };
    app.shutdown().await;
    drop(temporary);
    if let Some(signal) = outcome? {
        die_of(signal);
    }
    Ok(())
}

/// Uploads, opens the page, and stays.
async fn show(app: &App, args: &ViewArgs, file: Vec<u8>) -> Result<(), Failure> {
    let job = upload(app.address(), args, file).await?;
    let address = format!("http://{}/#job={job}", app.address());
    print(&address)?;
    if !args.no_open && has_display() && !open(&address) {
        note("no browser could be started; open the address yourself");
    }
    std::future::pending().await
}

/// Submits the scan; the id of its job.
async fn upload(address: SocketAddr, args: &ViewArgs, file: Vec<u8>) -> Result<String, Failure> {
    let mut client = Client::connect(&address.to_string()).await.map_err(Failure::other)?;
    let path = format!(
        "/clouds/{}?operator={}&bases={}",
        file_name(&args.scan),
        encoded(&args.operator),
        args.bases
    );
    let answer = client.send(Method::PUT, &path, None, file).await.map_err(|error| match error {
        ClientError::Refused { status, detail, .. } if status != StatusCode::INTERNAL_SERVER_ERROR => {
            Failure::Input(format!("{}: {detail}", args.scan.display()))
        }
        error => Failure::other(error),
    })?;
    let answer: Value = serde_json::from_slice(&answer).map_err(Failure::other)?;
    let id = answer["job"]["id"].as_str().map(str::to_owned);
    id.ok_or_else(|| Failure::Other("the service did not name a job".to_owned()))
}

/// The last part of a path, fit for an address: its ending tells the format.
fn file_name(path: &Path) -> String {
    encoded(&path.file_name().unwrap_or_default().to_string_lossy())
}

/// Percent-encoding [RFC 3986 §2.1] of everything but unreserved characters.
fn encoded(text: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
    text.bytes()
        .map(|byte| if is_plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") })
        .collect()
}

/// Whether a window can be opened from here.
fn has_display() -> bool {
    cfg!(target_os = "macos")
        || ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some())
}

/// Opens an address in the browser of the desktop.
fn open(address: &str) -> bool {
    let program = if cfg!(target_os = "macos") { "open" } else { "xdg-open" };
    let quiet = || Stdio::null();
    Command::new(program).arg(address).stdin(quiet()).stdout(quiet()).stderr(quiet()).spawn().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_fit_for_addresses() {
        assert_eq!(file_name(Path::new("a/my scan#1 ü.ply")), "my%20scan%231%20%C3%BC.ply");
    }
}
