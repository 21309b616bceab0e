//! The environment: variables that mean nothing to us, the filter of the log, colors.

use std::collections::BTreeSet;
use std::ffi::OsStr;

use clap::{Command, CommandFactory};
use tracing_subscriber::EnvFilter;

use super::Cli;

/// What all of our variables begin with.
const PREFIX: &str = "CHLADNI_";
/// Variables that had another name once: the command and the setting of each, and its former name, which still sets it.
const FORMER: [(&str, &str, &str); 3] = [
    ("serve", "body_bytes_max", "CHLADNI_MAX_BODY"),
    ("serve", "decoded_bytes_max", "CHLADNI_MAX_DECODED"),
    ("serve", "decoded_ratio_max", "CHLADNI_RATIO_MAX"),
];
/// Filters of the log.
pub(super) const LOG: &str = "CHLADNI_LOG";
/// Levels that a log filter may name.
const LEVELS: [&str; 6] = ["off", "error", "warn", "info", "debug", "trace"];
/// Edits that make a misspelt word of a known one, at most.
const EDITS_MAX: usize = 3;

/// Whether output to a terminal may be colored (<https://no-color.org>).
pub(super) fn colors() -> bool {
    std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}

/// Complaints about variables that are set and mean nothing.
pub(super) fn complaints() -> Vec<String> {
    let known = known(&Cli::command());
    let set = std::env::vars_os().filter_map(|(name, _)| name.into_string().ok());
    set.filter(|name| name.starts_with(PREFIX)).filter_map(|name| complaint(&name, &known)).collect()
}

fn complaint(name: &str, known: &BTreeSet<String>) -> Option<String> {
    if known.contains(name) {
        return None;
    }
    let nearest = known.iter().map(|known| (strsim::levenshtein(name, known), known)).min();
    let hint =
        nearest.filter(|(edits, _)| *edits <= EDITS_MAX).map(|(_, known)| format!("; did you mean {known}?"));
    Some(format!("the environment variable {name} sets nothing{}", hint.unwrap_or_default()))
}

/// The command, reading settings from variables of their former names where only these are set.
pub(super) fn with_former_names(command: Command) -> Command {
    FORMER.into_iter().fold(command, |command, (of, setting, former)| {
        command.mut_subcommand(of, |command| {
            command.mut_arg(setting, |argument| {
                let is_set = |name: &OsStr| std::env::var_os(name).is_some();
                let is_former = is_set(former.as_ref()) && !argument.get_env().is_some_and(is_set);
                if is_former { argument.env(former) } else { argument }
            })
        })
    })
}

/// The variables of all commands.
fn known(command: &Command) -> BTreeSet<String> {
    let own = command.get_arguments().filter_map(|argument| argument.get_env());
    let own = own.map(|name| name.to_string_lossy().into_owned());
    let below = command.get_subcommands().flat_map(known);
    own.chain(below)
        .chain(FORMER.map(|(_, _, former)| former).into_iter().chain([LOG]).map(str::to_owned))
        .collect()
}

/// The filter that `CHLADNI_LOG` holds, `info` when it holds none, and a complaint when what it holds is not one.
pub(super) fn log_filter() -> (EnvFilter, Option<String>) {
    filter(&std::env::var(LOG).unwrap_or_default())
}

fn filter(text: &str) -> (EnvFilter, Option<String>) {
    let default = || EnvFilter::new("info");
    if text.trim().is_empty() {
        return (default(), None);
    }
    let refused = |why: String| {
        let told = format!("{LOG}=`{text}` is not a filter: {why}; use debug or chladni=trace, for example");
        (default(), Some(told))
    };
    // A word alone is taken for a part of a program, and silences everything else.
    let is_level = |word: &str| LEVELS.iter().any(|level| word.eq_ignore_ascii_case(level));
    let stray = text.split(',').map(str::trim).find(|word| {
        !word.is_empty() && !word.contains(['=', '[', ':']) && !is_level(word) && *word != "chladni"
    });
    if let Some(word) = stray {
        return refused(format!("`{word}` is not one of {}", LEVELS.join(", ")));
    }
    match EnvFilter::try_new(text) {
        Ok(filter) => (filter, None),
        Err(error) => refused(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_variable_that_sets_nothing_is_complained_about() {
        let known = known(&Cli::command());
        for name in
            ["CHLADNI_LISTEN", "CHLADNI_LOG", "CHLADNI_LOG_FORMAT", "CHLADNI_KEYS", "CHLADNI_MAX_BODY"]
        {
            assert_eq!(complaint(name, &known), None);
        }
        let told = complaint("CHLADNI_LISTN", &known).unwrap();
        assert!(told.ends_with("did you mean CHLADNI_LISTEN?"), "{told}");
        let told = complaint("CHLADNI_SOMETHING_ELSE", &known).unwrap();
        assert!(told.ends_with("sets nothing"), "{told}");
    }

    #[test]
    fn a_filter_that_is_broken_is_replaced_and_complained_about() {
        for good in ["", "info", "DEBUG", "chladni=trace", "warn,chladni=debug", "chladni", "sqlx=off,info"] {
            assert_eq!(filter(good).1, None, "{good}");
        }
        for broken in ["inof", "chladni=loud", "info,verbose", "3x", "[{"] {
            let (replaced, told) = filter(broken);
            assert!(told.is_some(), "{broken}");
            assert_eq!(replaced.to_string(), "info");
        }
    }
}
