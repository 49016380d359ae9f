"""The `ogg` command of the wheel: the native module holds all of it."""

from __future__ import annotations

import sys

from . import _native


def main() -> None:
    """Runs `ogg` with the arguments of this process and ends with its exit code. Ctrl-C is the command's to handle."""
    sys.exit(_native.main(["ogg", *sys.argv[1:]]))
