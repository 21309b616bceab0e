"""Point clouds: from arrays, from files, and back."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from os import PathLike, fspath
from typing import Any, TypeVar, Union

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from . import _chladni

Path = Union[str, "PathLike[str]"]
Array = NDArray[np.float64]
Scalar = TypeVar("Scalar", bound=np.generic)

# The types that files have, by those of NumPy; all others are written as doubles.
_KINDS = {
    "i1": "int8",
    "u1": "uint8",
    "i2": "int16",
    "u2": "uint16",
    "i4": "int32",
    "u4": "uint32",
    "f4": "float32",
}


class Cloud:
    """Points with fields and faces; it never changes, and its arrays are read-only.

    `points` are n × d coordinates (d from 1 to 8), of any dtype and layout; `faces` m × 3 indices of points; `fields` one
    array of n numbers per name. Rows with a coordinate that is not finite raise `ValueError`, or carry no result with
    `nonfinite="drop"`.

    >>> cloud = Cloud([[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces=[[0, 1, 2]], fields={"t": [1.0, 2.0, 3.0]})
    >>> cloud.points.shape, cloud.faces.shape, cloud.fields["t"]
    ((3, 3), (1, 3), array([1., 2., 3.]))
    """

    def __init__(
        self,
        points: ArrayLike,
        faces: ArrayLike | None = None,
        fields: Mapping[str, ArrayLike] | None = None,
        nonfinite: str = "reject",
    ) -> None:
        """Take the arrays; the class says what they are."""
        array = numbers(points, "points")
        if array.ndim != 2:
            raise ValueError(f"points must have the shape (n, d), not {array.shape}")
        corners = None if faces is None else _corners(faces)
        cloud = _chladni.Cloud.from_arrays(_doubles(array), _kind(array), corners, nonfinite)
        if fields is not None:
            cloud = cloud.with_fields([_field(name, values) for name, values in fields.items()])
        self._inner = cloud

    @classmethod
    def _of(cls, inner: _chladni.Cloud) -> Cloud:
        cloud = cls.__new__(cls)
        cloud._inner = inner
        return cloud

    def __len__(self) -> int:
        """Give the number of points n."""
        return len(self._inner)

    @cached_property
    def points(self) -> Array:
        """Coordinates, n × d, in the units of the file."""
        return _fixed(self._inner.points())

    @cached_property
    def faces(self) -> NDArray[np.int64]:
        """Triangles as indices of points, m × 3; none for a cloud without faces."""
        return _fixed(self._inner.faces())

    @cached_property
    def fields(self) -> dict[str, NDArray[Any]]:
        """Every field's values, in the order and the types of the file."""
        types = self._inner.field_types()
        return {name: _fixed(_typed(self._inner.field(i), kind)) for i, (name, kind) in enumerate(types)}

    @property
    def grids(self) -> list[tuple[float, float]] | None:
        """Scale and offset of x, y and z where the file holds scaled integers (LAS, LAZ)."""
        return self._inner.grids()

    @property
    def notes(self) -> list[str]:
        """What was left out of the file, and what was not taken word for word; a sentence each."""
        return self._inner.notes()

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Give the coordinates to NumPy: `np.asarray(cloud)` is `cloud.points`."""
        return np.array(self.points, dtype=dtype) if copy else np.asarray(self.points, dtype=dtype)

    def __repr__(self) -> str:
        """Name the size and the fields."""
        faces = len(self._inner.faces())
        names = ", ".join(name for name, _ in self._inner.field_types()) or "none"
        return f"Cloud({len(self)} points in {self._inner.dimension()} dimensions, {faces} faces, fields: {names})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle all of it, what a LAS file says beside its points included."""
        types = self._inner.field_types()
        fields = [(name, kind, self._inner.field(i)) for i, (name, kind) in enumerate(types)]
        return _unpickled, (self._inner.points(), self._inner.kind(), self._inner.faces(), fields, self._inner.origin())


def _unpickled(points: Array, kind: str, faces: NDArray[np.int64], fields: Any, origin: Any) -> Cloud:
    cloud = _chladni.Cloud.from_arrays(points, kind, faces, "drop").with_fields(fields)
    return Cloud._of(cloud.with_origin(*origin))


def read(
    path: Path,
    format: str | None = None,
    coordinates: int | None = None,
    scan: int | None = None,
    nonfinite: str = "reject",
) -> Cloud:
    """Read a cloud from PLY, OBJ, OFF, STL, XYZ, CSV, NPY, NPZ, PCD, PTX, LAS, LAZ or E57, packed or not, at full precision.

    `format` follows from the name or the bytes. `coordinates` is how many columns of a table are coordinates, `scan`
    which scan of an E57 or PTX file is read: all of them when nothing is said. Raises `ValueError` that names the line or
    the byte at fault, and `OSError` as `open` does.

    >>> import tempfile, os
    >>> file = os.path.join(tempfile.mkdtemp(), "three.xyz")
    >>> _ = open(file, "w").write("0 0 0\\n1 0 0\\n0 1 0\\n")
    >>> read(file)
    Cloud(3 points in 3 dimensions, 0 faces, fields: none)
    """
    reading = {"format": format, "coordinates": coordinates, "scan": scan, "nonfinite": nonfinite}
    return Cloud._of(_chladni.Cloud.read(fspath(path), reading))


def write(
    path: Path,
    points: Cloud | ArrayLike,
    faces: ArrayLike | None = None,
    fields: Mapping[str, ArrayLike] | None = None,
    format: str | None = None,
    ascii: bool = False,
) -> None:
    """Write a cloud, or arrays, in the format that the name ends with: PLY, OBJ, OFF, STL, XYZ, CSV, NPY, PCD, LAS or LAZ.

    Coordinates and fields keep their types where the format has them; `ascii` writes PLY as text. Raises `ValueError`
    for what the format cannot hold, and `OSError` as `open` does.

    >>> import tempfile, os
    >>> file = os.path.join(tempfile.mkdtemp(), "two.ply")
    >>> write(file, [[0, 0, 0], [1, 2, 3]], fields={"t": [1.0, 2.0]})
    >>> read(file).fields["t"]
    array([1., 2.])
    """
    as_cloud(points, faces, fields, "drop")._inner.write(fspath(path), format, ascii)


def sample(
    shape: str,
    points: int = 10_000,
    sampling: str = "uniform",
    noise: float = 0.0,
    seed: int = 0,
    angle: float = 0.0,
) -> Cloud:
    """Draw a shape with known geometry: something to try things with.

    `shape` is sphere, ellipsoid, bumpy-sphere, torus, cylinder, square, two-hole-torus, flat-torus-4 or flat-torus-6;
    `sampling` uniform, iid, nonuniform or grid (with faces); `noise` the standard deviation along every axis; `angle`
    the fold of the square in degrees. The same arguments give the same cloud, to the bit.

    >>> sample("torus", 100)
    Cloud(100 points in 3 dimensions, 0 faces, fields: none)
    """
    return Cloud._of(_chladni.sample(shape, points, sampling, noise, seed, angle))


def as_cloud(
    points: Cloud | ArrayLike,
    faces: ArrayLike | None = None,
    fields: Mapping[str, ArrayLike] | None = None,
    nonfinite: str = "reject",
) -> Cloud:
    """Take a cloud as it is, and arrays as a cloud."""
    if isinstance(points, Cloud):
        if faces is not None or fields is not None:
            raise ValueError("a Cloud has its own faces and fields; give arrays, or the cloud alone")
        return points
    return Cloud(points, faces, fields, nonfinite)


def numbers(values: ArrayLike, name: str) -> NDArray[Any]:
    """Take real numbers as an array."""
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise ValueError(f"{name} must be an array of numbers: {error}") from None
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{name} must be real numbers, not {array.dtype}")
    return array


def columns(values: ArrayLike, name: str, rows: int) -> tuple[Array, bool]:
    """Take (rows,) or (rows, m) numbers as (rows, m) doubles, and say whether they were flat."""
    array = numbers(values, name)
    if array.ndim not in (1, 2) or array.shape[0] != rows:
        raise ValueError(f"{name} must have the shape ({rows},) or ({rows}, m), not {array.shape}")
    flat = array.ndim == 1
    return _doubles(array[:, np.newaxis] if flat else array), flat


def _doubles(array: NDArray[Any]) -> Array:
    """Copy only what is not already an array of doubles, row by row."""
    return np.ascontiguousarray(array, dtype=np.float64)


def _kind(array: NDArray[Any]) -> str:
    return _KINDS.get(array.dtype.str[1:], "float64")


def _corners(faces: ArrayLike) -> NDArray[np.int64]:
    array = np.asarray(faces)
    if array.size == 0:
        return np.empty((0, 3), dtype=np.int64)
    if array.ndim != 2 or array.dtype.kind not in "iu":
        raise ValueError(f"faces must be integers of the shape (m, 3), not {array.dtype} of {array.shape}")
    return np.ascontiguousarray(array, dtype=np.int64)


def _field(name: str, values: ArrayLike) -> tuple[str, str, Array]:
    array = numbers(values, f"field `{name}`")
    if array.ndim != 1:
        raise ValueError(f"field `{name}` must be one number per point, not of the shape {array.shape}")
    return name, _kind(array), _doubles(array)


def _typed(values: Array, kind: str) -> NDArray[Any]:
    """Give the values in their own type, if that holds them: a row without a value is NaN, which no integer is."""
    with np.errstate(invalid="ignore"):
        typed = values.astype(kind)
    return typed if np.array_equal(typed, values, equal_nan=kind.startswith("float")) else values


def _fixed(array: NDArray[Scalar]) -> NDArray[Scalar]:
    array.setflags(write=False)
    return array
