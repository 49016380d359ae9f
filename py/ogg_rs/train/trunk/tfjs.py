"""From a TensorFlow.js graph model to ONNX, without TensorFlow.

A graph model is a JSON file with the graph and the weights' names, shapes and types, and a binary with their values. Only what
the wanted outputs need is converted: convolutions (plain and depthwise, with bias and rectifier fused into them), sums,
products and bilinear enlargement. Pictures and maps are `(1, channels, height, width)` in the result; the graph has
channels last.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

OPSET = 17
_TYPES = {"float32": np.float32, "float16": np.float16, "int32": np.int32, "uint8": np.uint8, "uint16": np.uint16}
_WRAPPING = {"Cast", "Unpack", "ExpandDims", "Squeeze", "Identity"}
"""Before the first convolution these take the batch of one apart and put it together again: together they do nothing."""


def read_weights(model: Path) -> tuple[dict, dict[str, NDArray]]:
    """The JSON and all constants by name, widened from their storage types."""
    index = json.loads(model.read_text())
    constants = {}
    for group in index["weightsManifest"]:
        data = b"".join((model.parent / path).read_bytes() for path in group["paths"])
        at = 0
        for entry in group["weights"]:
            stored = entry.get("quantization", {})
            kind = _TYPES[stored.get("dtype", entry["dtype"])]
            count = int(np.prod(entry["shape"]))
            values = np.frombuffer(data, kind, count, at)
            at += values.nbytes
            if "scale" in stored:
                values = values.astype(np.float32) * stored["scale"] + stored["min"]
            constants[entry["name"]] = values.astype(_TYPES[entry["dtype"]]).reshape(entry["shape"])
        if at != len(data):
            raise ValueError(f"{model}: expected {at} bytes of weights, got {len(data)}")
    return index, constants


def _text(attribute: dict) -> str:
    return base64.b64decode(attribute["s"]).decode()


def _numbers(attribute: dict) -> list[int]:
    return [int(v) for v in attribute.get("list", {}).get("i", [])]


def same_padding(kernel: int, stride: int) -> tuple[int, int]:
    """Rows before and after the picture where its side is a multiple of `stride`, by TensorFlow's rule."""
    total = max(kernel - stride, 0)
    return total // 2, total - total // 2


