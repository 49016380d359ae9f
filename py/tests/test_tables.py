"""Recordings as tables, judged by the reference MCAP reader; LeRobot datasets, judged by their written format."""

import json
from importlib.util import find_spec

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import ogg_rs
from ogg_rs import recording


def messages(path, topic):
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [(m.log_time, decoded) for _, _, m, decoded in reader.iter_decoded_messages(topics=[topic])]


@pytest.fixture(scope="module")
def run(builtin_run):
    return recording.open(builtin_run[0])


def test_joint_tables_hold_every_number_of_every_message(builtin_run, run):
    for name in ("joint_states", "setpoints", "targets"):
        table = run.table(name)
        want = messages(builtin_run[0], recording.TABLES[name])
        assert table.rows == len(want) > 0
        np.testing.assert_array_equal(table["time_ns"], [time for time, _ in want])
        for place, (_, message) in enumerate(want[:50]):
            for joint in message.joints:
                assert table[f"{joint.name}.position"][place] == joint.position
        assert table.matrix("position").shape == (len(want), 6)
    np.testing.assert_allclose(table["time_s"], (table["time_ns"].astype(np.int64) - run.start_ns) / 1e9)


def test_keypoints_transforms_pictures_and_log_are_those_of_the_messages(builtin_run, run):
    keypoints = run.table("keypoints")
    for place, (_, message) in enumerate(messages(builtin_run[0], "/human/keypoints")):
        for point in message.keypoints:
            assert keypoints[f"{point.name}.state"][place] == point.state
            if point.state != "lost":
                assert [keypoints[f"{point.name}.{axis}"][place] for axis in "xyz"] == [point.x, point.y, point.z]
                assert keypoints[f"{point.name}.yz"][place] == point.covariance[5]
            else:
                assert np.isnan(keypoints[f"{point.name}.x"][place])
    poses = [t for _, m in messages(builtin_run[0], "/tf") for t in m.transforms]
    transforms = run.table("transforms")
    assert transforms["child"].tolist() == [pose.child_frame_id for pose in poses]
    np.testing.assert_array_equal(transforms["qw"], [pose.rotation.w for pose in poses])
    lines = [m for _, m in messages(builtin_run[0], "/log")]
    assert run.table("log")["message"].tolist() == [m.message for m in lines]
    assert set(run.table("log")["level"]) <= {"debug", "info", "warning", "error", "fatal"}
    shots = run.pictures()
    assert [m.data for _, m in messages(builtin_run[0], "/camera")] == shots.jpeg


def test_tables_become_data_frames(run):
    table = run.table("joint_states")
    frames = [table.to_pandas(), table.to_arrow().to_pandas(), table.to_polars().to_pandas()]
    for frame in frames:
        pd.testing.assert_frame_equal(frame, frames[0])
    assert list(frames[0]) == list(table)
    assert run.table("keypoints").to_arrow().num_rows == run.table("keypoints").rows


def test_a_model_is_taught_from_a_recording_as_the_command_teaches_it(run):
    model = ogg_rs.MotionModel.teach([run.arm("right")])
    # The built-in worker repeats its action every three seconds, give or take its two per cent.
    assert model.is_cyclic and abs(model.duration_s - 3.0) < 0.15
    assert model.teach_report["demonstrations"] >= 2
    with pytest.raises(ogg_rs.InvalidParameter, match="left arm"):
        run.arm("left")


def test_a_cut_recording_gives_everything_before_the_cut(builtin_run, tmp_path):
    whole = builtin_run[0].read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: len(whole) * 19 // 20])
    cut, full = recording.open(path), recording.open(builtin_run[0])
    assert cut.cut is not None and full.cut is None
    assert 0 < cut.table("joint_states").rows < full.table("joint_states").rows
    assert full.pictures().jpeg[: len(cut.pictures().jpeg)] == cut.pictures().jpeg != []
    assert cut.table("keypoints").rows == next(t.messages for t in cut.topics if t.name == "/human/keypoints")


