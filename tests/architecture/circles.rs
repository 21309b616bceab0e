//! No circles among the files of a room: a file is understood after those that it imports from, and before the others.
//!
//! An import names a file, or what the index of a folder (`mod.rs`, or the file of the folder's name) exports from one. What an
//! index exports it does not import; where it uses a file below it that imports from it in turn, it is listed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use super::{ROOMS, sources, src, without_comments};

/// Indexes that hold what the files below them are made of, and use those. None is to be added.
const INDEXES: [&str; 19] = [
    "analysis",
    "app",
    "cli",
    "cli::analyze",
    "cli::demo",
    "cli::harmonics",
    "cli::reproduce",
    "cloud::reader",
    "cloud::reader::e57",
    "cloud::reader::npy",
    "cloud::reader::off",
    "cloud::reader::ply",
    "cloud::shapes",
    "cloud::writer",
    "jobs",
    "picture",
    "spectrum::coarse_to_fine",
    "store",
    "store::postgres",
];

/// Inside `http`, a folder imports from those behind it only, and `wire` nothing that stands beside it.
const HTTP: [(&str, &[&str]); 3] =
    [("wire", &[]), ("results", &["wire"]), ("resources", &["results", "wire"])];

/// Names of modules from the root, such as `["http", "wire", "accept"]`.
type Module = Vec<String>;

#[test]
fn no_file_imports_itself_by_way_of_others() {
    let files = files();
    let imports = edges(&files);
    for (room, _) in ROOMS {
        let circles: Vec<_> =
            files.keys().filter(|file| file[0] == room && reaches_itself(file, &imports)).collect();
        assert!(circles.is_empty(), "files of {room} in circles: {circles:#?}");
    }
}

#[test]
fn no_index_imports_itself_by_way_of_files_below_it_but_for_those_that_are_listed() {
    let files = files();
    let found: Vec<String> = files
        .keys()
        .filter(|index| is_in_circle_below(index, &files))
        .map(|index| index.join("::"))
        .filter(|index| !["main", "lib"].contains(&index.as_str()))
        .collect();
    assert_eq!(found, INDEXES, "listed are those on the right");
}

#[test]
fn what_speaks_http_knows_no_resource() {
    let files = files();
    let mut violations = Vec::new();
    for (file, targets) in edges(&files).iter().filter(|(file, _)| file[0] == "http" && file.len() > 2) {
        let allowed = HTTP.iter().find(|(folder, _)| *folder == file[1]).map(|(_, allowed)| *allowed);
        let allowed = allowed.unwrap_or_else(|| panic!("{file:?} stands in no known folder"));
        for target in targets.iter().filter(|target| target[0] == "http") {
            let folder = target.get(1).map_or("the route table", String::as_str);
            let is_bound = file[1] == "wire" || HTTP.iter().any(|(name, _)| *name == folder);
            if target.len() == 1 || (is_bound && folder != file[1] && !allowed.contains(&folder)) {
                violations.push(format!("{} imports from {}", file.join("::"), target.join("::")));
            }
        }
    }
    assert!(violations.is_empty(), "{}", violations.join("\n"));
}

#[test]
fn a_circle_is_found_also_by_way_of_an_index() {
    let module = |path: &str| path.split("::").map(str::to_owned).collect::<Module>();
    let circles = |sources: &[(&str, &str)]| {
        let files = sources.iter().map(|(path, source)| (module(path), (*source).to_owned())).collect();
        let imports = edges(&files);
        files.keys().filter(|file| reaches_itself(file, &imports)).count()
    };
    let a = ("r::a", "use super::b::B;");
    assert_eq!(circles(&[a, ("r::b", "")]), 0);
    assert_eq!(circles(&[a, ("r::b", "fn f() { crate::r::a::f() }")]), 2);
    assert_eq!(circles(&[a, ("r::b", "use super::c;"), ("r::c", "use crate::{r::a::{A, C}, x};")]), 3);
    assert_eq!(circles(&[a, ("r::b", "use super::A;"), ("r", "pub use a::A;")]), 2);
    assert_eq!(circles(&[a, ("r::b", "use super::Own;"), ("r", "pub use a::A; struct Own;")]), 0);
    assert_eq!(circles(&[a, ("r::b", "#[cfg(test)]\nmod tests { use super::super::a::A; }")]), 0);
}

#[test]
fn an_index_that_uses_what_imports_from_it_is_found_and_one_that_exports_it_is_not() {
    let module = |path: &str| path.split("::").map(str::to_owned).collect::<Module>();
    let found = |index: &str, below: &str| {
        let sources = [("r", index), ("r::a", below), ("r::b", "use super::a::A;")];
        let files = sources.iter().map(|(path, source)| (module(path), (*source).to_owned())).collect();
        is_in_circle_below(&module("r"), &files)
    };
    let own = "use super::Own;";
    assert!(found("mod a; mod b;\nuse a::A;\nstruct Own;", own));
    assert!(found("mod a; mod b;\nstruct Own;\nfn f() { b::f() }", own), "by way of another file");
    assert!(!found("mod a; mod b;\npub use a::A;\npub(crate) use b::{B, C};\nstruct Own;", own));
    assert!(!found("mod a; mod b;\nuse a::A;\nstruct Own;", ""));
}

