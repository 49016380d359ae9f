"""Networks for the benchmark that are not committed: `models.py FOLDER` writes them there, with cards, once.

`ogg-vgg` is Table 1's network (py/ogg_rs/train/nets/vgg.py) at 368x368 with random weights, because a timing does not
depend on them; `ogg-vgg-int8` is its QDQ variant, calibrated on noise. Trained ones are measured where the folder that
OGG_POSE_MODELS names has them.
"""

import hashlib
import pathlib
import re
import sys

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

ROOT = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "py"))
from ogg_rs.train import quantise  # noqa: E402

SIZE = 368
STAGES = [(8, 16, 32, 64, 128), *[(16, 32, 64, 128, 256)] * 3, *[(32, 64, 128, 256, 512)] * 2]


class Builder:
    """Nodes and weights of a graph, one layer after the other."""

    def __init__(self):
        self.nodes, self.weights, self.random = [], [], np.random.default_rng(1)

    def node(self, kind, inputs, output=None, **attributes):
        output = output or f"t{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, inputs, [output], f"{kind}_{len(self.nodes)}", **attributes))
        return output

    def conv(self, x, inputs, outputs, kernel, output=None, share=1.0):
        name = f"w{len(self.weights)}"
        scale = np.sqrt(2.0 * share / (inputs * kernel * kernel))
        values = self.random.normal(0, scale, (outputs, inputs, kernel, kernel)).astype(np.float32)
        self.weights += [numpy_helper.from_array(values, name),
                         numpy_helper.from_array(np.zeros(outputs, np.float32), f"{name}b")]
        pad = kernel // 2
        return self.node("Conv", [x, name, f"{name}b"], output, kernel_shape=[kernel] * 2, pads=[pad] * 4)


def vgg():
    """The graph of `ogg-vgg`: input `image`, outputs `pcm` and `paf` of the last stage."""
    b = Builder()
    x, inputs = "image", 3
    for level, widths in enumerate([(64, 64), (128, 128), (256, 256, 256), (512, 512, 512)]):
        if level:
            x = b.node("MaxPool", [x], kernel_shape=[2, 2], strides=[2, 2])
            x = b.node("Relu", [b.conv(x, inputs, inputs, 1)])
        for width in widths:
            x = b.node("Relu", [b.conv(x, inputs, width, 3)])
            inputs = width
    for _ in range(3):
        x = b.node("Relu", [b.conv(x, 512, 512, 3)])
    features, states, width = x, {"pcm": x, "paf": x}, 512
    for stage, widths in enumerate(STAGES):
        for name, maps in (("pcm", 19), ("paf", 38)):
            y, inputs = states[name], width
            for outputs in widths:
                both = [b.conv(y, inputs, outputs, 3, share=0.5), b.conv(y, inputs, outputs, 1, share=0.5)]
                y, inputs = b.node("Relu", [b.node("Add", both)]), outputs
            states[name] = b.node("Concat", [features, y], axis=1)
            if stage + 1 == len(STAGES):
                b.conv(states[name], 512 + widths[-1], maps, 1, name, share=1e-3)
        width = 512 + widths[-1]
    cells = SIZE // 8
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, SIZE, SIZE])
    maps = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, c, cells, cells]) for n, c in (("pcm", 19), ("paf", 38))]
    graph = helper.make_graph(b.nodes, "ogg-vgg", [image], maps, b.weights)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


def main():
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    plain, small = folder / "ogg-vgg.onnx", folder / "ogg-vgg-int8.onnx"
    if small.with_suffix(".toml").is_file():
        return
    onnx.save(vgg(), plain)
    card = (ROOT / "crates/pose/models/ogg-lite.toml").read_text().split("[about]")[0]
    for key, value in (("width", SIZE), ("height", SIZE)):
        card = re.sub(rf"^{key} = .*$", f"{key} = {value}", card, count=1, flags=re.M)
    digest = hashlib.sha256(plain.read_bytes()).hexdigest()
    for key, value in (("name", "ogg-vgg"), ("file", plain.name), ("sha256", digest)):
        card = re.sub(rf'^{key} = ".*"$', f'{key} = "{value}"', card, count=1, flags=re.M)
    plain.with_suffix(".toml").write_text(card)
    noise = np.random.default_rng(2)
    tensors = (noise.uniform(-0.5, 0.5, (1, 3, SIZE, SIZE)).astype(np.float32) for _ in range(3))
    quantise.int8(plain, small, "image", tensors)
    digest = hashlib.sha256(small.read_bytes()).hexdigest()
    small.with_suffix(".toml").write_text(quantise.renew_card(card, "int8", small, digest))


main()
