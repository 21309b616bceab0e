"""Eigenbases and what they are for."""

from __future__ import annotations

import json
import math
import operator as operators
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from . import _chladni
from ._analysis import analyze
from ._cloud import Array, Cloud, as_cloud, columns, numbers, read
from ._parameters import Parameters
from ._progress import Progress

if TYPE_CHECKING:
    from os import PathLike

    from typing_extensions import Unpack


def eigenbasis(
    points: Cloud | ArrayLike,
    k: int | None = None,
    operator: str = "pb-mhb",
    tol: float = 1e-4,
    faces: ArrayLike | None = None,
    threads: int | None = None,
    nonfinite: str = "reject",
    progress: Progress = None,
    **parameters: Unpack[Parameters],
) -> Basis:
    """Compute the k smallest eigenpairs of an operator, zero modes included: 100, or what a small cloud allows.

    `points` are n × d numbers of any dtype and layout, or a `Cloud`. `operator` is pb-mhb, voronoi, pcd, pcd-symmetrized,
    mesh, cotangent (these two need `faces`), weighted-graph, graph, kirchhoff or tutte. `tol` is the largest relative
    residual. `parameters` are those of `chladni.Parameters`. The result depends neither on a seed nor on the number of
    `threads`; by default there is one per processor.

    Rows with a coordinate that is not finite raise `ValueError`, or carry no result with `nonfinite="drop"`. `progress`
    is `True` for tqdm's bar, or called with the share that is done and the name of the phase. Other threads of Python go
    on meanwhile; Ctrl-C ends the computation with `KeyboardInterrupt`.

    Raises `ValueError` for parameters and clouds that cannot be analyzed, `NumericalError` when the solver fails.

    >>> import chladni
    >>> basis = chladni.eigenbasis(chladni.sample("sphere", 500), k=9)
    >>> basis.vectors.shape, bool(basis.residuals.max() < 1e-4)
    ((500, 9), True)
    """
    cloud = as_cloud(points, faces, nonfinite=nonfinite)
    for name, argument in (("bases", "k"), ("tolerance", "tol")):  # as the service calls them
        if name in parameters:
            raise TypeError(f"unexpected keyword argument '{name}'. Did you mean '{argument}'?")
    own = {"operator": operator, "bases": k, "tolerance": tol}
    report, mass, vectors, _ = analyze(cloud, "eigen", {**own, **parameters}, threads, progress)
    return Basis(cloud, report, mass, vectors)


