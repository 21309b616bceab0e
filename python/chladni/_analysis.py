"""The call into Rust that `laplacian` and `eigenbasis` share."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from . import _chladni
from ._cloud import Cloud
from ._progress import Progress, told


def analyze(cloud: Cloud, kind: str, parameters: dict[str, object], threads: int | None, progress: Progress) -> Any:
    """Analyze; Ctrl-C ends the computation at its next checkpoint."""
    workers = 0 if threads is None else operator.index(threads)
    if workers < 0:
        raise ValueError(f"threads must be a number from 0 (one per processor), not {threads}")

    def call(tell: Callable[[float, str], object] | None) -> Any:
        return _chladni.analyze(cloud._inner, kind, parameters, workers, tell)

    return told(progress, call)
