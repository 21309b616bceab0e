//! Parses the command line and reports errors with a fix.

use std::ffi::OsString;
use std::io::{self, IsTerminal, Write};

use clap::error::{ContextKind, ContextValue};
use clap::{Command, CommandFactory, Error, FromArgMatches};

use super::output::not_printed;
use super::{Cli, Failure, environment};

/// Messages of number parsers, and what they mean.
const PLAIN: [(&str, &str); 4] = [
    ("invalid digit found in string", "expected a whole number from 0"),
    ("cannot parse integer from empty string", "expected a number"),
    ("invalid float literal", "expected a number"),
    ("number too large to fit in target type", "the number is too large"),
];

/// Why there is no command to run.
pub(super) enum Ended {
    /// Help was asked for, or the call is wrong, and that has been said; the exit code.
    Told(u8),
    /// It could not be said.
    Failed(Failure),
}

/// The command that the arguments name.
///
/// # Errors
/// [`Ended`].
pub(super) fn read(arguments: Vec<OsString>) -> Result<Cli, Ended> {
    let arguments = completed(arguments);
    // `--bases -3` is a wrong number, not an unknown flag.
    let command = Cli::command().mut_subcommands(|command| command.allow_negative_numbers(true));
    if arguments.len() < 2 {
        return Err(printed(command.color(clap::ColorChoice::Auto).print_help(), 0));
    }
    let command = environment::with_former_names(command);
    let read = command.clone().try_get_matches_from(&arguments);
    read.and_then(|matches| Cli::from_arg_matches(&matches))
        .map_err(|error| tell(&error, &command, &arguments))
}

/// Puts `serve` in where flags come without a command: `chladni --listen …` serves.
fn completed(mut arguments: Vec<OsString>) -> Vec<OsString> {
    let words: Vec<_> = arguments.iter().map(|argument| argument.to_string_lossy()).collect();
    let is_help = words.get(1).is_some_and(|first| first == "help");
    let serves = words.get(1).is_some_and(|first| {
        first.starts_with('-') && !["-h", "--help", "-V", "--version"].contains(&first.as_ref())
    });
    if serves {
        arguments.insert(1, "serve".into());
    } else if is_help {
        arguments.retain(|argument| argument != "--help" && argument != "-h");
    }
    arguments
}

fn printed(printed: io::Result<()>, code: u8) -> Ended {
    match printed.and_then(|()| io::stdout().flush()) {
        Ok(()) => Ended::Told(code),
        Err(error) => Ended::Failed(not_printed(&error)),
    }
}

fn tell(error: &Error, command: &Command, arguments: &[OsString]) -> Ended {
    let code = u8::try_from(error.exit_code()).unwrap_or(1);
    if !error.use_stderr() {
        return printed(error.print(), code);
    }
    let rendered = error.render();
    let colored = io::stderr().is_terminal() && environment::colors();
    let text = if colored { rendered.ansi().to_string() } else { rendered.to_string() };
    let text = improved(&text) + &of_environment(error, command, arguments).unwrap_or_default();
    let _ = write!(io::stderr().lock(), "{text}");
    Ended::Told(code)
}

/// The message in plain words, without the tip to pass a misspelt flag as a value.
fn improved(text: &str) -> String {
    let is_misleading = |line: &&str| line.contains("to pass '") && line.contains("as a value, use '");
    let text: String =
        text.lines().filter(|line| !is_misleading(line)).flat_map(|line| [line, "\n"]).collect();
    PLAIN.iter().fold(text, |text, (cryptic, plain)| text.replace(cryptic, plain))
}

/// A flag may be given by a variable too: which, and whether that is where a wrong value comes from.
fn of_environment(error: &Error, command: &Command, arguments: &[OsString]) -> Option<String> {
    let Some(ContextValue::String(shown)) = error.get(ContextKind::InvalidArg) else { return None };
    let flag = shown.split([' ', '=']).next()?;
    let named = arguments.get(1)?.to_str()?;
    let argument = command
        .find_subcommand(named)?
        .get_arguments()
        .find(|argument| argument.get_long().is_some_and(|long| flag == format!("--{long}")))?;
    let variable = argument.get_env()?;
    let is_given = arguments.iter().any(|argument| {
        let argument = argument.to_string_lossy();
        argument == flag || argument.starts_with(&format!("{flag}="))
    });
    let variable = variable.to_string_lossy();
    Some(if is_given || std::env::var_os(&*variable).is_none() {
        format!("\nThe environment variable {variable} sets {flag} too.\n")
    } else {
        format!("\nThe value comes from the environment variable {variable}, which sets {flag}.\n")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(words: &[&str]) -> Vec<OsString> {
        words.iter().map(OsString::from).collect()
    }

    #[test]
    fn flags_without_a_command_are_those_of_the_service() {
        let listen = ["chladni", "--listen", "[::1]:9"];
        assert_eq!(completed(words(&listen)), words(&["chladni", "serve", "--listen", "[::1]:9"]));
        for given in [&["chladni"][..], &["chladni", "sample"], &["chladni", "--help"], &["chladni", "-V"]] {
            assert_eq!(completed(words(given)), words(given));
        }
        assert_eq!(completed(words(&["chladni", "help", "--help"])), words(&["chladni", "help"]));
    }

    #[test]
    fn a_message_is_put_into_plain_words() {
        let text = "error: invalid value 'x' for '--points <N>': invalid digit found in string\n\n  \
                    tip: to pass '--x' as a value, use '-- --x'\n";
        let improved = improved(text);
        assert!(improved.contains("expected a whole number from 0"), "{improved}");
        assert!(!improved.contains("tip:"), "{improved}");
    }
}
