//! Arguments of requests: read from queries and JSON, and shown in the OpenAPI document.

use axum::extract::{FromRequestParts, Query};
use axum::http::request::Parts;
use serde_json::{Map, Value as Json};
use utoipa::IntoParams;
use utoipa::openapi::path::{Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{Object, ObjectBuilder, SchemaFormat, Type};
use utoipa::openapi::{KnownFormat, RefOr, Required, Schema};

use super::problem::{Kind, Problem};
use crate::arguments::{Absent, Accepts, Argument, ArgumentError, Arguments, Reader, Value};

/// Ranges that are narrower for a service than for a program on one's own machine.
const CEILINGS: [(&str, usize); 2] = [("width", 2048), ("height", 2048)];

/// Most bases that this service computes, as an extension of its requests.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BasesMax(pub usize);

/// The arguments of `A`, within what every service accepts.
pub(crate) fn table<A: Arguments>() -> Vec<Argument> {
    let mut table = A::table();
    for (name, ceiling) in CEILINGS {
        bound(&mut table, name, ceiling);
    }
    table
}

/// The arguments of `A`, within what this service accepts.
pub(crate) fn table_within<A: Arguments>(BasesMax(bases): BasesMax) -> Vec<Argument> {
    let mut table = table::<A>();
    bound(&mut table, "bases", bases);
    table
}

fn bound(table: &mut [Argument], name: &str, ceiling: usize) {
    for argument in table.iter_mut().filter(|argument| argument.name == name) {
        if let Accepts::Integer(_, most) = &mut argument.accepts {
            *most = ceiling.min(*most);
        }
    }
}

/// The query of a request, every argument known and of the right type.
///
/// As an extractor it refuses a request before its body is read.
pub(crate) struct FromQuery<A>(pub A);

impl<A: Arguments, S: Sync> FromRequestParts<S> for FromQuery<A> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        let Query(pairs) = Query::<Vec<(String, String)>>::try_from_uri(&parts.uri).map_err(|error| {
            Problem::new(Kind::MalformedRequest, format!("the query cannot be read: {error}"))
        })?;
        let table = parts.extensions.get().map_or_else(table::<A>, |&bases| table_within::<A>(bases));
        let mut reader = Reader::<A>::new(table);
        pairs.iter().try_for_each(|(name, text)| reader.read(name, text))?;
        Ok(Self(reader.finish()))
    }
}

impl<A: Arguments> IntoParams for FromQuery<A> {
    fn into_params(_: impl Fn() -> Option<ParameterIn>) -> Vec<Parameter> {
        table::<A>().iter().map(document).collect()
    }
}

/// The arguments that the members of a JSON object are; null is the same as absent.
///
/// # Errors
/// A problem that names the argument and what would be accepted.
pub(crate) fn from_json<A: Arguments>(object: &Map<String, Json>, bases: BasesMax) -> Result<A, Problem> {
    let mut reader = Reader::<A>::new(table_within::<A>(bases));
    for (name, json) in object {
        let shown = json.to_string();
        let value = match json {
            Json::Null => None,
            Json::Bool(on) => Some(Value::Switch(*on)),
            Json::String(text) => Some(Value::Text(text.clone())),
            Json::Number(number) => Some(
                (number.as_u64().and_then(|whole| usize::try_from(whole).ok()))
                    .map_or(Value::Number(number.as_f64().unwrap_or(f64::NAN)), Value::Integer),
            ),
            Json::Array(_) | Json::Object(_) => {
                reader.refuse(name, &shown)?;
                None
            }
        };
        reader.take(name, value.as_ref(), &shown)?;
    }
    Ok(reader.finish())
}

impl From<ArgumentError> for Problem {
    fn from(error: ArgumentError) -> Self {
        let detail = error.to_string();
        match error {
            ArgumentError::Unknown { name, nearest, known } => {
                let problem = Self::new(Kind::UnknownParameter, detail).with("parameter", name);
                let problem = match nearest {
                    Some(nearest) => problem.with("nearest", nearest),
                    None => problem,
                };
                problem.with("accepted", known)
            }
            ArgumentError::Value { name, accepted, .. } => {
                Self::invalid(name, detail).with("accepted", accepted)
            }
            ArgumentError::Twice(name) => Self::invalid(name, detail),
        }
    }
}

