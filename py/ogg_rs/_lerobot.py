"""Runs as a LeRobotDataset, version 3.0.

A dataset is a folder of Parquet files: `data/` holds one row per frame, `meta/` says what the columns are, which rows
belong to which episode, and the statistics of every column. Pictures are stored in the rows, as JPEG.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._arrays import FloatArray, count
from ._extras import require
from .errors import DeviceError, InvalidParameter

if TYPE_CHECKING:
    from .recording import Recording

VERSION = "v3.0"
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
# Columns every dataset has.
INDICES = {"frame_index": "int64", "episode_index": "int64", "index": "int64", "task_index": "int64"}
# Pictures per episode that the statistics are taken of.
PICTURES_SAMPLED = 64


def to_lerobot(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    fps: int = 30,
    task: str = "follow the worker's arm",
    pictures: bool = True,
) -> Path:
    """Writes recordings as a LeRobotDataset v3, one episode each; returns the folder.

    A frame every `1 / fps` s has the newest values that were known at its time, never later ones:

    - `observation.state`: measured joint positions, rad.
    - `action`: setpoints sent to the controller, rad.
    - `observation.images.<camera>`: the newest picture of each camera.
    - `timestamp`, `frame_index`, `episode_index`, `index`, `task_index`.

    Args:
        path: A recording, or several of the same robot and cameras.
        out: A folder that does not exist yet, or is empty.
        fps: Frames per second.
        task: What is done, in words.
        pictures: Whether to write pictures.

    Raises:
        DeviceError: A file cannot be read or written, or `out` is not empty.
        InvalidParameter: A recording lacks setpoints or measured joints, or recordings differ in joints or cameras.
        MissingDependency: pyarrow, or Pillow for pictures, is not installed.
    """
    from .recording import open as open_recording

    rate = count("fps", fps, 1)
    paths = [path] if isinstance(path, str | os.PathLike) else list(path)
    if not paths:
        raise InvalidParameter("path: expected at least one recording, got none", "Shape")
    require("pyarrow.parquet")
    if pictures:
        require("PIL.Image")
    folder = Path(out)
    episodes = [_Episode(open_recording(one), rate, pictures) for one in paths]
    for episode in episodes[1:]:
        for what in ("joints", "cameras"):
            first, other = getattr(episodes[0], what), getattr(episode, what)
            if first != other:
                raise InvalidParameter(f"{episode.path}: expected the {what} {first}, got {other}", "Mixed")
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise DeviceError(f"{folder}: expected no file and no folder with contents there", "NotEmpty")
        _write(folder, episodes, rate, task)
    except OSError as error:
        if isinstance(error, DeviceError):
            raise
        raise DeviceError(f"{folder}: {error}", "File", str(error)) from error
    return folder


class _Episode:
    """One recording on the grid of frames."""

    def __init__(self, run: Recording, fps: int, pictures: bool) -> None:
        self.path = run.path
        states, setpoints = run.table("joint_states"), run.table("setpoints")
        self.joints = [name.removesuffix(".position") for name in states if name.endswith(".position")]
        named = [name.removesuffix(".position") for name in setpoints if name.endswith(".position")]
        if not self.joints or sorted(named) != sorted(self.joints):
            raise InvalidParameter(
                f"{run.path}: expected setpoints of the measured joints {self.joints}, got {named}", "Mixed"
            )
        topics = [t.name for t in run.topics if t.schema == "foxglove.CompressedImage"] if pictures else []
        shots = {topic.strip("/").replace("/", "_"): run.pictures(topic) for topic in topics}
        self.cameras = list(shots)
        streams = [states["time_s"], setpoints["time_s"], *(shot.time_s for shot in shots.values())]
        if any(len(times) == 0 for times in streams):
            raise InvalidParameter(f"{run.path}: expected samples of every stream, one has none", "TooFewSamples")
        start, end = max(times[0] for times in streams), min(states["time_s"][-1], setpoints["time_s"][-1])
        frames = int(np.floor((end - start) * fps)) + 1
        if frames < 1:
            raise InvalidParameter(f"{run.path}: expected streams that overlap in time", "TooFewSamples")
        self.times = np.arange(frames) / fps
        at = start + self.times + 1e-9

        def newest(times: FloatArray) -> NDArray[np.int64]:
            places: NDArray[np.int64] = np.searchsorted(times, at, side="right") - 1
            return places

        def positions(table: Any) -> NDArray[np.float32]:
            columns = [table[f"{joint}.position"] for joint in self.joints]
            return np.stack(columns, axis=1)[newest(table["time_s"])].astype(np.float32)

        self.state, self.action = positions(states), positions(setpoints)
        self.pictures = {name: [shot.jpeg[i] for i in newest(shot.time_s)] for name, shot in shots.items()}

    def __len__(self) -> int:
        return len(self.times)


def _numbers(values: NDArray[Any]) -> dict[str, Any]:
    """Statistics of `(n, d)`, each `(d,)`."""
    wide = values.astype(np.float64)
    found = {
        "min": wide.min(axis=0),
        "max": wide.max(axis=0),
        "mean": wide.mean(axis=0),
        "std": wide.std(axis=0),
        "count": np.array([len(wide)]),
    }
    found |= {name: np.quantile(wide, share, axis=0) for name, share in QUANTILES.items()}
    return {name: value.tolist() for name, value in found.items()}


def _decoded(jpeg: bytes) -> NDArray[np.uint8]:
    with require("PIL.Image").open(BytesIO(jpeg)) as image:
        pixels: NDArray[np.uint8] = np.asarray(image.convert("RGB"))
        return pixels


def _picture_numbers(files: list[bytes]) -> dict[str, Any]:
    """Statistics of pictures by channel, each `(3, 1, 1)`, of values 0 to 1."""
    chosen = np.unique(np.linspace(0, len(files) - 1, min(len(files), PICTURES_SAMPLED)).round().astype(int))
    pixels = np.concatenate([_decoded(files[i])[::4, ::4].reshape((-1, 3)) for i in chosen]) / 255.0
    numbers = _numbers(pixels)
    shaped = {name: np.reshape(value, (3, 1, 1)).tolist() for name, value in numbers.items() if name != "count"}
    return {**shaped, "count": [len(chosen)]}


def _write(folder: Path, episodes: list[_Episode], fps: int, task: str) -> None:
    pyarrow, parquet = require("pyarrow"), require("pyarrow.parquet")
    joints, cameras = episodes[0].joints, episodes[0].cameras
    features: dict[str, Any] = {
        "observation.state": {"dtype": "float32", "shape": [len(joints)], "names": joints},
        "action": {"dtype": "float32", "shape": [len(joints)], "names": joints},
    }
    for camera in cameras:
        shape = list(_decoded(episodes[0].pictures[camera][0]).shape)
        names = ["height", "width", "channels"]
        features[f"observation.images.{camera}"] = {"dtype": "image", "shape": shape, "names": names}
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    features |= {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in INDICES.items()}

    vector = pyarrow.list_(pyarrow.float32(), len(joints))
    picture = pyarrow.struct([("bytes", pyarrow.binary()), ("path", pyarrow.string())])
    kinds = [("observation.state", vector), ("action", vector)]
    kinds += [(f"observation.images.{camera}", picture) for camera in cameras]
    kinds += [("timestamp", pyarrow.float32()), *((name, pyarrow.int64()) for name in INDICES)]
    schema = pyarrow.schema(kinds)

    data = folder / DATA_PATH.format(chunk_index=0, file_index=0)
    data.parent.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    whole: dict[str, list[NDArray[Any]]] = {}
    first = 0
    with parquet.ParquetWriter(data, schema, compression="snappy") as writer:
        for number, episode in enumerate(episodes):
            length = len(episode)
            columns: dict[str, NDArray[Any]] = {
                "observation.state": episode.state,
                "action": episode.action,
                "timestamp": episode.times.astype(np.float32),
                "frame_index": np.arange(length),
                "episode_index": np.full(length, number),
                "index": np.arange(first, first + length),
                "task_index": np.zeros(length, np.int64),
            }
            arrays = {
                name: pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(values.reshape(-1)), len(joints))
                if values.ndim == 2
                else pyarrow.array(values)
                for name, values in columns.items()
            }
            for camera in cameras:
                cells = [{"bytes": jpeg, "path": None} for jpeg in episode.pictures[camera]]
                arrays[f"observation.images.{camera}"] = pyarrow.array(cells, picture)
            writer.write_table(pyarrow.table([arrays[name] for name, _ in kinds], schema=schema))
            numbers = {name: _numbers(values.reshape((length, -1))) for name, values in columns.items()}
            for camera in cameras:
                numbers[f"observation.images.{camera}"] = _picture_numbers(episode.pictures[camera])
            rows.append(_episode_row(number, first, length, task, numbers))
            for name, values in columns.items():
                whole.setdefault(name, []).append(values.reshape((length, -1)))
            first += length

    meta = folder / "meta"
    (meta / "episodes/chunk-000").mkdir(parents=True)
    parquet.write_table(pyarrow.Table.from_pylist(rows), meta / "episodes/chunk-000/file-000.parquet")
    _write_tasks(meta / "tasks.parquet", task)
    stats = {name: _numbers(np.concatenate(parts)) for name, parts in whole.items()}
    for camera in cameras:
        files = [jpeg for episode in episodes for jpeg in episode.pictures[camera]]
        stats[f"observation.images.{camera}"] = _picture_numbers(files)
    info = {
        "codebase_version": VERSION,
        "robot_type": "ogg",
        "total_episodes": len(episodes),
        "total_frames": first,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": DATA_PATH,
        "video_path": None,
        "features": features,
    }
    for name, content in (("info.json", info), ("stats.json", stats)):
        (meta / name).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _episode_row(number: int, first: int, length: int, task: str, numbers: dict[str, Any]) -> dict[str, Any]:
    row: dict[str, Any] = {
        "episode_index": number,
        "tasks": [task],
        "length": length,
        "dataset_from_index": first,
        "dataset_to_index": first + length,
        "data/chunk_index": 0,
        "data/file_index": 0,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    for feature, found in numbers.items():
        row |= {f"stats/{feature}/{name}": value for name, value in found.items()}
    return row


def _write_tasks(path: Path, task: str) -> None:
    """Readers expect the task as the index of a pandas frame, which is a matter of the schema's metadata."""
    pyarrow, parquet = require("pyarrow"), require("pyarrow.parquet")
    table = pyarrow.table({"task_index": pyarrow.array([0], pyarrow.int64()), "task": [task]})

    def column(name: str, kind: str, stored: str) -> dict[str, Any]:
        return {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": stored, "metadata": None}

    pandas = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [column("task_index", "int64", "int64"), column("task", "unicode", "object")],
        "pandas_version": "2.0.0",
    }
    parquet.write_table(table.replace_schema_metadata({"pandas": json.dumps(pandas)}), path)
