//! Lists of numbers in JSON, read number by number: a tree of JSON values would take sixteen times the text.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};

use crate::harmonics::Function;

/// Most lists in one text.
pub(crate) const LISTS_MAX: usize = 256;
/// The member of an answer that holds lists by name.
const FIELDS: &str = "fields";

/// The lists of a text, named `f0`, `f1` and so on where it does not name them; null stands for NaN.
///
/// # Errors
/// Why it holds none, in words.
pub(crate) fn parse(text: &[u8]) -> Result<Vec<Function>, String> {
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let no_json = |error: serde_json::Error| format!("the body is neither npy nor JSON ({error})");
    let whole = Expected::Anything.deserialize(&mut deserializer).map_err(no_json)?;
    deserializer.end().map_err(no_json)?;
    match whole {
        Found::Lists(lists) => lists,
        Found::Numbers(numbers) => Ok(vec![named("f0", "the list", numbers)?]),
        Found::Number(_) | Found::Other(_) => Err("the body holds no list of numbers".to_owned()),
    }
}

/// What may stand in a place.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Expected {
    Number,
    /// Or numbers.
    Numbers,
    /// Or lists by name.
    Names,
    /// Or an array of lists, or members beside [`FIELDS`].
    Anything,
}

/// What stands there.
enum Found {
    Number(f64),
    Numbers(Result<Vec<f64>, NoNumber>),
    Lists(Result<Vec<Function>, String>),
    /// Something else, as messages show it.
    Other(String),
}

/// What stands in a list in place of a number.
struct NoNumber {
    place: usize,
    shown: String,
}

fn named(name: &str, what: &str, numbers: Result<Vec<f64>, NoNumber>) -> Result<Function, String> {
    let described = |NoNumber { place, shown }| {
        format!("{what} has {shown} at place {place} (counting from 0), which is not a number")
    };
    Ok(Function::new(name, numbers.map_err(described)?))
}

impl<'de> DeserializeSeed<'de> for Expected {
    type Value = Found;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Found, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Expected {
    type Value = Found;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("lists of numbers")
    }

    fn visit_f64<E>(self, number: f64) -> Result<Found, E> {
        Ok(Found::Number(number))
    }

    fn visit_u64<E>(self, number: u64) -> Result<Found, E> {
        Ok(Found::Number(number as f64))
    }

    fn visit_i64<E>(self, number: i64) -> Result<Found, E> {
        Ok(Found::Number(number as f64))
    }

    fn visit_unit<E>(self) -> Result<Found, E> {
        Ok(Found::Number(f64::NAN))
    }

    fn visit_bool<E>(self, value: bool) -> Result<Found, E> {
        Ok(Found::Other(format!("`{value}`")))
    }

    fn visit_str<E>(self, text: &str) -> Result<Found, E> {
        let shown: String = text.chars().take(40).collect();
        Ok(Found::Other(format!("`\"{shown}\"`")))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut places: A) -> Result<Found, A::Error> {
        let of_place = match self {
            Self::Number => {
                while places.next_element::<IgnoredAny>()?.is_some() {}
                return Ok(Found::Other("a list".to_owned()));
            }
            Self::Numbers | Self::Names => Self::Number,
            Self::Anything => Self::Numbers,
        };
        // The first place tells whether these are numbers or lists.
        match places.next_element_seed(of_place)? {
            None => Ok(Found::Numbers(Ok(Vec::new()))),
            Some(Found::Numbers(first)) => lists(first, places),
            Some(first) => numbers(first, places),
        }
    }

    fn visit_map<A: MapAccess<'de>>(self, members: A) -> Result<Found, A::Error> {
        match self {
            Self::Number | Self::Numbers => {
                skip_members(members)?;
                Ok(Found::Other("an object".to_owned()))
            }
            Self::Names | Self::Anything => by_name(members, self == Self::Anything),
        }
    }
}

/// Numbers from the first on.
fn numbers<'de, A: SeqAccess<'de>>(first: Found, mut places: A) -> Result<Found, A::Error> {
    let mut values = Vec::new();
    let mut next = Some(first);
    while let Some(found) = next {
        let Found::Number(number) = found else {
            while places.next_element::<IgnoredAny>()?.is_some() {}
            let shown = if let Found::Other(shown) = found { shown } else { "a list".to_owned() };
            return Ok(Found::Numbers(Err(NoNumber { place: values.len(), shown })));
        };
        values.push(number);
        next = places.next_element_seed(Expected::Number)?;
    }
    // Grown by doubling, it may have twice the room it needs.
    values.shrink_to_fit();
    Ok(Found::Numbers(Ok(values)))
}

/// Lists from the first on.
fn lists<'de, A: SeqAccess<'de>>(
    first: Result<Vec<f64>, NoNumber>,
    mut places: A,
) -> Result<Found, A::Error> {
    let mut lists = Vec::new();
    let mut next = Some(Found::Numbers(first));
    while let Some(found) = next {
        let place = lists.len();
        let list = match found {
            Found::Numbers(_) if place == LISTS_MAX => Err(too_many()),
            Found::Numbers(numbers) => named(&format!("f{place}"), &format!("list {place}"), numbers),
            _ => Err(format!("list {place} is not a list of numbers")),
        };
        match list {
            Ok(list) => lists.push(list),
            Err(why) => {
                while places.next_element::<IgnoredAny>()?.is_some() {}
                return Ok(Found::Lists(Err(why)));
            }
        }
        next = places.next_element_seed(Expected::Numbers)?;
    }
    Ok(Found::Lists(Ok(lists)))
}

