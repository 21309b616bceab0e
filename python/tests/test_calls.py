"""Wrong calls: the exception is Python's usual one, and says what is wrong and what would be accepted."""

from __future__ import annotations

import numpy as np
import pytest

import chladni


def with_nan(points: np.ndarray) -> np.ndarray:
    points = points.copy()
    points[7, 1] = np.nan
    return points


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda p: chladni.eigenbasis(p[:, 0]), ValueError, r"shape \(n, d\), not \(1200,\)"),
        (lambda p: chladni.eigenbasis(p[None]), ValueError, r"shape \(n, d\)"),
        (lambda p: chladni.eigenbasis(with_nan(p)), ValueError, "point 7"),
        (lambda p: chladni.eigenbasis(p[:3]), ValueError, "points"),
        (lambda p: chladni.eigenbasis(np.empty((0, 3))), ValueError, "no points"),
        (lambda p: chladni.eigenbasis([]), ValueError, r"shape \(n, d\)"),
        (lambda p: chladni.eigenbasis(np.empty((5, 0))), ValueError, "1 to 8 are supported"),
        (lambda p: chladni.eigenbasis(np.zeros((50, 9))), ValueError, "1 to 8 are supported"),
        (lambda p: chladni.eigenbasis([[1.0, 2.0], [3.0]]), ValueError, "points must be an array of numbers"),
        (lambda p: chladni.eigenbasis(np.array([["a", "b"]])), ValueError, "real numbers"),
        (lambda p: chladni.eigenbasis(p + 0j), ValueError, "real numbers, not complex128"),
        (lambda p: chladni.eigenbasis(None), ValueError, "real numbers"),
        (lambda p: chladni.eigenbasis(p, k=0), ValueError, "k must be a whole number from 1"),
        (lambda p: chladni.eigenbasis(p, k=2000), ValueError, "`k`"),
        (lambda p: chladni.eigenbasis(p, k=-3), ValueError, "k must be"),
        (lambda p: chladni.eigenbasis(p, k=2.5), ValueError, "k must be a whole number"),
        (lambda p: chladni.eigenbasis(p, k="many"), ValueError, "k must be a whole number.*many"),
        (lambda p: chladni.eigenbasis(p, tol=0.9), ValueError, "tol must be"),
        (lambda p: chladni.eigenbasis(p, tol=float("nan")), ValueError, "tol must be"),
        (lambda p: chladni.eigenbasis(p, operator="vornoi"), ValueError, "did you mean `voronoi`"),
        (lambda p: chladni.eigenbasis(p, operator="pb_mhb"), ValueError, "did you mean `pb-mhb`"),
        (lambda p: chladni.eigenbasis(p, operator="cotangent"), ValueError, "needs the faces of a mesh"),
        (lambda p: chladni.eigenbasis(p, t_facto=2.0), TypeError, "Did you mean 't_factor'"),
        (lambda p: chladni.eigenbasis(p, bases=5), TypeError, "Did you mean 'k'"),
        (lambda p: chladni.eigenbasis(p, tolerance=5), TypeError, "Did you mean 'tol'"),
        (lambda p: chladni.laplacian(p, zebra=5), TypeError, "unexpected keyword argument 'zebra'$"),
        (lambda p: chladni.eigenbasis(p, t="long"), ValueError, "t must be a number.*long"),
        (lambda p: chladni.eigenbasis(p, t=-1.0), ValueError, "t must be a number above 0"),
        (lambda p: chladni.eigenbasis(p, t=[1.0]), ValueError, "t must be a number above 0"),
        (lambda p: chladni.eigenbasis(p, dimension=7), ValueError, "dimension must be"),
        (lambda p: chladni.eigenbasis(p, paper="yes"), ValueError, "paper must be true or false"),
        (lambda p: chladni.eigenbasis(p, operator="pcd", distance="ambint"), ValueError, "did you mean `ambient`"),
        (lambda p: chladni.eigenbasis(p, nonfinite="keep"), ValueError, "reject, drop"),
        (lambda p: chladni.eigenbasis(p, threads=-1), ValueError, "threads"),
        (lambda p: chladni.eigenbasis(p, progress=5), TypeError, "progress"),
        (lambda p: chladni.laplacian(p, faces=[[0, 1, 5000]]), ValueError, "5000"),
        (lambda p: chladni.laplacian(p, faces=[[0, 1, -1]]), ValueError, "-1"),
        (lambda p: chladni.laplacian(p, faces=[[0, 1, 2, 3]]), ValueError, r"shape \(m, 3\)"),
        (lambda p: chladni.laplacian(p, faces=[[0.5, 1, 2]]), ValueError, "integers"),
        (lambda p: chladni.laplacian(chladni.Cloud(p), faces=[[0, 1, 2]]), ValueError, "its own faces"),
        (lambda p: chladni.Cloud(p, fields={"t": [1.0]}), ValueError, "`t`"),
        (lambda p: chladni.Cloud(p, fields={"t": p}), ValueError, "field `t`"),
        (lambda p: chladni.sample("sphre", 100), ValueError, "did you mean `sphere`"),
        (lambda p: chladni.sample("sphere", 0), ValueError, "points=0"),
        (lambda p: chladni.sample("sphere", 100, noise=-1.0), ValueError, "noise"),
    ],
)
def test_a_wrong_call_says_what_is_wrong(sphere, call, error, words):
    with pytest.raises(error, match=words):
        call(sphere)


