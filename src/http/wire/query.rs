//! Arguments of a request: what exists, what is accepted, and how it is told when something is not.
//!
//! One table per operation drives parsing, the error messages, `GET /capabilities` and the OpenAPI document.

use std::collections::BTreeMap;
use std::str::FromStr;

use axum::extract::Query as RawQuery;
use axum::http::Uri;
use serde_json::{Map, Value};
use utoipa::openapi::path::{Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{Object, ObjectBuilder, SchemaFormat, Type};
use utoipa::openapi::{KnownFormat, RefOr, Required, Schema};
use uuid::Uuid;

use super::problem::{Kind as ProblemKind, Problem};

/// Similarity (Jaro–Winkler, 0 to 1) from which an unknown name is taken for a slip of a known one.
const SLIP_SIMILARITY: f64 = 0.7;

/// What values an argument takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Accepts {
    /// A whole number in a closed range.
    Integer(u64, u64),
    /// A finite number above zero.
    Positive,
    /// A finite number from zero.
    NonNegative,
    /// Any text.
    Text,
    /// A number in a closed range.
    Range(f64, f64),
    /// `true` or `false`; in a query, the bare name means `true`.
    Switch,
    /// One of these words.
    Word(&'static [&'static str]),
    /// A UUID.
    Id,
}

/// An argument that exists.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Argument {
    /// Its name.
    pub name: &'static str,
    /// Another name for it.
    pub alias: Option<&'static str>,
    /// Its values.
    pub accepts: Accepts,
    /// Value when absent, in words if it depends on other things.
    pub default: &'static str,
    /// What it does, with units.
    pub meaning: &'static str,
}

impl Accepts {
    fn read(self, text: &str) -> Option<Value> {
        let value = match self {
            Self::Integer(..) => u64::from_str(text).ok()?.into(),
            Self::Positive | Self::NonNegative | Self::Range(..) => f64::from_str(text).ok()?.into(),
            Self::Switch => match text {
                "true" | "1" | "" => true.into(),
                "false" | "0" => false.into(),
                _ => return None,
            },
            Self::Word(_) => text.to_ascii_lowercase().into(),
            Self::Id | Self::Text => text.into(),
        };
        self.holds(&value).then_some(value)
    }

    fn holds(self, value: &Value) -> bool {
        match self {
            Self::Integer(least, most) => value.as_u64().is_some_and(|x| (least..=most).contains(&x)),
            Self::Positive => value.as_f64().is_some_and(|x| x > 0.0 && x.is_finite()),
            Self::NonNegative => value.as_f64().is_some_and(|x| x >= 0.0 && x.is_finite()),
            Self::Text => value.is_string(),
            Self::Range(low, high) => value.as_f64().is_some_and(|x| (low..=high).contains(&x)),
            Self::Switch => value.is_boolean(),
            Self::Word(words) => value.as_str().is_some_and(|word| words.contains(&word)),
            Self::Id => value.as_str().is_some_and(|text| Uuid::from_str(text).is_ok()),
        }
    }

    /// What is accepted, in words.
    #[must_use]
    pub(crate) fn in_words(self) -> String {
        match self {
            Self::Integer(least, u64::MAX) => format!("a whole number from {least}"),
            Self::Integer(least, most) => format!("a whole number from {least} to {most}"),
            Self::Positive => "a number above 0".to_owned(),
            Self::NonNegative => "a number from 0".to_owned(),
            Self::Text => "text".to_owned(),
            Self::Range(low, high) => format!("a number from {low:e} to {high:e}"),
            Self::Switch => "true or false".to_owned(),
            Self::Word(words) => format!("one of {}", words.join(", ")),
            Self::Id => "a UUID".to_owned(),
        }
    }

    /// The JSON schema of a value.
    #[must_use]
    pub(crate) fn schema(self) -> Object {
        let object = ObjectBuilder::new();
        match self {
            Self::Integer(least, most) => {
                let object = object.schema_type(Type::Integer).minimum(Some(least as f64));
                if most == u64::MAX { object.build() } else { object.maximum(Some(most as f64)).build() }
            }
            Self::Positive => object.schema_type(Type::Number).exclusive_minimum(Some(0.0)).build(),
            Self::NonNegative => object.schema_type(Type::Number).minimum(Some(0.0)).build(),
            Self::Text => object.schema_type(Type::String).build(),
            Self::Range(low, high) => {
                object.schema_type(Type::Number).minimum(Some(low)).maximum(Some(high)).build()
            }
            Self::Switch => object.schema_type(Type::Boolean).build(),
            Self::Word(words) => {
                object.schema_type(Type::String).enum_values(Some(words.iter().copied())).build()
            }
            Self::Id => object
                .schema_type(Type::String)
                .format(Some(SchemaFormat::KnownFormat(KnownFormat::Uuid)))
                .build(),
        }
    }
}

