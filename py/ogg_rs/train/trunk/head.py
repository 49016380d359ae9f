"""The head: a linear first stage for all maps, and a second one that draws the affinity fields anew.

Everything happens at an eighth of the picture's sides. The trunk's maps at a quarter are folded (each two by two cells become four
channels), those at a sixteenth enlarged. The first stage is one linear map of what the trunk saw at a cell and around it, so its
best weights follow from a system of equations (`fitting.solve_first`). A field is not linear in what joints look like: it lies between two of
them, wherever they are. So the second stage reads where the trunk and the first stage see joints, within 70 pixels, and adds to the
fields a correction that starts at zero and is trained by gradients. The part maps stay those of the first stage.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..nets.lite import ConvBn
from . import FEATURES

WIDTH = 32
"""Channels of the second stage."""

DILATIONS = (1, 2, 4, 1)
"""Of its convolutions."""

LIKELY = 4 * 17
"""Channels of the trunk's own keypoint maps, folded."""

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


class Fields(nn.Module):
    """The second stage: from where joints are seen to a correction of the fields."""

    def __init__(self, part_maps: int, field_maps: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(LIKELY + part_maps + field_maps, WIDTH, 1), nn.ReLU(),
            *(ConvBn(WIDTH, WIDTH, dilation=d) for d in DILATIONS),
        )  # fmt: skip
        self.correct = nn.Conv2d(WIDTH, field_maps, 1)
        nn.init.zeros_(self.correct.weight)
        nn.init.zeros_(self.correct.bias)

    def forward(self, seen: Tensor) -> Tensor:
        return self.correct(self.body(seen))


class Head(nn.Module):
    """From the trunk's features to `(pcm, paf)` of both stages, at an eighth of the picture's sides."""

    def __init__(self, part_maps: int, field_maps: int) -> None:
        super().__init__()
        self.part_maps = part_maps
        self.inputs = Inputs()
        self.around = nn.Conv2d(AROUND, part_maps + field_maps, 3, padding=1)
        self.at = nn.Conv2d(AT, part_maps + field_maps, 1, bias=False)
        self.fields = Fields(part_maps, field_maps)

    def forward(self, *features: Tensor) -> list[tuple[Tensor, Tensor]]:
        seen = self.seen(*features)
        pcm, paf = self.first_of(seen)
        return [(pcm, paf), (pcm, paf + self.fields(seen))]

    def first(self, *features: Tensor) -> tuple[Tensor, Tensor]:
        """The first stage's answer alone."""
        return self.first_of(self.seen(*features))

    def seen(self, *features: Tensor) -> Tensor:
        """What the second stage reads: the trunk's own keypoint maps, then the first stage's maps."""
        around, at = self.inputs(*features)
        return torch.cat((around[:, :LIKELY], self.around(around) + self.at(at)), 1)

    def first_of(self, seen: Tensor) -> tuple[Tensor, Tensor]:
        """The first stage's answer within what the second one reads."""
        return seen[:, LIKELY : LIKELY + self.part_maps], seen[:, LIKELY + self.part_maps :]