/// Whether an index uses a file below it from which imports lead back to the index without leaving what is below it.
fn is_in_circle_below(index: &Module, files: &BTreeMap<Module, String>) -> bool {
    let below = files.iter().filter(|(file, _)| file.starts_with(index));
    let below: BTreeMap<Module, String> =
        below.map(|(file, source)| (file.clone(), source.clone())).collect();
    let mut imports = edges(&below);
    let used = uses_below(index, &files[index]);
    let used: BTreeSet<Module> = used.iter().filter_map(|path| resolve(path, &below)).collect();
    imports.insert(index.clone(), used.into_iter().filter(|target| target != index).collect());
    reaches_itself(index, &imports)
}

/// The paths into files below it that an index has beside those that it exports.
fn uses_below(index: &Module, source: &str) -> Vec<Module> {
    let source = source.split("mod tests {").next().unwrap_or_default();
    let words: Vec<&str> = source.split_whitespace().collect();
    let declared =
        words.windows(2).filter(|words| words[0] == "mod").map(|words| words[1].trim_end_matches(';'));
    let mut found = Vec::new();
    for name in declared {
        for (at, _) in source.match_indices(&format!("{name}::")) {
            let before = source[..at].trim_end();
            let is_whole = !source[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':');
            let statement = before.rsplit([';', '}']).next().unwrap_or_default();
            let is_export = before.ends_with("use") && statement.contains("pub");
            if is_whole && !is_export {
                found.extend(tree(&source[at..], index.clone()));
            }
        }
    }
    found
}

/// Sources without comments and tests, by module.
fn files() -> BTreeMap<Module, String> {
    let module = |relative: &Path| {
        let text = relative.with_extension("").to_string_lossy().into_owned();
        let names: Module = text.split('/').map(str::to_owned).filter(|name| name != "mod").collect();
        names
    };
    let read = |path: &Path| without_comments(&fs::read_to_string(path).unwrap());
    sources().iter().map(|path| (module(path.strip_prefix(src()).unwrap()), read(path))).collect()
}

/// The files that each file imports from, an index's own files left out.
fn edges(files: &BTreeMap<Module, String>) -> BTreeMap<Module, BTreeSet<Module>> {
    let targets = |file: &Module, source: &str| {
        let paths = paths(file, source);
        let found = paths.iter().filter_map(|path| resolve(path, files));
        found.filter(|target| target != file && !target.starts_with(file)).collect()
    };
    files.iter().map(|(file, source)| (file.clone(), targets(file, source))).collect()
}

/// The file that a path leads to: the longest module that is one, or where its index has the name from.
fn resolve(path: &[String], files: &BTreeMap<Module, String>) -> Option<Module> {
    let depth = (1..=path.len()).rev().find(|&depth| files.contains_key(&path[..depth]))?;
    let (module, names) = path.split_at(depth);
    let exported = names.first().and_then(|name| {
        let export = |used: &Module| used.last() == Some(name) && used.len() > depth + 1;
        let own = files[module].split("use ").skip(1).map(|rest| tree(rest, module.to_vec()));
        own.flatten().find(|used| export(used) && used.starts_with(module) && used != path)
    });
    match exported {
        Some(used) => resolve(&used, files),
        None => Some(module.to_vec()),
    }
}

/// All paths that begin with `crate::` or `super::`, from the root.
fn paths(file: &Module, source: &str) -> Vec<Module> {
    let source = source.split("mod tests {").next().unwrap_or_default();
    let mut found = Vec::new();
    for (at, _) in source.match_indices("crate::") {
        found.extend(tree(&source[at + "crate::".len()..], Vec::new()));
    }
    for (at, _) in source.match_indices("super::").filter(|(at, _)| !source[..*at].ends_with("super::")) {
        let (mut rest, mut base) = (&source[at..], file.clone());
        while let Some(behind) = rest.strip_prefix("super::") {
            base.pop();
            rest = behind;
        }
        found.extend(tree(rest, base));
    }
    found
}

/// The paths of a use tree such as `a::{b, c::d}`, each behind `base`.
fn tree(text: &str, mut base: Module) -> Vec<Module> {
    let text = text.trim_start();
    if let Some(group) = text.strip_prefix('{') {
        return members(group).into_iter().flat_map(|member| tree(member, base.clone())).collect();
    }
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    if &text[..end] != "self" && end > 0 {
        base.push(text[..end].to_owned());
    }
    match text[end..].strip_prefix("::") {
        Some(rest) => tree(rest, base),
        None => vec![base],
    }
}

/// The members of a group, up to its closing brace.
fn members(group: &str) -> Vec<&str> {
    let (mut nesting, mut first, mut found) = (0, 0, Vec::new());
    for (at, c) in group.char_indices() {
        match c {
            '{' => nesting += 1,
            '}' if nesting == 0 => {
                found.push(&group[first..at]);
                break;
            }
            '}' => nesting -= 1,
            ',' if nesting == 0 => {
                found.push(&group[first..at]);
                first = at + 1;
            }
            _ => {}
        }
    }
    found.retain(|member| !member.trim().is_empty());
    found
}

fn reaches_itself(file: &Module, imports: &BTreeMap<Module, BTreeSet<Module>>) -> bool {
    let (mut seen, mut next) = (BTreeSet::new(), vec![file]);
    while let Some(at) = next.pop() {
        for target in imports.get(at).into_iter().flatten() {
            if target == file {
                return true;
            }
            if seen.insert(target) {
                next.push(target);
            }
        }
    }
    false
}
