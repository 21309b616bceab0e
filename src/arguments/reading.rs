//! Reading arguments one by one: each known, of the right type, and given once.

use super::{Argument, Arguments, Value};

/// Similarity (Jaro–Winkler, 0 to 1) from which an unknown name counts as a slip of a known one.
const SLIP_SIMILARITY: f64 = 0.7;

/// Why an argument is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ArgumentError {
    /// No argument has this name.
    #[error("there is no parameter `{name}` here; {}", suggestion(*.nearest, .known))]
    Unknown {
        /// As it was given.
        name: String,
        /// The known name that it may be meant for.
        nearest: Option<&'static str>,
        /// All names.
        known: Vec<&'static str>,
    },
    /// The value is not accepted.
    #[error("parameter `{name}` must be {accepted}, not `{value}`")]
    Value {
        /// The argument.
        name: &'static str,
        /// What is accepted, in words.
        accepted: String,
        /// As it was given.
        value: String,
    },
    /// It is given more than once.
    #[error("parameter `{0}` is given twice")]
    Twice(&'static str),
}

fn suggestion(nearest: Option<&'static str>, known: &[&'static str]) -> String {
    match nearest {
        Some(nearest) => format!("did you mean `{nearest}`?"),
        None if known.is_empty() => "none is accepted".to_owned(),
        None => format!("known parameters: {}", known.join(", ")),
    }
}

impl ArgumentError {
    /// The refusal of a value.
    #[must_use]
    pub fn value(argument: &Argument, value: &str) -> Self {
        let (name, accepted) = (argument.name, argument.accepts.in_words());
        Self::Value { name, accepted, value: value.chars().take(80).collect() }
    }
}

/// Reads arguments into a struct.
#[derive(Debug)]
pub struct Reader<A> {
    table: Vec<Argument>,
    given: Vec<&'static str>,
    arguments: A,
}

impl<A: Arguments> Reader<A> {
    /// Reads by `table`, that of `A` or a narrower one.
    #[must_use]
    pub fn new(table: Vec<Argument>) -> Self {
        Self { table, given: Vec::new(), arguments: A::default() }
    }

    /// Reads a value as text.
    ///
    /// # Errors
    /// [`ArgumentError`].
    pub fn read(&mut self, name: &str, text: &str) -> Result<(), ArgumentError> {
        let argument = self.find(name)?;
        let value = argument.accepts.read(text).ok_or_else(|| ArgumentError::value(&argument, text))?;
        self.set(argument, &value, text)
    }

    /// Takes a value that has a type already; `shown` is how a refusal quotes it. `None` is the same as absent.
    ///
    /// # Errors
    /// [`ArgumentError`].
    pub fn take(&mut self, name: &str, value: Option<&Value>, shown: &str) -> Result<(), ArgumentError> {
        let argument = self.find(name)?;
        match value {
            None => Ok(()),
            Some(value) if argument.accepts.holds(value) => self.set(argument, value, shown),
            Some(_) => Err(ArgumentError::value(&argument, shown)),
        }
    }

    /// A value that no argument could have, such as a list; refused as its argument says.
    ///
    /// # Errors
    /// Always: [`ArgumentError`].
    pub fn refuse(&self, name: &str, shown: &str) -> Result<(), ArgumentError> {
        Err(ArgumentError::value(&self.find(name)?, shown))
    }

    /// What was read.
    #[must_use]
    pub fn finish(self) -> A {
        self.arguments
    }

    fn set(&mut self, argument: Argument, value: &Value, shown: &str) -> Result<(), ArgumentError> {
        if self.given.contains(&argument.name) {
            return Err(ArgumentError::Twice(argument.name));
        }
        self.given.push(argument.name);
        let is_set = self.arguments.set(argument.name, value);
        if is_set { Ok(()) } else { Err(ArgumentError::value(&argument, shown)) }
    }

    fn find(&self, name: &str) -> Result<Argument, ArgumentError> {
        if let Some(argument) = self.table.iter().find(|argument| argument.is_called(name)) {
            return Ok(*argument);
        }
        let lower = name.to_ascii_lowercase();
        let similar = self.table.iter().map(|a| (strsim::jaro_winkler(&lower, a.name), a.name));
        let nearest = similar.filter(|(similarity, _)| *similarity >= SLIP_SIMILARITY);
        let nearest = nearest.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, name)| name);
        let known = self.table.iter().map(|argument| argument.name).collect();
        Err(ArgumentError::Unknown { name: name.chars().take(80).collect(), nearest, known })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::arguments;

    arguments! {
        #[derive(Debug, PartialEq)]
        struct Few {
            /// Number.
            bases: usize = integer(1, 10), default 5;
            /// T.
            #[alias = "tol"]
            tolerance: f64 = positive, default 1.0;
            /// P.
            paper: bool = switch, default false;
        }
    }

    fn read(pairs: &[(&str, &str)]) -> Result<Few, ArgumentError> {
        let mut reader = Reader::new(Few::table());
        pairs.iter().try_for_each(|(name, text)| reader.read(name, text))?;
        Ok(reader.finish())
    }

    fn refusal(pair: (&str, &str)) -> String {
        read(&[pair]).unwrap_err().to_string()
    }

    #[test]
    fn known_arguments_are_read_by_name_and_alias() {
        let few = read(&[("bases", "7"), ("tol", "1e-3"), ("paper", "")]).unwrap();
        assert_eq!(few, Few { bases: 7, tolerance: 1e-3, paper: true });
    }

    #[test]
    fn an_unknown_argument_is_refused_with_the_nearest_known() {
        assert!(refusal(("basis", "3")).contains("did you mean `bases`"));
        assert!(refusal(("zzz", "3")).contains("known parameters: bases, tolerance, paper"));
        let none = Reader::<()>::new(Vec::new()).read("x", "1").unwrap_err().to_string();
        assert!(none.contains("none is accepted"));
    }

    #[test]
    fn a_value_out_of_range_is_refused_with_the_range() {
        for value in ["0", "11", "-1", "many", "", "2.5"] {
            assert!(refusal(("bases", value)).contains("a whole number from 1 to 10"), "{value}");
        }
        for value in ["0", "-1", "nan", "inf"] {
            assert!(refusal(("tolerance", value)).contains("a number above 0"), "{value}");
        }
        assert!(refusal(("paper", "maybe")).contains("true or false"));
    }

    #[test]
    fn an_argument_given_twice_is_refused_also_under_its_alias() {
        let twice = read(&[("tol", "1"), ("tolerance", "2")]).unwrap_err();
        assert_eq!(twice, ArgumentError::Twice("tolerance"));
    }

    #[test]
    fn typed_values_follow_the_same_table() {
        let mut reader = Reader::<Few>::new(Few::table());
        reader.take("paper", None, "null").unwrap();
        reader.take("bases", Some(&Value::Integer(3)), "3").unwrap();
        assert!(reader.take("tolerance", Some(&Value::Text("3".into())), "\"3\"").is_err());
        assert!(reader.take("base", Some(&Value::Integer(3)), "3").is_err());
        assert_eq!(reader.finish().bases, 3);
    }
}
