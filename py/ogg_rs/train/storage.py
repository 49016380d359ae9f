"""Weights in a file at half their size: stored with 16 bits, turned into float32 when the network is loaded.

Runtimes fold the casts away before the first picture, so that the network runs wherever and as fast as the original does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import onnx

LARGE = 256
"""Weights of fewer elements stay in float32: biases cost nothing and matter."""

Narrow = Literal["bfloat16", "float16"]


def bfloat16_bits(values: NDArray[np.float32]) -> NDArray[np.uint16]:
    """To the nearest bfloat16, ties to even: what is cut off is half a step at most."""
    bits = np.ascontiguousarray(values).view(np.uint32).astype(np.uint64)
    return ((bits + 0x7FFF + ((bits >> 16) & 1)) >> 16).astype(np.uint16)


def float16_bits(name: str, values: NDArray[np.float32]) -> NDArray[np.uint16]:
    """To the nearest float16; a weight that it cannot hold is an `ArithmeticError`."""
    largest = float(np.abs(values).max())
    if not largest <= float(np.finfo(np.float16).max):
        raise ArithmeticError(f"{name}: expected weights of at most {np.finfo(np.float16).max} for float16, got {largest}")
    return np.ascontiguousarray(values.astype(np.float16)).view(np.uint16)


def narrow(model: onnx.ModelProto, kind: Narrow) -> None:
    """Large weights of `model` in `kind`, each followed by a cast to float32."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    graph, casts = model.graph, []
    for tensor in graph.initializer:
        values = numpy_helper.to_array(tensor)
        if tensor.data_type != TensorProto.FLOAT or values.size < LARGE:
            continue
        name = tensor.name
        bits = bfloat16_bits(values) if kind == "bfloat16" else float16_bits(name, values)
        stored = helper.make_tensor(f"{name}:{kind}", getattr(TensorProto, kind.upper()), values.shape, bits.tobytes(), raw=True)
        tensor.CopyFrom(stored)
        casts.append(helper.make_node("Cast", [stored.name], [name], to=TensorProto.FLOAT))
    nodes = [*casts, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
    onnx.checker.check_model(model)
