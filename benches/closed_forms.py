#!/usr/bin/env python3
"""Errors of eigenvalues and eigenvectors on surfaces with known spectra, by sampling and number of points.

usage: closed_forms.py CHLADNI [--only WORD] [--sizes 1000,4000,16000,64000] [--json FILE]

Printed as Markdown: for every surface and sampling the worst relative error, in percent, of the first 25 non-zero
eigenvalues at each size, the order of convergence in the spacing (least squares over all sizes; an error that falls
fourfold with four times the points has order 2), and the largest angle, in radians, between the span of the first
eigenvectors and that of the true functions, cut at the largest gap between the 12th and the 21st. Orders and angles
are those of `voronoi`, then `pb-mhb`.
Needs numpy and scipy.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile

import numpy as np
from scipy.linalg import eigh, subspace_angles
from scipy.special import jn_zeros, jnp_zeros, jv, lpmv

COUNT = 25
OPERATORS = ["voronoi", "pb-mhb"]


def first(pairs):
    """The smallest eigenvalues, zero included, each with its function of points."""
    return sorted(pairs, key=lambda pair: pair[0])[: COUNT + 6]


# Spectra. Functions take the points' parameters u, v.


def waves(order):
    """Cosine and sine of an integer order."""
    if order == 0:
        return [lambda u: np.ones_like(u)]
    return [lambda u: np.cos(order * u), lambda u: np.sin(order * u)]


def sphere():
    pairs = []
    for l in range(9):
        for m in range(l + 1):
            for wave in waves(m):
                pairs.append((l * (l + 1.0), lambda u, v, l=l, m=m, w=wave: lpmv(m, l, v) * w(u)))
    return first(pairs)


def rectangle(a, b):
    def mode(i, j):
        return lambda u, v: np.cos(np.pi * i * u / a) * np.cos(np.pi * j * v / b)

    return first([((np.pi * i / a) ** 2 + (np.pi * j / b) ** 2, mode(i, j)) for i in range(12) for j in range(12)])


def cylinder(height):
    pairs = []
    for i in range(12):
        for j in range(12):
            for wave in waves(i):
                value = i * i + (np.pi * j / height) ** 2
                pairs.append((value, lambda u, v, j=j, w=wave: w(u) * np.cos(np.pi * j * v / height)))
    return first(pairs)


def disk():
    pairs = [(0.0, lambda u, v: np.ones_like(u))]
    for order in range(15):
        zeros = jn_zeros(1, 8) if order == 0 else jnp_zeros(order, 8)
        for k in zeros:
            for wave in waves(order):
                pairs.append((k * k, lambda u, v, k=k, n=order, w=wave: jv(n, k * v) * w(u)))
    return first(pairs)


def flat_torus():
    pairs = []
    for i in range(8):
        for j in range(8):
            for a in waves(i):
                for b in waves(j):
                    pairs.append((i * i + j * j * 1.0, lambda u, v, a=a, b=b: a(u) * b(v)))
    return first(pairs)


def separated(radius, speed, ends, angular, closed=False, parity=None):
    """Pairs of a surface of revolution with `radius(v)` and meridians of `speed(v)`: on each order of rotation a
    Sturm-Liouville problem on `ends`, in Legendre polynomials or, `closed`, in waves. `angular` yields the order and its
    waves; `parity(order)` is 1 or -1 where functions of v must be even or odd."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    half, middle = 0.5 * (ends[1] - ends[0]), 0.5 * (ends[1] + ends[0])
    v, weights = middle + half * nodes, half * weights
    degree = 48
    r, g = radius(v), speed(v)
    pairs = []
    for order, waves_of in angular:

        def basis(at, derivative=False, order=order):
            if closed:
                k = np.arange(1, degree // 2)
                if derivative:
                    return np.c_[0 * at, -k * np.sin(np.outer(at, k)), k * np.cos(np.outer(at, k))]
                return np.c_[np.ones_like(at), np.cos(np.outer(at, k)), np.sin(np.outer(at, k))]
            x = (at - middle) / half
            if not derivative:
                return np.polynomial.legendre.legvander(x, degree)
            eye = np.eye(degree + 1)
            return np.polynomial.legendre.legval(x, np.polynomial.legendre.legder(eye)).T / half

        f, df = basis(v), basis(v, True)
        if parity is not None:
            f, df = f[:, (1 - parity(order)) // 2 :: 2], df[:, (1 - parity(order)) // 2 :: 2]
        stiffness = df.T @ (df * (weights * r / g)[:, None]) + f.T @ (f * (order**2 * weights * g / r)[:, None])
        mass = f.T @ (f * (weights * r * g)[:, None])
        values, vectors = eigh(stiffness, mass)
        for value, vector in zip(values[:10], vectors.T[:10]):
            for wave in waves_of:

                def mode(u, at, vector=vector, w=wave, basis=basis, order=order):
                    b = basis(at)
                    b = b if parity is None else b[:, (1 - parity(order)) // 2 :: 2]
                    return w(u) * (b @ vector)

                pairs.append((max(value, 0.0), mode))
    return first(pairs)


def torus():
    """Of revolution, radii 1 and 0.4."""
    return separated(
        lambda v: 1 + 0.4 * np.cos(v), lambda v: 0.4 + 0 * v, (-np.pi, np.pi), [(i, waves(i)) for i in range(12)], True
    )


def spheroid():
    """An ellipsoid with semi-axes 1, 1 and 2; v is the angle from the pole."""
    return separated(
        np.sin,
        lambda v: np.sqrt(np.cos(v) ** 2 + 4 * np.sin(v) ** 2),
        (1e-9, np.pi - 1e-9),
        [(i, waves(i)) for i in range(12)],
    )


def moebius():
    """A band of width 1 in four dimensions, on which turning by 2π turns v around."""
    orders = [(0.5 * i, waves_half(i)) for i in range(16)]
    return separated(
        lambda v: np.sqrt(1 + v * v / 4),
        lambda v: np.ones_like(v),
        (-0.5, 0.5),
        orders,
        parity=lambda order: 1 if float(order).is_integer() else -1,
    )


def waves_half(i):
    if i == 0:
        return [lambda u: np.ones_like(u)]
    return [lambda u: np.cos(0.5 * i * u), lambda u: np.sin(0.5 * i * u)]


# Samples: n points of the unit square, then onto the surface so that areas stay equal.


def plane_points(kind, n, aspect, rng):
    """Points of the unit square for a surface of `aspect` (length of u over that of v)."""
    rows = max(3, round(np.sqrt(n / aspect)))
    columns = max(3, round(n / rows))
    x, y = (a.ravel() for a in np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows))
    if kind == "uniform":
        # every second row moved by half a column: nearly hexagons
        return (x + 0.5 * (np.round(y * rows - 0.5) % 2) / columns) % 1, y
    if kind == "jittered":
        return (x + 0.6 * (rng.random(len(x)) - 0.5) / columns) % 1, y + 0.6 * (rng.random(len(y)) - 0.5) / rows
    if kind == "iid":
        return rng.random(n), rng.random(n)
    if kind == "100:1":
        # density exp(v ln 100)
        return rng.random(n), np.log1p(99 * rng.random(n)) / np.log(100)
    # lines four times as far apart as the points on them
    return plane_points("grid", n, aspect / 4, rng) if kind == "lines" else (x, y)


def surfaces():
    """Name, pairs, aspect, and the map of the unit square to parameters and points."""

    def ball(x, y):
        u, z = 2 * np.pi * x, 2 * y - 1
        r = np.sqrt(1 - z * z)
        return u, z, np.c_[r * np.cos(u), r * np.sin(u), z]

    def by_area(radius, speed, ends, place):
        v = np.linspace(*ends, 20001)
        area = np.concatenate([[0], np.cumsum(0.5 * (radius(v) * speed(v))[1:] + 0.5 * (radius(v) * speed(v))[:-1])])
        area /= area[-1]

        def onto(x, y):
            u, at = 2 * np.pi * x, np.interp(y, area, v)
            return u, at, place(u, at)

        return onto

    def ring(u, v):
        r = 1 + 0.4 * np.cos(v)
        return np.c_[r * np.cos(u), r * np.sin(u), 0.4 * np.sin(v)]

    def long_ball(u, v):
        return np.c_[np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), 2 * np.cos(v)]

    def band(u, v):
        return np.c_[np.cos(u), np.sin(u), v * np.cos(u / 2), v * np.sin(u / 2)]

    def plate(x, y):
        return x, y, np.c_[x, y, 0 * x]

    def tube(x, y):
        u, v = 2 * np.pi * x, 2 * y
        return u, v, np.c_[np.cos(u), np.sin(u), v]

    def flat_disk(x, y):
        u, v = 2 * np.pi * x, np.sqrt(y)
        return u, v, np.c_[v * np.cos(u), v * np.sin(u), 0 * u]

    def flat_ring(x, y):
        u, v = 2 * np.pi * x, 2 * np.pi * y
        return u, v, np.c_[np.cos(u), np.sin(u), np.cos(v), np.sin(v)]

    one = lambda v: np.ones_like(v)
    yield "sphere", sphere(), np.pi, ball
    yield "flat torus", flat_torus(), 1.0, flat_ring
    yield "torus", torus(), 2.5, by_area(lambda v: 1 + 0.4 * np.cos(v), one, (-np.pi, np.pi), ring)
    long = lambda v: np.sqrt(np.cos(v) ** 2 + 4 * np.sin(v) ** 2)
    yield "ellipsoid 1 1 2", spheroid(), 1.5, by_area(np.sin, long, (0, np.pi), long_ball)
    yield "cylinder", cylinder(2.0), np.pi, tube
    yield "square", rectangle(1.0, 1.0), 1.0, plate
    yield "disk", disk(), np.pi, flat_disk
    stretch = lambda v: np.sqrt(1 + v * v / 4)
    yield "Möbius band", moebius(), 2 * np.pi, by_area(stretch, one, (-0.5, 0.5), band)


SAMPLINGS = ["uniform", "jittered", "iid", "100:1", "lines"]


def angle(bases, mass, pairs, u, v):
    """Largest principal angle between found and true spans, both cut at the largest gap of the true values."""
    values = np.array([value for value, _ in pairs])
    cut = 13 + int(np.argmax(values[13:22] - values[12:21]))
    truth = np.stack([function(u, v) for _, function in pairs[:cut]], axis=1)
    root = np.sqrt(mass)[:, None]
    return float(subspace_angles(root * truth, root * bases[:, :cut]).max())


def run(chladni, points, operator):
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        np.save(folder / "cloud.npy", points)
        command = [chladni, "analyze", folder / "cloud.npy", "-o", folder / "out", "--operator", operator]
        command += ["--bases", str(COUNT + 1)]
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(done.stderr.strip())
        report = json.loads((folder / "out" / "report.json").read_text())
        return report, np.load(folder / "out" / "bases.npy"), np.load(folder / "out" / "mass.npy")


def measure(chladni, onto, pairs, aspect, sampling, size):
    x, y = plane_points(sampling, size, aspect, np.random.default_rng(size))
    u, v, points = onto(x, y)
    row = {}
    for operator in OPERATORS:
        report, bases, mass = run(chladni, points, operator)
        bases = bases if bases.shape[0] == len(points) else bases.T
        known = np.isfinite(bases).all(axis=1)
        truth = np.array([value for value, _ in pairs[1 : COUNT + 1]])
        found = np.array([np.inf if value is None else value for value in report["spectrum"]["eigenvalues"]])
        row[operator] = {
            "points": len(points),
            "worst": float(100 * np.abs(found[1 : COUNT + 1] / truth - 1).max()),
            "angle": angle(bases[known], mass[known], pairs, u[known], v[known]),
            "trust": report["fidelity"]["trust"],
        }
    return row


def order(cells):
    """Slope of log error over log spacing."""
    x = np.log([1 / np.sqrt(cell["points"]) for cell in cells])
    return np.polyfit(x, np.log([cell["worst"] for cell in cells]), 1)[0]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("chladni")
    parser.add_argument("--only", default="")
    parser.add_argument("--sizes", default="1000,4000,16000,64000")
    parser.add_argument("--json", type=pathlib.Path)
    args = parser.parse_args()
    sizes = [int(size) for size in args.sizes.split(",")]
    print("| surface | sampling | " + " | ".join(f"{size // 1000}k" for size in sizes) + " | order | angle |")
    print("|---|---|" + "---|" * len(sizes) + "---|---|")
    rows = []
    for name, pairs, aspect, onto in surfaces():
        for sampling in SAMPLINGS:
            if args.only not in f"{name} {sampling}":
                continue
            cells = [measure(args.chladni, onto, pairs, aspect, sampling, size) for size in sizes]
            rows.append({"surface": name, "sampling": sampling, "sizes": sizes, "cells": cells})
            line = [" / ".join(f"{cell[o]['worst']:.2g}" for o in OPERATORS) for cell in cells]
            line.append(" / ".join(f"{order([cell[o] for cell in cells]):.1f}" for o in OPERATORS))
            line.append(" / ".join(f"{cells[-1][o]['angle']:.2g}" for o in OPERATORS))
            print(f"| {name} | {sampling} | " + " | ".join(line) + " |", flush=True)
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
