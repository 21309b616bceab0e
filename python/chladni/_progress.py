"""How far a computation is: tqdm's bar, or a function of the caller."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, Union

Tell = Callable[[float, str], object]
Progress = Union[bool, Tell, None]
Result = TypeVar("Result")


def told(progress: Progress, work: Callable[[Tell | None], Result]) -> Result:
    """Do `work` with what it is to call; `True` draws tqdm's bar."""
    if progress is None or progress is False:
        return work(None)
    if callable(progress):
        return work(progress)
    if progress is not True:
        raise TypeError(f"progress must be True or a function of share and phase, not {progress!r}")
    try:
        from tqdm.auto import tqdm
    except ImportError as error:
        raise ImportError("progress=True needs tqdm: pip install 'chladni[progress]'") from error
    with tqdm(total=100, bar_format="{desc:>14} {percentage:3.0f}% |{bar}| {elapsed}") as bar:

        def tell(share: float, phase: str) -> None:
            bar.set_description_str(phase)
            bar.update(100.0 * share - bar.n)

        return work(tell)
