//! What the library offers to other programs: few names, each shown in an example of the crate's documentation.

use std::fs;

use super::{names_word, src};

/// More names are not learned in an afternoon.
const NAMES_MAX: usize = 60;

#[test]
fn the_interface_is_small_and_every_name_of_it_has_an_example() {
    let library = fs::read_to_string(src().join("lib.rs")).unwrap();
    let names = exported(&library);
    assert!((1..=NAMES_MAX).contains(&names.len()), "{} names, {NAMES_MAX} at most", names.len());
    let examples = examples(&library);
    let unseen: Vec<_> = names.iter().filter(|name| !names_word(&examples, name)).collect();
    assert!(unseen.is_empty(), "no example in lib.rs names {unseen:?}");
}

#[test]
fn every_public_module_is_hidden_from_the_documentation() {
    let library = fs::read_to_string(src().join("lib.rs")).unwrap();
    let lines: Vec<_> = library.lines().collect();
    for (at, module) in lines.iter().enumerate().filter(|(_, line)| line.starts_with("pub mod ")) {
        assert_eq!(lines[at - 1], "#[doc(hidden)]", "{module}");
    }
}

#[test]
fn exports_and_examples_are_found() {
    let library = "//! Use [`A`].\n//! ```\n//! use x::{B, c};\n//! ```\npub use b::{self, B,\n    c};\npub use d::A;\n";
    assert_eq!(exported(library), ["self", "B", "c", "A"]);
    let examples = examples(library);
    assert!(names_word(&examples, "c") && !names_word(&examples, "A"));
}

/// The names of all `pub use`.
fn exported(library: &str) -> Vec<&str> {
    let uses = library.split("pub use ").skip(1).filter_map(|rest| rest.split(';').next());
    uses.flat_map(|path| {
        let names = path.rsplit("::").next().unwrap_or_default();
        names.trim_matches(['{', '}', '\n', ' ']).split(',').map(str::trim).filter(|name| !name.is_empty())
    })
    .collect()
}

/// The lines between fences of the crate's documentation.
fn examples(library: &str) -> String {
    let documented: Vec<_> = library.lines().map_while(|line| line.strip_prefix("//!")).collect();
    let documented = documented.join("\n");
    documented.split("```").skip(1).step_by(2).collect()
}
