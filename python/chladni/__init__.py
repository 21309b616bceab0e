"""Laplace-Beltrami operators, spectra and manifold harmonics of point clouds.

>>> import chladni
>>> points = chladni.sample_sphere(500)
>>> evals, evecs = chladni.eigenbasis(points, k=9)
>>> [round(float(value)) for value in evals[:4]]
[0, 2, 2, 2]
"""

from ._basis import Basis, eigenbasis, load
from ._chladni import NumericalError, __version__
from ._client import Bases, Client, Job, ServiceError
from ._cloud import Cloud, read, sample_sphere, write
from ._laplacian import laplacian

__all__ = [
    "Bases",
    "Basis",
    "Client",
    "Cloud",
    "Job",
    "NumericalError",
    "ServiceError",
    "__version__",
    "eigenbasis",
    "laplacian",
    "load",
    "read",
    "sample_sphere",
    "write",
]
