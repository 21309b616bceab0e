//! Keyword arguments of Python, read as the library declares them.

use chladni::arguments::{Accepts, ArgumentError, Arguments, Reader, Value};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::refused;

/// Likeness (Jaro–Winkler) from which a word is taken for a misspelling of another.
const LIKENESS: f64 = 0.75;

/// The arguments that are `given` by name; `None` is as if absent.
pub(crate) fn read<A: Arguments>(given: &Bound<'_, PyDict>) -> PyResult<A> {
    let mut reader = Reader::<A>::new(A::table());
    for (name, value) in given.iter().filter(|(_, value)| !value.is_none()) {
        let name: String = name.extract()?;
        let shown = value.str()?.to_string();
        let taken = match typed(&value) {
            Some(typed) => reader.take(&name, Some(&typed), &shown),
            None => reader.refuse(&name, &shown),
        };
        taken.map_err(|error| explained::<A>(error))?;
    }
    Ok(reader.finish())
}

/// A value of one of the types that arguments have, those of NumPy among them.
fn typed(value: &Bound<'_, PyAny>) -> Option<Value> {
    let switch = || value.extract().map(Value::Switch);
    let integer = || value.extract().map(Value::Integer);
    let number = || value.extract().map(Value::Number);
    let text = || value.extract().map(Value::Text);
    switch().or_else(|_| integer()).or_else(|_: PyErr| number()).or_else(|_: PyErr| text()).ok()
}

fn explained<A: Arguments>(error: ArgumentError) -> PyErr {
    match error {
        ArgumentError::Unknown { name, nearest, .. } => {
            let hint = nearest.map_or(String::new(), |near| format!(". Did you mean '{}'?", called(near)));
            PyTypeError::new_err(format!("unexpected keyword argument '{name}'{hint}"))
        }
        ArgumentError::Value { name, accepted, value } => {
            let argument = A::table().into_iter().find(|argument| argument.name == name);
            let hint = match argument.map(|argument| argument.accepts) {
                Some(Accepts::Word(words)) => nearest(&value, words),
                _ => String::new(),
            };
            refused(format!("{} must be {accepted}, not `{value}`{hint}", called(name)))
        }
        ArgumentError::Twice(name) => refused(format!("{} is given twice", called(name))),
    }
}

/// What `find` knows by the word, which is one of `names`.
pub(crate) fn named<T>(
    argument: &str,
    word: &str,
    names: &[&str],
    find: impl FnOnce(&str) -> Option<T>,
) -> PyResult<T> {
    find(word).ok_or_else(|| {
        let hint = nearest(word, names);
        refused(format!("{argument} must be one of {}, not `{word}`{hint}", names.join(", ")))
    })
}

fn nearest(word: &str, names: &[&str]) -> String {
    let alike = |name: &&str| strsim::jaro_winkler(&word.to_ascii_lowercase(), name);
    let nearest = names.iter().copied().max_by(|a, b| alike(a).total_cmp(&alike(b)));
    let nearest = nearest.filter(|name| alike(name) >= LIKENESS);
    nearest.map_or(String::new(), |name| format!("; did you mean `{name}`?"))
}

/// What a parameter is called in Python.
pub(crate) fn called(name: &str) -> &str {
    match name {
        "bases" => "k",
        "tolerance" => "tol",
        "filter" => "kind",
        name => name,
    }
}
