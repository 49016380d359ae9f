"""The exceptions of the package.

Every error of the native half becomes one of these. The message says what was expected and what was given; `kind` names
the exact error and `detail` holds its fields.

>>> import numpy as np
>>> import ogg_rs
>>> try:
...     ogg_rs.GaussianMixture(3).fit(np.zeros((2, 1)))
... except ogg_rs.InvalidParameter as error:
...     print(error.kind, "-", error)
TooFewSamples - mixture fit: expected at least 3 samples, got 2
"""

from __future__ import annotations

import sys


class OggError(Exception):
    """Base of all errors.

    Attributes:
        kind: Name of the exact error, such as `NotFinite`.
        detail: The error with all its fields, as text.
    """

    kind: str
    detail: str

    def __init__(self, message: str = "", kind: str = "", detail: str = "") -> None:
        super().__init__(message)
        self.kind = kind
        self.detail = detail


class InvalidParameter(OggError, ValueError):
    """An argument, an array or a file is not what the call expects."""


class NumericalError(OggError, ArithmeticError):
    """The arguments are in order, but the computation has no usable result for them."""


class DeviceError(OggError, OSError):
    """A file or a device could not be read or written."""


class NotFitted(OggError, ValueError, AttributeError):
    """An estimator is asked for something that only a fit can tell."""

    def __init__(self, message: str = "", kind: str = "NotFitted", detail: str = "") -> None:
        super().__init__(message, kind, detail)


    def __reduce__(self) -> tuple[type[OggError], tuple[str, str, str]]:
        return (NotFitted, (str(self), self.kind, self.detail))


def not_fitted(message: str) -> NotFitted:
    """The exception to raise; where scikit-learn is loaded, it is also scikit-learn's own."""
    sklearn = sys.modules.get("sklearn.exceptions")
    if sklearn is None:
        return NotFitted(message)
    both: type[NotFitted] = type("NotFitted", (NotFitted, sklearn.NotFittedError), {"__module__": __name__})
    return both(message)


class MissingDependency(OggError, ImportError):
    """A function needs a package that is not installed."""


class ConvergenceWarning(UserWarning):
    """A fit used up its iterations before the change fell below the tolerance."""
