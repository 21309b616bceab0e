//! Command line of chladni.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
