//! `chladni completions`.

use clap::CommandFactory;
use clap_complete::Shell;

use super::output::not_printed;
use super::{Cli, Failure};

/// Print a script that completes commands and flags.
#[derive(Debug, clap::Args)]
pub(crate) struct CompletionsArgs {
    /// The shell, as in `chladni completions bash > /etc/bash_completion.d/chladni`
    shell: Shell,
}

/// Prints the script.
pub(crate) fn run(args: &CompletionsArgs) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "chladni", &mut script);
    std::io::Write::write_all(&mut std::io::stdout().lock(), &script).map_err(|error| not_printed(&error))
}
