"""`ogg-vgg`: the network of the paper's Table 1, as exactly as the text allows.

Fixed by the table and the text: the first ten convolutions of VGG-16 (512 channels, stride 8), three 3x3
convolutions giving F (512); six stages of two branches; five convolutions C1..C5 per branch and stage with the
widths below; the output of a stage is F joined with the branch's C5 (640, 768, 768, 768, 1024, 1024 channels)
and feeds the same branch of the next stage; each branch is residual; each stage is supervised (1)(2).

Where the text is vague, this file decides, and only this file:

- *"first 10 layers of VGG-16"*: its first ten convolutions, 2 + 2 + 3 + 3, the last being conv4_3 by VGG-16's
  names. (In VGG-19, which OpenPose uses, the tenth is called conv4_2; width and stride are the same.)
- *"max pooling uses 1x1 convolution kernels, which make the network deeper"*: each of the three poolings between
  them is the usual 2x2 maximum followed by a 1x1 convolution and a rectifier. It starts as the identity, so that
  pretrained VGG-16 weights mean at the first step what they meant where they were trained.
- *Kernel size of C1..C5*: 3x3, the size the text names for F. With 30 of them in a row the view covers the picture.
- *"residual network structure"*: each convolution has its own skip, `relu(conv3x3(x) + project(x))`, with a 1x1
  projection because every width differs from the one before it.
- *Input of stage 1*: F alone (512 channels).
- *Heads*: one 1x1 convolution per branch and stage on that branch's output (F joined with C5), so that the 128
  channels of the first stage need not carry what F already says.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

VGG16_TEN: tuple[tuple[int, ...], ...] = ((64, 64), (128, 128), (256, 256, 256), (512, 512, 512))
"""Widths of VGG-16's first ten convolutions, one tuple per resolution, a pooling between two."""

F_CHANNELS = 512

STAGE_WIDTHS: tuple[tuple[int, int, int, int, int], ...] = (
    (8, 16, 32, 64, 128),
    (16, 32, 64, 128, 256),
    (16, 32, 64, 128, 256),
    (16, 32, 64, 128, 256),
    (32, 64, 128, 256, 512),
    (32, 64, 128, 256, 512),
)
"""C1..C5 of each stage, Table 1."""


def conv_relu(inputs: int, outputs: int) -> nn.Sequential:
    """3x3 convolution and rectifier, initialised as He et al. (2015) for that pair."""
    conv = nn.Conv2d(inputs, outputs, 3, padding=1)
    nn.init.kaiming_normal_(conv.weight, nonlinearity="relu")
    nn.init.zeros_(conv.bias)
    return nn.Sequential(conv, nn.ReLU(inplace=True))


class Pool(nn.Sequential):
    """2x2 maximum, then a 1x1 convolution that starts as the identity, then a rectifier."""

    def __init__(self, channels: int) -> None:
        mix = nn.Conv2d(channels, channels, 1)
        nn.init.dirac_(mix.weight)
        nn.init.zeros_(mix.bias)
        super().__init__(nn.MaxPool2d(2), mix, nn.ReLU(inplace=True))


class ResidualConv(nn.Module):
    """`relu(conv3x3(x) + project1x1(x))`."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, 3, padding=1)
        self.project = nn.Conv2d(inputs, outputs, 1, bias=False)
        for conv in (self.conv, self.project):
            # Two terms are summed: each gets half of He's variance, so that the sum keeps the input's scale.
            nn.init.kaiming_normal_(conv.weight, nonlinearity="linear")
        nn.init.zeros_(self.conv.bias)

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(self.conv(x) + self.project(x))


class Branch(nn.Module):
    """One branch of one stage: C1..C5, the output joined with F, and the head that is supervised."""

    def __init__(self, inputs: int, widths: tuple[int, ...], maps: int) -> None:
        super().__init__()
        steps = (inputs, *widths)
        self.convs = nn.Sequential(*(ResidualConv(a, b) for a, b in zip(steps, steps[1:], strict=False)))
        self.head = nn.Conv2d(F_CHANNELS + widths[-1], maps, 1)
        nn.init.normal_(self.head.weight, std=0.01)
        nn.init.zeros_(self.head.bias)

    def forward(self, features: Tensor, x: Tensor) -> tuple[Tensor, Tensor]:
        output = torch.cat((features, self.convs(x)), 1)
        return output, self.head(output)


class OggVgg(nn.Module):
    """Table 1's network. See the module's description for what the paper fixes and what is decided here."""

    def __init__(self, part_maps: int, field_maps: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        inputs = 3
        for level, widths in enumerate(VGG16_TEN):
            if level > 0:
                layers.append(Pool(inputs))
            for width in widths:
                layers.append(conv_relu(inputs, width))
                inputs = width
        self.vgg = nn.Sequential(*layers)
        self.deep = nn.Sequential(*(conv_relu(F_CHANNELS, F_CHANNELS) for _ in range(3)))
        stage_inputs = [F_CHANNELS] + [F_CHANNELS + widths[-1] for widths in STAGE_WIDTHS[:-1]]
        self.pcm_branches, self.paf_branches = (
            nn.ModuleList(Branch(i, widths, maps) for i, widths in zip(stage_inputs, STAGE_WIDTHS, strict=True))
            for maps in (part_maps, field_maps)
        )

    def features(self, image: Tensor) -> Tensor:
        """The maps F: `(batch, 512, height / 8, width / 8)`."""
        return self.deep(self.vgg(image))

    def forward(self, image: Tensor) -> list[tuple[Tensor, Tensor]]:
        features = self.features(image)
        pcm_state = paf_state = features
        stages = []
        for pcm_branch, paf_branch in zip(self.pcm_branches, self.paf_branches, strict=True):
            pcm_state, pcm = pcm_branch(features, pcm_state)
            paf_state, paf = paf_branch(features, paf_state)
            stages.append((pcm, paf))
        return stages
