"""Parameters of an analysis."""

from __future__ import annotations

from typing import TypedDict


class Parameters(TypedDict, total=False):
    """What `eigenbasis` and `laplacian` take beside their own arguments; what is absent follows from the cloud."""

    dimension: int
    """Intrinsic dimension of what the points sample: 1 for curves, 2 for surfaces (the default), 3 for volumes."""
    solved_points: int
    """Most points that the eigenproblem is solved on; of larger surfaces an evenly spread part is solved, and the bases
    are extended to all points."""
    t: float
    """Time of the heat kernel, in squared units of the cloud."""
    t_factor: float
    """The same as a multiple of the squared covering radius."""
    delta: float
    """Cut-off radius of the heat kernel, or length of a graph's edges, in units of the cloud."""
    delta_factor: float
    """The same as a multiple of √(2t); of the covering radius for graph operators."""
    epsilon: float
    """Covering radius of the sampling, in units of the cloud, instead of the estimate."""
    distance: str
    """Distance in the Gaussian of `pcd`: `ambient` or `projected`."""
    parameterization: str
    """How `pcd` chooses t, δ and its simplices: `covering-radius` or `nearest-ten`."""
    paper: bool
    """Exactly the operator of the PB-MHB paper: all switches below are off unless they are set."""
    isometric_cells: bool
    """Measure cells by true distances; on surfaces in the triangles around every point."""
    truncation_compensation: bool
    """Make up for the Gaussian's share beyond the cut-off."""
    sheet_aware: bool
    """Couple only neighbors on the same sheet of the surface."""
    surface_distances: bool
    """Measure distances in the kernel of `pb-mhb` along the surface; needs `isometric_cells`."""
    moment_calibration: bool
    """Scale the kernel of `pb-mhb` so that its second moment is right around every point."""
    local_bandwidth: bool
    """Let t and δ of `pb-mhb` follow the local spacing, with t their mean; needs `moment_calibration`."""
    heat_correction: bool
    """Report λ = −ln(1−tμ)/t beside the μ of the matrices."""
