"""The call into Rust that `laplacian` and `eigenbasis` share."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, Union

from . import _chladni
from ._cloud import Cloud

Progress = Union[bool, Callable[[float, str], object], None]


def analyze(cloud: Cloud, kind: str, parameters: dict[str, Any], threads: int | None, progress: Progress) -> Any:
    """Analyse; Ctrl-C ends the computation at its next checkpoint."""
    text = json.dumps({name: value for name, value in parameters.items() if value is not None})
    call = (cloud._inner, kind, text, threads or 0)
    if progress is True:
        return _with_bar(*call)
    return _chladni.analyze(*call, progress if callable(progress) else None)


def _with_bar(cloud: _chladni.Cloud, kind: str, text: str, threads: int) -> Any:
    try:
        from tqdm.auto import tqdm
    except ImportError as error:
        raise ImportError("progress=True needs tqdm: pip install 'chladni[progress]'") from error
    with tqdm(total=100, unit="%", bar_format="{desc:>14} {percentage:3.0f}% |{bar}| {elapsed}") as bar:

        def told(share: float, phase: str) -> None:
            bar.set_description(phase)
            bar.update(100.0 * share - bar.n)

        result = _chladni.analyze(cloud, kind, text, threads, told)
        bar.update(100.0 - bar.n)
        return result
