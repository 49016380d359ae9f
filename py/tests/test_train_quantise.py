"""Variants of a network: smaller, nearly the same answers, with a card that names them."""

from __future__ import annotations

from pathlib import Path

import pytest
from train_support import require_training_packages

require_training_packages()

import numpy as np  # noqa: E402
import onnx  # noqa: E402
import onnxruntime  # noqa: E402
from onnx import TensorProto, helper, numpy_helper  # noqa: E402
from PIL import Image  # noqa: E402

from ogg_rs.train import quantise  # noqa: E402

CARD = """name = "tiny"
file = "tiny.onnx"
sha256 = "00"

[input]
name = "image"
width = 32
height = 16
layout = "nchw"
dtype = "float32"
colour = "bgr"
mean = [128.0, 128.0, 128.0]
scale = [0.00390625, 0.00390625, 0.00390625]
pad = 128
"""


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    """Two convolutions with random weights, and a card."""
    random = np.random.default_rng(3)
    weights = [
        numpy_helper.from_array(random.normal(0, 0.3, shape).astype(np.float32), name)
        for name, shape in (("a", (16, 3, 3, 3)), ("b", (4, 16, 3, 3)))
    ]
    nodes = [
        helper.make_node("Conv", ["image", "a"], ["x"], "first", kernel_shape=[3, 3], pads=[1] * 4),
        helper.make_node("Relu", ["x"], ["y"], "relu"),
        helper.make_node("Conv", ["y", "b"], ["maps"], "last", kernel_shape=[3, 3], pads=[1] * 4),
    ]
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, 16, 32])
    maps = helper.make_tensor_value_info("maps", TensorProto.FLOAT, [1, 4, 16, 32])
    graph = helper.make_graph(nodes, "tiny", [image], [maps], weights)
    path = tmp_path / "tiny.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    path.with_suffix(".toml").write_text(CARD)
    for i in range(6):
        pixels = random.integers(0, 256, (20, 30, 3), dtype=np.uint8)
        Image.fromarray(pixels).save(tmp_path / f"{i}.png")
    return path


@pytest.mark.parametrize(("variant", "bound"), [("int8", 0.03), ("bf16", 0.005), ("fp16", 0.002)])
def test_a_variant_answers_nearly_as_its_original(tiny: Path, variant: str, bound: float) -> None:
    out = tiny.with_name(f"tiny-{variant}.onnx")
    digest = quantise.quantise(tiny, out, variant, calibration=tiny.parent, limit=6)
    card = out.with_suffix(".toml").read_text()
    assert f'name = "tiny-{variant}"' in card and f'file = "{out.name}"' in card and f'sha256 = "{digest}"' in card
    tensor = quantise.Input.of_card(CARD).tensor(Image.open(tiny.parent / "0.png"))
    before, after = (
        onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"]).run(None, {"image": tensor})[0]
        for path in (tiny, out)
    )
    # Of the range of the answers: half a step of 8 bits in each of two layers, of 8 and of 11 bits of mantissa.
    assert np.abs(before - after).max() <= bound * np.ptp(before)


def test_a_picture_is_letterboxed_and_normalised_as_at_run_time() -> None:
    tensor = quantise.Input.of_card(CARD).tensor(Image.new("RGB", (16, 16), (255, 128, 0)))
    assert tensor.shape == (1, 3, 16, 32)
    assert tensor[0, :, 8, 0].tolist() == [0, 0, 0]
    assert tensor[0, :, 8, 16].tolist() == [-0.5, 0, 127 / 256]


def test_wrong_input_is_named(tiny: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="calibration"):
        quantise.quantise(tiny, tmp_path / "x.onnx", "int8")
    with pytest.raises(FileNotFoundError, match=r"with \.jpg or \.png pictures"):
        quantise.quantise(tiny, tmp_path / "x.onnx", "int8", calibration=tmp_path / "nothing")
    with pytest.raises(FileNotFoundError, match="card beside it"):
        quantise.quantise(tmp_path / "no.onnx", tmp_path / "x.onnx", "bf16")