def test_numbers_of_numpy_are_numbers(sphere):
    theirs = chladni.eigenbasis(sphere, k=np.int64(5), t_factor=np.float32(2.0), paper=np.bool_(True))
    ours = chladni.eigenbasis(sphere, k=5, t_factor=2.0, paper=True)
    np.testing.assert_array_equal(theirs.vectors, ours.vectors)
    assert len(ours) == 5


@pytest.fixture(scope="module")
def basis(sphere):
    return chladni.eigenbasis(sphere, k=12)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda b: b.transform(np.ones(7)), ValueError, r"\(1200,\) or \(1200, m\), not \(7,\)"),
        (lambda b: b.transform("z"), ValueError, "real numbers"),
        (lambda b: b.synthesize(np.ones(13)), ValueError, "j ≤ 12"),
        (lambda b: b.filter(cutoff=1e9), ValueError, "cutoff"),
        (lambda b: b.filter(kind="lowpass", cutoff=3), ValueError, "did you mean `low-pass`"),
        (lambda b: b.filter(by="wave-length", cutoff=3), ValueError, "did you mean `wavelength`"),
        (lambda b: b.filter(np.full(1200, np.nan), cutoff=3), ValueError, "not finite in row 0"),
        (lambda b: b.filter(gains=[1.0], cutoff=3), ValueError, "take the place"),
        (lambda b: b.filter(gains=[1.0] * 13), ValueError, "13 numbers; there are 12"),
        (lambda b: b.hks([-1.0]), ValueError, "above 0"),
        (lambda b: b.hks(0), ValueError, "from 1 to"),
        (lambda b: b.hks([[1.0]]), ValueError, r"shape \(s,\)"),
        (lambda b: b.distances(1200), IndexError, "there are 1200"),
        (lambda b: b.distances(0, kind="diffusing"), ValueError, "did you mean `diffusion`"),
        (lambda b: b.distances(0, kind="diffusion", time=0.0), ValueError, "above 0"),
        (lambda b: b.features(radius=-1.0), ValueError, "radius must be"),
        (lambda b: b.features(modes=1), ValueError, "modes must be"),
        (lambda b: b.image(12), ValueError, "from 0 to 11"),
        (lambda b: b.image(3, width=0), ValueError, "width must be"),
        (lambda b: b.image(3, up="w"), ValueError, "up must be one of x, y, z"),
        (lambda b: b.image(values=[1.0]), ValueError, r"shape \(1200,\)"),
    ],
)
def test_a_wrong_call_of_a_basis_says_what_is_wrong(basis, call, error, words):
    with pytest.raises(error, match=words):
        call(basis)
