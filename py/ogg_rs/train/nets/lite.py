"""`ogg-lite`: part maps and affinity fields for a CPU, about 0.47 giga multiply-adds at 256x192.

Three stride-2 convolutions bring the picture to stride 8, where the maps are drawn. Whose arm is whose is seen from further away: two
more levels, at strides 16 and 32, are added back level by level, each brought up by a transposed convolution whose kernel is its
stride, so that no resize is needed, on which runtimes differ. Most of the weights lie where cells are few, most of the work where the
maps are. Two stages follow. The first reads the shared features F; the second reads F with the first stage's
maps and may correct them, which is what lets a limb seen clearly place a joint seen badly. Channel counts are
multiples of 16, the width of one AVX-512 register of floats: other counts cost the same and compute less.

Batch normalisation is used in training only; `fold_batch_norm` removes it before export.
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn

WIDTHS = (64, 96, 128)
"""Channels at strides 8, 16 and 32."""

COARSEST = (1, 2, 1, 2, 1, 1)
"""Dilations of the blocks at stride 32, where the whole person is in view and work is cheap: 14 million multiply-adds a
block at 256x192."""

MULTIPLE = 32
"""Width and height of the picture are multiples of this: the coarsest stride."""


class ConvBn(nn.Sequential):
    """3x3 convolution, batch normalisation and, where asked, a rectifier."""

    def __init__(self, inputs: int, outputs: int, *, stride: int = 1, dilation: int = 1, relu: bool = True) -> None:
        conv = nn.Conv2d(inputs, outputs, 3, stride, padding=dilation, dilation=dilation, bias=False)
        nn.init.kaiming_normal_(conv.weight, mode="fan_out", nonlinearity="relu")
        super().__init__(conv, nn.BatchNorm2d(outputs), *([nn.ReLU(inplace=True)] if relu else []))


class Residual(nn.Module):
    """`relu(x + conv(conv(x)))`, the second convolution dilated. It begins as the identity of what a rectifier gave: a
    block put after others changes nothing until it has learnt something."""

    def __init__(self, channels: int, dilation: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            ConvBn(channels, channels), ConvBn(channels, channels, dilation=dilation, relu=False)
        )
        nn.init.zeros_(self.body[1][1].weight)

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(x + self.body(x))


class Level(nn.Module):
    """One stride coarser: work there, and the result added to what came in."""

    def __init__(self, widths: tuple[int, ...], inner: nn.Module | None) -> None:
        super().__init__()
        fine, coarse = widths[:2]
        self.down = ConvBn(fine, coarse, stride=2)
        dilations = (1, 1) if inner is not None else COARSEST
        self.before = nn.Sequential(*(Residual(coarse, dilation) for dilation in dilations))
        self.inner = inner
        self.after = Residual(coarse, 1) if inner is not None else nn.Identity()
        self.up = nn.ConvTranspose2d(coarse, fine, 2, 2)

    def forward(self, x: Tensor) -> Tensor:
        y = self.before(self.down(x))
        if self.inner is not None:
            y = self.after(self.inner(y))
        return torch.relu(x + self.up(y))


class Stage(nn.Module):
    """Trunk shared by both branches, then one 1x1 head per branch."""

    def __init__(self, inputs: int, dilations: tuple[int, ...], part_maps: int, field_maps: int) -> None:
        super().__init__()
        width = WIDTHS[0]
        widths = [inputs] + [width] * len(dilations)
        self.trunk = nn.Sequential(
            *(ConvBn(a, b, dilation=d) for a, b, d in zip(widths, widths[1:], dilations, strict=False))
        )
        self.pcm = nn.Conv2d(width, part_maps, 1)
        self.paf = nn.Conv2d(width, field_maps, 1)
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
        width = WIDTHS[0]
        self.stem = nn.Sequential(
            ConvBn(3, 16, stride=2),
            ConvBn(16, 32, stride=2),
            ConvBn(32, width, stride=2),
            Residual(width, 1),
        )
        self.context = Level(WIDTHS, Level(WIDTHS[1:], None))
        self.refine = Residual(width, 1)
        self.stages = nn.ModuleList(
            (
                Stage(width, (1,), part_maps, field_maps),
                Stage(width + part_maps + field_maps, (2, 1), part_maps, field_maps),
            )
        )

    def forward(self, image: Tensor) -> list[tuple[Tensor, Tensor]]:
        height, width = image.shape[-2:]
        if not torch.jit.is_tracing() and (height % MULTIPLE or width % MULTIPLE):
            raise ValueError(f"picture: expected sides that are multiples of {MULTIPLE}, got {width}x{height}")
        features = self.refine(self.context(self.stem(image)))
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
