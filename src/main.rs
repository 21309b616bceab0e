//! Command line of chladni.

fn main() -> std::process::ExitCode {
    chladni::cli::main()
}
