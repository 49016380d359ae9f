"""From trained weights to an ONNX file that ONNX Runtime and tract read, checked against PyTorch.

Only the last stage is exported: outputs `pcm (1, parts + 1, h / 8, w / 8)` and `paf (1, 2 limbs, h / 8, w / 8)`. The shape
is fixed and the batch is one. Batch normalisation is folded into the convolutions first.
"""

from __future__ import annotations

import copy
import hashlib
import warnings
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from .nets import OggLite, fold_batch_norm
from .storage import LARGE, float16_bits, narrow

OPSET = 17
PARITY = 1e-4
"""Largest allowed difference between PyTorch and ONNX Runtime, of maps whose range is 0 to 1."""


class LastStage(nn.Module):
    """The network without its intermediate answers."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, *inputs: Tensor) -> tuple[Tensor, Tensor]:
        return self.network(*inputs)[-1]


def trace(model: nn.Module, inputs: tuple[Tensor, ...], path: Path, names: list[str]) -> None:
    """Writes a model of `inputs` called `names` whose answers are `pcm` and `paf`."""
    with warnings.catch_warnings():
        # The tracing exporter needs no further package and writes plain convolutions; its notice is about that choice.
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            model, inputs, path, input_names=names, output_names=["pcm", "paf"], opset_version=OPSET, dynamo=False
        )


def export(
    network: nn.Module, size: tuple[int, int], path: Path, *, half: bool = False, metadata: dict[str, str] | None = None
) -> str:
    """Writes the network for pictures of `size` (width, height); returns the file's SHA-256.

    `half` rounds the weights to float16 and stores them so; the arithmetic stays in float32. Raises `ArithmeticError` when
    ONNX Runtime's answer to a random picture differs from that of the (rounded) network by more than `PARITY`.
    """
    import onnx
    import onnxruntime

    network = fold_batch_norm(network) if isinstance(network, OggLite) else network.eval()
    model = LastStage(copy.deepcopy(network)).eval().to(memory_format=torch.contiguous_format)
    if half:
        with torch.no_grad():
            for name, weights in model.named_parameters():
                if weights.numel() >= LARGE:
                    stored = float16_bits(name, weights.numpy()).view(np.float16)
                    weights.copy_(torch.from_numpy(stored.astype(np.float32)))
    image = torch.from_numpy(np.random.default_rng(0).uniform(-0.5, 0.5, (1, 3, size[1], size[0])).astype(np.float32))
    trace(model, (image,), path, ["image"])
    proto = onnx.load(path)
    for key, value in (metadata or {}).items():
        entry = proto.metadata_props.add()
        entry.key, entry.value = key, value
    if half:
        narrow(proto, "float16")
    onnx.checker.check_model(proto)
    onnx.save(proto, path)
    with torch.no_grad():
        expected = [t.numpy() for t in model(image)]
    got = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"]).run(None, {"image": image.numpy()})
    worst = max(float(np.abs(a - b).max()) for a, b in zip(expected, got, strict=True))
    if not worst <= PARITY:
        raise ArithmeticError(f"{path}: expected ONNX and PyTorch to agree to {PARITY}, got {worst:.3e}")
    return hashlib.sha256(path.read_bytes()).hexdigest()
