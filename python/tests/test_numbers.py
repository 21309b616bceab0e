"""Operators and eigenbases: closed forms, invariants, and the errors of wrong calls."""

from __future__ import annotations

import numpy as np
import pytest

import chladni


def test_the_sphere_has_the_eigenvalues_of_spherical_harmonics(sphere):
    evals, evecs = chladni.eigenbasis(sphere, k=16)
    exact = np.repeat([0.0, 2.0, 6.0, 12.0], [1, 3, 5, 7])
    assert evecs.shape == (1200, 16) and evecs.flags.c_contiguous and evecs.dtype == np.float64
    np.testing.assert_allclose(evals, exact, rtol=0.02, atol=1e-9)


def test_bases_tell_how_far_off_they_may_be(sphere):
    exact = np.repeat([0.0, 2.0, 6.0, 12.0], [1, 3, 5, 7])
    basis = chladni.eigenbasis(sphere, k=16, operator="voronoi")
    assert basis.dual_residuals.shape == basis.expected_errors.shape == (16,)
    assert 0.0 <= basis.dual_residuals.max() < 1e-2
    off = np.abs(basis.eigenvalues[1:] / exact[1:] - 1.0)
    assert off.max() < 2.0 * basis.expected_errors[1:].max() < 0.1
    assert chladni.eigenbasis(sphere, k=4, operator="pcd").dual_residuals is None
    assert chladni.eigenbasis(sphere, k=4, operator="graph").expected_errors is None


def test_bases_are_orthonormal_in_the_mass_of_their_operator(bumpy):
    basis = chladni.eigenbasis(bumpy, k=12, operator="voronoi", tol=1e-8)
    _, M = chladni.laplacian(bumpy, operator="voronoi")
    np.testing.assert_array_equal(M.diagonal(), basis.mass)
    np.testing.assert_allclose(basis.vectors.T @ (M @ basis.vectors), np.eye(12), atol=1e-10)
    assert basis.residuals.max() <= 1e-8


def test_matrices_have_the_signs_of_a_drop_in(bumpy):
    L, M = chladni.laplacian(bumpy)
    assert L.format == "csr" and L.dtype == np.float64 and M.format == "csr"
    assert abs(L - L.T).max() == 0.0 and abs(L.sum(axis=1)).max() < 1e-10
    assert M.diagonal().min() > 0.0 and M.nnz == len(bumpy)
    rayleigh = [f @ (L @ f) for f in np.random.default_rng(1).normal(size=(5, len(bumpy)))]
    assert min(rayleigh) > 0.0


def test_pairs_solve_the_pencil_of_the_matrices(bumpy):
    evals, H = chladni.eigenbasis(bumpy, k=10, operator="voronoi", tol=1e-10)
    L, M = chladni.laplacian(bumpy, operator="voronoi")
    rest = L @ H - (M @ H) * evals
    assert np.abs(rest).max() < 1e-7


def test_any_dtype_and_layout_gives_the_same_bits(bumpy):
    single = bumpy.astype(np.float32)
    expected = chladni.eigenbasis(single.astype(np.float64), k=5).vectors
    for points in (single, np.asfortranarray(single), single[:, :].tolist(), np.repeat(single, 2, axis=0)[::2]):
        np.testing.assert_array_equal(chladni.eigenbasis(points, k=5).vectors, expected)


def test_threads_do_not_change_the_bits(bumpy):
    one, two = (chladni.eigenbasis(bumpy, k=8, threads=threads).vectors for threads in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_meshes_take_their_faces():
    # an octahedron, refined four times
    vertices = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    points = [np.array(vertex, dtype=float) for vertex in vertices]
    faces = [(a, b, c) for a in (0, 1) for b in (2, 3) for c in (4, 5)]
    for _ in range(4):
        middle = {}

        def between(i, j):
            key = (min(i, j), max(i, j))
            if key not in middle:
                point = points[i] + points[j]
                middle[key] = len(points)
                points.append(point / np.linalg.norm(point))
            return middle[key]

        faces = [
            face
            for a, b, c in faces
            for ab, bc, ca in [(between(a, b), between(b, c), between(c, a))]
            for face in [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        ]
    evals, _ = chladni.eigenbasis(np.array(points), k=4, operator="cotangent", faces=faces)
    np.testing.assert_allclose(evals, [0, 2, 2, 2], atol=0.01)
    with pytest.raises(ValueError, match="needs the faces of a mesh"):
        chladni.eigenbasis(np.array(points), k=4, operator="cotangent")


def test_dropped_rows_carry_no_result(sphere):
    broken = sphere.copy()
    broken[7, 1] = np.nan
    basis = chladni.eigenbasis(broken, k=4, nonfinite="drop")
    assert np.isnan(basis.vectors[7]).all() and np.isnan(basis.mass[7])
    assert np.isfinite(np.delete(basis.vectors, 7, axis=0)).all()
    L, M = chladni.laplacian(broken, nonfinite="drop")
    assert M[7, 7] == 0.0 and L[7].nnz == 0


def test_progress_is_told_and_an_exception_in_it_ends_the_computation(sphere):
    told: list[tuple[float, str]] = []
    points = chladni.sample("sphere", 4_000)
    chladni.eigenbasis(points, k=30, progress=lambda share, phase: told.append((share, phase)))
    shares = [share for share, _ in told]
    assert shares == sorted(shares) and shares[-1] == 1.0

    class Enough(Exception):
        pass

    def stop(share: float, phase: str) -> None:
        raise Enough

    with pytest.raises(Enough):
        chladni.eigenbasis(points, k=30, progress=stop)
