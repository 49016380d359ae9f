"""Recordings of runs as tables, and as datasets to learn from.

>>> from ogg_rs import recording
>>> run = recording.open(example)                                     # doctest: +SKIP
>>> run.table("joint_states").to_pandas()["joint1.position"].mean()   # doctest: +SKIP
>>> recording.to_lerobot(example, "dataset")                          # doctest: +SKIP
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._arrays import FloatArray
from ._extras import require
from ._lerobot import to_lerobot
from .errors import InvalidParameter

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow

__all__ = ["TABLES", "Pictures", "Recording", "Table", "Topic", "open", "to_lerobot"]

TABLES: dict[str, str] = {
    "joint_states": "/joint_states",
    "setpoints": "/setpoints",
    "targets": "/targets",
    "keypoints": "/human/keypoints",
    "transforms": "/tf",
    "metrics": "/metrics",
    "log": "/log",
}
"""Names of the tables, and the topic each is made of."""

_STATES = np.array(["lost", "inferred", "measured"])
_LEVELS = np.array(["unknown", "debug", "info", "warning", "error", "fatal"])


class Table(Mapping[str, NDArray[Any]]):
    """Columns of equal length, by name; each a NumPy array.

    >>> table = Table({"time_s": np.array([0.0, 0.5]), "level": np.array(["info", "error"])})
    >>> len(table["time_s"]), list(table), table
    (2, ['time_s', 'level'], Table(2 rows: time_s, level))
    """

    __slots__ = ("_columns",)

    def __init__(self, columns: Mapping[str, NDArray[Any]]) -> None:
        self._columns = dict(columns)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return next((len(column) for column in self._columns.values()), 0)

    def __repr__(self) -> str:
        return f"Table({self.rows} rows: {', '.join(self._columns)})"

    def matrix(self, suffix: str) -> FloatArray:
        """The columns that end in `.suffix`, `(rows, n)`: `matrix("position")` is every joint's position."""
        chosen = [column for name, column in self._columns.items() if name.endswith(f".{suffix}")]
        if not chosen:
            raise InvalidParameter(f"suffix: expected that of a column in {list(self)}, got {suffix!r}", "Domain")
        return np.stack(chosen, axis=1)

    def to_pandas(self) -> pandas.DataFrame:
        """As a pandas data frame.

        Raises:
            MissingDependency: pandas is not installed.
        """
        frame: pandas.DataFrame = require("pandas").DataFrame(self._columns)
        return frame

    def to_arrow(self) -> pyarrow.Table:
        """As an Arrow table.

        Raises:
            MissingDependency: pyarrow is not installed.
        """
        table: pyarrow.Table = require("pyarrow").table(self._columns)
        return table

    def to_polars(self) -> polars.DataFrame:
        """As a polars data frame.

        Raises:
            MissingDependency: polars is not installed.
        """
        frame: polars.DataFrame = require("polars").DataFrame(self._columns)
        return frame


class Topic(NamedTuple):
    """A topic of a recording: name, schema, encoding, number of messages."""

    name: str
    schema: str
    encoding: str
    messages: int


class Pictures(NamedTuple):
    """Pictures of one camera.

    Attributes:
        time_s: Capture times since the start of the recording, `(n,)`.
        jpeg: One JPEG file each.
    """

    time_s: FloatArray
    jpeg: list[bytes]