impl Argument {
    /// The refusal of a value.
    #[must_use]
    pub(crate) fn refuse(&self, value: &str) -> Problem {
        let accepted = self.accepts.in_words();
        let shown: String = value.chars().take(80).collect();
        Problem::new(
            ProblemKind::InvalidParameter,
            format!("parameter `{}` is {accepted}, not `{shown}`", self.name),
        )
        .with("parameter", self.name)
        .with("accepted", accepted)
    }

    fn is_called(&self, name: &str) -> bool {
        self.name == name || self.alias == Some(name)
    }

    /// As the OpenAPI document shows it.
    #[must_use]
    pub(crate) fn document(&self) -> Parameter {
        ParameterBuilder::new()
            .name(self.name)
            .parameter_in(ParameterIn::Query)
            .required(Required::False)
            .description(Some(format!("{} Default: {}.", self.meaning, self.default)))
            .schema(Some(RefOr::T(Schema::Object(self.accepts.schema()))))
            .build()
    }
}

/// The arguments of one request, each known and of the right type.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Arguments {
    values: BTreeMap<&'static str, Value>,
}

impl Arguments {
    /// Reads the query of `uri` by `tables`.
    ///
    /// # Errors
    /// A problem that names the argument and what would be accepted.
    pub(crate) fn from_query(uri: &Uri, tables: &[&'static [Argument]]) -> Result<Self, Problem> {
        let RawQuery(pairs) = RawQuery::<Vec<(String, String)>>::try_from_uri(uri).map_err(|error| {
            Problem::new(ProblemKind::MalformedRequest, format!("the query cannot be read: {error}"))
        })?;
        let mut arguments = Self::default();
        for (name, text) in pairs {
            let argument = find(&name, tables)?;
            let value = argument.accepts.read(&text).ok_or_else(|| argument.refuse(&text))?;
            arguments.add(argument, value)?;
        }
        Ok(arguments)
    }

    /// Reads the members of a JSON object by `tables`; null is the same as absent.
    ///
    /// # Errors
    /// A problem that names the argument and what would be accepted.
    pub(crate) fn from_json(
        object: Map<String, Value>,
        tables: &[&'static [Argument]],
    ) -> Result<Self, Problem> {
        let mut arguments = Self::default();
        for (name, value) in object {
            let argument = find(&name, tables)?;
            if value.is_null() {
                continue;
            }
            if !argument.accepts.holds(&value) {
                return Err(argument.refuse(&value.to_string()));
            }
            arguments.add(argument, value)?;
        }
        Ok(arguments)
    }

    fn add(&mut self, argument: &'static Argument, value: Value) -> Result<(), Problem> {
        match self.values.insert(argument.name, value) {
            None => Ok(()),
            Some(_) => Err(Problem::new(
                ProblemKind::InvalidParameter,
                format!("parameter `{}` is given twice", argument.name),
            )
            .with("parameter", argument.name)),
        }
    }

    /// The values of those arguments that are in `table`.
    #[must_use]
    pub(crate) fn of(&self, table: &[Argument]) -> Map<String, Value> {
        table
            .iter()
            .filter_map(|argument| Some((argument.name.to_owned(), self.values.get(argument.name)?.clone())))
            .collect()
    }

    /// An integer.
    #[must_use]
    pub(crate) fn integer(&self, name: &str) -> Option<u64> {
        self.values.get(name).and_then(Value::as_u64)
    }

    /// A number.
    #[must_use]
    pub(crate) fn number(&self, name: &str) -> Option<f64> {
        self.values.get(name).and_then(Value::as_f64)
    }

    /// A switch.
    #[must_use]
    pub(crate) fn switch(&self, name: &str) -> Option<bool> {
        self.values.get(name).and_then(Value::as_bool)
    }

    /// A word.
    #[must_use]
    pub(crate) fn word(&self, name: &str) -> Option<&str> {
        self.values.get(name).and_then(Value::as_str)
    }

    /// An id.
    #[must_use]
    pub(crate) fn id(&self, name: &str) -> Option<Uuid> {
        self.word(name).and_then(|text| text.parse().ok())
    }
}

fn find(name: &str, tables: &[&'static [Argument]]) -> Result<&'static Argument, Problem> {
    let all = || tables.iter().flat_map(|table| table.iter());
    if let Some(argument) = all().find(|argument| argument.is_called(name)) {
        return Ok(argument);
    }
    let shown: String = name.chars().take(80).collect();
    let nearest = all()
        .map(|argument| (strsim::jaro_winkler(&name.to_ascii_lowercase(), argument.name), argument.name))
        .filter(|(similarity, _)| *similarity >= SLIP_SIMILARITY)
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let known = all().map(|argument| argument.name).collect::<Vec<_>>();
    let problem =
        |detail| Problem::new(ProblemKind::UnknownParameter, detail).with("parameter", shown.clone());
    Err(match nearest {
        Some((_, nearest)) => {
            problem(format!("there is no parameter `{shown}` here; did you mean `{nearest}`?"))
                .with("nearest", nearest)
        }
        None if known.is_empty() => {
            problem(format!("there is no parameter `{shown}` here; none is accepted"))
        }
        None => problem(format!("there is no parameter `{shown}` here; known are {}", known.join(", "))),
    }
    .with("accepted", known))
}

/// Declares the type that documents the query of an operation, from tables of [`Argument`]s.
macro_rules! arguments {
    ($(#[$meta:meta])* $name:ident = $($table:expr),+ $(,)?) => {
        $(#[$meta])*
        pub(crate) struct $name;

        impl $name {
            /// The tables.
            pub(crate) const TABLES: &'static [&'static [$crate::http::wire::query::Argument]] = &[$($table),+];

            /// Reads the query of `uri`.
            ///
            /// # Errors
            /// As [`Arguments::from_query`]($crate::http::wire::query::Arguments::from_query).
            pub(crate) fn read(
                uri: &axum::http::Uri,
            ) -> Result<$crate::http::wire::query::Arguments, $crate::http::wire::problem::Problem> {
                $crate::http::wire::query::Arguments::from_query(uri, Self::TABLES)
            }
        }

        impl utoipa::IntoParams for $name {
            fn into_params(
                _: impl Fn() -> Option<utoipa::openapi::path::ParameterIn>,
            ) -> Vec<utoipa::openapi::path::Parameter> {
                Self::TABLES.iter().flat_map(|table| table.iter()).map(|a| a.document()).collect()
            }
        }
    };
}
pub(crate) use arguments;

arguments!(
    /// No query at all.
    Nothing = &[]
);

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &[Argument] = &[
        Argument {
            name: "bases",
            alias: None,
            accepts: Accepts::Integer(1, 10),
            default: "5",
            meaning: "Number.",
        },
        Argument {
            name: "tolerance",
            alias: Some("tol"),
            accepts: Accepts::Positive,
            default: "1",
            meaning: "T.",
        },
        Argument { name: "paper", alias: None, accepts: Accepts::Switch, default: "false", meaning: "P." },
    ];

    fn read(query: &str) -> Result<Arguments, Problem> {
        Arguments::from_query(&format!("/x?{query}").parse().unwrap(), &[TABLE])
    }

    fn detail(query: &str) -> String {
        read(query).unwrap_err().document(None, None).detail
    }

    #[test]
    fn known_arguments_are_read_by_name_and_alias() {
        let arguments = read("bases=7&tol=1e-3&paper").unwrap();
        assert_eq!(arguments.integer("bases"), Some(7));
        assert_eq!(arguments.of(TABLE)["tolerance"], 1e-3);
        assert_eq!(arguments.switch("paper"), Some(true));
    }

    #[test]
    fn an_unknown_argument_is_refused_with_the_nearest_known() {
        assert!(detail("basis=3").contains("did you mean `bases`"), "{}", detail("basis=3"));
        assert!(detail("zzz=3").contains("known are bases, tolerance, paper"), "{}", detail("zzz=3"));
    }

    #[test]
    fn a_value_out_of_range_is_refused_with_the_range() {
        for query in ["bases=0", "bases=11", "bases=-1", "bases=many", "bases=", "bases=2.5"] {
            assert!(detail(query).contains("a whole number from 1 to 10"), "{query}");
        }
        for query in ["tolerance=0", "tolerance=-1", "tolerance=nan", "tolerance=inf"] {
            assert!(detail(query).contains("a number above 0"), "{query}");
        }
        assert!(detail("paper=maybe").contains("true or false"));
    }

    #[test]
    fn an_argument_given_twice_is_refused_also_under_its_alias() {
        assert!(detail("tol=1&tolerance=2").contains("given twice"));
    }

    #[test]
    fn json_members_follow_the_same_table() {
        let object = |json: Value| json.as_object().cloned().unwrap();
        let read = |json| Arguments::from_json(object(json), &[TABLE]);
        assert_eq!(read(serde_json::json!({"bases": 3, "paper": null})).unwrap().integer("bases"), Some(3));
        assert!(read(serde_json::json!({"bases": "3"})).is_err());
        assert!(read(serde_json::json!({"base": 3})).is_err());
    }
}
