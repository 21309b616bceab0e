#!/usr/bin/env bash
# chladni beside what a Python user would take: robust_laplacian and SciPy's shift-invert eigsh, one after the other on
# the same clouds.
#
#   benches/compare.sh [--bases K] [CLOUD.npy|CLOUD.ply|CLOUD.obj …]      (bumpy spheres of 30,000 and 90,000 points when none is given)
#
# Prints a Markdown table of seconds (points in memory to eigenpairs), peak memory and ratios and, of clouds of several sizes,
# how seconds grow with them. Installs the peer with pip into target/peers.
set -euo pipefail
cd "$(dirname "$0")/.."

venv=target/peers
if [ ! -x "$venv/bin/python" ]; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet numpy scipy robust_laplacian plyfile
fi
cargo build --locked --release --workspace --bins
exec "$venv/bin/python" benches/compare.py target/release/chladni "$@"
