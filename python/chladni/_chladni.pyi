from os import PathLike
from typing import Callable, final

import numpy as np
from numpy.typing import NDArray

__all__: list[str]
__version__: str

class NumericalError(RuntimeError): ...

@final
class Cloud:
    @staticmethod
    def from_arrays(
        points: NDArray[np.float64], kind: str, faces: NDArray[np.int64] | None, nonfinite: str
    ) -> Cloud: ...
    @staticmethod
    def read(
        path: str | PathLike[str],
        format: str | None,
        coordinates: int | None,
        scan: int | None,
        nonfinite: str,
    ) -> Cloud: ...
    def write(self, path: str | PathLike[str], format: str | None, ascii: bool) -> None: ...
    def to_ply(self) -> bytes: ...
    def write_bases(self, path: str | PathLike[str], vectors: NDArray[np.float64]) -> None: ...
    def with_fields(self, fields: list[tuple[str, str, NDArray[np.float64]]]) -> Cloud: ...
    def with_origin(
        self, continued: list[int], grids: list[tuple[float, float]] | None, origin: str
    ) -> Cloud: ...
    def origin(self) -> tuple[list[int], list[tuple[float, float]] | None, str]: ...
    def kind(self) -> str: ...
    def dimension(self) -> int: ...
    def points(self) -> NDArray[np.float64]: ...
    def faces(self) -> NDArray[np.int64]: ...
    def field_types(self) -> list[tuple[str, str]]: ...
    def field(self, place: int) -> NDArray[np.float64]: ...
    def grids(self) -> list[tuple[float, float]] | None: ...
    def notes(self) -> list[str]: ...
    def __len__(self) -> int: ...

@final
class Modes:
    def __new__(cls, report: str) -> Modes: ...
    @staticmethod
    def transform(
        vectors: NDArray[np.float64],
        mass: NDArray[np.float64],
        functions: NDArray[np.float64],
    ) -> NDArray[np.float64]: ...
    @staticmethod
    def synthesize(
        vectors: NDArray[np.float64], coefficients: NDArray[np.float64]
    ) -> NDArray[np.float64]: ...
    def transfer(
        self,
        kind: str,
        by: str,
        cutoff: float | None,
        from_: float | None,
        to: float | None,
        gain: float | None,
        time: float | None,
        taper: float,
        outside: float | None,
    ) -> tuple[list[float], float]: ...
    def filter(
        self,
        vectors: NDArray[np.float64],
        mass: NDArray[np.float64],
        functions: NDArray[np.float64],
        gains: list[float],
        outside: float,
    ) -> NDArray[np.float64]: ...
    def scales(self, kind: str, count: int) -> list[float]: ...
    def signature(
        self,
        vectors: NDArray[np.float64],
        kind: str,
        scales: list[float] | None,
        count: int,
        scaled: bool,
    ) -> NDArray[np.float64]: ...
    def distances(
        self, vectors: NDArray[np.float64], row: int, kind: str, time: float | None
    ) -> NDArray[np.float64]: ...
    def features(
        self,
        cloud: Cloud,
        vectors: NDArray[np.float64],
        mass: NDArray[np.float64],
        modes: int | None,
        persistence: float | None,
        radius: float | None,
    ) -> str: ...
    def invariants(self) -> str: ...
    def similarity(self, other: Modes, modes: int, sized: bool) -> str: ...

def draw(
    cloud: Cloud,
    values: NDArray[np.float64] | None,
    shown: tuple[int, float | None] | str,
    sight: dict[str, object],
) -> bytes: ...
def sample(
    shape: str, points: int, sampling: str, noise: float, seed: int, angle: float
) -> Cloud: ...
def analyze(
    cloud: Cloud,
    kind: str,
    parameters: str,
    threads: int,
    progress: Callable[[float, str], object] | None,
) -> tuple[
    str,
    NDArray[np.float64],
    NDArray[np.float64] | None,
    tuple[NDArray[np.uint64], NDArray[np.uint32], NDArray[np.float64]] | None,
]: ...
def run_command_line(arguments: list[str]) -> int: ...
