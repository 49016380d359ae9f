"""Rendered people with exact keypoints: `python -m ogg_rs.train people`.

A parametric body (package `anny`) is posed at a bench or freely, dressed, put among furniture, a machine and fabric, and
rendered (package `pyrender`, off screen) before a random background. Everything random follows from `(seed, number)`.

The two packages are needed by this command alone; without them it says what to install.
"""

from .writing import write

__all__ = ["write"]
