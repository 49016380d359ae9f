"""The examples run as they are, on a recording made by the command and on synthetic data."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


def run(name, *arguments, cwd):
    command = [sys.executable, str(EXAMPLES / name), *arguments]
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, cwd=cwd, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_learning_an_action_from_a_recording(builtin_run, tmp_path):
    out = run("learn_an_action.py", str(builtin_run[0]), "learned", cwd=tmp_path)
    assert "cyclic=True" in out
    assert (tmp_path / "learned/action.json").stat().st_size > 1000
    assert (tmp_path / "learned/action.png").read_bytes()[:4] == b"\x89PNG"


def test_reading_a_run_into_pandas(builtin_run, tmp_path):
    out = run("run_to_pandas.py", str(builtin_run[0]), cwd=tmp_path)
    assert "joint6" in out and "setpoint - measured" in out


def test_comparing_with_scikit_learn(tmp_path):
    out = run("compare_with_scikit_learn.py", cwd=tmp_path)
    line = next(line for line in out.splitlines() if line.startswith("means differ by"))
    assert float(line.split()[3]) < 1e-9


@pytest.mark.skipif(find_spec("torch") is None, reason="PyTorch is not installed: pip install 'ogg_rs[train]'")
def test_training_on_synthetic_workers(tmp_path):
    out = run("train_on_synthetic_workers.py", "--steps", "4", "--batch", "4", cwd=tmp_path)
    losses = [float(line.split()[-1]) for line in out.splitlines()]
    assert len(losses) == 4 and losses[-1] < losses[0]


def test_every_example_is_run_here():
    source = Path(__file__).read_text()
    assert all(f'"{path.name}"' in source for path in EXAMPLES.glob("*.py"))
