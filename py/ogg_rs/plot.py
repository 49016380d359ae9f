"""Pictures of what a run or a model holds. Needs matplotlib: `pip install 'ogg_rs[plot]'`.

Every function draws into `ax`, or into a new figure, and returns the axes.

>>> import matplotlib
>>> matplotlib.use("Agg")
>>> import numpy as np
>>> from ogg_rs import plot
>>> ax = plot.variance_band(np.arange(3.0), np.zeros(3), np.ones(3))
>>> len(ax.lines), len(ax.collections)
(1, 1)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._arrays import count, floats, rows, vector
from ._extras import require
from .errors import InvalidParameter

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ._fit import MixtureEstimator
    from ._model import MotionModel
    from .recording import Recording

__all__ = ["components", "motion_model", "tracking_error", "tracks", "variance_band"]


def _axes(ax: Axes | None, title: str, x: str, y: str) -> Axes:
    if ax is None:
        ax = require("matplotlib.pyplot").subplots()[1]
    ax.set_title(title)
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.grid(alpha=0.3)
    ax.set_axisbelow(True)
    return ax


def tracks(
    table: Mapping[str, NDArray[Any]], quantity: str = "position", *, unit: str = "rad", ax: Axes | None = None
) -> Axes:
    """One line over time for every column `<name>.<quantity>` of a recording's table.

    Args:
        table: As `Recording.table` returns it.
        quantity: Which columns: `position`, `velocity` … of joints, `x`, `y`, `z` of keypoints.
        unit: Written at the axis.
        ax: Axes to draw into; None for a new figure.

    Raises:
        InvalidParameter: No column is of that quantity.
        MissingDependency: matplotlib is not installed.
    """
    chosen = [name for name in table if name.endswith(f".{quantity}")]
    if not chosen:
        raise InvalidParameter(f"quantity: expected that of a column in {list(table)}, got {quantity!r}", "Domain")
    ax = _axes(ax, quantity, "time (s)", f"{quantity} ({unit})")
    for name in chosen:
        ax.plot(table["time_s"], table[name], label=name.removesuffix(f".{quantity}"), linewidth=1.0)
    ax.legend(fontsize="small", ncols=3)
    return ax


def tracking_error(run: Recording, *, ax: Axes | None = None) -> Axes:
    """Setpoint minus measured position of every joint over time, rad; the setpoint is the newest at each measurement.

    Raises:
        InvalidParameter: The recording has no setpoints or no measured joints.
        MissingDependency: matplotlib is not installed.
    """
    measured, setpoints = run.table("joint_states"), run.table("setpoints")
    newest = np.searchsorted(setpoints["time_s"], measured["time_s"], side="right") - 1
    known = newest >= 0
    joints = [name for name in measured if name.endswith(".position") and name in setpoints]
    if not joints or not known.any():
        raise InvalidParameter(f"{run.path}: expected setpoints of the measured joints", "Missing")
    ax = _axes(ax, "tracking error", "time (s)", "setpoint - measured (rad)")
    for name in joints:
        error = setpoints[name][newest[known]] - measured[name][known]
        ax.plot(measured["time_s"][known], error, label=name.removesuffix(".position"), linewidth=1.0)
    ax.legend(fontsize="small", ncols=3)
    return ax


def variance_band(
    t: ArrayLike,
    mean: ArrayLike,
    variance: ArrayLike,
    *,
    deviations: float = 2.0,
    label: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """A line `mean` over `t` with a band of `deviations` standard deviations, each `(n,)`.

    Raises:
        InvalidParameter: The lengths differ, or a variance is negative.
        MissingDependency: matplotlib is not installed.
    """
    times = vector("t", t)
    middle, spread = vector("mean", mean, len(times)), vector("variance", variance, len(times))
    if not (spread >= 0.0).all():
        raise InvalidParameter(f"variance: expected numbers that are not negative, got {spread.min()}", "Domain")
    ax = _axes(ax, "", "time (s)", "")
    half = deviations * np.sqrt(spread)
    (line,) = ax.plot(times, middle, label=label)
    ax.fill_between(times, middle - half, middle + half, color=line.get_color(), alpha=0.25, linewidth=0.0)
    return ax


def motion_model(model: MotionModel, *, deviations: float = 2.0, ax: Axes | None = None) -> Axes:
    """The wrist's expected way over one repetition, m, each coordinate with its band of variance.

    Raises:
        MissingDependency: matplotlib is not installed.
    """
    t = np.linspace(0.0, model.duration_s, 200)
    mean, covariance = model.predict(t, return_cov=True)
    ax = _axes(ax, "", "", "")
    for place, axis in enumerate("xyz"):
        variance_band(t, mean[:, place], covariance[:, place, place], deviations=deviations, label=axis, ax=ax)
    ax.set_title(f"wrist in world, with {deviations:g} standard deviations")
    ax.set_ylabel("position (m)")
    ax.legend()
    return ax


def components(
    mixture: MixtureEstimator,
    dimensions: tuple[int, int] = (0, 1),
    *,
    samples: ArrayLike | None = None,
    deviations: float = 2.0,
    ax: Axes | None = None,
) -> Axes:
    """The components of a fitted mixture in two of its dimensions: an ellipse of `deviations` each, darker the more
    weight, with the samples `(n, d)` behind them.

    Raises:
        InvalidParameter: A dimension does not exist.
        NotFitted: The mixture is not fitted.
        MissingDependency: matplotlib is not installed.
    """
    mixture._fitted  # noqa: B018  raises where there is nothing to draw
    i, j = (count("dimensions", dimension, 0) for dimension in dimensions)
    k, d = mixture.means_.shape
    if max(i, j) >= d or i == j:
        raise InvalidParameter(f"dimensions: expected two different ones below {d}, got {dimensions!r}", "Domain")
    ax = _axes(ax, f"{k} components", f"dimension {i}", f"dimension {j}")
    if samples is not None:
        points = rows("samples", samples, d)
        ax.plot(points[:, i], points[:, j], ".", color="0.7", markersize=2, zorder=0)
    given = floats("covariances_", mixture.covariances_)
    kind = mixture.covariance_type
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    circle = np.stack((np.cos(turn), np.sin(turn)))
    for c in range(k):
        if kind in ("full", "tied"):
            full = given if kind == "tied" else given[c]
            block = full[np.ix_([i, j], [i, j])]
        else:
            block = np.diag(given[c, [i, j]] if kind == "diag" else np.full(2, given[c]))
        outline = mixture.means_[c, [i, j], np.newaxis] + deviations * np.linalg.cholesky(block) @ circle
        shade = 0.25 + 0.75 * float(mixture.weights_[c] / mixture.weights_.max())
        ax.plot(outline[0], outline[1], color="tab:blue", alpha=shade)
        ax.plot(*mixture.means_[c, [i, j]], "+", color="tab:blue", alpha=shade)
    return ax
