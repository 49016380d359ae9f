"""Shapes, widths and sizes of the two networks, and that folding and exporting change nothing."""

from __future__ import annotations

import copy
from pathlib import Path

from train_support import require_training_packages

require_training_packages()

import numpy as np
import pytest
import torch

from ogg_rs.train.engine import start_from
from ogg_rs.train.export import LastStage, export
from ogg_rs.train.nets import OggLite, OggVgg, fold_batch_norm, lite, parameter_count
from ogg_rs.train.nets.lite import Residual
from ogg_rs.train.nets.vgg import F_CHANNELS, STAGE_WIDTHS, VGG16_TEN, Pool
from ogg_rs.train.storage import LARGE


def test_ogg_lite_answers_in_two_stages_of_19_and_38_maps_at_stride_8() -> None:
    stages = OggLite(19, 38)(torch.zeros(2, 3, 96, 128))
    assert [(tuple(s.shape), tuple(f.shape)) for s, f in stages] == [((2, 19, 12, 16), (2, 38, 12, 16))] * 2


def test_ogg_vgg_answers_in_six_stages_of_19_and_38_maps_at_stride_8() -> None:
    network = OggVgg(19, 38).eval()
    with torch.no_grad():
        stages = network(torch.zeros(1, 3, 32, 48))
        assert network.features(torch.zeros(1, 3, 32, 48)).shape == (1, 512, 4, 6)
    assert [(tuple(s.shape), tuple(f.shape)) for s, f in stages] == [((1, 19, 4, 6), (1, 38, 4, 6))] * 6


def test_ogg_vgg_stage_outputs_have_the_widths_of_table_1() -> None:
    with torch.device("meta"):
        network = OggVgg(19, 38)
    for branches in (network.pcm_branches, network.paf_branches):
        assert [branch.head.in_channels for branch in branches] == [640, 768, 768, 768, 1024, 1024]
        assert [branch.convs[0].conv.in_channels for branch in branches] == [512, 640, 768, 768, 768, 1024]
        widths = [tuple(c.conv.out_channels for c in branch.convs) for branch in branches]
        assert widths == [
            (8, 16, 32, 64, 128),
            (16, 32, 64, 128, 256),
            (16, 32, 64, 128, 256),
            (16, 32, 64, 128, 256),
            (32, 64, 128, 256, 512),
            (32, 64, 128, 256, 512),
        ]


def test_ogg_vgg_has_as_many_parameters_as_its_layers_add_up_to() -> None:
    def conv(inputs: int, outputs: int, kernel: int, bias: bool = True) -> int:
        return inputs * outputs * kernel * kernel + (outputs if bias else 0)

    total, inputs = 0, 3
    for level, widths in enumerate(VGG16_TEN):
        total += conv(inputs, inputs, 1) if level else 0
        for width in widths:
            total += conv(inputs, width, 3)
            inputs = width
    total += 3 * conv(512, 512, 3)
    for maps in (19, 38):
        inputs = F_CHANNELS
        for widths in STAGE_WIDTHS:
            for width in widths:
                total += conv(inputs, width, 3) + conv(inputs, width, 1, bias=False)
                inputs = width
            inputs += F_CHANNELS
            total += conv(inputs, maps, 1)
    with torch.device("meta"):
        network = OggVgg(19, 38)
    assert parameter_count(network) == total
    assert sum(1 for widths in VGG16_TEN for _ in widths) == 10


def test_the_1x1_pooling_convolution_starts_as_the_identity() -> None:
    x = torch.rand(1, 64, 8, 8)
    assert torch.allclose(Pool(64)(x), torch.nn.functional.max_pool2d(x, 2), atol=1e-6)


def trained_looking(network: OggLite) -> OggLite:
    """Batch normalisations away from their start, so that folding has something to fold."""
    generator = torch.Generator().manual_seed(1)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.copy_(torch.randn(module.num_features, generator=generator) * 0.2)
            module.running_var.copy_(torch.rand(module.num_features, generator=generator) + 0.5)
            with torch.no_grad():
                module.weight.copy_(torch.rand(module.num_features, generator=generator) + 0.5)
                module.bias.copy_(torch.randn(module.num_features, generator=generator) * 0.2)
    for stage in network.stages:
        for head in (stage.pcm, stage.paf):
            torch.nn.init.normal_(head.bias, std=0.1, generator=generator)
    return network.eval()


def test_folding_batch_normalisation_keeps_the_function() -> None:
    network = trained_looking(OggLite(19, 38))
    folded = fold_batch_norm(network)
    assert not any(isinstance(m, torch.nn.BatchNorm2d) for m in folded.modules())
    x = torch.rand(1, 3, 64, 64, generator=torch.Generator().manual_seed(2)) - 0.5
    with torch.no_grad():
        for before, after in zip(network(x)[-1], folded(x)[-1], strict=True):
            assert (before - after).abs().max() < 1e-4


