"""Eigenbases and what they are for."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _chladni
from ._analysis import Progress, analyze
from ._cloud import Cloud, as_cloud, read

Array = NDArray[np.float64]


def eigenbasis(
    points: Cloud | ArrayLike,
    k: int = 100,
    operator: str = "pb-mhb",
    tol: float = 1e-4,
    faces: ArrayLike | None = None,
    threads: int | None = None,
    nonfinite: str = "reject",
    progress: Progress = None,
    **parameters: Any,
) -> Basis:
    """Compute the `k` smallest eigenpairs of the operator, zero modes included.

    `tol` is the largest relative residual. The result does not depend on the number of threads; there is no seed.
    `progress` is `True` for tqdm's bar, or called with the share that is done and the name of the phase. Ctrl-C ends the
    computation with `KeyboardInterrupt`. `parameters` are those of the service (`dimension`, `t_factor`, `paper`, …).

    Raises `ValueError` for parameters and clouds that cannot be analysed, `NumericalError` when the solver fails.

    >>> import chladni
    >>> basis = chladni.eigenbasis(chladni.sample_sphere(500), k=9)
    >>> basis.vectors.shape, bool(basis.residuals.max() < 1e-4)
    ((500, 9), True)
    """
    cloud = as_cloud(points, faces, nonfinite=nonfinite)
    # the caller of `k` and `tol` is told of `k` and `tol`
    for name, value in (("bases", k), ("tolerance", tol)):
        if name in parameters:
            raise ValueError(f"parameter `{name}` is the argument `{'k' if name == 'bases' else 'tol'}`")
        parameters[name] = value
    report, mass, vectors, _ = analyze(cloud, "eigen", {"operator": operator, **parameters}, threads, progress)
    return Basis(cloud, report, mass, vectors)


class Basis:
    """Eigenpairs of an operator on a cloud: `evals, evecs = basis`.

    `basis.vectors.T @ (M @ basis.vectors)` is the identity, with the diagonal matrix M of `basis.mass`. Rows are those of
    the input: a point that repeats an earlier one has its values and mass 0; rows without a result are NaN.
    """

    eigenvalues: Array
    """λ, ascending, (k,), in 1/length²; NaN where a heat kernel says nothing about it."""
    vectors: Array
    """One basis per column, (n, k), C order, in 1/length on a surface."""
    mass: Array
    """Diagonal of M, (n,), in length² on a surface."""
    residuals: Array
    """Relative residual of every pair, (k,)."""
    report: dict[str, Any]
    """Everything that the analysis measured, as the service and the command line report it."""
    clusters: list[list[int]]
    """Ranges [first, last] of eigenvalues too close to tell their vectors apart."""

    def __init__(self, cloud: Cloud, report: str, mass: Array, vectors: Array) -> None:
        """Take what an analysis computed; `eigenbasis` and `load` do."""
        self.cloud = cloud
        self.report = json.loads(report)
        self.mass = mass
        self.vectors = vectors
        spectrum = self.report["spectrum"]
        self.eigenvalues = np.array([math.nan if x is None else x for x in spectrum["eigenvalues"]])
        self.residuals = np.array(spectrum["residuals"])
        self.clusters = spectrum["clusters"]
        self._text = report
        self._modes = _chladni.Modes(report)

    def __iter__(self) -> Iterator[Array]:
        """Unpack as eigenvalues and vectors."""
        return iter((self.eigenvalues, self.vectors))

    def __len__(self) -> int:
        """Give the number of eigenpairs k."""
        return len(self.eigenvalues)

    def __repr__(self) -> str:
        """Name the sizes and the operator."""
        n, k = self.vectors.shape
        return f"Basis({k} eigenpairs of {self.report['operator']} on {n} points)"

    def transform(self, f: ArrayLike) -> Array:
        """Give the coefficients of functions, (k,) or (k, m), of (n,) or (n, m) values: `Hᵀ M f`.

        >>> import chladni, numpy as np
        >>> points = chladni.sample_sphere(500)
        >>> basis = chladni.eigenbasis(points, k=9)
        >>> c = basis.transform(points[:, 2])
        >>> bool(np.allclose(basis.synthesize(c), points[:, 2], atol=0.02))
        True
        """
        values, flat = _columns(f)
        coefficients, _ = self._modes.transform(self.vectors, self.mass, values)
        return coefficients[:, 0] if flat else coefficients

    def synthesize(self, c: ArrayLike) -> Array:
        """Give the functions, (n,) or (n, m), that at most k coefficients stand for: `H c`."""
        values, flat = _columns(c)
        functions = self._modes.synthesize(self.vectors, values)
        return functions[:, 0] if flat else functions

    def filter(
        self,
        f: ArrayLike | None = None,
        kind: str = "low-pass",
        *,
        by: str = "mode",
        cutoff: float | None = None,
        from_: float | None = None,
        to: float | None = None,
        gain: float | None = None,
        time: float | None = None,
        taper: float = 0.0,
        outside: float | None = None,
        gains: Sequence[float] | None = None,
    ) -> Array:
        """Filter functions, or the cloud's coordinates where none are given.

        `kind` is low-pass, high-pass, band-pass, band-stop, enhance or heat; edges are numbers of modes, or with `by`
        frequencies or wavelengths. `gains` takes the place of all of these. The rest outside of the span of the bases
        is treated as the filter treats the highest frequencies, unless `outside` says otherwise.

        >>> import chladni
        >>> basis = chladni.eigenbasis(chladni.sample_sphere(500), k=25)
        >>> basis.filter(kind="low-pass", cutoff=16).shape
        (500, 3)
        """
        values, flat = _columns(self.cloud.points if f is None else f)
        if gains is None:
            chosen, rest = self._modes.transfer(kind, by, cutoff, from_, to, gain, time, taper, outside)
        else:
            chosen, rest = [float(gain) for gain in gains], 0.0 if outside is None else outside
        filtered = self._modes.filter(self.vectors, self.mass, values, chosen, rest)
        return filtered[:, 0] if flat else filtered

    def hks(self, times: ArrayLike | int = 16, scaled: bool = False) -> Array:
        """Give the heat kernel signature, (n, s), at times in length², or at so many spread over the spectrum.

        >>> import chladni
        >>> chladni.eigenbasis(chladni.sample_sphere(500), k=9).hks([0.1, 1.0]).shape
        (500, 2)
        """
        return self._signature("hks", times, scaled)

    def wks(self, energies: ArrayLike | int = 16) -> Array:
        """Give the wave kernel signature, (n, s), at energies ln λ, or at so many spread over the spectrum."""
        return self._signature("wks", energies, False)

    def _signature(self, kind: str, scales: ArrayLike | int, scaled: bool) -> Array:
        if isinstance(scales, int):
            return self._modes.signature(self.vectors, kind, None, scales, scaled)[0]
        given = [float(scale) for scale in np.atleast_1d(np.asarray(scales, dtype=np.float64))]
        return self._modes.signature(self.vectors, kind, given, len(given), scaled)[0]

    def distances(self, i: int, kind: str = "biharmonic", time: float | None = None) -> Array:
        """Give the distances, (n,), of all points from point `i`: biharmonic, or diffusion at a time.

        >>> import chladni
        >>> distances = chladni.eigenbasis(chladni.sample_sphere(500), k=25).distances(0)
        >>> float(distances[0]), int(distances.argmax()) > 450
        (0.0, True)
        """
        return self._modes.distances(self.vectors, i, kind, time)

    def features(
        self, modes: int | None = None, persistence: float = 0.1, radius: float | None = None
    ) -> list[dict[str, Any]]:
        """Find points where consecutive bases have extrema, most persistent first."""
        found = self._modes.features(self.cloud._inner, self.vectors, self.mass, modes, persistence, radius)
        return list(json.loads(found))

    def invariants(self) -> dict[str, Any]:
        """Read area, boundary length and Euler characteristic off the spectrum."""
        return dict(json.loads(self._modes.invariants()))

    def similarity(self, other: Basis, modes: int = 50, sized: bool = False) -> dict[str, Any]:
        """Compare two shapes by their spectra (ShapeDNA): `["distance"]` is 0 for equal ones.

        >>> import chladni
        >>> basis = chladni.eigenbasis(chladni.sample_sphere(500), k=9)
        >>> basis.similarity(basis)["distance"]
        0.0
        """
        return dict(json.loads(self._modes.similarity(other._modes, modes, sized)))

    def image(
        self,
        mode: int | None = None,
        *,
        values: ArrayLike | None = None,
        azimuth: float = -60.0,
        elevation: float = 20.0,
        up: str = "z",
        width: int = 800,
        height: int = 600,
        background: str = "white",
    ) -> bytes:
        """Draw the cloud, colored by a mode or by values of your own, as PNG.

        >>> import chladni
        >>> chladni.eigenbasis(chladni.sample_sphere(500), k=9).image(5)[:4]
        b'\\x89PNG'
        """
        if mode is not None:
            if not 0 <= mode < len(self):
                raise ValueError(f"mode {mode}: there are the modes 0 to {len(self) - 1}")
            values = self.vectors[:, mode]
        shown = None if values is None else np.ascontiguousarray(values, dtype=np.float64)
        return _chladni.Modes.image(
            self.cloud._inner, shown, azimuth, elevation, up, width, height, background
        )

    def _repr_png_(self) -> bytes:
        first = int(self.report["spectrum"]["components"])
        return self.image(min(first, len(self) - 1), width=480, height=360)

    def save(self, directory: str | Path) -> None:
        """Write the directory of results that the command line writes: `chladni filter DIRECTORY …` works on it.

        >>> import chladni, tempfile
        >>> basis = chladni.eigenbasis(chladni.sample_sphere(500), k=9)
        >>> folder = tempfile.mkdtemp()
        >>> basis.save(folder)
        >>> bool((chladni.load(folder).vectors == basis.vectors).all())
        True
        """
        folder = Path(directory)
        folder.mkdir(parents=True, exist_ok=True)
        for name, value in (("report.json", self.report), ("spectrum.json", self.report["spectrum"])):
            (folder / name).write_text(json.dumps(value, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        np.save(folder / "mass.npy", self.mass)
        np.save(folder / "bases.npy", np.asfortranarray(self.vectors))
        self.cloud._inner.write_bases(folder / "bases.ply", self.vectors)


def load(directory: str | Path) -> Basis:
    """Read a directory of results, of `Basis.save` or of `chladni analyze`."""
    folder = Path(directory)
    text = (folder / "report.json").read_text(encoding="utf-8")
    report = json.loads(text)
    if report.get("spectrum") is None:
        raise ValueError(f"{folder} holds an operator without bases; analyze the cloud with --kind eigen")
    vectors = np.ascontiguousarray(np.load(folder / "bases.npy"))
    mass = np.load(folder / "mass.npy")
    if vectors.shape != (report["rows"], len(report["spectrum"]["eigenvalues"])) or len(mass) != len(vectors):
        raise ValueError(f"{folder}: bases, masses and report are not of one analysis")
    with_bases = read(folder / "bases.ply", nonfinite="drop")
    own = with_bases._inner.field_types()[: -vectors.shape[1]]
    fields = [(name, kind, with_bases._inner.field(i)) for i, (name, kind) in enumerate(own)]
    return Basis(Cloud._of(with_bases._inner.with_fields(fields)), text, mass, vectors)


def _columns(values: ArrayLike) -> tuple[Array, bool]:
    array = np.asarray(values)
    if array.ndim not in (1, 2) or array.dtype.kind not in "fiub":
        raise ValueError(f"numbers of the shape (n,) or (n, m) are expected, not {array.dtype} of {array.shape}")
    flat = array.ndim == 1
    return np.ascontiguousarray(array[:, np.newaxis] if flat else array, dtype=np.float64), flat
