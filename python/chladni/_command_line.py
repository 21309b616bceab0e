"""The program `chladni`: the command line of the Rust project, `serve` included."""

from __future__ import annotations

import signal
import sys

from . import _chladni


def main() -> None:
    """Run the command that `sys.argv` names, and exit with its code."""
    # Commands handle signals themselves; Python's own handler would only note them. A signal that the process was
    # started to ignore stays ignored.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_chladni.run_command_line(["chladni", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
