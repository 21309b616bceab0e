"""Point clouds: from arrays, from files, and back."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike, fspath
from typing import Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _chladni

Path = Union[str, "PathLike[str]"]

# The types of PLY by those of NumPy.
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
    """Points with fields and faces.

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
        """Take n × d coordinates, any dtype and layout; m × 3 corners; one array of n numbers per field.

        Rows with a coordinate that is not finite raise `ValueError`, or carry no result with `nonfinite="drop"`.
        """
        corners = None if faces is None else np.ascontiguousarray(_integers(faces))
        cloud = _chladni.Cloud.from_arrays(_matrix(points, "points"), corners, nonfinite)
        if fields:
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

    @property
    def points(self) -> NDArray[np.float64]:
        """Coordinates, n × d, in the units of the file."""
        return self._inner.points()

    @property
    def faces(self) -> NDArray[np.int64]:
        """Triangles as indices of points, m × 3; none for a cloud without faces."""
        return self._inner.faces()

    @property
    def fields(self) -> dict[str, NDArray[np.float64]]:
        """Every field's values, in the order of the file."""
        return {name: self._inner.field(i) for i, (name, _) in enumerate(self._inner.field_types())}

    @property
    def grids(self) -> list[tuple[float, float]] | None:
        """Scale and offset of x, y and z where the file holds scaled integers (LAS, LAZ)."""
        return self._inner.grids()

    def __repr__(self) -> str:
        """Name the size and the fields."""
        shape = self.points.shape
        names = ", ".join(name for name, _ in self._inner.field_types()) or "none"
        return f"Cloud({shape[0]} points in {shape[1]} dimensions, {len(self.faces)} faces, fields: {names})"


def read(
    path: Path,
    format: str | None = None,
    coordinates: int | None = None,
    scan: int | None = None,
    nonfinite: str = "reject",
) -> Cloud:
    """Read a cloud from PLY, OBJ, OFF, STL, XYZ, CSV, NPY, PCD, PTX, LAS, LAZ or E57, at full precision.

    `coordinates` is how many columns of a table are coordinates, `scan` which scan of an E57 or PTX
    file is read: all of them when nothing is said.

    >>> import tempfile, os
    >>> file = os.path.join(tempfile.mkdtemp(), "three.xyz")
    >>> _ = open(file, "w").write("0 0 0\\n1 0 0\\n0 1 0\\n")
    >>> read(file)
    Cloud(3 points in 3 dimensions, 0 faces, fields: none)
    """
    return Cloud._of(_chladni.Cloud.read(fspath(path), format, coordinates, scan, nonfinite))


def write(
    path: Path,
    points: Cloud | ArrayLike,
    faces: ArrayLike | None = None,
    fields: Mapping[str, ArrayLike] | None = None,
    format: str | None = None,
    ascii: bool = False,
) -> None:
    """Write a cloud, or arrays, in the format that the name ends with: PLY, OBJ, OFF, XYZ, CSV, NPY, LAS or LAZ.

    >>> import tempfile, os
    >>> file = os.path.join(tempfile.mkdtemp(), "two.ply")
    >>> write(file, [[0, 0, 0], [1, 2, 3]], fields={"t": [1.0, 2.0]})
    >>> read(file).fields["t"]
    array([1., 2.])
    """
    as_cloud(points, faces, fields)._inner.write(fspath(path), format, ascii)


def sample_sphere(points: int, radius: float = 1.0) -> NDArray[np.float64]:
    """Give evenly spread points on a sphere (a Fibonacci lattice), n × 3: something to try things with.

    >>> sample_sphere(100).shape
    (100, 3)
    """
    i = np.arange(points) + 0.5
    z = 1.0 - 2.0 * i / points
    angle = i * np.pi * (3.0 - np.sqrt(5.0))
    r = np.sqrt(1.0 - z * z)
    return np.ascontiguousarray(radius * np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1))


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


def _matrix(values: ArrayLike, name: str) -> NDArray[np.float64]:
    array = np.asarray(values)
    if array.ndim != 2:
        raise ValueError(f"{name} have the shape (n, d), not {array.shape}")
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{name} are numbers, not {array.dtype}")
    return np.ascontiguousarray(array, dtype=np.float64)


def _integers(faces: ArrayLike) -> NDArray[np.int64]:
    array = np.asarray(faces)
    if array.ndim != 2 or array.dtype.kind not in "iu":
        raise ValueError(f"faces are integers of the shape (m, 3), not {array.dtype} of {array.shape}")
    return array.astype(np.int64)


def _field(name: str, values: ArrayLike) -> tuple[str, str, NDArray[np.float64]]:
    array = np.asarray(values)
    if array.ndim != 1 or array.dtype.kind not in "fiub":
        raise ValueError(f"field `{name}` is one number per point, not {array.dtype} of {array.shape}")
    kind = _KINDS.get(array.dtype.str[1:], "float64")
    return name, kind, np.ascontiguousarray(array, dtype=np.float64)