@dataclass
class _Builder:
    index: dict
    constants: dict[str, NDArray]
    nodes: list = field(default_factory=list)
    weights: list = field(default_factory=list)
    done: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        from onnx import helper, numpy_helper

        self.helper, self.from_array = helper, numpy_helper.from_array
        self.by_name = {node["name"]: node for node in self.index["modelTopology"]["node"]}

    def emit(self, op: str, inputs: list[str], **attributes: object) -> str:
        name = f"t{len(self.nodes)}"
        self.nodes.append(self.helper.make_node(op, inputs, [name], **attributes))
        return name

    def weight(self, values: NDArray) -> str:
        name = f"w{len(self.weights)}"
        self.weights.append(self.from_array(np.ascontiguousarray(values), name))
        return name

    def constant(self, name: str) -> str | None:
        """A constant operand of a sum or product, channels moved to where ONNX expects them."""
        if name not in self.constants:
            return None
        values = self.constants[name].astype(np.float32)
        return self.weight(values.transpose(0, 3, 1, 2) if values.ndim == 4 else values.reshape(-1, 1, 1) if values.ndim else values)

    def value(self, reference: str) -> str:
        """Name of the tensor that holds `reference`; converts what it needs first."""
        name = reference.split(":")[0]
        if name not in self.done:
            self.done[name] = self.convert(self.by_name[name])
        return self.done[name]

    def convert(self, node: dict) -> str:
        op, inputs, attributes = node["op"], node.get("input", []), node.get("attr", {})
        if op == "Placeholder":
            return "image"
        if op in _WRAPPING:
            return self.value(inputs[0])
        if op in {"_FusedConv2D", "FusedDepthwiseConv2dNative", "DepthwiseConv2dNative", "Conv2D"}:
            return self.convolution(op, inputs, attributes)
        if op in {"AddV2", "Add", "Sub", "Mul"}:
            operands = [self.constant(name) or self.value(name) for name in inputs]
            return self.emit(op.replace("V2", ""), operands)
        if op == "ResizeBilinear":
            return self.enlarge(inputs, attributes)
        raise ValueError(f"node {node['name']}: expected a convolution, sum, product or enlargement, got {op}")

    def enlarge(self, inputs: list[str], attributes: dict) -> str:
        if attributes.get("align_corners", {}).get("b"):
            raise ValueError("ResizeBilinear: expected align_corners = false")
        mode = "half_pixel" if attributes.get("half_pixel_centers", {}).get("b") else "asymmetric"
        scales = self.weight(np.array([1, 1, 2, 2], np.float32))
        return self.emit("Resize", [self.value(inputs[0]), "", scales], mode="linear", coordinate_transformation_mode=mode)

    def convolution(self, op: str, inputs: list[str], attributes: dict) -> str:
        kernel = self.constants[inputs[1]].astype(np.float32)
        depthwise = "Depthwise" in op
        groups = kernel.shape[2] if depthwise else 1
        shaped = kernel.transpose(2, 3, 0, 1).reshape(-1, 1, *kernel.shape[:2]) if depthwise else kernel.transpose(3, 2, 0, 1)
        strides = _numbers(attributes["strides"])[1:3]
        if _numbers(attributes.get("dilations", {})) not in ([], [1, 1, 1, 1]):
            raise ValueError("convolution: expected no dilation")
        pads = [(0, 0), (0, 0)]
        if _text(attributes["padding"]) == "SAME":
            pads = [same_padding(k, s) for k, s in zip(kernel.shape[:2], strides, strict=True)]
        fused = [base64.b64decode(v).decode() for v in attributes.get("fused_ops", {}).get("list", {}).get("s", [])]
        operands = [self.value(inputs[0]), self.weight(shaped)]
        if "BiasAdd" in fused:
            operands.append(self.weight(self.constants[inputs[2]].astype(np.float32).reshape(-1)))
        result = self.emit(
            "Conv", operands, strides=strides, group=groups, kernel_shape=list(kernel.shape[:2]),
            pads=[pads[0][0], pads[1][0], pads[0][1], pads[1][1]],
        )  # fmt: skip
        for step in fused:
            if step == "Relu":
                result = self.emit("Relu", [result])
            elif step == "Relu6":
                result = self.emit("Clip", [result, self.weight(np.float32(0)), self.weight(np.float32(6))])
            elif step != "BiasAdd":
                raise ValueError(f"convolution: expected BiasAdd, Relu or Relu6 fused into it, got {step}")
        return result


def to_onnx(model: Path, outputs: dict[str, str], size: tuple[int, int]) -> object:
    """An ONNX model with the input `image (1, 3, height, width)`, float RGB of 0..255, and `outputs` by their new names.

    `size` is (width, height), both multiples of 32. Raises `ValueError` for a graph with other operations.
    """
    from onnx import TensorProto, checker, helper, shape_inference

    width, height = size
    if width % 32 or height % 32 or min(size) <= 0:
        raise ValueError(f"size: expected multiples of 32, got {width}x{height}")
    builder = _Builder(*read_weights(model))
    for new, old in outputs.items():
        builder.nodes.append(helper.make_node("Identity", [builder.value(old)], [new]))
    graph = helper.make_graph(
        builder.nodes, "trunk",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, height, width])],
        [helper.make_tensor_value_info(new, TensorProto.FLOAT, None) for new in outputs],
        builder.weights,
    )  # fmt: skip
    proto = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
    proto = shape_inference.infer_shapes(proto, strict_mode=True)
    checker.check_model(proto)
    return proto
