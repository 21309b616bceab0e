//! Arguments of the library as flags: names, values, defaults and help come from their declarations.

use std::str::FromStr;

use chladni::arguments::{Absent, Accepts, Argument, Arguments, Value};
use clap::builder::{PossibleValuesParser, Str, TypedValueParser, ValueParser};
use clap::error::{Error, ErrorKind};
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command};

/// Accepts one of the words of an enum, of which `names` are offered.
pub(super) fn word<T>(names: &[&'static str]) -> impl TypedValueParser<Value = T> + use<T>
where
    T: FromStr<Err = strum::ParseError> + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(names).try_map(|name| name.parse())
}

/// The flags of a struct of arguments.
#[derive(Debug, Clone)]
pub(super) struct Flags<A>(pub A, Vec<&'static str>);

impl<A> Flags<A> {
    /// Whether the argument stands on the command line.
    pub(super) fn is_given(&self, name: &str) -> bool {
        self.1.contains(&name)
    }
}

impl<A: Arguments> clap::Args for Flags<A> {
    fn augment_args(command: Command) -> Command {
        command.args(A::table().iter().map(flag))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<A: Arguments> clap::FromArgMatches for Flags<A> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let mut flags = Self(A::default(), Vec::new());
        flags.update_from_arg_matches(matches)?;
        Ok(flags)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        for argument in A::table() {
            if matches.value_source(argument.name) == Some(ValueSource::CommandLine) {
                self.1.push(argument.name);
            }
            let value = if is_bare(&argument) {
                matches.get_flag(argument.name).then_some(Value::Switch(true))
            } else {
                let given = matches.get_many::<String>(argument.name);
                let given = given.map(|texts| texts.map(String::as_str).collect::<Vec<_>>().join(","));
                given.map(|text| read(&argument, &text)).transpose()?
            };
            if value.is_some_and(|value| !self.0.set(argument.name, &value)) {
                return Err(refuse(&argument, "this value"));
            }
        }
        Ok(())
    }
}

/// Whether the flag alone says it all: a switch that is off when it is not given.
fn is_bare(argument: &Argument) -> bool {
    argument.accepts == Accepts::Switch
        && matches!(argument.absent, Absent::Value(shown) if shown() == "false")
}

fn flag(argument: &Argument) -> Arg {
    let mut flag = Arg::new(argument.name).long(kebab(argument.name));
    if let Some(alias) = argument.alias {
        flag = flag.visible_alias(kebab(alias));
    }
    if let Some(short) = argument.short {
        flag = flag.short(short);
    }
    let mut help = argument.meaning.trim_end_matches('.').to_owned();
    if is_bare(argument) {
        return flag.help(help).action(ArgAction::SetTrue);
    }
    match argument.absent {
        Absent::Value(shown) => flag = flag.default_value(Str::from(shown())),
        Absent::Words(words) => help = format!("{help} [default: {}]", words()),
    }
    let is_list = argument.accepts == Accepts::Names;
    flag.help(help)
        .value_name(value_name(argument.accepts))
        .value_parser(parser(*argument))
        .allow_negative_numbers(true)
        .action(if is_list { ArgAction::Append } else { ArgAction::Set })
}

fn kebab(name: &str) -> Str {
    Str::from(name.replace('_', "-"))
}

fn value_name(accepts: Accepts) -> &'static str {
    match accepts {
        Accepts::Integer(..) => "N",
        Accepts::Positive | Accepts::NonNegative | Accepts::Range(..) => "NUMBER",
        Accepts::Switch => "BOOL",
        Accepts::Word(_) => "WORD",
        Accepts::Text => "TEXT",
        Accepts::Names => "NAMES",
        Accepts::Id => "ID",
    }
}

/// Accepts what the argument does, and passes it on as text.
fn parser(argument: Argument) -> ValueParser {
    match argument.accepts {
        Accepts::Word(words) => PossibleValuesParser::new(words).into(),
        accepts => clap::builder::StringValueParser::new()
            .try_map(move |text| match accepts.read(&text) {
                Some(_) => Ok(text),
                None => Err(format!("expected {}", accepts.in_words())),
            })
            .into(),
    }
}

fn read(argument: &Argument, text: &str) -> Result<Value, Error> {
    argument.accepts.read(text).ok_or_else(|| refuse(argument, text))
}

fn refuse(argument: &Argument, text: &str) -> Error {
    let accepted = argument.accepts.in_words();
    Error::raw(
        ErrorKind::InvalidValue,
        format!("--{} must be {accepted}, not {text}\n", kebab(argument.name)),
    )
}

#[cfg(test)]
mod tests {
    use chladni::analysis::Parameters;
    use chladni::harmonics::filtered::Named;
    use clap::{Args, FromArgMatches};

    use super::*;

    fn parse<A: Arguments>(line: &str) -> Result<A, Error> {
        let command = Flags::<A>::augment_args(Command::new("test"));
        let matches = command.try_get_matches_from(format!("test {line}").split_whitespace())?;
        Flags::<A>::from_arg_matches(&matches).map(|flags| flags.0)
    }

    #[test]
    fn without_flags_the_defaults_of_the_library_hold() {
        assert_eq!(parse::<Parameters>("").unwrap(), Parameters::default());
    }

    #[test]
    fn flags_reach_their_fields_by_name_alias_and_letter() {
        let parsed =
            parse::<Parameters>("-k 7 --tol 1e-3 --paper --sheet-aware false --operator graph").unwrap();
        let expected = Parameters {
            bases: 7,
            tolerance: 1e-3,
            paper: true,
            sheet_aware: Some(false),
            operator: chladni::operator::OperatorKind::Graph,
            ..Parameters::default()
        };
        assert_eq!(parsed, expected);
    }

    #[test]
    fn lists_are_given_in_one_or_several_flags() {
        let named = parse::<Named>("--field a,b --field c").unwrap();
        assert_eq!(named.field, ["a", "b", "c"]);
    }

    #[test]
    fn values_out_of_range_are_refused() {
        for line in ["--bases 0", "--tolerance 2", "--t -1", "--operator none", "--sheet-aware maybe"] {
            assert!(parse::<Parameters>(line).is_err(), "{line}");
        }
    }
}
