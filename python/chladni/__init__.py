"""Laplace-Beltrami operators, spectra and manifold harmonics of point clouds.

>>> import chladni
>>> evals, evecs = chladni.eigenbasis(chladni.sample("sphere", 500), k=9)
>>> [round(float(value)) for value in evals[:4]]
[0, 2, 2, 2]
"""

from ._basis import Basis, eigenbasis, load
from ._chladni import NumericalError, __version__
from ._client import Bases, Client, Job, ServiceError
from ._cloud import Cloud, read, sample, write
from ._laplacian import laplacian
from ._parameters import Parameters

__all__ = [
    "Bases",
    "Basis",
    "Client",
    "Cloud",
    "Job",
    "NumericalError",
    "Parameters",
    "ServiceError",
    "__version__",
    "eigenbasis",
    "laplacian",
    "load",
    "read",
    "sample",
    "write",
]
