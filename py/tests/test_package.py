"""The package imports without PyTorch, and the examples in its documentation are true."""

import doctest
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest


def test_importing_the_package_needs_no_torch():
    code = "import sys; sys.modules['torch'] = None; import ogg_rs, ogg_rs.train; assert 'sklearn' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


@pytest.mark.parametrize(
    "name",
    ["", ".can", ".errors", ".kin", ".motion", ".plot", ".pose", ".recording", ".sim", "._arima", "._mixture", "._model",
     "._regressor"],
)  # fmt: skip
def test_the_examples_of_the_documentation_hold(name):
    done = doctest.testmod(importlib.import_module(f"ogg_rs{name}"), optionflags=doctest.NORMALIZE_WHITESPACE)
    assert done.attempted > 0
    assert done.failed == 0


def test_the_readme_is_true(builtin_run, tmp_path, monkeypatch):
    text = (Path(__file__).parent.parent / "README.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 2
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks:
        exec(block.replace("runs/run-20260101-120000.mcap", str(builtin_run[0])), names)
    assert (tmp_path / "action.json").exists() and (tmp_path / "dataset/meta/info.json").exists()
    for name in ("GaussianMixture", "Arima", "MotionModel", "pose", "kin", "recording", "plot", "train"):
        assert f"`{name}" in text
