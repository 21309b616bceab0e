"""Runs chladni and its peer on the same clouds; called by compare.sh."""

import argparse
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile

PEER = """
import json, sys, time
import numpy, robust_laplacian
from scipy.sparse.linalg import eigsh

points = numpy.load(sys.argv[1])
began = time.time()
stiffness, mass = robust_laplacian.point_cloud_laplacian(points)
eigsh(stiffness, int(sys.argv[2]), mass, sigma=-1e-2 / mass.diagonal().sum())
print(json.dumps(time.time() - began))
"""


def run(command):
    """Standard output, and the peak memory in GB."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    output = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        sys.exit(f"{' '.join(map(str, command))} failed")
    return output, usage.ru_maxrss / 1e6


def ours(chladni, cloud, bases, operator, folder):
    output, memory = run(
        [chladni, "analyze", cloud, "-o", folder, "--bases", str(bases), "--operator", operator, "--force"]
    )
    total = next(line for line in output.splitlines() if line.startswith("total"))
    return float(total.split()[1]), memory


def points_of(cloud, folder):
    """The peer reads NPY: no time of it goes into parsing."""
    import numpy

    path = pathlib.Path(folder) / "points.npy"
    if cloud.suffix == ".npy":
        return cloud
    if cloud.suffix == ".ply":
        from plyfile import PlyData

        vertex = PlyData.read(str(cloud))["vertex"]
        points = numpy.column_stack([vertex[axis] for axis in "xyz"])
    else:
        rows = (line.split() for line in open(cloud) if line.startswith("v "))
        points = numpy.array([[float(x) for x in row[1:4]] for row in rows])
    numpy.save(path, points.astype(float))
    return path


def points_count(path):
    import numpy

    return len(numpy.load(path, mmap_mode="r"))


def exponent(sizes, seconds):
    """The power of the number of points that the seconds grow with, by least squares of logarithms."""
    x, y = [[math.log(value) for value in values] for values in (sizes, seconds)]
    middle = sum(x) / len(x)
    return sum((a - middle) * b for a, b in zip(x, y)) / sum((a - middle) ** 2 for a in x)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("chladni")
    parser.add_argument("clouds", nargs="*", type=pathlib.Path)
    parser.add_argument("--bases", type=int, default=100)
    arguments = parser.parse_intermixed_args()  # options may stand between positional arguments
    with tempfile.TemporaryDirectory() as folder:
        clouds = arguments.clouds
        if not clouds:
            clouds = [pathlib.Path(folder) / f"bumpy-sphere-{points}.npy" for points in (30_000, 90_000)]
            for cloud in clouds:
                points = cloud.stem.rsplit("-", 1)[1]
                run([arguments.chladni, "sample", "bumpy-sphere", "--points", points, "-o", str(cloud)])
        print(f"| cloud, {arguments.bases} bases | `voronoi` | `pb-mhb` | peer | ratios of seconds | of memory |")
        print("|---|---|---|---|---|---|")
        sizes, times = [], []
        for cloud in clouds:
            out = os.path.join(folder, "result")
            mine = [ours(arguments.chladni, str(cloud), arguments.bases, o, out) for o in ("voronoi", "pb-mhb")]
            points = points_of(cloud, folder)
            output, memory = run([sys.executable, "-c", PEER, str(points), str(arguments.bases)])
            peer = json.loads(output), memory
            cells = [f"{seconds:.1f} s, {gigabytes:.2f} GB" for seconds, gigabytes in [*mine, peer]]
            ratios = [", ".join(f"{own[i] / peer[i]:.2f}" for own in mine) for i in (0, 1)]
            print(f"| {cloud.name} | " + " | ".join([*cells, *ratios]) + " |", flush=True)
            sizes.append(points_count(points))
            times.append([seconds for seconds, _ in [*mine, peer]])
        if len(set(sizes)) > 1:
            grown = [f"{exponent(sizes, seconds):.2f}" for seconds in zip(*times)]
            print(f"\nSeconds grow with points to the power of {grown[0]}, {grown[1]} and {grown[2]}.")


main()
