"""Smaller and faster variants of an exported network: int8 (QDQ), bfloat16 and float16.

- `int8`: static quantisation. Activations are unsigned 8-bit with a zero point, weights signed 8-bit per channel, their
  ranges measured on calibration pictures. The last layers stay in float: their maps are small numbers that are compared
  with thresholds. ONNX Runtime and OpenVINO run it.
- `bf16`: large weights are stored as bfloat16 and turned into float32 when the network is loaded, so that the file has half
  its size and runs wherever the original does. OpenVINO multiplies in bfloat16 by itself where the CPU has AMX.
- `fp16`: the whole network in float16, inputs and outputs in float32; for GPUs.

The card beside the network is written anew with name, file and SHA-256 of the variant. How much is lost is for
`ogg pose eval` to say: score the network and the variant on the same labels.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .storage import narrow

VARIANTS = ("int8", "bf16", "fp16")
PICTURES = {".jpg", ".jpeg", ".png"}


@dataclass(frozen=True)
class Input:
    """The input tensor, as the card describes it."""

    name: str
    width: int
    height: int
    planar: bool
    reversed: bool
    mean: tuple[float, ...]
    scale: tuple[float, ...]
    pad: int

    @classmethod
    def of_card(cls, text: str) -> Input:
        """Reads the section `[input]` of a card."""
        section = re.search(r"^\[input\]\n(.*?)(?=^\[|\Z)", text, re.S | re.M)
        if section is None:
            raise ValueError("card: expected a section [input]")
        values = dict(re.findall(r"^(\w+) = (.+)$", section[1], re.M))

        def numbers(key: str, default: float) -> tuple[float, ...]:
            return tuple(float(v) for v in values[key].strip("[]").split(",")) if key in values else (default,) * 3

        if values.get("dtype", '"float32"') != '"float32"':
            raise ValueError(f"card: input.dtype {values['dtype']}, expected \"float32\"")
        return cls(
            name=values["name"].strip('"'),
            width=int(values["width"]),
            height=int(values["height"]),
            planar=values["layout"] == '"nchw"',
            reversed=values["colour"] == '"bgr"',
            mean=numbers("mean", 0.0),
            scale=numbers("scale", 1.0),
            pad=int(values.get("pad", 0)),
        )

    def tensor(self, image: Image.Image) -> NDArray[np.float32]:
        """A picture letterboxed and normalised, with a batch of one."""
        scale = min(self.width / image.width, self.height / image.height)
        size = (max(round(image.width * scale), 1), max(round(image.height * scale), 1))
        canvas = Image.new("RGB", (self.width, self.height), (self.pad,) * 3)
        place = ((self.width - size[0]) // 2, (self.height - size[1]) // 2)
        canvas.paste(image.convert("RGB").resize(size, Image.Resampling.BOX), place)
        pixels = np.asarray(canvas, np.float32)
        if self.reversed:
            pixels = pixels[:, :, ::-1]
        values = (pixels - np.array(self.mean, np.float32)) * np.array(self.scale, np.float32)
        return np.ascontiguousarray(values.transpose(2, 0, 1) if self.planar else values)[None]


def pictures(folder: Path, limit: int) -> list[Path]:
    """At most `limit` pictures of a folder, spread evenly over its names in order."""
    files = sorted(p for p in folder.rglob("*") if p.suffix.lower() in PICTURES) if folder.is_dir() else []
    if not files:
        raise FileNotFoundError(f"{folder}: expected a folder with .jpg or .png pictures")
    step = max(len(files) / limit, 1.0)
    return [files[int(i * step)] for i in range(min(limit, len(files)))]


def int8(source: Path, out: Path, name: str, tensors: Iterator[NDArray[np.float32]]) -> None:
    """Static QDQ quantisation, calibrated on `tensors`."""
    import onnx
    from onnxruntime import quantization

    class Reader(quantization.CalibrationDataReader):  # type: ignore[misc]
        def get_next(self) -> dict[str, NDArray[np.float32]] | None:
            tensor = next(tensors, None)
            return None if tensor is None else {name: tensor}

    model = onnx.load(source)
    outputs = {o.name for o in model.graph.output}
    last = [node.name for node in model.graph.node if outputs & set(node.output)]
    with tempfile.TemporaryDirectory() as folder:
        ready = Path(folder) / "ready.onnx"
        quantization.quant_pre_process(source, ready, skip_symbolic_shape=True)
        quantization.quantize_static(
            ready,
            out,
            Reader(),
            quant_format=quantization.QuantFormat.QDQ,
            activation_type=quantization.QuantType.QUInt8,
            weight_type=quantization.QuantType.QInt8,
            per_channel=True,
            nodes_to_exclude=[n for n in last if n],
            op_types_to_quantize=["Conv", "MaxPool", "Concat", "Add", "Relu"],
            extra_options={"WeightSymmetric": True, "ActivationSymmetric": False},
        )


def bf16(source: Path, out: Path) -> None:
    """Large weights in bfloat16, each followed by a cast to float32."""
    import onnx

    model = onnx.load(source)
    narrow(model, "bfloat16")
    onnx.save(model, out)


def fp16(source: Path, out: Path) -> None:
    """Everything in float16 but inputs and outputs."""
    import onnx
    from onnxruntime.transformers.float16 import convert_float_to_float16

    onnx.save(convert_float_to_float16(onnx.load(source), keep_io_types=True), out)


def renew_card(text: str, variant: str, out: Path, digest: str) -> str:
    """The card's text with name, file and SHA-256 of the variant."""
    name = re.search(r'^name = "(.*)"$', text, re.M)
    if name is None:
        raise ValueError("card: expected a name")
    for key, value in (("name", f"{name[1]}-{variant}"), ("file", out.name), ("sha256", digest)):
        text = re.sub(rf'^{key} = ".*"$', f'{key} = "{value}"', text, count=1, flags=re.M)
    return text


def quantise(source: Path, out: Path, variant: str, *, calibration: Path | None = None, limit: int = 200) -> str:
    """Writes one variant and its card; returns the SHA-256. `calibration` is a folder of pictures, for `int8`."""
    card = source.with_suffix(".toml")
    for path in (source, card):
        if not path.is_file():
            raise FileNotFoundError(f"{path}: expected an exported network with its card beside it")
    if out.suffix != ".onnx":
        raise ValueError(f"{out}: expected a name that ends in .onnx")
    text = card.read_text()
    out.parent.mkdir(parents=True, exist_ok=True)
    if variant == "int8":
        if calibration is None:
            raise ValueError("calibration: expected a folder of pictures for int8")
        spec = Input.of_card(text)
        int8(source, out, spec.name, (spec.tensor(Image.open(p)) for p in pictures(calibration, limit)))
    elif variant in VARIANTS:
        {"bf16": bf16, "fp16": fp16}[variant](source, out)
    else:
        raise ValueError(f"variant: {variant!r}, expected one of {', '.join(VARIANTS)}")
    digest = hashlib.sha256(out.read_bytes()).hexdigest()
    out.with_suffix(".toml").write_text(renew_card(text, variant, out, digest))
    return digest


def run(options: argparse.Namespace) -> None:
    """`quantise`."""
    digest = quantise(options.model, options.out, options.variant, calibration=options.calibration, limit=options.limit)
    before, after = options.model.stat().st_size, options.out.stat().st_size
    print(f"{options.out}: {after} bytes instead of {before}, sha256 {digest}")
