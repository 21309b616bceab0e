"""The program that the wheel installs is the command line of the project."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from importlib.metadata import entry_points, version

import numpy as np
from conftest import COMMAND, command

import chladni
from chladni import _command_line


def test_the_wheel_installs_the_program_under_its_name():
    (script,) = entry_points(group="console_scripts", name="chladni")
    assert script.load() is _command_line.main
    assert command("--version") == f"chladni {chladni.__version__}\n"
    assert version("chladni") == chladni.__version__


def test_a_wrong_call_exits_with_2_and_says_why(tmp_path):
    done = subprocess.run([*COMMAND, "analyze", tmp_path / "absent.ply", "-o", tmp_path / "out"], capture_output=True)
    assert done.returncode == 2 and b"absent.ply" in done.stderr


def test_standard_output_is_whole(bumpy, tmp_path):
    """Rust's own buffer is written out although Python ends the process."""
    np.save(tmp_path / "cloud.npy", bumpy)
    call = [*COMMAND, "render", tmp_path / "cloud.npy", "--width", "80", "--height", "60", "--output", "-"]
    png = subprocess.run(call, capture_output=True, check=True).stdout
    assert png.startswith(b"\x89PNG") and png.endswith(b"IEND\xaeB`\x82")


def test_ctrl_c_ends_a_command_as_it_ends_other_programs(tmp_path):
    chladni.write(tmp_path / "cloud.npy", chladni.sample("bumpy-sphere", 60_000))
    call = [*COMMAND, "analyze", tmp_path / "cloud.npy", "-k", "500", "-o", tmp_path / "out"]
    # a shell lets the commands in its background ignore SIGINT, and children inherit that
    heeded = "import os, signal, sys; signal.signal(signal.SIGINT, signal.SIG_DFL); os.execv(sys.argv[1], sys.argv[1:])"
    process = subprocess.Popen([sys.executable, "-c", heeded, *map(str, call)], stderr=subprocess.DEVNULL)
    time.sleep(3.0)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=30) == -signal.SIGINT
    assert not (tmp_path / "out").exists()
