#!/usr/bin/env python3
"""Errors of eigenvalues against references: scans of a folder and clouds made here, beside robust_laplacian.

usage: scans.py CHLADNI [--scans FOLDER] [--kinds] [--only WORD] [--peer] [--json FILE] [--extra "--flag value"]

FOLDER holds scans.json, a list of {"name", "components", "eigenvalues", "peer30"}, and NAME.ply for each of its
entries. Printed are the worst and the median relative error, in percent, of the first 29 non-zero eigenvalues.
Needs numpy and scipy, and robust_laplacian with --peer.
"""

import argparse
import json
import pathlib
import shlex
import subprocess
import tempfile

import numpy as np
from scipy.sparse.linalg import eigsh
from scipy.special import jnp_zeros

COUNT = 29
OPERATORS = ["voronoi", "pb-mhb"]


# Truths: the smallest eigenvalues, zero included.


def first(values):
    return np.sort(np.asarray(values, float))[: COUNT + 1]


def sphere():
    return first(np.concatenate([[l * (l + 1)] * (2 * l + 1) for l in range(9)]))


def hemisphere():
    """Even harmonics: natural rims at the equator."""
    return first(np.concatenate([[l * (l + 1)] * (l + 1) for l in range(12)]))


def rectangle(a, b):
    return first([(np.pi * i / a) ** 2 + (np.pi * j / b) ** 2 for i in range(30) for j in range(30)])


def cylinder(height):
    return first([a * a + (np.pi * b / height) ** 2 for a in range(-30, 31) for b in range(30)])


def disk():
    values = [0.0]
    for order in range(20):
        values += (1 if order == 0 else 2) * list(jnp_zeros(order, 12) ** 2)
    return first(values)


def flat_torus():
    return first([a * a + b * b for a in range(-9, 10) for b in range(-9, 10)])


# Clouds.


def fibonacci(n):
    i = np.arange(n)
    z = 1 - (2 * i + 1) / n
    angle = np.pi * (3 - np.sqrt(5)) * i
    r = np.sqrt(1 - z * z)
    return np.c_[r * np.cos(angle), r * np.sin(angle), z]


def iid_sphere(n, seed=1):
    p = np.random.default_rng(seed).normal(size=(n, 3))
    return p / np.linalg.norm(p, axis=1)[:, None]


def latlong(rings):
    """`rings` − 1 rings of twice as many points, and two poles."""
    theta = np.arange(1, rings) * np.pi / rings
    phi = np.arange(2 * rings) * np.pi / rings
    t, f = (x.ravel() for x in np.meshgrid(theta, phi, indexing="ij"))
    p = np.c_[np.sin(t) * np.cos(f), np.sin(t) * np.sin(f), np.cos(t)]
    return np.r_[p, [[0, 0, 1], [0, 0, -1]]]


