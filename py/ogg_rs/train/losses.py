"""The loss of the paper, (1) and (2): masked squared error, summed over stages, maps and cells.

`f_S^t = sum_j sum_p W(p) |S_j^t(p) - S_j*(p)|^2`, the same for `f_L^t`, and `f = sum_t (f_S^t + f_L^t)`; divided by
the batch size, so that the learning rate does not depend on it.

`emphasis` multiplies the error of a cell by `1 + emphasis |target|` (for the background map: one minus the target). A
Gaussian covers about 1 % of a map, and with `emphasis = 0` (the paper's loss) a small network spends its first epochs
at the constant answer zero. Both forms have the same minimum for a network that can reach the targets.

`MapWeights` multiply whole maps: a network too small for all of them spends itself on those that matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .skeleton import ARM_PARTS, NECK, PARTS, Skeleton
from .targets import Maps


@dataclass(frozen=True)
class MapWeights:
    """A factor for each map: `pcm (parts + 1, 1, 1)`, `paf (2 limbs, 1, 1)`."""

    pcm: Tensor
    paf: Tensor

    @staticmethod
    def of_arms(skeleton: Skeleton, arms: float) -> MapWeights:
        """`arms` for shoulders, elbows, wrists and the limbs from the neck to them, one for all else."""
        names = {PARTS[i] for i in ARM_PARTS}
        parts = [arms if name in names else 1.0 for name in skeleton.parts]
        chain = {skeleton.parts.index(name) for name in (*names, PARTS[NECK])}
        limbs = [arms if set(limb) <= chain else 1.0 for limb in skeleton.limbs]
        pcm, paf = torch.tensor([*parts, 1.0]), torch.tensor(limbs).repeat_interleave(2)
        return MapWeights(pcm[:, None, None], paf[:, None, None])


def stage_losses(
    stages: list[tuple[Tensor, Tensor]], maps: Maps, *, emphasis: float = 0.0, weights: MapWeights | None = None
) -> list[tuple[Tensor, Tensor]]:
    """`(f_S^t, f_L^t)` of each stage, per picture."""
    batch = maps.pcm.shape[0]
    presence = maps.pcm.clone()
    presence[:, -1] = 1 - presence[:, -1]
    pcm_weight = maps.pcm_mask * (1 + emphasis * presence)
    strength = torch.hypot(maps.paf[:, 0::2], maps.paf[:, 1::2]).repeat_interleave(2, 1)
    paf_weight = maps.paf_mask * (1 + emphasis * strength)
    if weights is not None:
        pcm_weight, paf_weight = weights.pcm * pcm_weight, weights.paf * paf_weight
    return [
        (
            (pcm_weight * (pcm.to(maps.pcm.dtype) - maps.pcm) ** 2).sum() / batch,
            (paf_weight * (paf.to(maps.paf.dtype) - maps.paf) ** 2).sum() / batch,
        )
        for pcm, paf in stages
    ]


def total_loss(
    stages: list[tuple[Tensor, Tensor]], maps: Maps, *, emphasis: float = 0.0, weights: MapWeights | None = None
) -> Tensor:
    """`f` of (2)."""
    parts = [term for pair in stage_losses(stages, maps, emphasis=emphasis, weights=weights) for term in pair]
    return sum(parts[1:], parts[0])
