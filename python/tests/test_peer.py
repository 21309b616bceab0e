"""Beside robust_laplacian on the same cloud: the same spectrum, within what both discretizations leave."""

from __future__ import annotations

import numpy as np
import pytest

import chladni

robust_laplacian = pytest.importorskip("robust_laplacian", reason="robust_laplacian is not installed")


def test_both_operators_have_the_spectrum_of_the_sphere(sphere):
    from scipy.sparse.linalg import eigsh

    exact = np.repeat([2.0, 6.0, 12.0], [3, 5, 7])

    def spectrum(L, M):
        return np.sort(eigsh(L.tocsc(), k=16, M=M.tocsc(), sigma=-0.1, return_eigenvectors=False))

    theirs = spectrum(*robust_laplacian.point_cloud_laplacian(sphere))
    ours = spectrum(*chladni.laplacian(sphere))
    error = [np.abs(values[1:] / exact - 1.0).max() for values in (ours, theirs)]
    assert error[0] < 0.02 and error[0] <= error[1], error
    found = chladni.eigenbasis(sphere, k=16, operator="voronoi", tol=1e-8).report["spectrum"]["raw_eigenvalues"]
    np.testing.assert_allclose(ours[1:], found[1:], rtol=1e-8)

