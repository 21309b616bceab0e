//! The rooms of the code and what they may know of each other.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

mod circles;
mod python;
mod surface;

use std::fs;
use std::path::{Path, PathBuf};

/// Every room with the rooms that it may import from. A room stands below those that it is named in.
const ROOMS: [(&str, &[&str]); 16] = [
    ("arguments", &[]),
    ("progress", &["arguments"]),
    ("metrics", &[]),
    ("cloud", &["arguments", "progress"]),
    ("geometry", &["cloud", "progress"]),
    ("operator", &["arguments", "geometry", "cloud", "progress"]),
    ("spectrum", &["operator", "geometry", "cloud", "progress"]),
    ("picture", &["arguments", "geometry", "cloud", "progress"]),
    ("viewer", &["picture"]),
    ("harmonics", &["arguments", "spectrum", "operator", "geometry", "cloud", "progress"]),
    ("analysis", &["arguments", "spectrum", "operator", "geometry", "cloud", "progress"]),
    ("store", &["arguments", "analysis", "spectrum", "operator", "cloud", "progress"]),
    ("jobs", &["metrics", "store", "harmonics", "analysis", "spectrum", "operator", "cloud", "progress"]),
    (
        "http",
        &[
            "arguments",
            "metrics",
            "jobs",
            "store",
            "viewer",
            "picture",
            "harmonics",
            "analysis",
            "spectrum",
            "operator",
            "geometry",
            "cloud",
            "progress",
        ],
    ),
    ("app", &["metrics", "http", "jobs", "store", "analysis", "cloud", "progress"]),
    ("cli", &["arguments", "app", "picture", "harmonics", "analysis", "operator", "cloud", "progress"]),
];

/// The pure library: usable by itself, without a runtime, a clock or an environment.
const PURE: [&str; 10] = [
    "arguments",
    "progress",
    "cloud",
    "geometry",
    "picture",
    "viewer",
    "operator",
    "spectrum",
    "harmonics",
    "analysis",
];

/// What the pure library does without.
const IMPURE: [&str; 13] = [
    "tokio",
    "axum",
    "hyper",
    "tower",
    "sqlx",
    "clap",
    "utoipa",
    "serde_json",
    "tracing",
    "jiff",
    "std::time",
    "std::env",
    "std::net",
];

/// A longer file holds two ideas.
const LINES_MAX: usize = 450;

#[test]
fn imports_run_downwards_only() {
    assert_clean(|room, source| imports(source).filter_map(|import| refuse_import(room, import)).collect());
}

#[test]
fn no_path_climbs_out_of_its_room() {
    let mut violations = Vec::new();
    for path in sources() {
        let relative = path.strip_prefix(src()).unwrap();
        let source = without_comments(&fs::read_to_string(&path).unwrap());
        violations
            .extend(climbs(&source, depth(relative)).map(|room| format!("{}: {room}", relative.display())));
    }
    assert!(violations.is_empty(), "write crate::… instead:\n{}", violations.join("\n"));
}

#[test]
fn the_pure_library_knows_no_runtime_no_clock_and_no_environment() {
    // the one thing that a type may say for the service: that its documentation is a schema, where there is a service
    let derived = r#"#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]"#;
    assert_clean(|room, source| {
        let source = source.replace(derived, "");
        if PURE.contains(&room) { impurities(&source).collect() } else { Vec::new() }
    });
}

#[test]
fn only_the_store_speaks_sql() {
    assert_clean(|room, source| {
        let speaks = room != "store" && names_path(source, "sqlx");
        speaks.then(|| "sqlx".to_owned()).into_iter().collect()
    });
}

/// Where a request's body may be read: bounded, drained after an error, or as the bytes of a form that is there already.
const BODY_READERS: [&str; 3] = ["http/wire/body.rs", "http/wire/drain.rs", "http/wire/upload.rs"];
/// What reads one.
const BODY_READING: [&str; 5] = ["into_body", "into_data_stream", "to_bytes", "Multipart", "Form"];

