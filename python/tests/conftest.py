"""Clouds that the tests make, and the command line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import chladni


@pytest.fixture(scope="session")
def sphere() -> np.ndarray:
    return chladni.sample("sphere", 1200).points


@pytest.fixture(scope="session")
def bumpy() -> np.ndarray:
    """A closed surface without symmetries: every eigenvalue is simple."""
    x, y, z = chladni.sample("sphere", 1500).points.T
    radius = 1.0 + 0.15 * np.sin(2.3 * x + 0.4) * np.cos(1.7 * y) + 0.1 * z * x
    return np.ascontiguousarray((radius * np.stack([x, 1.2 * y, 0.9 * z])).T)


COMMAND = (sys.executable, "-m", "chladni._command_line")


def command(*arguments: str | float | Path) -> str:
    """What `chladni …` prints; it must succeed."""
    done = subprocess.run([*COMMAND, *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
