"""The types are true: mypy in its strict mode, and the stub against the native module."""

import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pytest

import ogg_rs

SETTINGS = Path(__file__).parent.parent / "pyproject.toml"
INSTALLED = Path(ogg_rs.__file__).parent
CACHE = Path(tempfile.gettempdir()) / f"ogg-mypy-{sys.version_info.major}.{sys.version_info.minor}"

pytestmark = pytest.mark.skipif(find_spec("mypy") is None, reason="mypy is not installed")


def run(*arguments, cwd):
    command = [sys.executable, "-m", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=500, check=False, cwd=cwd)


def test_the_package_is_strictly_typed(tmp_path):
    # Beside no other package, which mypy would take for a part of it. Training is checked where PyTorch is.
    shutil.copytree(INSTALLED, tmp_path / "ogg_rs", ignore=shutil.ignore_patterns("train", "__pycache__", "*.so"))
    done = run("mypy", "--config-file", str(SETTINGS), "--cache-dir", str(CACHE), "ogg_rs", cwd=tmp_path)
    assert done.returncode == 0, done.stdout


def test_the_stub_says_what_the_native_module_has(tmp_path):
    done = run("mypy.stubtest", "ogg_rs._native", "--mypy-config-file", str(SETTINGS), cwd=tmp_path)
    assert done.returncode == 0, done.stdout


def test_a_caller_sees_the_types(tmp_path):
    (tmp_path / "caller.py").write_text(
        "import numpy as np\n"
        "import ogg_rs\n"
        "from ogg_rs import kin\n"
        "reveal_type(ogg_rs.GaussianMixture(2).fit(np.zeros((3, 1))).means_)\n"
        "reveal_type(kin.Robot.builtin().ik(np.eye(4)).reached)\n"
        "ogg_rs.GaussianMixture(2, 'full')\n"
    )
    done = run("mypy", "--strict", "--cache-dir", str(CACHE), "caller.py", cwd=tmp_path)
    lines = done.stdout.splitlines()
    assert "float64" in lines[0] and "bool" in lines[1], done.stdout
    assert "Too many positional arguments" in done.stdout and done.returncode == 1
