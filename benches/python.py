"""The Python package beside robust_laplacian and SciPy's eigsh: seconds, peak memory and worst error, in one run.

    python benches/python.py [--bases 100] [MESH.ply|MESH.obj …]

Needs `pip install './python[scipy]' robust_laplacian`. Every method has a process of its own and begins with points in an
array. Errors are those of λ₁ to λ_k beside a reference that is none of the two: the cotangent operator, solved by eigsh,
on the triangles of the mesh or, for the bumpy sphere of 90,000 points that is always measured, of a grid of 360,000.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

METHODS = {
    "chladni, voronoi": "values = chladni.eigenbasis(points, k=k, operator='voronoi').eigenvalues",
    "chladni, pb-mhb": "values = chladni.eigenbasis(points, k=k).eigenvalues",
    "chladni.laplacian + eigsh": "L, M = chladni.laplacian(points); values = solve(L.tocsc(), M.tocsc())",
    "robust_laplacian + eigsh": "L, M = robust_laplacian.point_cloud_laplacian(points); values = solve(L, M)",
}

SCRIPT = """
import json, sys, time
import numpy as np
import chladni, robust_laplacian
from scipy.sparse.linalg import eigsh

def solve(L, M):
    return np.sort(eigsh(L, k, M, sigma=-1e-2 / M.diagonal().sum(), return_eigenvectors=True)[0])

points, k = np.load(sys.argv[1]), int(sys.argv[2])
began = time.perf_counter()
{}
seconds = time.perf_counter() - began
# not ru_maxrss: a child begins with its parent's
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
memory = int(status["VmHWM"].split()[0]) / 1e6
print(json.dumps([seconds, memory, list(values)]))
"""


def measured(method, points, bases):
    """Seconds, gigabytes, eigenvalues."""
    command = [sys.executable, "-c", SCRIPT.format(METHODS[method]), str(points), str(bases)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def cotangent(points, faces, bases):
    """The lowest eigenvalues of the cotangent operator with lumped masses, assembled here and solved by SciPy."""
    from scipy.sparse import coo_matrix, diags
    from scipy.sparse.linalg import LinearOperator, eigsh, splu

    # the seams of a grid are closed, and points without a triangle left out
    corners, faces = np.unique(points[faces.ravel()], axis=0, return_inverse=True)
    faces, n = faces.reshape(-1, 3), len(corners)
    mass, rows, columns, values = np.zeros(n), [], [], []
    for i in range(3):
        a, b, c = (faces[:, (i + j) % 3] for j in range(3))
        u, v = corners[b] - corners[a], corners[c] - corners[a]
        double_area = np.linalg.norm(np.cross(u, v), axis=1)
        half_cotangent = np.where(double_area > 0.0, 0.5 * (u * v).sum(axis=1) / np.maximum(double_area, 1e-300), 0.0)
        np.add.at(mass, a, double_area / 6.0)  # a third of the triangle to each corner
        rows += [b, c, b, c]
        columns += [c, b, b, c]
        values += [-half_cotangent, -half_cotangent, half_cotangent, half_cotangent]
    stiffness = coo_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (n, n)).tocsc()
    masses, shift = diags(mass, format="csc"), -1e-2 / mass.sum()
    symmetric = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    factor = splu((stiffness - shift * masses).tocsc(), **symmetric)
    inverse = LinearOperator((n, n), matvec=factor.solve)
    return np.sort(eigsh(stiffness, bases, masses, sigma=shift, OPinv=inverse, return_eigenvectors=False))


def main():
    import chladni

    parser = argparse.ArgumentParser()
    parser.add_argument("meshes", nargs="*", type=pathlib.Path)
    parser.add_argument("--bases", type=int, default=100)
    arguments = parser.parse_intermixed_args()
    bases = arguments.bases
    fine = chladni.sample("bumpy-sphere", 360_000, sampling="grid")
    clouds = [("bumpy sphere", chladni.sample("bumpy-sphere", 90_000), fine)]
    for path in arguments.meshes:
        mesh = chladni.read(path)
        clouds.append((path.stem, mesh, mesh))
    print(f"| {bases} bases | points | method | seconds | GB | worst error |\n|---|--:|---|--:|--:|--:|")
    with tempfile.TemporaryDirectory() as folder:
        for name, cloud, reference in clouds:
            array = os.path.join(folder, "points.npy")
            np.save(array, cloud.points)
            exact = cotangent(reference.points, reference.faces, bases)
            for method in METHODS:
                seconds, memory, values = measured(method, array, bases)
                error = np.abs(np.array(values)[1:] / exact[1:] - 1.0).max()
                print(f"| {name} | {len(cloud):,} | {method} | {seconds:.1f} | {memory:.2f} | {100 * error:.2f} % |", flush=True)


main()
