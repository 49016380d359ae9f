"""What the tests of the training package share."""

from __future__ import annotations

import importlib.util

import pytest

NEEDED = ("torch", "onnx", "onnxruntime", "PIL", "tqdm", "numpy")


def require_training_packages() -> None:
    """Skips the calling module with a printed line where the packages of training are not installed."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        line = f"training tests skipped: not installed: {', '.join(missing)} (pip install 'ogg_rs[train]')"
        print(line)
        pytest.skip(line, allow_module_level=True)
    import torch

    torch.set_num_threads(2)
