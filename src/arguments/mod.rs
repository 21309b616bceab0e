//! Arguments, each declared once: name, accepted values, default and meaning stand on the field of a struct.
//!
//! From the declaration follow the struct's default, the reading of queries, JSON and command lines, and every
//! document that lists arguments.

mod declare;
mod reading;
mod words;

pub(crate) use declare::arguments;
#[cfg(feature = "server")]
pub(crate) use declare::groups;
pub use reading::{ArgumentError, Reader};
pub(crate) use words::words;

/// What values an argument takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Accepts {
    /// A whole number in a closed range.
    Integer(usize, usize),
    /// A finite number above zero.
    Positive,
    /// A finite number from zero.
    NonNegative,
    /// A number in a closed range.
    Range(f64, f64),
    /// `true` or `false`; in a query, the bare name means `true`.
    Switch,
    /// One of these words.
    Word(&'static [&'static str]),
    /// Any text.
    Text,
    /// Names between commas.
    Names,
    /// A UUID.
    Id,
}

/// A value as it was given, of the type that its argument accepts.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A whole number.
    Integer(usize),
    /// A number.
    Number(f64),
    /// A truth value.
    Switch(bool),
    /// A word, text, names, or an id.
    Text(String),
}

/// The value of an argument that is not given.
#[derive(Debug, Clone, Copy)]
pub enum Absent {
    /// This value.
    Value(fn() -> String),
    /// It depends on other things, told in words.
    Words(fn() -> String),
}

/// An argument that exists.
#[derive(Debug, Clone, Copy)]
pub struct Argument {
    /// Its name.
    pub name: &'static str,
    /// Another name for it.
    pub alias: Option<&'static str>,
    /// Its one letter on the command line.
    pub short: Option<char>,
    /// Its values.
    pub accepts: Accepts,
    /// Its value when it is not given.
    pub absent: Absent,
    /// What it does, with units.
    pub meaning: &'static str,
}

/// A struct of arguments; its default is what holds when none is given.
pub trait Arguments: Default {
    /// The arguments, in the order in which they are documented.
    fn table() -> Vec<Argument>;

    /// Sets the argument `name` of the table; `false` when the value is not of its type.
    fn set(&mut self, name: &str, value: &Value) -> bool;
}

/// What a struct of arguments may hold and no caller could give: numbers. Other types hold only what is accepted.
pub trait Ranges: Arguments {
    /// The first argument whose number is not accepted.
    fn out_of_range(&self) -> Option<Argument>;
}

/// No arguments.
impl Arguments for () {
    fn table() -> Vec<Argument> {
        Vec::new()
    }

    fn set(&mut self, _: &str, _: &Value) -> bool {
        false
    }
}

impl Absent {
    /// The value, or what it depends on.
    #[must_use]
    pub fn in_words(self) -> String {
        match self {
            Self::Value(shown) | Self::Words(shown) => shown(),
        }
    }
}

impl Argument {
    /// Whether `name` is its name or its alias.
    #[must_use]
    pub fn is_called(&self, name: &str) -> bool {
        self.name == name || self.alias == Some(name)
    }
}

impl Accepts {
    /// The value that a text stands for; `None` when it is not accepted.
    #[must_use]
    pub fn read(self, text: &str) -> Option<Value> {
        let value = match self {
            Self::Integer(..) => Value::Integer(text.parse().ok()?),
            Self::Positive | Self::NonNegative | Self::Range(..) => Value::Number(text.parse().ok()?),
            Self::Switch => match text {
                "true" | "1" | "" => Value::Switch(true),
                "false" | "0" => Value::Switch(false),
                _ => return None,
            },
            Self::Word(_) => Value::Text(text.to_ascii_lowercase()),
            Self::Text | Self::Names | Self::Id => Value::Text(text.to_owned()),
        };
        self.holds(&value).then_some(value)
    }

    /// Whether a value is accepted. Of an id only the type is looked at; its struct reads it.
    #[must_use]
    pub fn holds(self, value: &Value) -> bool {
        match self {
            Self::Integer(least, most) => value.integer().is_some_and(|x| (least..=most).contains(&x)),
            Self::Positive => value.number().is_some_and(|x| x > 0.0 && x.is_finite()),
            Self::NonNegative => value.number().is_some_and(|x| x >= 0.0 && x.is_finite()),
            Self::Range(low, high) => value.number().is_some_and(|x| (low..=high).contains(&x)),
            Self::Switch => value.switch().is_some(),
            Self::Word(words) => value.text().is_some_and(|word| words.contains(&word)),
            Self::Text | Self::Names | Self::Id => value.text().is_some(),
        }
    }

    /// What is accepted, in words.
    #[must_use]
    pub fn in_words(self) -> String {
        match self {
            Self::Integer(least, usize::MAX) => format!("a whole number from {least}"),
            Self::Integer(least, most) => format!("a whole number from {least} to {most}"),
            Self::Positive => "a number above 0".to_owned(),
            Self::NonNegative => "a number from 0".to_owned(),
            Self::Range(low, high) => format!("a number from {low:e} to {high:e}"),
            Self::Switch => "true or false".to_owned(),
            Self::Word(words) => format!("one of {}", words.join(", ")),
            Self::Text => "text".to_owned(),
            Self::Names => "names separated by commas".to_owned(),
            Self::Id => "a UUID".to_owned(),
        }
    }
}

impl Value {
    /// A whole number.
    #[must_use]
    pub fn integer(&self) -> Option<usize> {
        if let Self::Integer(number) = self { Some(*number) } else { None }
    }

    /// A number, whole or not.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Integer(number) => Some(*number as f64),
            Self::Number(number) => Some(*number),
            Self::Switch(_) | Self::Text(_) => None,
        }
    }

    /// A truth value.
    #[must_use]
    pub fn switch(&self) -> Option<bool> {
        if let Self::Switch(on) = self { Some(*on) } else { None }
    }

    /// A text.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        if let Self::Text(text) = self { Some(text) } else { None }
    }

    /// The names between commas, without the blanks around them.
    #[must_use]
    pub fn names(&self) -> Option<Vec<String>> {
        let names = self.text()?.split(',').map(str::trim).filter(|name| !name.is_empty());
        Some(names.map(str::to_owned).collect())
    }
}

/// A number as one writes it: `0.1`, `100`, `1e-4`.
#[must_use]
pub fn number_in_words(number: f64) -> String {
    if number != 0.0 && number.abs() < 1e-3 { format!("{number:e}") } else { number.to_string() }
}
