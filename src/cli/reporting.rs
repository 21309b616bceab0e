//! What a command says of its work, and in which form.

use std::io::{self, Write};
use std::path::Path;

use serde_json::{Value, json};

use super::Failure;
use super::output::{is_standard, not_printed};

/// Prints a command's own output.
///
/// # Errors
/// [`Failure`]: the reader closed its end of a pipe, a full disk.
pub(super) fn print(text: impl std::fmt::Display) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    writeln!(out, "{text}").and_then(|()| out.flush()).map_err(|error| not_printed(&error))
}

/// Tells something beside the output. Whoever closed standard error does not want to read it.
pub(super) fn note(text: impl std::fmt::Display) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// How commands report.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(super) struct Reporting {
    /// Print nothing but warnings and errors
    #[arg(long, short)]
    pub(super) quiet: bool,

    /// Print what was done as a JSON object in place of text
    #[arg(long, conflicts_with = "quiet")]
    pub(super) json: bool,
}

impl Reporting {
    /// Says that a file was written: `what` in text, `facts` (an object) in JSON. Standard output is left to the file
    /// when the file is written there.
    pub(super) fn wrote(self, path: &Path, what: &str, facts: Value) {
        let name = path.display().to_string();
        let text = if self.json {
            let mut told = json!({ "file": name });
            if let (Some(told), Value::Object(facts)) = (told.as_object_mut(), facts) {
                told.extend(facts);
            }
            told.to_string()
        } else {
            format!("{}: {what}", if is_standard(path) { "standard output" } else { &name })
        };
        if is_standard(path) { self.aside(&text) } else { self.say(&text) }
    }

    /// Prints a line, or several, of the command's own output.
    pub(super) fn say(self, text: &str) {
        if !self.quiet {
            // A reader that has seen enough, such as `head`, is not a failure.
            let _ = writeln!(io::stdout().lock(), "{text}");
        }
    }

    /// Prints warnings, also for those who want to read nothing else; in JSON they stand among the facts.
    pub(super) fn warn(self, warnings: &[String]) {
        if !self.json {
            for warning in warnings {
                note(format_args!("chladni: warning: {warning}"));
            }
        }
    }

    fn aside(self, text: &str) {
        if !self.quiet {
            note(text);
        }
    }
}
