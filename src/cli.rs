//! Reads the command line and runs a command. Without one, the service is started.

mod analyze;
mod backup;
mod completions;
mod demo;
mod harmonics;
mod health;
mod input;
mod output;
mod reproduce;
mod sample;
mod serve;

use std::ffi::OsString;
use std::future::Future;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// What a caller's script may rely on.
const EXIT_CODES: &str = "\
Exit codes:
  0  done
  1  something failed that the caller cannot mend: the disk, the database, numerics; or a signal ended it
  2  the call is wrong: a flag, a parameter, or a file that cannot be read or analysed; nothing was written

Without a command the service is started.";

/// Spectral geometry of scanned surfaces: Laplace-Beltrami operators and manifold harmonics of point clouds.
#[derive(Debug, Parser)]
#[command(name = "chladni", version, about, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve the HTTP interface (the default command)
    Serve(serve::ServeArgs),
    /// Show what the service does, on a synthetic scan
    Demo(demo::DemoArgs),
    /// Analyse a point cloud and write the results into a directory
    Analyze(Box<analyze::AnalyzeArgs>),
    /// Filter the coordinates of an analysed cloud, or some of its fields
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
    /// Copy the database into a new file while the service goes on
    Backup(backup::BackupArgs),
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
        }
    }
}

/// Runs the command that the process was started with.
#[must_use]
pub fn main() -> ExitCode {
    run(std::env::args_os().collect()).into()
}

/// Runs the command that `arguments` name, the program's name first; gives the exit code.
#[allow(clippy::print_stderr)] // errors of commands go there
#[must_use]
pub fn run(arguments: Vec<OsString>) -> u8 {
    let cli = Cli::parse_from(with_command(arguments));
    let result = match cli.command {
        Command::Serve(args) => block_on(serve::run(args)),
        Command::Backup(args) => backup::run(&args),
        Command::Demo(args) => block_on(demo::run(args)),
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
        Command::Health(args) => health::run(&args),
        Command::Completions(args) => completions::run(&args),
    };
    match result {
        Ok(()) => 0,
        Err(failure) => {
            eprintln!("chladni: error: {failure}");
            failure.exit_code()
        }
    }
}

/// Puts `serve` in where no command is named: `chladni --listen …` serves.
fn with_command(mut arguments: Vec<OsString>) -> Vec<OsString> {
    let first = arguments.get(1).and_then(|argument| argument.to_str());
    let serves = match first {
        None => arguments.len() < 2,
        Some("-h" | "--help" | "-V" | "--version") => false,
        Some(first) => first.starts_with('-'),
    };
    if serves {
        arguments.insert(1.min(arguments.len()), "serve".into());
    }
    arguments
}

fn block_on<E: std::fmt::Display>(command: impl Future<Output = Result<(), E>>) -> Result<(), Failure> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().map_err(Failure::other)?;
    runtime.block_on(command).map_err(Failure::other)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn completed(words: &[&str]) -> Vec<OsString> {
        with_command(words.iter().map(OsString::from).collect())
    }

    #[test]
    fn the_service_starts_when_no_command_is_named() {
        assert_eq!(completed(&["chladni"]), ["chladni", "serve"]);
        assert_eq!(
            completed(&["chladni", "--listen", "[::1]:9"]),
            ["chladni", "serve", "--listen", "[::1]:9"]
        );
        for words in
            [&["chladni", "sample"][..], &["chladni", "--help"], &["chladni", "-V"], &["chladni", "srve"]]
        {
            assert_eq!(completed(words), words);
        }
    }

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }
}