def test_the_exported_network_agrees_with_pytorch_and_has_a_fixed_shape(tmp_path: Path) -> None:
    import onnx
    import onnxruntime

    network = trained_looking(OggLite(19, 38))
    path = tmp_path / "lite.onnx"
    digest = export(network, (64, 32), path, metadata={"network": "ogg-lite"})
    assert len(digest) == 64
    proto = onnx.load(path)
    assert 13 <= proto.opset_import[0].version <= 17
    assert {node.op_type for node in proto.graph.node} <= {"Conv", "ConvTranspose", "Relu", "Add", "Concat"}
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    assert session.get_inputs()[0].shape == [1, 3, 32, 64]
    assert [(o.name, o.shape) for o in session.get_outputs()] == [("pcm", [1, 19, 4, 8]), ("paf", [1, 38, 4, 8])]
    x = torch.rand(1, 3, 32, 64, generator=torch.Generator().manual_seed(3)) - 0.5
    with torch.no_grad():
        expected = LastStage(network)(x)
    for want, got in zip(expected, session.run(None, {"image": x.numpy()}), strict=True):
        assert abs(want.numpy() - got).max() < 1e-4


def test_half_precision_halves_the_file_and_answers_as_the_rounded_network(tmp_path: Path) -> None:
    import onnx
    import onnxruntime

    network = trained_looking(OggLite(19, 38))
    before = copy.deepcopy(network.state_dict())
    export(network, (64, 32), tmp_path / "whole.onnx")
    export(network, (64, 32), tmp_path / "half.onnx", half=True)
    assert all(torch.equal(a, b) for a, b in zip(before.values(), network.state_dict().values(), strict=True))
    sizes = [(tmp_path / name).stat().st_size for name in ("half.onnx", "whole.onnx")]
    assert sizes[0] < 0.52 * sizes[1]
    stored = {t.name: onnx.numpy_helper.to_array(t) for t in onnx.load(tmp_path / "half.onnx").graph.initializer}
    whole = {t.name: onnx.numpy_helper.to_array(t) for t in onnx.load(tmp_path / "whole.onnx").graph.initializer}
    assert len(stored) == len(whole)
    for name, values in whole.items():
        if values.size < LARGE:
            assert np.array_equal(stored[name], values)
        else:
            assert np.array_equal(stored[f"{name}:float16"], values.astype(np.float16))
    x = torch.rand(1, 3, 32, 64, generator=torch.Generator().manual_seed(3)) - 0.5
    answers = [
        onnxruntime.InferenceSession(tmp_path / name, providers=["CPUExecutionProvider"]).run(None, {"image": x.numpy()})
        for name in ("whole.onnx", "half.onnx")
    ]
    for a, b in zip(*answers, strict=True):
        assert 0 < np.abs(a - b).max() < 2e-3 * np.abs(a).max()


def test_weights_too_large_for_half_precision_are_named(tmp_path: Path) -> None:
    network = OggLite(19, 38)
    with torch.no_grad():
        network.stages[1].pcm.weight[0, 0] = 1e5
    with pytest.raises(ArithmeticError, match=r"stages.1.pcm.weight: expected weights of at most 65504.0 for float16, got 100000"):
        export(network, (64, 32), tmp_path / "large.onnx", half=True)


def test_a_new_residual_block_changes_nothing() -> None:
    x = torch.relu(torch.randn(2, 16, 5, 6, generator=torch.Generator().manual_seed(1)))
    assert torch.equal(Residual(16, 2)(x), x)


def test_a_network_starts_from_one_with_fewer_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as smaller:
        smaller.setattr(lite, "COARSEST", lite.COARSEST[:2])
        small = trained_looking(OggLite(19, 38))
    torch.save({"average": small.state_dict()}, tmp_path / "small.pt")
    large = OggLite(19, 38)
    assert start_from(large, [tmp_path / "small.pt"]) == [f"context.inner.before.{i}" for i in range(2, len(lite.COARSEST))]
    x = torch.rand(1, 3, 64, 64, generator=torch.Generator().manual_seed(2)) - 0.5
    with torch.no_grad():
        for before, after in zip(small(x)[-1], large.eval()(x)[-1], strict=True):
            assert torch.equal(before, after)
    torch.save({"average": large.state_dict()}, tmp_path / "large.pt")
    assert start_from(OggLite(19, 38), [tmp_path / "large.pt"]) == []
    with pytest.raises(ValueError, match=r"large.pt: expected .* fewer residual blocks, they differ in context.inner.before.2"):
        start_from(small, [tmp_path / "large.pt"])


def test_several_starts_are_averaged(tmp_path: Path) -> None:
    states = []
    for k in range(3):
        torch.manual_seed(k)
        states.append(OggLite(19, 38).state_dict())
        torch.save({"average": states[-1]}, tmp_path / f"{k}.pt")
    network = OggLite(19, 38)
    assert start_from(network, [tmp_path / f"{k}.pt" for k in range(3)]) == []
    for name, values in network.state_dict().items():
        if values.is_floating_point():
            torch.testing.assert_close(values, sum(state[name] for state in states) / 3)


def test_weights_of_another_network_are_no_start(tmp_path: Path) -> None:
    torch.save({"average": OggLite(9, 12).state_dict()}, tmp_path / "arms.pt")
    with pytest.raises(ValueError, match=r"arms.pt: expected weights of this network.*stages.0.pcm.weight"):
        start_from(OggLite(19, 38), [tmp_path / "arms.pt"])
    state = OggLite(19, 38).state_dict()
    del state["stem.0.0.weight"]
    torch.save({"average": state}, tmp_path / "stem.pt")
    with pytest.raises(ValueError, match=r"they differ in stem.0.0.weight$"):
        start_from(OggLite(19, 38), [tmp_path / "stem.pt"])


def test_ogg_lite_names_the_sides_it_takes() -> None:
    with pytest.raises(ValueError, match="multiples of 32, got 64x40"):
        OggLite(19, 38)(torch.zeros(1, 3, 40, 64))
