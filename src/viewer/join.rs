//! Makes one script of ES modules: every module becomes a function that returns what it exports.
//!
//! Each module keeps a scope of its own. An import must fit on a line, and name modules that stand before.

use std::fmt::Write as _;

/// The joined script of these modules, of which later ones import from earlier ones.
pub(super) fn script(first: &[&[(&str, &str)]], then: &[&[(&str, &str)]]) -> String {
    let mut joined = String::from("'use strict';\n");
    for (name, source) in first.iter().chain(then).flat_map(|modules| modules.iter()) {
        let (mut body, mut exports) = (String::new(), Vec::new());
        for line in lean(source).lines() {
            let line = import(line).unwrap_or_else(|| line.to_owned());
            let line = line.strip_prefix("export ").map_or(line.clone(), |declaration| {
                exports.push(declared(declaration));
                declaration.to_owned()
            });
            body.push_str(&line);
            body.push('\n');
        }
        // Writing to a string cannot fail.
        let _ =
            writeln!(joined, "const ${name} = (() => {{\n{body}return {{ {} }};\n}})();", exports.join(", "));
    }
    joined
}

/// `import { a } from './b.js';` as `const { a } = $b;`; `None` for other lines.
fn import(line: &str) -> Option<String> {
    let (names, module) = line.strip_prefix("import ")?.strip_suffix(".js';")?.split_once(" from './")?;
    Some(format!("const {names} = ${module};"))
}

/// The name that a declaration gives.
fn declared(declaration: &str) -> String {
    let words = declaration
        .split(|c: char| !c.is_alphanumeric() && c != '_' && c != '$')
        .filter(|word| !word.is_empty());
    let is_name = |word: &&str| !["const", "let", "function", "async", "class"].contains(word);
    words.into_iter().find(is_name).unwrap_or_default().to_owned()
}

/// The text without indentation, empty lines, and lines of comments.
pub(super) fn lean(source: &str) -> String {
    let is_comment = |line: &str| line.starts_with("//") || (line.starts_with("/**") && line.ends_with("*/"));
    let lines = source.lines().map(str::trim).filter(|line| !line.is_empty() && !is_comment(line));
    lines.fold(String::with_capacity(source.len()), |text, line| text + line + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::viewer::{KERNEL, MAIN, SAVED, VIEWER};

    #[test]
    fn modules_become_functions_that_return_what_they_export() {
        let a =
            "// says a\nexport const A = 1;\nconst own = 2;\nexport async function f() {\n  return own;\n}\n";
        let b = "import { A, f } from './a.js';\n\nexport class B {}\nf(A);\n";
        let expected = "'use strict';\n\
            const $a = (() => {\nconst A = 1;\nconst own = 2;\nasync function f() {\nreturn own;\n}\nreturn { A, f };\n})();\n\
            const $b = (() => {\nconst { A, f } = $a;\nclass B {}\nf(A);\nreturn { B };\n})();\n";
        assert_eq!(script(&[&[("a", a)]], &[&[("b", b)]]), expected);
    }

    #[test]
    fn every_module_imports_from_earlier_ones_only_and_in_lines_that_are_understood() {
        let mut known = vec!["palette"];
        for (name, source) in KERNEL.iter().chain(&VIEWER).chain(&MAIN).chain(&SAVED) {
            for line in source.lines().filter(|line| line.starts_with("import ")) {
                let Some(joined) = import(line) else { panic!("{name}.js: {line}") };
                let module = joined.rsplit('$').next().unwrap().trim_end_matches(';').to_owned();
                assert!(
                    known.contains(&module.as_str()),
                    "{name}.js imports {module}, which stands behind it"
                );
            }
            for line in source.lines().filter(|line| line.starts_with("export ")) {
                assert!(
                    !line.starts_with("export {") && !line.starts_with("export default"),
                    "{name}.js: {line}"
                );
            }
            known.push(name);
        }
    }
}
