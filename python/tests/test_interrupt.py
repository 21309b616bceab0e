"""Ctrl-C in the middle of a computation."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

SCRIPT = """
import chladni
print("begin", flush=True)
chladni.eigenbasis(chladni.sample("sphere", 40_000), k=300, progress=lambda share, phase: print(phase, flush=True))
"""


def test_an_interrupt_ends_the_computation_within_a_second():
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    for line in process.stdout:
        if line.strip() == "eigenpairs":
            break
    process.send_signal(signal.SIGINT)
    begin = time.monotonic()
    _, errors = process.communicate(timeout=60)
    seconds = time.monotonic() - begin
    assert "KeyboardInterrupt" in errors, errors
    # a second, and what it takes to leave the interpreter on a busy machine
    assert seconds < 3.0, seconds
