//! `chladni demo`: a synthetic scan through the whole service, over HTTP, in a directory of its own.

mod report;

use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};

use chladni::app::{App, DatabaseAddress, Settings, StartError, address, told_to_stop};
use chladni::cloud::PointCloud;
use chladni::cloud::reader::Format;
use chladni::cloud::shapes::{SampleError, SampleRequest, Sampling, Shape, sample};
use chladni::cloud::writer::write;
use hyper::Method;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::Value;
use tempfile::TempDir;

use super::Failure;
use super::client::{Client, ClientError};
use super::interrupt::die_of;
use super::reporting::{note, print};

/// Seconds of each `?wait=`: how often the progress bar moves.
const LOOK_SECONDS: u64 = 1;
/// Of the bar.
const PERCENT: f64 = 100.0;
/// Standard deviation of the scan's noise; the torus is two units long.
const NOISE: f64 = 0.001;

/// Show what the service does, on a synthetic scan.
#[derive(Debug, clap::Args)]
pub(crate) struct DemoArgs {
    /// End after the printout instead of serving on.
    #[arg(long)]
    exit: bool,

    /// Directory for the database; a temporary one, removed at the end, when not given.
    #[arg(long, value_name = "DIRECTORY")]
    directory: Option<PathBuf>,

    /// Points of the scan.
    #[arg(long, value_name = "N", default_value_t = 20_000)]
    points: usize,

    /// Bases to compute.
    #[arg(long, value_name = "N", default_value_t = 30)]
    bases: usize,

    /// Address and port; when it is taken, a free port of loopback is used.
    #[arg(long, value_name = "ADDRESS", value_parser = address, default_value_t = SocketAddr::from((Ipv4Addr::LOCALHOST, 8080)))]
    listen: SocketAddr,
}

/// Why the demo ended early.
#[derive(Debug, thiserror::Error)]
pub(crate) enum DemoError {
    /// The service did not start.
    #[error(transparent)]
    Start(#[from] StartError),
    /// A request failed.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// A file or a signal.
    #[error("{0}")]
    System(#[from] std::io::Error),
    /// The scan cannot be made.
    #[error(transparent)]
    Sample(#[from] SampleError),
    /// The job did not succeed.
    #[error("the job ended {state}: {detail}")]
    Job {
        /// Its state.
        state: String,
        /// Why.
        detail: String,
    },
    /// An answer is not what it should be.
    #[error("the answer is not what it should be: {0}")]
    Answer(String),
}

/// Runs the demo.
///
/// # Errors
/// [`Failure`]: a [`DemoError`].
pub(crate) async fn run(args: DemoArgs) -> Result<(), Failure> {
    let temporary = match &args.directory {
        Some(given) => {
            std::fs::create_dir_all(given).map_err(Failure::other)?;
            None
        }
        None => Some(tempfile::Builder::new().prefix("chladni-demo-").tempdir().map_err(Failure::other)?),
    };
    let directory =
        args.directory.as_deref().or(temporary.as_ref().map(TempDir::path)).unwrap_or(Path::new("."));
    let app = start(&args, directory).await.map_err(Failure::other)?;
    let outcome = tokio::select! {
        shown = show_and_stay(&app, &args) => shown.map(|()| None),
        told = told_to_stop() => told.map(Some).map_err(Failure::other),
    };
    app.shutdown().await;
    if let Some(Err(error)) = temporary.map(TempDir::close) {
        tracing::warn!(%error, "cannot remove the temporary directory");
    }
    if let Some(signal) = outcome? {
        die_of(signal);
    }
    Ok(())
}

/// Shows everything, then waits forever unless the demo is to exit.
async fn show_and_stay(app: &App, args: &DemoArgs) -> Result<(), Failure> {
    print(show(app, args).await.map_err(Failure::other)?)?;
    if !args.exit {
        note(format_args!("\nServing on http://{}; Ctrl-C ends it.", app.address()));
        std::future::pending::<()>().await;
    }
    Ok(())
}

async fn start(args: &DemoArgs, directory: &Path) -> Result<App, StartError> {
    let settings = Settings {
        listen: args.listen,
        database: DatabaseAddress::file(directory.join("chladni.db")),
        ..Settings::default()
    };
    match App::start(settings.clone()).await {
        Err(StartError::Listen { cause, .. }) if cause.kind() == std::io::ErrorKind::AddrInUse => {
            note(format_args!("{} is taken; using a free port.", args.listen));
            App::start(Settings { listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 0)), ..settings }).await
        }
        started => started,
    }
}

/// Sends a scan through the service; what comes of it, as text.
async fn show(app: &App, args: &DemoArgs) -> Result<String, DemoError> {
    let cloud = scan(args.points)?;
    let mut file = Vec::new();
    write(&cloud, Format::Ply, &mut file)?;
    let served = app.address();
    note(format_args!(
        "The scan: a torus with two holes, tenfold denser at one end than at the other, with noise; {} points, {} KB of PLY.",
        cloud.len(),
        file.len() >> 10
    ));
    note(format_args!("PUT http://{served}/clouds?bases={}", args.bases));
    let mut client = Client::connect(&served.to_string()).await?;
    let path = format!("/clouds?bases={}", args.bases);
    let accepted = client.send(Method::PUT, &path, Some("application/x-ply"), file).await?;
    let accepted: Value = serde_json::from_slice(&accepted).map_err(ClientError::from)?;
    let id =
        accepted["job"]["id"].as_str().ok_or_else(|| DemoError::Answer("no job id".to_owned()))?.to_owned();
    let job = follow(&mut client, &id).await?;
    let spectrum = client.json(&format!("/jobs/{id}/spectrum")).await?;
    let orthogonality = report::orthogonality(&mut client, &id, cloud.len(), args.bases).await?;
    let next = if args.exit { report::how_to_serve() } else { report::next(app.address(), &job) };
    Ok(report::text(&job, &spectrum, orthogonality) + &next)
}

/// Noisy and unevenly sampled, as scans are.
fn scan(points: usize) -> Result<PointCloud, SampleError> {
    let even = SampleRequest::new(Shape::TwoHoleTorus, points);
    sample(&SampleRequest { sampling: Sampling::NonUniform, noise: NOISE, ..even })
}

/// Shows the job's progress until it ends.
async fn follow(client: &mut Client, id: &str) -> Result<Value, DemoError> {
    let style = ProgressStyle::with_template("{msg:>15} [{bar:40}] {percent}% {elapsed}");
    let bar =
        ProgressBar::new(PERCENT as u64).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    loop {
        let job = client.json(&format!("/jobs/{id}?wait={LOOK_SECONDS}")).await?;
        let state = job["state"].as_str().unwrap_or_default().to_owned();
        bar.set_message(job["phase"].as_str().unwrap_or(&state).to_owned());
        bar.set_position((job["progress"].as_f64().unwrap_or(0.0) * PERCENT) as u64);
        match state.as_str() {
            "succeeded" => {
                bar.finish_and_clear();
                return Ok(job);
            }
            "failed" | "canceled" => {
                bar.abandon();
                let detail = job["error"]["detail"].as_str().unwrap_or("no reason given").to_owned();
                return Err(DemoError::Job { state, detail });
            }
            _ => {}
        }
    }
}
