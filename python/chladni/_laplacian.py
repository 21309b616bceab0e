"""The operator as sparse matrices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ._analysis import Progress, analyze
from ._cloud import Cloud, as_cloud

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


def laplacian(
    points: Cloud | ArrayLike,
    faces: ArrayLike | None = None,
    operator: str = "voronoi",
    threads: int | None = None,
    nonfinite: str = "reject",
    progress: Progress = None,
    **parameters: Any,
) -> tuple[csr_matrix, csr_matrix]:
    """Build the operator: stiffness `L`, positive semi-definite, and the diagonal mass `M`, both n × n CSR of float64.

    The order and the signs are those of `robust_laplacian`: `L f = λ M f`. On a surface M is in length² and λ in
    1/length². Rows that repeat an earlier point, or carry no result, are empty and have mass 0. `parameters` are those
    of the service (`dimension`, `t_factor`, `paper`, …).

    >>> import chladni
    >>> L, M = chladni.laplacian(chladni.sample_sphere(400))
    >>> L.shape, bool(abs(L.sum()) < 1e-9), round(float(M.sum()), 1)
    ((400, 400), True, 12.5)
    """
    from scipy.sparse import csr_matrix, diags

    cloud = as_cloud(points, faces, nonfinite=nonfinite)
    _, mass, _, matrix = analyze(cloud, "operator", {"operator": operator, **parameters}, threads, progress)
    offsets, columns, values = matrix
    n = len(mass)
    # SciPy's solvers want indices of one type, 32 bits where they fit
    small = len(values) <= np.iinfo(np.int32).max
    index = np.int32 if small else np.int64
    stiffness = csr_matrix((-values, columns.astype(index), offsets.astype(index)), shape=(n, n))
    return stiffness, csr_matrix(diags(np.nan_to_num(mass, nan=0.0), format="csr"))
