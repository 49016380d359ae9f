"""A run's recording opens with the reference Python library, and holds what the documentation lists."""

import math
from pathlib import Path

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def messages(path: Path, topic: str) -> list:
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [decoded for _, _, _, decoded in reader.iter_decoded_messages(topics=[topic])]


def test_topics_and_schemas(builtin_run):
    path, _ = builtin_run
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    topics = {c.topic: (c.message_encoding, summary.schemas[c.schema_id].name) for c in summary.channels.values()}
    assert topics["/joint_states"] == ("protobuf", "foxglove.JointStates")
    assert topics["/tf"] == ("protobuf", "foxglove.FrameTransforms")
    assert topics["/camera"] == ("protobuf", "foxglove.CompressedImage")
    assert topics["/camera/calibration"] == ("protobuf", "foxglove.CameraCalibration")
    assert topics["/camera/annotations"] == ("protobuf", "foxglove.ImageAnnotations")
    assert topics["/human/keypoints3d"] == ("protobuf", "foxglove.PosesInFrame")
    assert topics["/robot_description"] == ("cdr", "std_msgs/msg/String")


def test_joint_states_are_named_and_finite(builtin_run):
    path, _ = builtin_run
    states = messages(path, "/joint_states")
    assert len(states) > 500
    for state in states:
        assert [j.name for j in state.joints] == [f"joint{i}" for i in range(1, 7)]
        assert all(math.isfinite(j.position) for j in state.joints)


def test_the_robot_description_is_a_urdf(builtin_run):
    path, _ = builtin_run
    with path.open("rb") as stream:
        [data] = [m.data for _, _, m in make_reader(stream).iter_messages(topics=["/robot_description"])]
    # CDR: four bytes of header, four of length, the text, a zero.
    length = int.from_bytes(data[4:8], "little")
    text = data[8 : 8 + length - 1].decode()
    assert text.startswith("<?xml") and "<robot" in text and data[8 + length - 1] == 0


def test_the_summary_has_the_stable_keys(builtin_run):
    _, summary = builtin_run
    assert summary["frames"] > 200 and summary["dropped"] == 0
    for stage in ("pose", "lift", "predict", "control"):
        spread = summary["latency_ms"][stage]
        assert 0 <= spread["p50"] <= spread["p99"]
    assert 0 < summary["tracking"]["joint_rms_rad"] <= summary["tracking"]["joint_max_rad"]
    assert set(summary["tracking"]["wrist_rmse_mm"]) == {"x", "y", "z"}
    assert summary["reference"]["wrist_median_mm"] is None
