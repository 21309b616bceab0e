"""Ctrl-C in the middle of a computation."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

# A shell lets the commands in its background ignore SIGINT, and children inherit that.
SCRIPT = """
import signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)
import chladni
cloud = chladni.sample("bumpy-sphere", 60_000)
try:
    chladni.eigenbasis(cloud, k=400, operator="{operator}", progress=lambda share, phase: print(phase, flush=True))
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.parametrize("operator", ["pb-mhb", "voronoi"])
@pytest.mark.parametrize("phase", ["", "eigenpairs"], ids=["at once", "while it solves"])
def test_an_interrupt_ends_the_computation_within_a_second(operator, phase):
    call = [sys.executable, "-c", SCRIPT.format(operator=operator)]
    process = subprocess.Popen(call, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    phases = iter(process.stdout)
    assert any(line.startswith(phase) for line in phases)
    process.send_signal(signal.SIGINT)
    begin = time.monotonic()
    assert any(line.strip() == "interrupted" for line in phases)
    seconds = time.monotonic() - begin
    assert process.wait(timeout=30) == 0
    # within a second on a machine that has nothing else to do
    assert seconds < 3.0, seconds
    print(f"{operator}, {phase}: {seconds:.2f} s")
