//! Reads the command line and runs a command.

mod analyze;
mod backup;
mod client;
mod compact;
mod completions;
mod database;
mod demo;
mod environment;
mod flags;
mod harmonics;
mod health;
mod input;
mod interrupt;
mod keys;
mod migrate;
mod output;
mod reporting;
mod reproduce;
mod sample;
mod serve;
mod source;
mod usage;
mod view;

use std::ffi::OsString;
use std::future::Future;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use signal_hook::consts::SIGPIPE;

/// What a caller's script may rely on.
const EXIT_CODES: &str = "\
Exit codes:
  0  done
  1  something failed that the caller cannot mend: the disk, the database, numerics
  2  the call is wrong: a flag, a parameter, or a file that cannot be read or analyzed; nothing was written
A command that Ctrl-C or another signal ends dies of that signal, so that loops of a shell stop.

`chladni serve` starts the service; `-` is standard input or output where a file is expected.";

/// Spectral geometry of scanned surfaces: Laplace-Beltrami operators and manifold harmonics of point clouds.
#[derive(Debug, Parser)]
#[command(name = "chladni", version, about, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve the HTTP interface
    Serve(serve::ServeArgs),
    /// Show what the service does, on a synthetic scan
    Demo(demo::DemoArgs),
    /// Show a scan and its modes in a browser
    View(view::ViewArgs),
    /// Analyze a point cloud and write the results into a directory
    Analyze(Box<analyze::AnalyzeArgs>),
    /// Filter the coordinates of an analyzed cloud, or some of its fields
    Filter(harmonics::FilterArgs),
    /// Transform coordinates and fields, or functions of your own, into coefficients
    Coefficients(harmonics::CoefficientsArgs),
    /// Make functions from coefficients
    Synthesis(harmonics::SynthesisArgs),
    /// Find salient feature points
    Features(harmonics::FeaturesArgs),
    /// Compute heat or wave kernel signatures of every point
    Signatures(harmonics::SignaturesArgs),
    /// Compute distances from one point to all others
    Distances(harmonics::DistancesArgs),
    /// Compare two shapes by their spectra
    Similarity(harmonics::SimilarityArgs),
    /// Read area, boundary length and Euler characteristic off a spectrum
    Invariants(harmonics::InvariantsArgs),
    /// Draw a cloud, a basis, or feature points; plot a spectrum
    Render(Box<harmonics::RenderArgs>),
    /// Write a sample shape with known geometry
    Sample(sample::SampleArgs),
    /// Reproduce the tables and figures of the papers and compare
    Reproduce(reproduce::ReproduceArgs),
    /// Keep the file of API keys: add, list, rotate, rename, revoke
    Keys(keys::KeysArgs),
    /// Copy the database into a new file while the service goes on
    Backup(backup::BackupArgs),
    /// Copy an SQLite file into an empty PostgreSQL database
    Migrate(migrate::MigrateArgs),
    /// Give the space of deleted data back to the disk while no service runs
    Compact(compact::CompactArgs),
    /// Ask a running service whether it is alive; exits 0 if so
    Health(health::HealthArgs),
    /// Print a script that completes commands and flags in a shell
    Completions(completions::CompletionsArgs),
}

/// Why a command ended without doing what it should.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// The caller can mend it: exit code 2, as for a misspelt flag.
    #[error("{0}")]
    Input(String),
    /// Anything else: exit code 1.
    #[error("{0}")]
    Other(String),
    /// A signal broke it off; the process is to die of it.
    #[error("canceled")]
    Signal(i32),
}

impl Failure {
    fn input(error: impl std::fmt::Display) -> Self {
        Self::Input(error.to_string())
    }

    fn other(error: impl std::fmt::Display) -> Self {
        Self::Other(error.to_string())
    }

    fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Other(_) => 1,
            // As shells tell a death by a signal.
            Self::Signal(signal) => 128 + u8::try_from(*signal).unwrap_or(127),
        }
    }
}

/// Runs the command that the process was started with.
#[must_use]
pub fn main() -> ExitCode {
    run(std::env::args_os().collect()).into()
}

/// Runs the command that `arguments` name, the program's name first; gives the exit code.
#[must_use]
pub fn run(arguments: Vec<OsString>) -> u8 {
    let cli = match usage::read(arguments) {
        Ok(cli) => cli,
        Err(usage::Ended::Told(code)) => return code,
        Err(usage::Ended::Failed(failure)) => return end(&failure),
    };
    let result = match cli.command {
        Command::Serve(args) => block_on(serve::run(args)),
        Command::Keys(args) => keys::run(&args),
        Command::Backup(args) => backup::run(&args),
        Command::Migrate(args) => migrate::run(&args),
        Command::Compact(args) => compact::run(&args),
        Command::Demo(args) => run_on_runtime(demo::run(args)),
        Command::View(args) => run_on_runtime(view::run(args)),
        Command::Analyze(args) => analyze::run(&args),
        Command::Filter(args) => harmonics::filter(&args),
        Command::Coefficients(args) => harmonics::coefficients(&args),
        Command::Synthesis(args) => harmonics::synthesis(&args),
        Command::Features(args) => harmonics::features(&args),
        Command::Signatures(args) => harmonics::signatures(&args),
        Command::Distances(args) => harmonics::distances(&args),
        Command::Similarity(args) => harmonics::similarity(&args),
        Command::Invariants(args) => harmonics::invariants(&args),
        Command::Render(args) => harmonics::render(&args),
        Command::Sample(args) => sample::run(&args),
        Command::Reproduce(args) => reproduce::run(&args),
        Command::Health(args) => run_on_runtime(health::run(args)),
        Command::Completions(args) => completions::run(&args),
    };
    match result {
        Ok(()) => 0,
        Err(failure) => end(&failure),
    }
}

/// Says why a command failed; gives the exit code, unless the process is to die of a signal.
fn end(failure: &Failure) -> u8 {
    // A reader that closed its end of a pipe has seen enough.
    if !matches!(failure, Failure::Signal(SIGPIPE)) {
        reporting::note(format_args!("chladni: error: {failure}"));
    }
    if let Failure::Signal(signal) = failure {
        interrupt::die_of(*signal);
    }
    failure.exit_code()
}

/// As [`block_on`], for commands whose failures may be the caller's.
fn run_on_runtime(command: impl Future<Output = Result<(), Failure>>) -> Result<(), Failure> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().map_err(Failure::other)?;
    runtime.block_on(command)
}

fn block_on<E: std::fmt::Display>(command: impl Future<Output = Result<(), E>>) -> Result<(), Failure> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().map_err(Failure::other)?;
    runtime.block_on(command).map_err(Failure::other)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }
}
