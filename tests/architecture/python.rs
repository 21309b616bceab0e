//! What the Python package lists of the library by hand.

use std::fs;
use std::path::Path;

use chladni::analysis::Parameters;
use chladni::arguments::{Accepts, Arguments};

/// Arguments of `chladni.eigenbasis` itself; and `exact`, which means something only beside a memory budget.
const NOT_LISTED: [&str; 4] = ["operator", "bases", "tolerance", "exact"];

#[test]
fn the_parameters_that_python_lists_are_those_of_the_library_with_their_types_and_a_meaning_each() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/chladni/_parameters.py");
    let text = fs::read_to_string(path).unwrap();
    let lines: Vec<_> = text.lines().map(str::trim).collect();
    let listed: Vec<(&str, &str)> = lines
        .windows(2)
        .filter_map(|pair| Some((pair[0].split_once(": ")?, pair[1])))
        .filter(|((_, kind), _)| ["bool", "int", "float", "str"].contains(kind))
        .map(|(declared, meaning)| {
            assert!(meaning.starts_with("\"\"\""), "{declared:?} has no meaning");
            declared
        })
        .collect();
    let expected: Vec<(&str, &str)> = Parameters::table()
        .into_iter()
        .filter(|argument| !NOT_LISTED.contains(&argument.name))
        .map(|argument| (argument.name, python_type(argument.accepts)))
        .collect();
    assert_eq!(listed, expected);
}

fn python_type(accepts: Accepts) -> &'static str {
    match accepts {
        Accepts::Integer(..) => "int",
        Accepts::Positive | Accepts::NonNegative | Accepts::Range(..) => "float",
        Accepts::Switch => "bool",
        Accepts::Word(_) | Accepts::Text | Accepts::Names | Accepts::Id => "str",
    }
}
