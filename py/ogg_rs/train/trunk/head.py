"""The head: a linear first stage, and a second one that corrects it.

Everything happens at an eighth of the picture's sides. The trunk's maps at a quarter are folded (each two by two cells become four
channels), those at a sixteenth enlarged. The first stage is one linear map of what the trunk saw at a cell and around it, so its
best weights follow from a system of equations (`fitting.solve_first`). The second stage reads the same and the first one's maps and adds a
correction that starts at zero; it is trained by gradients.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..nets.lite import ConvBn
from . import FEATURES

WIDTH = 64
_CHANNELS = {name: count for name, (_, count, _) in FEATURES.items()}
AROUND = 4 * _CHANNELS["heat"] + 2 * (_CHANNELS["middle"] + _CHANNELS["middle_body"])
"""Channels that the first stage reads in the three by three cells around."""

AT = 4 * _CHANNELS["fine"] + 2 * (_CHANNELS["coarse"] + _CHANNELS["coarse_body"])
"""Channels that it reads at the cell alone."""


class Inputs(nn.Module):
    """The trunk's maps as `(around, at)` of the head: normalised, brought to one size, and joined by their positive halves."""

    def __init__(self) -> None:
        super().__init__()
        self.normalise = nn.ModuleList(nn.BatchNorm2d(count, affine=False, momentum=None) for count in _CHANNELS.values())

    def forward(self, *features: Tensor) -> tuple[Tensor, Tensor]:
        fine, _, middle, middle_body, coarse, coarse_body = (
            layer(value) for layer, value in zip(self.normalise, features, strict=True)
        )
        likely = functional.pixel_unshuffle(4 * torch.sigmoid(features[1]), 2)
        near = torch.cat((middle, middle_body), 1)
        far = functional.interpolate(
            torch.cat((coarse, coarse_body), 1), scale_factor=2.0, mode="bilinear", align_corners=False
        )
        around = torch.cat((likely, near, functional.relu(near)), 1)
        return around, torch.cat((functional.pixel_unshuffle(fine, 2), far, functional.relu(far)), 1)


class Head(nn.Module):
    """From the trunk's features to `[(pcm, paf), (pcm, paf)]` at an eighth of the picture's sides."""

    def __init__(self, part_maps: int, field_maps: int) -> None:
        super().__init__()
        self.part_maps = part_maps
        maps = part_maps + field_maps
        self.inputs = Inputs()
        self.around = nn.Conv2d(AROUND, maps, 3, padding=1)
        self.at = nn.Conv2d(AT, maps, 1, bias=False)
        self.refine = nn.Sequential(
            nn.Conv2d(AROUND + AT + maps, WIDTH, 1), nn.ReLU(), ConvBn(WIDTH, WIDTH, dilation=2), ConvBn(WIDTH, WIDTH)
        )
        self.correct = nn.Conv2d(WIDTH, maps, 1)
        nn.init.zeros_(self.correct.weight)
        nn.init.zeros_(self.correct.bias)

    def forward(self, *features: Tensor) -> list[tuple[Tensor, Tensor]]:
        around, at = self.inputs(*features)
        first = self.around(around) + self.at(at)
        second = first + self.correct(self.refine(torch.cat((around, at, first), 1)))
        return [self._parted(m) for m in (first, second)]

    def first(self, *features: Tensor) -> tuple[Tensor, Tensor]:
        """The first stage's answer alone."""
        around, at = self.inputs(*features)
        return self._parted(self.around(around) + self.at(at))

    def _parted(self, maps: Tensor) -> tuple[Tensor, Tensor]:
        return maps[:, : self.part_maps], maps[:, self.part_maps :]
