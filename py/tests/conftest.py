"""Fixtures: the ogg command, and one recording of the built-in cell made with it."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def ogg() -> str:
    """The path of the ogg command."""
    program = os.environ.get("OGG_BIN") or shutil.which("ogg")
    assert program, "the ogg command is needed: set OGG_BIN or install the wheel"
    return program


@pytest.fixture(scope="session")
def builtin_run(ogg: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """Recording and summary of eight seconds of the built-in worker."""
    folder = tmp_path_factory.mktemp("run")
    summary = folder / "summary.json"
    command = [ogg, "follow", "run", "--duration", "8", "--record", str(folder), "--summary", str(summary)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    values = json.loads(summary.read_text())
    return Path(values["recording"]), values
