"""The two networks: `ogg-lite` for a CPU in real time, `ogg-vgg` as in Table 1 of the paper.

Both take a float picture `(batch, 3, height, width)` whose sides are multiples of 8 and return a list with one
`(pcm, paf)` pair per stage: `(batch, parts + 1, height / 8, width / 8)` and `(batch, 2 limbs, height / 8, width / 8)`.
The last pair is the answer; the earlier ones exist for supervision.
"""

from __future__ import annotations

from torch import nn

from ..skeleton import Skeleton
from .lite import OggLite, fold_batch_norm
from .vgg import OggVgg

STRIDE = 8
"""Input pixels per cell of the output maps, for both networks."""

NETWORKS: dict[str, type[nn.Module]] = {"ogg-lite": OggLite, "ogg-vgg": OggVgg}


def build(name: str, skeleton: Skeleton) -> nn.Module:
    """A freshly initialised network by name, for the parts and limbs of `skeleton`."""
    if name not in NETWORKS:
        raise ValueError(f"network: expected one of {sorted(NETWORKS)}, got {name!r}")
    return NETWORKS[name](skeleton.part_maps, skeleton.field_maps)


def parameter_count(network: nn.Module) -> int:
    """Number of trainable numbers in a network."""
    return sum(p.numel() for p in network.parameters() if p.requires_grad)


__all__ = ["NETWORKS", "STRIDE", "OggLite", "OggVgg", "build", "fold_batch_norm", "parameter_count"]