#[test]
fn request_bodies_are_read_within_their_bounds_only() {
    for path in sources() {
        let relative = path.strip_prefix(src()).unwrap();
        let is_handler =
            relative.starts_with("http") && !BODY_READERS.iter().any(|file| relative.ends_with(file));
        let source = without_comments(&fs::read_to_string(&path).unwrap());
        let imports_request = source.contains("axum::extract") && source.contains("Request");
        let read = BODY_READING.iter().find(|word| imports_request && names_word(&source, word));
        assert!(!is_handler || read.is_none(), "{} reads a body by {read:?}", relative.display());
    }
}

#[test]
fn no_file_is_longer_than_a_few_screens() {
    let length = |path: &PathBuf| fs::read_to_string(path).unwrap().lines().count();
    let long: Vec<_> = sources().into_iter().filter(|path| length(path) > LINES_MAX).collect();
    assert!(long.is_empty(), "more than {LINES_MAX} lines: {long:?}");
}

#[test]
fn every_source_file_belongs_to_a_room() {
    let roomless = ["main", "lib"];
    for path in sources() {
        let room = room_of(path.strip_prefix(src()).unwrap());
        assert!(ROOMS.iter().any(|(name, _)| *name == room) || roomless.contains(&room.as_str()), "{path:?}");
    }
}

