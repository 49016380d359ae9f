"""Packages that only some functions need."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from .errors import MissingDependency

_EXTRAS = {"matplotlib": "plot", "pyarrow": "lerobot", "PIL": "lerobot"}


def require(module: str) -> Any:
    """The module.

    Raises:
        MissingDependency: Its package is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.split(".")[0]
        extra = _EXTRAS.get(package)
        how = f"pip install 'ogg_rs[{extra}]'" if extra else f"pip install {package}"
        raise MissingDependency(f"{package} is needed: {how}", "MissingDependency", str(error)) from error