/// Lists by name. In an answer of ours they are the members of `fields`, and what stands beside that is passed over.
fn by_name<'de, A: MapAccess<'de>>(mut members: A, may_be_answer: bool) -> Result<Found, A::Error> {
    let mut lists: Vec<Function> = Vec::new();
    // Told only if no `fields` follows.
    let mut fault = None;
    while let Some(name) = members.next_key::<String>()? {
        if may_be_answer && name == FIELDS {
            match members.next_value_seed(Expected::Names)? {
                Found::Lists(fields) => {
                    skip_members(members)?;
                    return Ok(Found::Lists(fields));
                }
                found => keep(&mut lists, &mut fault, &name, found),
            }
        } else if fault.is_some() {
            members.next_value::<IgnoredAny>()?;
        } else {
            keep(&mut lists, &mut fault, &name, members.next_value_seed(Expected::Numbers)?);
        }
    }
    Ok(Found::Lists(fault.map_or(Ok(lists), Err)))
}

fn keep(lists: &mut Vec<Function>, fault: &mut Option<String>, name: &str, found: Found) {
    let list = match found {
        _ if lists.iter().any(|list| list.name == name) => Err(format!("`{name}` is given twice")),
        Found::Numbers(_) if lists.len() == LISTS_MAX => Err(too_many()),
        Found::Numbers(numbers) => named(name, &format!("`{name}`"), numbers),
        _ => Err(format!("`{name}` is not a list of numbers")),
    };
    match list {
        Ok(list) => lists.push(list),
        Err(why) => *fault = Some(why),
    }
}

fn skip_members<'de, A: MapAccess<'de>>(mut members: A) -> Result<(), A::Error> {
    while members.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
    Ok(())
}

fn too_many() -> String {
    format!("the body holds more than {LISTS_MAX} lists of numbers")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Vec<(String, Vec<f64>)>, String> {
        let pair = |function: Function| (function.name, function.values);
        Ok(parse(text.as_bytes())?.into_iter().map(pair).collect())
    }

    fn list(name: &str, values: &[f64]) -> (String, Vec<f64>) {
        (name.to_owned(), values.to_vec())
    }

    #[test]
    fn lists_come_alone_in_a_list_or_under_names() {
        assert_eq!(parsed("[1, 2.5, -3]"), Ok(vec![list("f0", &[1.0, 2.5, -3.0])]));
        assert_eq!(parsed("[]"), Ok(vec![list("f0", &[])]));
        assert_eq!(
            parsed("[[1], [], [2]]"),
            Ok(vec![list("f0", &[1.0]), list("f1", &[]), list("f2", &[2.0])])
        );
        assert_eq!(parsed(r#"{"b": [1], "a": [2]}"#), Ok(vec![list("b", &[1.0]), list("a", &[2.0])]));
        assert!(parsed("[null, 1]").unwrap()[0].1[0].is_nan());
    }

    #[test]
    fn an_answer_holds_its_fields_and_nothing_else() {
        for answer in [
            r#"{"job_id": "…", "fields": {"x": [3]}, "energy": {}}"#,
            r#"{"eigenvalues": [0, 1], "fields": {"x": [3]}, "fields": 7}"#,
        ] {
            assert_eq!(parsed(answer), Ok(vec![list("x", &[3.0])]), "{answer}");
        }
        assert_eq!(parsed(r#"{"fields": [4]}"#), Ok(vec![list("fields", &[4.0])]));
        assert_eq!(parsed(r#"{"fields": {"fields": [4]}}"#), Ok(vec![list("fields", &[4.0])]));
    }

    #[test]
    fn what_holds_no_lists_is_refused_with_the_place() {
        for (body, told) in [
            ("3", "the body holds no list of numbers"),
            ("\"x\"", "the body holds no list of numbers"),
            ("[1, \"two\", {}]", "the list has `\"two\"` at place 1"),
            ("[1, [2]]", "the list has a list at place 1"),
            ("[[1], [2, true]]", "list 1 has `true` at place 1"),
            ("[[[1]]]", "list 0 has a list at place 0"),
            ("[[1], 2, 3]", "list 1 is not a list of numbers"),
            (r#"{"a": 1, "b": [2]}"#, "`a` is not a list of numbers"),
            (r#"{"a": {"b": [1]}}"#, "`a` is not a list of numbers"),
            (r#"{"a": [1], "a": [2]}"#, "`a` is given twice"),
            (r#"{"fields": {"a": 1}}"#, "`a` is not a list of numbers"),
            ("{", "neither npy nor JSON"),
            ("[1] 2", "neither npy nor JSON"),
            ("[1e999]", "neither npy nor JSON"),
        ] {
            let why = parsed(body).unwrap_err();
            assert!(why.contains(told), "{body}: {why}");
        }
    }

    #[test]
    fn lists_are_counted_while_they_are_read() {
        let many = |count: usize| format!("[{}]", vec!["[]"; count].join(","));
        assert_eq!(parsed(&many(LISTS_MAX)).unwrap().len(), LISTS_MAX);
        assert!(parsed(&many(LISTS_MAX + 1)).unwrap_err().contains("more than 256 lists"));
    }
}
