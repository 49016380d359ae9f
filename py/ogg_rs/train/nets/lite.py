"""`ogg-lite`: part maps and affinity fields for a CPU, about 0.2 giga multiply-adds at 256x192.

Three stride-2 convolutions bring the picture to stride 8 (16, 32, 48 channels); residual blocks whose second
convolution is dilated widen the view to most of the picture without another resolution, so that no resize is
needed. Two stages follow. The first reads the shared features F; the second reads F with the first stage's
maps and may correct them, which is what lets a limb seen clearly place a joint seen badly. Channel counts are
multiples of 16, the width of one AVX-512 register of floats: other counts cost the same and compute less.

Batch normalisation is used in training only; `fold_batch_norm` removes it before export.
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn

FEATURES = 48
DILATIONS = (1, 2, 4)
"""Dilation of the second convolution of each residual block. At stride 8 a dilation of 4 spans 64 input pixels
to each side; the three blocks and the stages together see about 400 pixels."""


class ConvBn(nn.Sequential):
    """3x3 convolution, batch normalisation and, where asked, a rectifier."""

    def __init__(self, inputs: int, outputs: int, *, stride: int = 1, dilation: int = 1, relu: bool = True) -> None:
        conv = nn.Conv2d(inputs, outputs, 3, stride, padding=dilation, dilation=dilation, bias=False)
        nn.init.kaiming_normal_(conv.weight, mode="fan_out", nonlinearity="relu")
        super().__init__(conv, nn.BatchNorm2d(outputs), *([nn.ReLU(inplace=True)] if relu else []))


class Residual(nn.Module):
    """`relu(x + conv(conv(x)))`, the second convolution dilated."""

    def __init__(self, channels: int, dilation: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            ConvBn(channels, channels), ConvBn(channels, channels, dilation=dilation, relu=False)
        )

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(x + self.body(x))


class Stage(nn.Module):
    """Trunk shared by both branches, then one 1x1 head per branch."""

    def __init__(self, inputs: int, dilations: tuple[int, ...], part_maps: int, field_maps: int) -> None:
        super().__init__()
        widths = [inputs] + [FEATURES] * len(dilations)
        self.trunk = nn.Sequential(
            *(ConvBn(a, b, dilation=d) for a, b, d in zip(widths, widths[1:], dilations, strict=False))
        )
        self.pcm = nn.Conv2d(FEATURES, part_maps, 1)
        self.paf = nn.Conv2d(FEATURES, field_maps, 1)
        for head in (self.pcm, self.paf):
            nn.init.normal_(head.weight, std=0.01)
            nn.init.zeros_(head.bias)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        y = self.trunk(x)
        return self.pcm(y), self.paf(y)


class OggLite(nn.Module):
    """The small network. See the module's description for the reasons behind its shape."""

    def __init__(self, part_maps: int, field_maps: int) -> None:
        super().__init__()
        self.stem = nn.Sequential(
            ConvBn(3, 16, stride=2),
            ConvBn(16, 32, stride=2),
            ConvBn(32, FEATURES, stride=2),
        )
        self.context = nn.Sequential(*(Residual(FEATURES, d) for d in DILATIONS))
        self.stages = nn.ModuleList(
            (
                Stage(FEATURES, (1,), part_maps, field_maps),
                Stage(FEATURES + part_maps + field_maps, (2, 1), part_maps, field_maps),
            )
        )

    def forward(self, image: Tensor) -> list[tuple[Tensor, Tensor]]:
        features = self.context(self.stem(image))
        first = self.stages[0](features)
        second = self.stages[1](torch.cat((features, *first), 1))
        return [first, second]


def fold_batch_norm(network: nn.Module) -> nn.Module:
    """A copy of `network` in evaluation mode with each batch normalisation folded into its convolution.

    The copy computes the same function: for `y = g (w x - m) / s + b` the convolution gets the kernel `g w / s`
    and the bias `b - g m / s`.
    """
    folded = copy.deepcopy(network).eval()
    for module in folded.modules():
        if isinstance(module, ConvBn):
            module[0] = nn.utils.fuse_conv_bn_eval(module[0], module[1])
            module[1] = nn.Identity()
    return folded