class Basis:
    """Eigenpairs of an operator on a cloud: `evals, evecs = basis`.

    `basis.vectors.T @ (M @ basis.vectors)` is the identity, with the diagonal matrix M of `basis.mass`. Rows are those of
    the input: a point that repeats an earlier one has its values and mass 0; rows without a result are NaN.
    """

    cloud: Cloud
    """The cloud that was analyzed."""
    eigenvalues: Array
    """λ, ascending, (k,), in 1/length²; NaN where a heat kernel says nothing about it."""
    vectors: Array
    """One basis per column, (n, k), C order, in 1/length on a surface."""
    mass: Array
    """Diagonal of M, (n,), in length² on a surface."""
    residuals: Array
    """Relative residual of every pair, (k,)."""
    dual_residuals: Array | None
    """Bound ρ of every pair, (k,): some eigenvalue λ of the matrices has |λ − μ| ≤ ρ (λ + σ); None without symmetry."""
    expected_errors: Array | None
    """Relative error of every eigenvalue to expect of the sampling, (k,), an estimate; None where there is none."""
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
        self.dual_residuals, self.expected_errors = (
            None if spectrum.get(name) is None else np.array(spectrum[name])
            for name in ("dual_residuals", "expected_errors")
        )
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

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the cloud, the report and the arrays."""
        return Basis, (self.cloud, self._text, self.mass, self.vectors)

    def transform(self, f: ArrayLike) -> Array:
        """Give the coefficients `Hᵀ M f`, (k,) or (k, m), of functions, (n,) or (n, m).

        >>> import chladni, numpy as np
        >>> cloud = chladni.sample("sphere", 500)
        >>> basis = chladni.eigenbasis(cloud, k=9)
        >>> c = basis.transform(cloud.points[:, 2])
        >>> bool(np.allclose(basis.synthesize(c), cloud.points[:, 2], atol=0.02))
        True
        """
        values, flat = columns(f, "f", len(self.vectors))
        coefficients = self._modes.transform(self.vectors, self.mass, values)
        return coefficients[:, 0] if flat else coefficients

    def synthesize(self, c: ArrayLike) -> Array:
        """Give the functions `H c`, (n,) or (n, m), that coefficients, (j,) or (j, m) with j ≤ k, stand for.

        >>> import chladni
        >>> basis = chladni.eigenbasis(chladni.sample("sphere", 500), k=9)
        >>> bool((basis.synthesize([0.0, 0.0, 1.0]) == basis.vectors[:, 2]).all())
        True
        """
        array = numbers(c, "c")
        if array.ndim not in (1, 2) or len(array) > len(self):
            raise ValueError(f"c must have the shape (j,) or (j, m), j ≤ {len(self)}, not {array.shape}")
        values, flat = columns(array, "c", len(array))
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
        gains: Sequence[float] | Array | None = None,
    ) -> Array:
        """Filter functions, (n,) or (n, m), or the cloud's coordinates where none are given.

        `kind` is low-pass, high-pass, band-pass, band-stop, enhance or heat; edges are numbers of modes, or with `by`
        frequencies (√λ) or wavelengths (2π/√λ, in units of the cloud). `gains`, one factor per mode, takes the place of
        all of these. What lies outside of the span of the bases is treated as the filter treats the highest frequencies,
        unless `outside` says otherwise.

        >>> import chladni
        >>> basis = chladni.eigenbasis(chladni.sample("sphere", 500), k=25)
        >>> basis.filter(kind="low-pass", cutoff=16).shape
        (500, 3)
        """
        values, flat = columns(self.cloud.points if f is None else f, "f", len(self.vectors))
        if gains is None:
            edges = {"cutoff": cutoff, "from": from_, "to": to, "gain": gain, "time": time}
            chosen, rest = self._modes.transfer({"kind": kind, "by": by, **edges, "taper": taper, "outside": outside})
        elif kind != "low-pass" or any(edge is not None for edge in (cutoff, from_, to, gain, time)):
            raise ValueError("gains take the place of a filter: leave kind and its edges out")
        else:
            chosen, rest = [float(gain) for gain in gains], 0.0 if outside is None else outside
        filtered = self._modes.filter(self.vectors, self.mass, values, chosen, rest)
        return filtered[:, 0] if flat else filtered

    def hks(self, times: ArrayLike | int = 16, scaled: bool = False) -> Array:
        """Give the heat kernel signature, (n, s), at times in length², or at a number of them spread over the spectrum.

        `scaled` divides every column by its integral over the surface.

        >>> import chladni
        >>> chladni.eigenbasis(chladni.sample("sphere", 500), k=9).hks([0.1, 1.0]).shape
        (500, 2)
        """
        return self._signature("hks", times, scaled)

    def wks(self, energies: ArrayLike | int = 16) -> Array:
        """Give the wave kernel signature, (n, s), at energies ln λ, or at a number of them spread over the spectrum.

        >>> import chladni
        >>> chladni.eigenbasis(chladni.sample("sphere", 500), k=9).wks(5).shape
        (500, 5)
        """
        return self._signature("wks", energies, False)

    def scales(self, kind: str = "hks", count: int = 16) -> Array:
        """Give the times that `hks`, or the energies that `wks`, takes when it is called with a number of scales.

        >>> import chladni
        >>> basis = chladni.eigenbasis(chladni.sample("sphere", 500), k=9)
        >>> bool((basis.hks(basis.scales("hks", 5)) == basis.hks(5)).all())
        True
        """
        return np.array(self._modes.scales({"kind": kind, "count": count}))

    def _signature(self, kind: str, scales: ArrayLike | int, scaled: bool) -> Array:
        given = numbers(scales, "times" if kind == "hks" else "energies")
        if given.ndim == 0 and given.dtype.kind in "iu":
            request = {"kind": kind, "count": int(given), "scaled": scaled}
            return self._modes.signature(self.vectors, request, None)
        if given.ndim > 1:
            raise ValueError(f"scales must have the shape (s,), not {given.shape}")
        wanted = [float(scale) for scale in np.atleast_1d(given)]
        return self._modes.signature(self.vectors, {"kind": kind, "scaled": scaled}, wanted)

    def distances(self, i: int, kind: str = "biharmonic", time: float | None = None) -> Array:
        """Give the distances, (n,), of all points from point `i`: biharmonic, or diffusion at a time in length².

        >>> import chladni
        >>> distances = chladni.eigenbasis(chladni.sample("sphere", 500), k=25).distances(0)
        >>> float(distances[0]), int(distances.argmax()) > 450
        (0.0, True)
        """
        rows = len(self.vectors)
        row = operators.index(i)
        if not -rows <= row < rows:
            raise IndexError(f"point {row}: there are {rows}")
        return self._modes.distances(self.vectors, {"from": row % rows, "kind": kind, "time": time})

    def features(
        self,
        modes: int | None = None,
        persistence: float | None = None,
        radius: float | None = None,
        limit: int | None = None,
    ) -> list[dict[str, Any]]:
        """Find points where consecutive bases have extrema, most persistent first.

        Each has `index`, `position`, `pairs` of modes and `persistence`. `modes` is how many modes are looked at,
        `persistence` the least of an extremum, 0.1 by default, `radius` that of the neighborhoods, twice the covering
        radius by default, `limit` how many are given.

        >>> import chladni
        >>> found = chladni.eigenbasis(chladni.sample("bumpy-sphere", 1000), k=25).features()
        >>> sorted(found[0])
        ['index', 'pairs', 'persistence', 'position']
        """
        request = {"modes": modes, "persistence": persistence, "radius": radius, "limit": limit}
        found = self._modes.features(self.cloud._inner, self.vectors, self.mass, request)
        return list(json.loads(found))

    def invariants(self) -> dict[str, Any]:
        """Read area, boundary length and Euler characteristic off the spectrum of a surface.

        >>> import chladni
        >>> chladni.eigenbasis(chladni.sample("sphere", 1000)).invariants()["euler_characteristic_rounded"]
        2
        """
        return dict(json.loads(self._modes.invariants()))

    def similarity(self, other: Basis, modes: int = 50, sized: bool = False) -> dict[str, Any]:
        """Compare two shapes by their spectra (ShapeDNA): `["distance"]` is 0 for equal ones.

        At most `modes` eigenvalues above 0 are compared; `sized` distinguishes two sizes of one shape.

        >>> import chladni
        >>> basis = chladni.eigenbasis(chladni.sample("sphere", 500), k=9)
        >>> basis.similarity(basis)["distance"]
        0.0
        """
        return dict(json.loads(self._modes.similarity(other._modes, {"modes": modes, "sized": sized})))

    def image(
        self,
        mode: int | None = None,
        *,
        values: ArrayLike | None = None,
        title: str = "",
        azimuth: float | None = None,
        elevation: float | None = None,
        up: str | None = None,
        width: int | None = None,
        height: int | None = None,
        background: str | None = None,
        legend: bool = False,
    ) -> bytes:
        """Draw the cloud as PNG, colored by a mode, by `values` of your own (n,), or not at all.

        Angles are in degrees, `up` is x, y or z, `background` white, black or transparent; what is absent is as the
        command line has it. `legend` adds a color bar, of `values` under a `title`.

        >>> import chladni
        >>> chladni.eigenbasis(chladni.sample("sphere", 500), k=9).image(5)[:4]
        b'\\x89PNG'
        """
        shown: tuple[int, float | None] | str = title
        painted: Array | None = None
        if mode is not None:
            if values is not None:
                raise ValueError("a mode or values color a cloud, not both")
            if not 0 <= operators.index(mode) < len(self):
                raise ValueError(f"mode must be from 0 to {len(self) - 1}, not {mode}")
            eigenvalue = float(self.eigenvalues[mode])
            shown = (operators.index(mode), None if math.isnan(eigenvalue) else eigenvalue)
            painted = np.ascontiguousarray(self.vectors[:, mode])
        elif values is not None:
            painted = np.ascontiguousarray(numbers(values, "values"), dtype=np.float64)
            if painted.shape != self.mass.shape:
                raise ValueError(f"values must have the shape {self.mass.shape}, not {painted.shape}")
        view: dict[str, object] = {"azimuth": azimuth, "elevation": elevation, "up": up, "width": width}
        view |= {"height": height, "background": background, "legend": legend}
        return _chladni.draw(self.cloud._inner, painted, shown, view)

    def _repr_png_(self) -> bytes:
        first = int(self.report["spectrum"]["components"])
        return self.image(min(first, len(self) - 1), width=480, height=360)

    def save(self, directory: str | PathLike[str]) -> None:
        """Write the directory of results that the command line writes: `chladni filter DIRECTORY …` works on it.

        >>> import chladni, tempfile
        >>> basis = chladni.eigenbasis(chladni.sample("sphere", 500), k=9)
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


