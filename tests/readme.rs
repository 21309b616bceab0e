//! The commands of the README, run as they stand there, on smaller clouds.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use tempfile::TempDir;

const README: &str = include_str!("../README.md");
/// Where the README's service listens.
const ADDRESS: &str = "127.0.0.1:8080";
/// Commands that build, never end, or take hours are not run; each has tests of its own.
const NOT_RUN: [&str; 5] =
    ["cargo test", "cargo run --release -- demo", "cargo run --release -- serve", "benches/", "reproduce"];

/// The blocks of a language, each with the commands in it.
fn blocks(language: &str) -> Vec<String> {
    let fence = format!("```{language}\n");
    let starts = README.match_indices(&fence).map(|(at, _)| at + fence.len());
    starts.map(|start| README[start..].split("```").next().unwrap().to_owned()).collect()
}

/// A smaller problem than the README's: the commands are tested, not the numbers.
fn smaller(command: &str) -> String {
    let replacements = [
        ("cargo run --release --", "chladni"),
        ("--points 4000", "--points 400"),
        ("--points 6000", "--points 600"),
        ("bases=50", "bases=20"),
        ("--bases 30", "--bases 20"),
    ];
    replacements.iter().fold(command.to_owned(), |command, (from, to)| command.replace(from, to))
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
        let command = smaller(command).replace(ADDRESS, &self.address);
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

#[test]
fn every_command_of_the_readme_works() {
    let tour = Tour::start();
    tour.succeed("chladni sample sphere --points 400 -o sphere.ply", &[]);
    tour.succeed("chladni sample torus --points 400 -o torus-to-compare.ply", &[]);
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
    let mut run = 0;
    for command in blocks("sh").iter().flat_map(|block| block.lines()) {
        let is_command = !command.is_empty() && !command.starts_with('#');
        if !is_command || NOT_RUN.iter().any(|not_run| command.contains(not_run)) {
            continue;
        }
        let (succeeded, told) = tour.run(command, &names);
        assert_eq!(succeeded, !command.ends_with("# fails"), "{command}\n{told}");
        run += 1;
    }
    assert!(run > 30, "{run} commands were found");
    for file in
        ["bases.npy", "bases.ply", "spectrum.svg", "basis-4.png", "cloud.laz", "smooth.ply", "basis-6.png"]
    {
        assert!(tour.folder.path().join(file).metadata().unwrap().len() > 100, "{file}");
    }
}

#[test]
fn every_picture_and_every_link_of_the_readme_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let targets = README.match_indices("](").map(|(at, _)| README[at + 2..].split(')').next().unwrap());
    let mut found = 0;
    for target in targets.filter(|target| !target.starts_with("http")) {
        match target.strip_prefix('#') {
            Some(anchor) => {
                let headings = README.lines().filter_map(|line| line.strip_prefix("## "));
                let anchors: Vec<String> = headings.map(|h| h.to_lowercase().replace(' ', "-")).collect();
                assert!(anchors.iter().any(|a| a == anchor), "#{anchor}");
            }
            None => assert!(root.join(target).exists(), "{target}"),
        }
        found += 1;
    }
    assert!(found >= 6);
}
