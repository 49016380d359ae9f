"""The package imports without PyTorch, and the examples in its documentation are true."""

import doctest
import importlib
import subprocess
import sys

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