def load(directory: str | PathLike[str]) -> Basis:
    """Read a directory of results, of `Basis.save` or of `chladni analyze`.

    Raises `ValueError` when the directory holds no bases, or files of different analyses, and `OSError` as `open` does.

    >>> import chladni, tempfile
    >>> folder = tempfile.mkdtemp()
    >>> chladni.eigenbasis(chladni.sample("sphere", 500), k=9).save(folder)
    >>> load(folder)
    Basis(9 eigenpairs of pb-mhb on 500 points)
    """
    folder = Path(directory)
    text = (folder / "report.json").read_text(encoding="utf-8")
    report = json.loads(text)
    if report.get("spectrum") is None:
        raise ValueError(f"{folder} holds an operator without bases; analyze the cloud with --kind eigen")
    vectors = np.ascontiguousarray(np.load(folder / "bases.npy"))
    mass = np.load(folder / "mass.npy")
    if vectors.shape != (report["rows"], len(report["spectrum"]["eigenvalues"])) or len(mass) != len(vectors):
        raise ValueError(f"{folder}: bases, masses and report are not of one analysis")
    inner = read(folder / "bases.ply", nonfinite="drop")._inner
    dimension = int(report["ambient_dimension"])
    if dimension < inner.dimension():  # PLY has three coordinates at least
        points = np.ascontiguousarray(inner.points()[:, :dimension])
        flat = _chladni.Cloud.from_arrays(points, inner.kind(), inner.faces(), "drop")
    else:
        flat = inner
    own = inner.field_types()[: -vectors.shape[1]]
    fields = [(name, kind, inner.field(i)) for i, (name, kind) in enumerate(own)]
    return Basis(Cloud._of(flat.with_fields(fields)), text, mass, vectors)