#[test]
fn a_violating_snippet_is_caught() {
    let found = |room: &str, snippet: &str| {
        let source = without_comments(snippet);
        imports(&source).filter_map(|import| refuse_import(room, import)).collect::<Vec<_>>()
    };
    assert_eq!(found("cloud", "use crate::store::Store;"), ["store"]);
    assert_eq!(found("cloud", "fn f() { crate::http::router() }"), ["http"]);
    assert_eq!(
        found("store", "use crate::{\n    cloud::{PointCloud, reader},\n    jobs::Queue,\n};"),
        ["jobs"]
    );
    assert_eq!(found("cli", "use chladni::store::Store;"), ["store"]);
    assert_eq!(found("geometry", "use crate::cloud::PointCloud; // crate::http, for example"), [""; 0]);
    assert_eq!(found("cli", r#"let filter = "chladni::jobs=trace";"#), [""; 0]);
    assert_eq!(found("cloud", "pub(in crate::cloud::reader) fn f() {}"), [""; 0]);
    let impure = |snippet: &str| impurities(&without_comments(snippet)).collect::<Vec<_>>();
    assert_eq!(impure("use std::time::Instant;"), ["std::time"]);
    assert_eq!(impure("let x = serde_json::to_string(&y);"), ["serde_json"]);
    assert_eq!(impure("use std::{fs, env};"), ["std::env"]);
    assert_eq!(impure("let tokio_like = 1; /// no tokio:: here"), [""; 0]);
    let climbing = |snippet: &str, depth| climbs(&without_comments(snippet), depth).collect::<Vec<_>>();
    assert_eq!(climbing("use super::store::Store;", 1), ["store"]);
    assert_eq!(climbing("use super::super::store::Store;", 2), ["store"]);
    assert_eq!(climbing("use super::operator::X;", 2), [""; 0]);
    assert_eq!(climbing("use super::X;\n#[cfg(test)]\nmod tests { use super::jobs; }", 1), [""; 0]);
}

/// Fails with every violation of every file.
fn assert_clean(violations: impl Fn(&str, &str) -> Vec<String>) {
    let mut all = Vec::new();
    for path in sources() {
        let relative = path.strip_prefix(src()).unwrap();
        let source = without_comments(&fs::read_to_string(&path).unwrap());
        let found = violations(&room_of(relative), &source);
        all.extend(found.into_iter().map(|what| format!("{} knows {what}", relative.display())));
    }
    assert!(all.is_empty(), "{}", all.join("\n"));
}

/// Whether `word` stands in `source` by itself.
fn names_word(source: &str, word: &str) -> bool {
    source.split(|c: char| !c.is_alphanumeric() && c != '_').any(|found| found == word)
}

fn src() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn sources() -> Vec<PathBuf> {
    let (mut found, mut folders) = (Vec::new(), vec![src()]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    assert!(found.len() > 10, "the sources are found");
    found
}

/// `cloud/reader/ply.rs` belongs to `cloud`, `app.rs` to `app`.
fn room_of(relative: &Path) -> String {
    let first = relative.components().next().unwrap().as_os_str().to_string_lossy();
    first.trim_end_matches(".rs").to_owned()
}

/// How many modules a file is below the root: 1 for `cloud/mod.rs` and `app.rs`, 2 for `cloud/error.rs`.
fn depth(relative: &Path) -> usize {
    relative.components().count() - usize::from(relative.ends_with("mod.rs"))
}

fn without_comments(source: &str) -> String {
    source.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

/// The first names behind every `crate::` and `chladni::`, also in braces.
fn imports(source: &str) -> impl Iterator<Item = &str> {
    ["crate::", "chladni::"].into_iter().flat_map(move |root| {
        source.match_indices(root).flat_map(move |(at, _)| {
            let is_whole = !source[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_');
            // a text such as "chladni::jobs=trace" imports nothing
            let line = source[..at].rsplit('\n').next().unwrap_or_default();
            let is_text = line.matches('"').count() % 2 == 1;
            if is_whole && !is_text { heads(&source[at + root.len()..]) } else { Vec::new() }
        })
    })
}

/// The first names of a path, or of every path of a group.
fn heads(path: &str) -> Vec<&str> {
    let Some(group) = path.strip_prefix('{') else { return vec![name(path)] };
    let mut nesting = 0;
    let mut found = vec![name(group.trim_start())];
    for (at, c) in group.char_indices() {
        match c {
            '{' => nesting += 1,
            '}' if nesting == 0 => break,
            '}' => nesting -= 1,
            ',' if nesting == 0 => found.push(name(group[at + 1..].trim_start())),
            _ => {}
        }
    }
    found
}

fn name(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    &text[..end]
}

/// The imported room, if this room may not know it.
fn refuse_import(room: &str, import: &str) -> Option<String> {
    let is_room = ROOMS.iter().any(|(name, _)| *name == import);
    let allowed = ROOMS.iter().find(|(name, _)| *name == room).map_or(&[][..], |(_, allowed)| allowed);
    // main.rs and lib.rs name the rooms.
    let is_root = ["main", "lib"].contains(&room);
    (is_room && !is_root && import != room && !allowed.contains(&import)).then(|| import.to_owned())
}

/// Rooms reached by as many `super::` as the file is deep. An inline test module is one deeper.
fn climbs(source: &str, depth: usize) -> impl Iterator<Item = String> {
    let source = source.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let to_root = "super::".repeat(depth);
    let starts = source.match_indices(&to_root).map(|(at, _)| at + to_root.len()).collect::<Vec<_>>();
    starts
        .into_iter()
        .map(|start| name(&source[start..]).to_owned())
        .filter(|name| ROOMS.iter().any(|(room, _)| room == name))
}

/// The impure crates and modules that a source names.
fn impurities(source: &str) -> impl Iterator<Item = String> {
    IMPURE.iter().filter(move |path| names_path(source, path)).map(|&path| path.to_owned())
}

/// Whether a path such as `tokio::…`, `std::time::…` or `std::{…, time, …}` stands in a source.
fn names_path(source: &str, path: &str) -> bool {
    let (root, member) = path.split_once("::").map_or((path, None), |(root, member)| (root, Some(member)));
    let root = format!("{root}::");
    source.match_indices(&root).any(|(at, _)| {
        let is_whole = !source[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':');
        let heads = heads(&source[at + root.len()..]);
        is_whole && member.is_none_or(|member| heads.contains(&member))
    })
}
