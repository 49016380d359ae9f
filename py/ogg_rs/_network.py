"""Networks that find people in pictures."""

from __future__ import annotations

import os
import site
import sysconfig
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._arrays import count
from ._skeletons import SKELETONS, Skeleton
from .errors import InvalidParameter

BUILTIN_CARDS: tuple[str, ...] = tuple(_native.builtin_cards())
"""Names of the model cards that are compiled in."""


class People(NamedTuple):
    """People in one picture, best first.

    Attributes:
        keypoints: u and v in px and the network's score, `(n, joints, 3)` float32; NaN, NaN, 0 where there is none.
        scores: Score of each person, 0 to 1, `(n,)` float32.
    """

    keypoints: NDArray[np.float32]
    scores: NDArray[np.float32]


class Estimator:
    """A network that looks at the pictures of one camera, one after the other.

    A network for one person looks at a square around the person of the picture before: make one estimator per camera, and
    call `reset` at a cut.

    Args:
        card: `builtin:ogg-lite`, another name of `BUILTIN_CARDS`, a model card (`.toml`), or a network (`.onnx`).
        weights_dirs: Where the weights that a card names are looked for.
        onnxruntime: A shared library of ONNX Runtime; `"tract"` for the built-in pure-Rust runtime; None for the first
            that is found, the package `onnxruntime` of this interpreter included, and else the built-in one. `runtime`
            says which one serves. A process holds one runtime.
        provider: `"cpu"`, `"openvino"`, `"cuda"` or `"tensorrt"`.
        fallback: Provider that serves where `provider` is not there; None makes that an error.
        threads: Threads for one picture; None leaves it to the runtime.
        mirror: Looks at every picture a second time, mirrored, and takes the mean of both answers: more exact, and twice
            the work. For networks that answer with confidence maps and fields.

    Raises:
        DeviceError: A file, the library or the provider is missing, or another runtime already serves.
        InvalidParameter: The card or the network is not what it says.

    >>> import numpy as np
    >>> from ogg_rs import pose
    >>> estimator = pose.Estimator("builtin:ogg-lite", onnxruntime="tract")
    >>> estimator.name, estimator.skeleton.name
    ('ogg-lite', 'openpose-18')
    >>> estimator.estimate(np.zeros((240, 320, 3), np.uint8)).keypoints.shape
    (0, 18, 3)
    """

    __slots__ = ("_native",)

    def __init__(
        self,
        card: str | os.PathLike[str] = "builtin:ogg-lite",
        *,
        weights_dirs: Iterable[str | os.PathLike[str]] = (),
        onnxruntime: str | os.PathLike[str] | None = None,
        provider: str = "cpu",
        fallback: str | None = None,
        threads: int | None = None,
        mirror: bool = False,
    ) -> None:
        folders = [sysconfig.get_path("platlib"), sysconfig.get_path("purelib"), site.getusersitepackages()]
        self._native = _native.Estimator(
            os.fspath(card),
            weights_dirs=[os.fspath(folder) for folder in weights_dirs],
            library=None if onnxruntime is None else os.fspath(onnxruntime),
            site_packages=list(dict.fromkeys(folders)),
            provider=provider,
            fallback=fallback,
            threads=None if threads is None else count("threads", threads, 1),
            mirror=bool(mirror),
        )

    def __repr__(self) -> str:
        return f"Estimator({self.name!r}, {self.skeleton.name!r}, on {self.runtime})"

    @property
    def name(self) -> str:
        """Name on the card."""
        return self._native.name

    @property
    def skeleton(self) -> Skeleton:
        """Order of the keypoints."""
        return SKELETONS[self._native.skeleton]

    @property
    def runtime(self) -> str:
        """What computes the network."""
        return self._native.runtime

    def estimate(self, image: NDArray[np.uint8]) -> People:
        """People in an RGB picture `(height, width, 3)`, uint8, in its pixels; the interpreter is released meanwhile.

        Raises:
            InvalidParameter: The picture is no such array.
            NumericalError: The network answers with NaN.
        """
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            got = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
            raise InvalidParameter(f"image: expected uint8 (height, width, 3), got {got}", "Type")
        return People(*self._native.estimate(np.ascontiguousarray(image)))

    def reset(self) -> None:
        """Forgets the person of the picture before."""
        self._native.reset()
