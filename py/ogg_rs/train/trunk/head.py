"""The head: features of three resolutions, fused, and two stages of maps and fields."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..nets.lite import ConvBn
from . import FEATURES

WIDTH = 64


class Head(nn.Module):
    """From the trunk's features to `[(pcm, paf), (pcm, paf)]` at a quarter of the picture's sides.

    Each feature is normalised first: the trunk's maps differ in size by factors of ten. The trunk's own keypoint maps enter
    twice, as logits and as probabilities. The second stage reads the first one's maps, as in OpenPose.
    """

    def __init__(self, part_maps: int, field_maps: int) -> None:
        super().__init__()
        self.normalise = nn.ModuleList(nn.BatchNorm2d(channels) for _, channels, _ in FEATURES.values())
        channels = {name: count for name, (_, count, _) in FEATURES.items()}
        self.fine = nn.Conv2d(channels["fine"] + 2 * channels["heat"], WIDTH, 1)
        self.middle = nn.Conv2d(channels["middle"] + channels["middle_body"], WIDTH, 1)
        self.coarse = nn.Conv2d(channels["coarse"] + channels["coarse_body"], WIDTH, 1)
        self.mix = nn.Sequential(ConvBn(WIDTH, WIDTH), ConvBn(WIDTH, WIDTH, dilation=2))
        self.refine = nn.Sequential(
            nn.Conv2d(WIDTH + part_maps + field_maps, WIDTH, 1), nn.ReLU(), ConvBn(WIDTH, WIDTH, dilation=2), ConvBn(WIDTH, WIDTH)
        )
        self.pcm = nn.ModuleList(nn.Conv2d(WIDTH, part_maps, 1) for _ in range(2))
        self.paf = nn.ModuleList(nn.Conv2d(WIDTH, field_maps, 1) for _ in range(2))
        for answer in (*self.pcm, *self.paf):
            nn.init.normal_(answer.weight, std=0.01)
            nn.init.zeros_(answer.bias)

    def forward(self, *features: Tensor) -> list[tuple[Tensor, Tensor]]:
        fine, heat, middle, middle_body, coarse, coarse_body = (
            layer(value) for layer, value in zip(self.normalise, features, strict=True)
        )
        likely = torch.sigmoid(features[1])
        x = self.fine(torch.cat((fine, heat, 4 * likely), 1))
        for layer, parts, scale in ((self.middle, (middle, middle_body), 2.0), (self.coarse, (coarse, coarse_body), 4.0)):
            small = layer(torch.cat(parts, 1))
            x = x + functional.interpolate(small, scale_factor=scale, mode="bilinear", align_corners=False)
        x = self.mix(functional.relu(x))
        first = self.pcm[0](x), self.paf[0](x)
        y = self.refine(torch.cat((x, *first), 1))
        return [first, (self.pcm[1](y), self.paf[1](y))]