class Recording:
    """A run; made by `open`. Times are in s since `start_ns`, the first message."""

    __slots__ = ("_native", "path")

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self._native = _native.Recording(self.path)

    def __repr__(self) -> str:
        return f"Recording({self.path!r}, {self.duration_s:.2f} s, {len(self.topics)} topics)"

    @property
    def topics(self) -> list[Topic]:
        """What it holds."""
        return [Topic(*row) for row in self._native.topics]

    @property
    def facts(self) -> dict[str, str]:
        """What was known at the start: configuration hash, model, versions."""
        return self._native.facts

    @property
    def attachments(self) -> dict[str, bytes]:
        """Files by name: `robot.urdf`, `config.toml`."""
        return self._native.attachments

    @property
    def cut(self) -> str | None:
        """Why reading stopped before the end of the file; None for a whole recording."""
        return self._native.cut

    @property
    def start_ns(self) -> int:
        """Time of the first message, nanoseconds since 1970; 0 without any."""
        times = self._native.time_range_ns
        return times[0] if times else 0

    @property
    def duration_s(self) -> float:
        """Time from the first message to the last."""
        times = self._native.time_range_ns
        return (times[1] - times[0]) / 1e9 if times else 0.0

    def _times(self, time_ns: NDArray[np.uint64]) -> dict[str, NDArray[Any]]:
        since = (time_ns.astype(np.int64) - self.start_ns) / 1e9
        return {"time_s": since, "time_ns": time_ns}

    def table(self, name: str) -> Table:
        """One of `TABLES`, with `time_s` and `time_ns` (since 1970) first.

        - `joint_states` (measured), `setpoints` (sent), `targets` (wanted): `<joint>.position`, `.velocity`,
          `.acceleration`, `.effort` in rad, s and N m; NaN where the message does not say.
        - `keypoints`: `<part>.x`, `.y`, `.z` (m), `.state` (`measured`, `inferred`, `lost`), and the covariance
          `.xx`, `.xy`, `.xz`, `.yy`, `.yz`, `.zz` (m^2); NaN where lost.
        - `transforms`: `parent`, `child`, `x`, `y`, `z` (m), quaternion `qx`, `qy`, `qz`, `qw`; one row per frame.
        - `metrics`: `name`, `value`, `unit`; one row per number.
        - `log`: `level`, `name`, `message`.

        Raises:
            InvalidParameter: There is no such table, or the recording lacks its topic.
        """
        if name not in TABLES:
            raise InvalidParameter(f"table: expected one of {sorted(TABLES)}, got {name!r}", "Domain")
        known = [topic.name for topic in self.topics]
        if TABLES[name] not in known:
            raise InvalidParameter(f"{self.path}: expected the topic {TABLES[name]}, it has {known}", "Missing")
        if name == "keypoints":
            return self._keypoints()
        if name == "transforms":
            times, parents, children, numbers = self._native.transforms()
            poses = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), numbers.T.copy(), strict=True))
            return Table({**self._times(times), "parent": np.array(parents), "child": np.array(children), **poses})
        if name == "metrics":
            times, names, values, units = self._native.metrics()
            return Table({**self._times(times), "name": np.array(names), "value": values, "unit": np.array(units)})
        if name == "log":
            times, levels, names, messages = self._native.log()
            level = _LEVELS[np.minimum(np.frombuffer(bytes(levels), np.uint8), len(_LEVELS) - 1)]
            return Table({**self._times(times), "level": level, "name": np.array(names), "message": np.array(messages)})
        times, joints, quantities = self._native.joint_table(name)
        columns = self._times(times)
        for place, joint in enumerate(joints):
            for quantity in ("position", "velocity", "acceleration", "effort"):
                columns[f"{joint}.{quantity}"] = quantities[quantity][:, place].copy()
        return Table(columns)

    def _keypoints(self) -> Table:
        times, names, numbers, states = self._native.keypoint_table()
        columns = self._times(times)
        for place, part in enumerate(names):
            of_part = numbers[:, 12 * place : 12 * (place + 1)]
            for index, axis in enumerate("xyz"):
                columns[f"{part}.{axis}"] = of_part[:, index].copy()
            columns[f"{part}.state"] = _STATES[states[:, place]]
            for index, entry in ((3, "xx"), (4, "xy"), (5, "xz"), (7, "yy"), (8, "yz"), (11, "zz")):
                columns[f"{part}.{entry}"] = of_part[:, index].copy()
        return Table(columns)

    def arm(self, side: str = "right") -> tuple[FloatArray, FloatArray]:
        """Times `(n,)` and shoulder, elbow, wrist `(n, 3, 3)` in `world`, as `MotionModel.teach` takes them.

        A joint that is lost, and a wrist that is not measured, are NaN.

        Raises:
            InvalidParameter: `side` is neither `"left"` nor `"right"`, or the recording does not have that arm.
        """
        if side not in ("left", "right"):
            raise InvalidParameter(f"side: expected 'left' or 'right', got {side!r}", "Domain")
        table = self.table("keypoints")
        parts = [f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist")]
        if any(f"{part}.x" not in table for part in parts):
            raise InvalidParameter(f"{self.path}: expected keypoints of the {side} arm, it has none", "Missing")
        joints = np.stack([np.stack([table[f"{part}.{axis}"] for axis in "xyz"], axis=1) for part in parts], axis=1)
        joints[table[f"{parts[2]}.state"] != "measured", 2] = np.nan
        return table["time_s"], joints

    def pictures(self, topic: str = "/camera") -> Pictures:
        """Pictures of a camera.

        Raises:
            InvalidParameter: The recording has no such topic.
        """
        times, jpeg = self._native.pictures(topic)
        return Pictures(self._times(times)["time_s"], [bytes(file) for file in jpeg])


def open(path: str | os.PathLike[str]) -> Recording:
    """Reads a recording (`.mcap`), also one that was cut short: see `Recording.cut`.

    Raises:
        DeviceError: The file cannot be read.
        InvalidParameter: It is no recording.
    """
    return Recording(path)