def density_step(n, ratio, points=fibonacci):
    dense, sparse = points(n), points(n // ratio)
    return np.r_[dense[dense[:, 2] >= 0], sparse[sparse[:, 2] < 0]]


def graded(n, ratio, seed=3):
    """Spacing that grows `ratio`-fold from pole to pole, the points kept apart (best candidates)."""
    rng = np.random.default_rng(seed)
    chosen = np.empty((n, 3))
    spacing = lambda z: ratio ** ((z + 1) / 2)
    count = 0
    while count < n:
        candidates = iid_sphere(24, rng.integers(1 << 31))
        if count == 0:
            chosen[0], count = candidates[0], 1
            continue
        d = np.linalg.norm(candidates[:, None] - chosen[None, :count], axis=2).min(1) / spacing(candidates[:, 2])
        chosen[count] = candidates[np.argmax(d)]
        count += 1
    return chosen


def hundredfold(n, seed=4):
    """Density exp(z · ln 10): a hundred times as dense at one pole as at the other."""
    rng = np.random.default_rng(seed)
    growth = 0.5 * np.log(100.0)
    u, f = rng.random(n), 2 * np.pi * rng.random(n)
    z = np.log(np.exp(-growth) + u * (np.exp(growth) - np.exp(-growth))) / growth
    r = np.sqrt(np.maximum(0, 1 - z * z))
    return np.c_[r * np.cos(f), r * np.sin(f), z]


def square_lines(n, ratio):
    """Lines `ratio` times as far apart as the points on them, both ends on the rim."""
    lines = max(3, round(np.sqrt(n / ratio)))
    along = round(n / lines)
    x, y = np.meshgrid(np.linspace(0, 1, along), np.linspace(0, 1, lines))
    return np.c_[x.ravel(), y.ravel(), 0 * x.ravel()]


def cylinder_lines(n, ratio):
    lines = max(4, round(np.sqrt(n * 2 / (2 * np.pi * ratio))))
    along = round(n / lines)
    f, z = np.meshgrid(2 * np.pi * np.arange(along) / along, np.linspace(0, 2, lines))
    return np.c_[np.cos(f.ravel()), np.sin(f.ravel()), z.ravel()]


def noisy(p, share, seed=5):
    """Unit-sphere points moved along their radius by `share` spacings (σ)."""
    h = np.sqrt(4 * np.pi / len(p))
    return p * (1 + share * h * np.random.default_rng(seed).normal(size=len(p)))[:, None]


def repeated(p, frames, share, seed=6):
    rng = np.random.default_rng(seed)
    h = np.sqrt(4 * np.pi / len(p))
    return np.concatenate([p + share * h * rng.normal(size=p.shape) for _ in range(frames)])


def views(share, n=3000, count=6, seed=7):
    """Overlapping caps of the sphere, each moved by `share` spacings as a whole."""
    rng = np.random.default_rng(seed)
    h = np.sqrt(4 * np.pi / n)
    parts = []
    for axis in np.r_[np.eye(3), -np.eye(3)][:count]:
        p = iid_sphere(n, rng.integers(1 << 31))
        parts.append(p[p @ axis > 0.2] + share * h * rng.normal(size=3))
    return np.concatenate(parts)


def square_iid(n, seed=8):
    p = np.random.default_rng(seed).random((n, 2))
    return np.c_[p, np.zeros(n)]


def disk_points(n):
    i = np.arange(n)
    r, f = np.sqrt((i + 0.5) / n), np.pi * (3 - np.sqrt(5)) * i
    return np.c_[r * np.cos(f), r * np.sin(f), np.zeros(n)]


def half(p):
    return p[p[:, 2] >= 0]


def torus_grid(n, ratio=1):
    b = round(np.sqrt(n / ratio))
    a = round(n / b)
    u, v = np.meshgrid(2 * np.pi * np.arange(a) / a, 2 * np.pi * np.arange(b) / b)
    u, v = u.ravel(), v.ravel()
    return np.c_[np.cos(u), np.sin(u), np.cos(v), np.sin(v)]


def double_and_float(p):
    return np.r_[p, p.astype(np.float32).astype(float)]


def two_plates(gap, side=1.0, n=45):
    x, y = np.meshgrid(np.linspace(0, side, n), np.linspace(0, side, n))
    x, y = x.ravel(), y.ravel()
    h = side / (n - 1)
    return np.r_[np.c_[x, y, 0 * x], np.c_[x, y, 0 * x + gap * h]]


def kinds():
    """Name, cloud, truth, number of zero eigenvalues."""
    s, q = sphere(), rectangle(1, 1)
    for n in (1000, 4000, 16000, 64000):
        yield f"sphere fibonacci {n}", fibonacci(n), s, 1
        yield f"sphere iid {n}", iid_sphere(n), s, 1
    for rings in (17, 23, 39, 64):
        yield f"sphere lat-long {rings}", latlong(rings), s, 1
    for ratio in (8, 16, 32):
        yield f"sphere step {ratio}:1", density_step(8000, ratio), s, 1
        yield f"sphere iid step {ratio}:1", density_step(8000, ratio, iid_sphere), s, 1
    yield "sphere graded 1:8", graded(2000, 8), s, 1
    yield "sphere 100:1 iid 4000", hundredfold(4000), s, 1
    yield "sphere 100:1 iid 16000", hundredfold(16000), s, 1
    for ratio in (1, 2, 4, 8, 10, 16, 24):
        yield f"square lines {ratio}:1", square_lines(8000, ratio), q, 1
    for ratio in (4, 8, 16):
        yield f"cylinder lines {ratio}:1", cylinder_lines(12000, ratio), cylinder(2), 1
    yield "torus in R4 1:1", torus_grid(4000), flat_torus(), 1
    yield "torus in R4 2:1", torus_grid(4000, 2), flat_torus(), 1
    for share in (0.1, 0.25, 0.5):
        yield f"sphere noise {share} h", noisy(fibonacci(8000), share), s, 1
        yield f"sphere iid noise {share} h", noisy(iid_sphere(8000), share), s, 1
    for frames, share in ((2, 1e-6), (5, 0.001), (20, 0.001), (20, 0.01), (5, 0.1), (20, 0.1)):
        yield f"sphere {frames} frames {share} h", repeated(fibonacci(2000), frames, share), s, 1
    yield "sphere double and float", double_and_float(fibonacci(4000)), s, 1
    for share in (0.0, 0.1, 0.5):
        yield f"sphere 6 views {share} h", views(share), s, 1
    for n in (4000, 16000):
        yield f"square iid {n}", square_iid(n), q, 1
        yield f"disk {n}", disk_points(n), disk(), 1
        yield f"hemisphere iid {n}", half(iid_sphere(2 * n)), hemisphere(), 1
    yield "hemisphere fibonacci 4000", half(fibonacci(8000)), hemisphere(), 1
    for gap in (2, 3):
        yield f"two plates {gap} h apart", two_plates(gap), first(np.repeat(q, 2)), 2


def errors(found, truth, zeros):
    """Worst and median relative error; a zero where none belongs counts as 100 %."""
    wanted = np.asarray(truth[zeros : zeros + COUNT], float)
    found = np.asarray([np.inf if x is None else x for x in found[zeros : zeros + COUNT]], float)
    e = np.abs(found[: len(wanted)] / wanted[: len(found)] - 1)
    return 100 * e.max(), 100 * np.median(e)


def ours(chladni, path, operator, bases, extra):
    with tempfile.TemporaryDirectory() as folder:
        command = [chladni, "analyze", path, "-o", folder, "--force", "--operator", operator, "--bases", bases, *extra]
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
        if done.returncode != 0:
            return None, done.stderr.strip().splitlines()[-1][:100] if done.stderr.strip() else "failed"
        return json.loads((pathlib.Path(folder) / "report.json").read_text()), None


def peer(points, bases):
    import robust_laplacian

    stiffness, mass = robust_laplacian.point_cloud_laplacian(points)
    values, _ = eigsh(stiffness, bases, mass, sigma=-1e-2 / mass.diagonal().sum())
    return np.sort(values)


def measure(name, path, truth, zeros, args, points=None, known_peer=None):
    row = {"name": name, "peer": None if known_peer is None else 100 * known_peer}
    bases = zeros + COUNT
    line = f"{name:28}"
    for operator in OPERATORS:
        report, failure = ours(args.chladni, path, operator, bases, shlex.split(args.extra))
        if report is None:
            row[operator] = None
            line += f" | {operator} fails: {failure}"
            continue
        worst, median = errors(report["spectrum"]["eigenvalues"], truth, zeros)
        row[operator] = [worst, median]
        row[f"{operator} report"] = {
            key: report.get(key) for key in ("components", "isolated", "sampling", "warnings", "fidelity", "points_used")
        }
        parts = report["components"] - zeros
        mark = f" {parts:+d} parts" if parts else ""
        fidelity = report.get("fidelity") or {}
        trust = f" trust {fidelity['trust']:.2f}" if "trust" in fidelity else ""
        line += f" | {worst:6.2f} / {median:5.2f}{mark}{trust}"
    if points is not None and args.peer and points.shape[1] == 3:
        try:
            row["peer"], median = errors(list(peer(points, bases)), truth, zeros)
        except Exception as error:  # the peer's failures are part of the table
            line += f" | peer {type(error).__name__}"
    if row["peer"] is not None:
        line += f" | peer {row['peer']:6.2f}"
    print(line, flush=True)
    return row


def summary(rows):
    for operator in OPERATORS:
        worst = [row[operator][0] if row[operator] else np.inf for row in rows]
        against = [row for row in rows if row["peer"] is not None]
        behind = [r["name"] for r in against if not r[operator] or r[operator][0] > r["peer"]]
        shares = ", ".join(f"{sum(w <= bound for w in worst)} within {bound} %" for bound in (1, 3, 10))
        print(f"{operator}: {len(rows)} clouds, median of the worst {np.median(worst):.2f} %, {shares}")
        print(f"    worse than the peer on {len(behind)} of {len(against)}: {', '.join(behind)}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("chladni")
    parser.add_argument("--scans", type=pathlib.Path)
    parser.add_argument("--kinds", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--most", type=int, default=1 << 30, help="leave out clouds of more points")
    parser.add_argument("--peer", action="store_true")
    parser.add_argument("--json", type=pathlib.Path)
    parser.add_argument("--extra", default="")
    args = parser.parse_args()
    rows = []
    if args.scans:
        for entry in json.loads((args.scans / "scans.json").read_text()):
            if args.only in entry["name"] and entry["points"] <= args.most:
                path = args.scans / f"{entry['name']}.ply"
                known = entry.get("peer30")
                rows.append(
                    measure(entry["name"], path, entry["eigenvalues"], entry["components"], args, known_peer=known)
                )
        summary(rows)
    if args.kinds:
        made = []
        with tempfile.TemporaryDirectory() as folder:
            for name, points, truth, zeros in kinds():
                if args.only in name and len(points) <= args.most:
                    path = pathlib.Path(folder) / "cloud.npy"
                    np.save(path, points)
                    made.append(measure(name, path, truth, zeros, args, points))
        summary(made)
        rows += made
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
