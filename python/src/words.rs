//! Words that name one of a few: what is misspelled is answered with the nearest.

use pyo3::prelude::*;

use crate::refused;

/// Likeness (Jaro–Winkler) from which a word is taken for a misspelling of another.
const LIKENESS: f64 = 0.75;

/// What `find` knows by the word, which is one of `names`.
pub(crate) fn word<T>(
    argument: &str,
    word: &str,
    names: &[&str],
    find: impl FnOnce(&str) -> Option<T>,
) -> PyResult<T> {
    find(word).ok_or_else(|| {
        let alike = |name: &&str| strsim::jaro_winkler(&word.to_ascii_lowercase(), name);
        let nearest = names.iter().copied().max_by(|a, b| alike(a).total_cmp(&alike(b)));
        let nearest = nearest.filter(|name| alike(name) >= LIKENESS);
        let hint = nearest.map_or(String::new(), |name| format!("; did you mean `{name}`?"));
        refused(format!("{argument} must be one of {}, not `{word}`{hint}", names.join(", ")))
    })
}
