"""The loss of the paper, (1) and (2): masked squared error, summed over stages, maps and cells.

`f_S^t = sum_j sum_p W(p) |S_j^t(p) - S_j*(p)|^2`, the same for `f_L^t`, and `f = sum_t (f_S^t + f_L^t)`; divided by
the batch size, so that the learning rate does not depend on it.

`emphasis` multiplies the error of a cell by `1 + emphasis |target|` (for the background map: one minus the target). A
Gaussian covers about 1 % of a map, and with `emphasis = 0` (the paper's loss) a small network spends its first epochs
at the constant answer zero. Both forms have the same minimum for a network that can reach the targets.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .targets import Maps


def stage_losses(stages: list[tuple[Tensor, Tensor]], maps: Maps, *, emphasis: float = 0.0) -> list[tuple[Tensor, Tensor]]:
    """`(f_S^t, f_L^t)` of each stage, per picture."""
    batch = maps.pcm.shape[0]
    presence = maps.pcm.clone()
    presence[:, -1] = 1 - presence[:, -1]
    pcm_weight = maps.pcm_mask * (1 + emphasis * presence)
    strength = torch.hypot(maps.paf[:, 0::2], maps.paf[:, 1::2]).repeat_interleave(2, 1)
    paf_weight = maps.paf_mask * (1 + emphasis * strength)
    return [
        (
            (pcm_weight * (pcm.to(maps.pcm.dtype) - maps.pcm) ** 2).sum() / batch,
            (paf_weight * (paf.to(maps.paf.dtype) - maps.paf) ** 2).sum() / batch,
        )
        for pcm, paf in stages
    ]


def total_loss(stages: list[tuple[Tensor, Tensor]], maps: Maps, *, emphasis: float = 0.0) -> Tensor:
    """`f` of (2)."""
    parts = [term for pair in stage_losses(stages, maps, emphasis=emphasis) for term in pair]
    return sum(parts[1:], parts[0])