/// An argument in the OpenAPI document.
fn document(argument: &Argument) -> Parameter {
    let mut schema = schema(argument.accepts);
    if let Absent::Value(shown) = argument.absent {
        schema.default = argument.accepts.read(&shown()).map(|value| json(&value));
    }
    let absent = argument.absent.in_words();
    ParameterBuilder::new()
        .name(argument.name)
        .parameter_in(ParameterIn::Query)
        .required(Required::False)
        .description(Some(format!("{} Default: {absent}.", argument.meaning)))
        .schema(Some(RefOr::T(Schema::Object(schema))))
        .build()
}

fn json(value: &Value) -> Json {
    match value {
        Value::Integer(number) => (*number).into(),
        Value::Number(number) => (*number).into(),
        Value::Switch(on) => (*on).into(),
        Value::Text(text) => text.clone().into(),
    }
}

/// The JSON schema of what is accepted.
pub(crate) fn schema(accepts: Accepts) -> Object {
    let object = ObjectBuilder::new();
    match accepts {
        Accepts::Integer(least, most) => {
            let object = object.schema_type(Type::Integer).minimum(Some(least as f64));
            if most == usize::MAX { object.build() } else { object.maximum(Some(most as f64)).build() }
        }
        Accepts::Positive => object.schema_type(Type::Number).exclusive_minimum(Some(0.0)).build(),
        Accepts::NonNegative => object.schema_type(Type::Number).minimum(Some(0.0)).build(),
        Accepts::Range(low, high) => {
            object.schema_type(Type::Number).minimum(Some(low)).maximum(Some(high)).build()
        }
        Accepts::Switch => object.schema_type(Type::Boolean).build(),
        Accepts::Word(words) => {
            object.schema_type(Type::String).enum_values(Some(words.iter().copied())).build()
        }
        Accepts::Text | Accepts::Names => object.schema_type(Type::String).build(),
        Accepts::Id => {
            let format = SchemaFormat::KnownFormat(KnownFormat::Uuid);
            object.schema_type(Type::String).format(Some(format)).build()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::Parameters;
    use crate::picture::View;

    fn read<A: Arguments>(json: &Json) -> Result<A, Problem> {
        from_json(json.as_object().unwrap(), BasesMax(1000))
    }

    #[test]
    fn json_members_follow_the_same_table_as_queries() {
        let parameters: Parameters = read(&serde_json::json!({"bases": 3, "paper": null})).unwrap();
        assert_eq!(parameters, Parameters { bases: 3, ..Parameters::default() });
        let whole: Parameters = read(&serde_json::json!({"t": 2})).unwrap();
        assert_eq!(whole.t, Some(2.0));
        for refused in [
            serde_json::json!({"bases": "3"}),
            serde_json::json!({"bases": 3.5}),
            serde_json::json!({"bases": [3]}),
            serde_json::json!({"base": 3}),
            serde_json::json!({"tol": 1e-3, "tolerance": 1e-3}),
        ] {
            assert!(read::<Parameters>(&refused).is_err(), "{refused}");
        }
    }

    #[test]
    fn pictures_of_the_service_are_smaller_than_on_ones_own_machine() {
        assert!(read::<View>(&serde_json::json!({"width": 2048})).is_ok());
        assert!(read::<View>(&serde_json::json!({"width": 2049})).is_err());
        assert!(View::table().iter().any(|argument| argument.accepts.holds(&Value::Integer(2049))));
    }

    #[test]
    fn documented_defaults_are_of_the_documented_type() {
        for argument in Parameters::table().iter().chain(&View::table()) {
            let schema = serde_json::to_value(document(argument)).unwrap()["schema"].clone();
            let is_typed = match &schema["default"] {
                Json::Null => matches!(argument.absent, Absent::Words(_)),
                Json::Number(_) => ["integer", "number"].contains(&schema["type"].as_str().unwrap()),
                Json::Bool(_) => schema["type"] == "boolean",
                other => schema["enum"].as_array().unwrap().contains(other),
            };
            assert!(is_typed, "{}: {schema}", argument.name);
        }
    }
}
