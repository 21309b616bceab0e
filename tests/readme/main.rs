//! The commands of the README and of the pages under `docs/`, run as they stand there; the outputs shown are compared.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

mod shown;

use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use tempfile::TempDir;

/// Every page whose commands must work.
const PAGES: [&str; 13] = [
    "README.md",
    "CONTRIBUTING.md",
    "docs/accuracy.md",
    "docs/cli.md",
    "docs/deployment.md",
    "docs/formats.md",
    "docs/operation.md",
    "docs/operators.md",
    "docs/performance.md",
    "docs/quantities.md",
    "docs/results.md",
    "docs/scale-out.md",
    "docs/viewer.md",
];
/// Where the service of the pages listens.
const ADDRESS: &str = "127.0.0.1:8080";
/// Commands that build, never end, or take long are not run; each has tests of its own.
const NOT_RUN: [&str; 9] = [
    "cargo test",
    "cargo bench",
    "cargo run --release -- demo",
    "chladni serve",
    "chladni view",
    "benches/",
    "reproduce",
    "--points 250000",
    "docker ",
];

fn page(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(name)).unwrap()
}

/// A command of a page, and the output that the page shows below it as comments.
struct Step {
    command: String,
    shown: Option<String>,
}

/// The commands in the `sh` blocks of a page.
fn steps(text: &str) -> Vec<Step> {
    let fence = "```sh\n";
    let blocks =
        text.match_indices(fence).map(|(at, _)| text[at + fence.len()..].split("```").next().unwrap());
    let mut steps: Vec<Step> = Vec::new();
    for line in blocks.flat_map(str::lines).filter(|line| !line.is_empty()) {
        match (line.strip_prefix("# "), steps.last_mut()) {
            (Some(output), Some(step)) => step.shown.get_or_insert_default().push_str(output),
            (Some(_), None) => {}
            (None, _) => steps.push(Step { command: line.to_owned(), shown: None }),
        }
    }
    steps.retain(|step| !NOT_RUN.iter().any(|not_run| step.command.contains(not_run)));
    steps
}

/// A folder with the sample of the README, `chladni` and a `curl` that fails on problems in its path, and a service.
struct Tour {
    folder: TempDir,
    service: Child,
    address: String,
}