def test_what_is_no_recording_is_refused(run, tmp_path):
    (tmp_path / "text.mcap").write_text("no recording at all, but long enough for a magic number")
    with pytest.raises(ogg_rs.InvalidParameter) as caught:
        recording.open(tmp_path / "text.mcap")
    assert caught.value.kind == "NotMcap"
    with pytest.raises(ogg_rs.DeviceError, match="absent"):
        recording.open(tmp_path / "absent.mcap")
    for call in (
        lambda: run.table("joints"),
        lambda: run.table("metrics"),
        lambda: run.pictures("/eye"),
        lambda: run.arm("middle"),
        lambda: run.table("log").matrix("x"),
    ):
        with pytest.raises(ogg_rs.InvalidParameter):
            call()


def test_a_lerobot_dataset_has_the_written_format(builtin_run, run, tmp_path):
    out = recording.to_lerobot([builtin_run[0], builtin_run[0]], tmp_path / "set", fps=20)
    info = json.loads((out / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["fps"] == 20 and info["total_episodes"] == 2
    data = pd.read_parquet(out / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(data) == set(info["features"]) and len(data) == info["total_frames"]
    episodes = pd.read_parquet(out / "meta/episodes/chunk-000/file-000.parquet")
    assert episodes["dataset_to_index"].tolist() == [len(data) // 2, len(data)]
    np.testing.assert_array_equal(data["index"], np.arange(len(data)))
    np.testing.assert_allclose(data["timestamp"], data["frame_index"] / 20, rtol=1e-6)
    tasks = pd.read_parquet(out / "meta/tasks.parquet")
    assert tasks.index.tolist() == ["follow the worker's arm"] and tasks["task_index"].tolist() == [0]
    stats = json.loads((out / "meta/stats.json").read_text())
    actions = np.stack(data["action"])
    np.testing.assert_allclose(stats["action"]["mean"], actions.mean(axis=0, dtype=float), atol=1e-6)
    assert np.shape(stats["observation.images.camera"]["mean"]) == (3, 1, 1)
    # Every row is the newest that was known at its time.
    states = run.table("joint_states")
    first = max(run.table(n)["time_s"][0] for n in ("joint_states", "setpoints"))
    first = max(first, run.pictures().time_s[0])
    known = np.searchsorted(states["time_s"], first + data["frame_index"][37] / 20 + 1e-9, side="right") - 1
    np.testing.assert_allclose(data["observation.state"][37], states.matrix("position")[known], atol=1e-6)
    assert data["observation.images.camera"][0]["bytes"][:2] == b"\xff\xd8"
    schema = pq.read_schema(out / "data/chunk-000/file-000.parquet")
    assert str(schema.field("action").type).startswith("fixed_size_list")
    with pytest.raises(ogg_rs.DeviceError, match="contents"):
        recording.to_lerobot(builtin_run[0], out)
    with pytest.raises(ogg_rs.InvalidParameter):
        recording.to_lerobot([], tmp_path / "none")


@pytest.mark.skipif(find_spec("lerobot") is None, reason="LeRobot is not installed, it needs PyTorch")
def test_lerobot_itself_opens_the_dataset(builtin_run, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    out = recording.to_lerobot([builtin_run[0]] * 2, tmp_path / "set", fps=20)
    dataset = LeRobotDataset("local/run", root=out, delta_timestamps={"action": [0.0, 0.05]})
    assert dataset.num_episodes == 2 and dataset[3]["action"].shape == (2, 6)
    assert tuple(dataset[3]["observation.images.camera"].shape[:1]) == (3,)


def test_a_package_that_is_missing_is_named(run, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "polars", None)
    with pytest.raises(ImportError, match="pip install polars") as caught:
        run.table("log").to_polars()
    assert type(caught.value) is ogg_rs.MissingDependency