impl Tour {
    fn start() -> Self {
        let folder = TempDir::new().unwrap();
        let bin = folder.path().join("bin");
        std::fs::create_dir(&bin).unwrap();
        std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_chladni"), bin.join("chladni")).unwrap();
        let curl = "#!/bin/sh\nexec /usr/bin/env -i PATH=\"$OUTER\" curl --fail-with-body -sS \"$@\"\n";
        std::fs::write(bin.join("curl"), curl).unwrap();
        std::fs::set_permissions(bin.join("curl"), PermissionsExt::from_mode(0o755)).unwrap();
        let mut service = Command::new(env!("CARGO_BIN_EXE_chladni"))
            .args(["serve", "--listen", "127.0.0.1:0", "--threads", "2"])
            .current_dir(folder.path())
            .env("CHLADNI_LOG", "error")
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(service.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.split("http://").nth(1).unwrap().split_whitespace().next().unwrap().to_owned();
        Self { folder, service, address }
    }

    /// Runs a command of the README with these names for ids.
    fn run(&self, command: &str, names: &[(&str, String)]) -> (bool, String) {
        let outer = std::env::var("PATH").unwrap();
        let path = format!("{}:{outer}", self.folder.path().join("bin").display());
        let command = command.replace("cargo run --release --", "chladni").replace(ADDRESS, &self.address);
        let mut shell = Command::new("sh");
        shell.args(["-c", &command]).current_dir(self.folder.path()).env("PATH", path).env("OUTER", outer);
        shell.envs(names.iter().map(|(name, value)| (name, value)));
        let output = shell.output().unwrap();
        let told = [output.stdout, output.stderr].concat();
        (output.status.success(), String::from_utf8_lossy(&told).into_owned())
    }

    /// Runs what must succeed.
    fn succeed(&self, command: &str, names: &[(&str, String)]) -> String {
        let (succeeded, told) = self.run(command, names);
        assert!(succeeded, "{command}\n{told}");
        told
    }

    /// Submits a file and waits; the ids of cloud and job.
    fn submit(&self, file: &str, query: &str) -> (String, String) {
        let told = self.succeed(&format!("curl -T {file} 'http://{ADDRESS}/clouds?{query}'"), &[]);
        let answer: serde_json::Value = serde_json::from_str(&told).unwrap();
        let id = |of: &str| answer[of]["id"].as_str().unwrap().to_owned();
        let job = id("job");
        let ended = self.succeed(&format!("curl 'http://{ADDRESS}/jobs/{job}?wait=60'"), &[]);
        assert!(ended.contains("\"state\":\"succeeded\""), "{ended}");
        (id("cloud"), job)
    }
}

impl Drop for Tour {
    fn drop(&mut self) {
        // The test has ended, well or badly: nothing depends on how the service does.
        let _ = self.service.kill();
        let _ = self.service.wait();
    }
}

/// Runs the commands of a page on clouds of the size that it names; returns their number.
fn follow(name: &str) -> usize {
    let steps = steps(&page(name));
    if steps.is_empty() {
        return 0;
    }
    let tour = Tour::start();
    tour.succeed("chladni sample sphere --points 4000 -o sphere.ply", &[]);
    tour.succeed("chladni sample two-hole-torus --points 4000 -o torus-to-compare.ply", &[]);
    tour.succeed("chladni analyze sphere.ply -o result --bases 30 --force", &[]);
    let (cloud, job) = tour.submit("sphere.ply", "bases=50");
    let (_, other) = tour.submit("torus-to-compare.ply", "bases=50");
    let (_, operator) = tour.submit("sphere.ply", "kind=operator");
    let at = |kind: &str, id: &str| format!("http://{}/{kind}/{id}", tour.address);
    let names = [
        ("J", at("jobs", &job)),
        ("O", at("jobs", &operator)),
        ("C", at("clouds", &cloud)),
        ("OTHER", other),
    ];
    for Step { command, shown } in &steps {
        if command.contains("-o result ") {
            std::fs::remove_dir_all(tour.folder.path().join("result")).unwrap();
        }
        let (succeeded, output) = tour.run(command, &names);
        assert_eq!(succeeded, !command.ends_with("# fails"), "{name}: {command}\n{output}");
        if let Some(shown) = shown {
            let start: String = output.chars().take(2000).collect();
            let agreed = shown::agrees(shown, &output);
            assert!(agreed.is_ok(), "{name}: {command}\n{agreed:?}\nshown: {shown}\nreal: {start}");
        }
    }
    steps.len()
}

#[test]
fn every_command_of_every_page_works_and_prints_what_is_shown() {
    let run: usize = PAGES.iter().map(|name| follow(name)).sum();
    assert!(run > 40, "{run} commands were found");
}

#[test]
fn the_readme_is_short() {
    assert!(page("README.md").lines().count() <= 150);
}

/// The anchors of a page's headings.
fn anchors(text: &str) -> Vec<String> {
    let headings = text.lines().filter(|line| line.starts_with('#'));
    let kept = |c: &char| c.is_alphanumeric() || " -_".contains(*c);
    let anchor =
        |line: &str| line.trim_matches('#').trim().to_lowercase().chars().filter(kept).collect::<String>();
    headings.map(|line| anchor(line).replace(' ', "-")).collect()
}

/// Every Markdown page of the project, by its path from the root.
fn documents() -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folders = ["", "docs/", "docs/decisions/", "python/"];
    let names = folders.into_iter().flat_map(|folder| {
        let entries = root.join(folder).read_dir().unwrap();
        entries.map(move |entry| format!("{folder}{}", entry.unwrap().file_name().to_str().unwrap()))
    });
    names.filter(|name| Path::new(name).extension().is_some_and(|extension| extension == "md")).collect()
}

#[test]
fn every_page_is_linked_from_the_readme_or_the_list_of_decisions() {
    let (readme, decisions) = (page("README.md"), page("docs/decisions/README.md"));
    for name in documents().iter().filter(|name| !name.ends_with("README.md")) {
        let listed = match name.strip_prefix("docs/decisions/") {
            Some(name) => decisions.contains(&format!("]({name})")),
            None => readme.contains(&format!("]({name})")),
        };
        assert!(listed, "{name}");
    }
    assert!(readme.contains("](docs/decisions/README.md)"));
}

#[test]
fn every_picture_and_every_link_of_every_page_is_there() {
    let mut found = 0;
    for name in documents() {
        let text = page(&name);
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(&name);
        let targets = text.match_indices("](").map(|(at, _)| text[at + 2..].split(')').next().unwrap());
        for target in targets.filter(|target| !target.starts_with("http")) {
            let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
            let file = if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
            assert!(file.exists(), "{name}: {target}");
            if !anchor.is_empty() {
                let there = std::fs::read_to_string(&file).unwrap();
                assert!(anchors(&there).iter().any(|heading| heading == anchor), "{name}: {target}");
            }
            found += 1;
        }
    }
    assert!(found >= 20, "{found} links were found");
}
