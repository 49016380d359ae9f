"""Training targets: part confidence maps, part affinity fields, the mask W, and label fusion (3).

Coordinates are continuous picture coordinates in pixels: the picture covers `[0, width] x [0, height]`, pixel `i`
covers `[i, i + 1]`, and cell `k` of a map covers `[8 k, 8 k + 8]`, its value standing for its centre `8 k + 4`.

`ogg_rs.pose.encode_targets` and the decoder count from the centre of the first pixel instead: their coordinates are
smaller by half a pixel, and the cells lie in the same places.

Confidence maps (Cao et al. 2017, eq. 6): `S_j(p) = max over people of exp(-|p - x_j|^2 / (2 sigma^2))`, and the
background map `1 - max_j S_j`. Affinity fields (eqs. 8-10): the unit vector from a limb's first joint to its
second, for every `p` within half a limb width of the segment between them, averaged over the people there.

The mask `W` is false where a label is missing (1), per map and cell:

- a joint whose place is known but which nobody is asked to see (`State.HIDDEN`: legs under the bench) is left out
  where it is, within `MASK_RADIUS` of its Gaussian; elsewhere the map must still be empty, so the network is neither
  taught to guess the joint nor allowed to invent it;
- a joint whose place is not known (`State.UNKNOWN`) leaves its map out all over the person's box;
- a joint outside the picture (`State.OUTSIDE`) leaves nothing out: the map must be empty there;
- a limb is labelled when both ends are; a limb with a hidden end is left out along its segment, one with an unknown end
  all over the person's box; the background map is left out wherever a part map is.

Arm joints covered by fabric with an exactly known place are labelled like visible ones.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from enum import IntEnum
from importlib.util import find_spec

import torch
from torch import Tensor

from .nets import STRIDE
from .skeleton import Skeleton

if find_spec("ogg_rs._native"):
    from ..pose import encode_targets
else:
    encode_targets = None
    logging.getLogger(__name__).warning("the native module is not built: PyTorch draws the labels, several times slower")

SIGMA_PX = 7.0
"""Width of the Gaussian in input pixels, that of the published OpenPose training. Much narrower than a cell, the peak
falls between cells and cannot be refined; much wider, neighbouring joints merge."""

LIMB_HALF_WIDTH_PX = 8.0
"""Half the width of an affinity field in input pixels: one cell, as in the published training."""

MASK_RADIUS = 3.0
"""Radius, in sigmas, of what a hidden joint leaves out. At 3 sigma the Gaussian has fallen to 0.011."""

FUSION_FLOOR = 0.1
"""Smallest teacher response that counts as a label where the annotation is missing. The decoder's peak floor."""


class State(IntEnum):
    """What is known about one joint of one person."""

    UNKNOWN = 0
    """In the picture or not, nobody knows where: not labelled."""
    HIDDEN = 1
    """The place is known, but the network is not asked for it."""
    OUTSIDE = 2
    """Not in the picture, or the person slot is empty."""
    LABELLED = 3
    """The place is known and is to be learnt, covered or not."""


@dataclass
class Maps:
    """Targets of one batch: `pcm (b, parts + 1, h, w)`, `paf (b, 2 limbs, h, w)` and the masks, bool of the same shapes."""

    pcm: Tensor
    paf: Tensor
    pcm_mask: Tensor
    paf_mask: Tensor


def encode(
    joints_px: Tensor,
    states: Tensor,
    boxes_px: Tensor,
    skeleton: Skeleton,
    size: tuple[int, int],
    *,
    sigma_px: float = SIGMA_PX,
    half_width_px: float = LIMB_HALF_WIDTH_PX,
    stride: int = STRIDE,
) -> Maps:
    """Targets and masks for a batch, one cell for `stride` pixels: the native encoder's where it is built, else
    `encode_in_torch`'s, which are the same numbers.

    `joints_px (b, people, parts, 2)`, `states (b, people, parts)` of `State`, `boxes_px (b, people, 4)` as
    x0, y0, x1, y1; `size` is the picture's (width, height). Empty person slots have all states `OUTSIDE`.
    """
    if size[0] % stride or size[1] % stride:
        raise ValueError(f"picture size: expected multiples of {stride}, got {size[0]}x{size[1]}")
    lengths = {"sigma_px": sigma_px, "half_width_px": half_width_px}
    if encode_targets is None:
        return encode_in_torch(joints_px, states, boxes_px, skeleton, size, stride=stride, **lengths)
    maps = encode_targets(
        (joints_px - 0.5).numpy(),
        states.to(torch.uint8).numpy(),
        (boxes_px - 0.5).numpy(),
        size=size,
        skeleton=skeleton.name,
        limbs=skeleton.limbs,
        stride=stride,
        **lengths,
    )
    return Maps(*map(torch.from_numpy, maps))


def encode_in_torch(
    joints_px: Tensor,
    states: Tensor,
    boxes_px: Tensor,
    skeleton: Skeleton,
    size: tuple[int, int],
    *,
    sigma_px: float = SIGMA_PX,
    half_width_px: float = LIMB_HALF_WIDTH_PX,
    stride: int = STRIDE,
) -> Maps:
    """`encode` without the native module."""
    width, height = (side // stride for side in size)
    x = (torch.arange(width, dtype=torch.float32) + 0.5) * stride
    y = (torch.arange(height, dtype=torch.float32) + 0.5) * stride
    labelled, hidden, unknown = (states == s for s in (State.LABELLED, State.HIDDEN, State.UNKNOWN))
    placed = torch.where((labelled | hidden)[..., None], joints_px, torch.zeros_like(joints_px))

    gx = torch.exp(-((x - placed[..., 0, None]) ** 2) / (2 * sigma_px**2))
    gy = torch.exp(-((y - placed[..., 1, None]) ** 2) / (2 * sigma_px**2))
    gaussian = gy[..., :, None] * gx[..., None, :]
    parts = (gaussian * labelled[..., None, None]).amax(1)
    pcm = torch.cat((parts, 1 - parts.amax(1, keepdim=True)), 1)

    in_box = (
        ((x >= boxes_px[..., 0, None]) & (x <= boxes_px[..., 2, None]))[..., None, :]
        & ((y >= boxes_px[..., 1, None]) & (y <= boxes_px[..., 3, None]))[..., :, None]
    )[:, :, None]
    near_hidden = (gaussian > torch.exp(torch.tensor(-(MASK_RADIUS**2) / 2))) & hidden[..., None, None]
    part_out = (near_hidden | (in_box & unknown[..., None, None])).any(1)
    background_out = near_hidden.any(1).any(1, keepdim=True) | (
        (in_box & unknown[..., None, None]).any(1).any(1, keepdim=True) & (pcm[:, -1:] > 0.5)
    )
    pcm_mask = ~torch.cat((part_out, background_out), 1)

    ends = torch.tensor(skeleton.limbs)
    a, b = placed[:, :, ends[:, 0]], placed[:, :, ends[:, 1]]
    state_a, state_b = states[:, :, ends[:, 0]], states[:, :, ends[:, 1]]
    along = b - a
    length = along.norm(dim=-1)
    unit = along / length.clamp(min=1e-3)[..., None]
    dx = x - a[..., 0, None]
    dy = y - a[..., 1, None]
    ux, uy = unit[..., 0, None, None], unit[..., 1, None, None]
    forward = dx[..., None, :] * ux + dy[..., :, None] * uy
    sideways = dx[..., None, :] * uy - dy[..., :, None] * ux
    on_limb = (forward >= 0) & (forward <= length[..., None, None]) & (sideways.abs() <= half_width_px)

    limb_labelled = (state_a == State.LABELLED) & (state_b == State.LABELLED)
    has_place_a, has_place_b = ((s == State.LABELLED) | (s == State.HIDDEN) for s in (state_a, state_b))
    limb_placed = has_place_a & has_place_b
    limb_unknown = ((state_a == State.UNKNOWN) & (state_b != State.OUTSIDE)) | (
        (state_b == State.UNKNOWN) & (state_a != State.OUTSIDE)
    )
    members = on_limb & limb_labelled[..., None, None]
    count = members.sum(1).clamp(min=1)
    fields = torch.stack(
        ((members * unit[..., 0, None, None]).sum(1) / count, (members * unit[..., 1, None, None]).sum(1) / count), 2
    )
    limb_out = (
        (on_limb & (limb_placed & ~limb_labelled)[..., None, None]) | (in_box & limb_unknown[..., None, None])
    ).any(1)
    paf = fields.flatten(1, 2)
    paf_mask = (~limb_out).repeat_interleave(2, 1)
    return Maps(pcm, paf, pcm_mask, paf_mask)


def fuse(labels: Maps, teacher_pcm: Tensor, teacher_paf: Tensor, *, floor: float = FUSION_FLOOR) -> Maps:
    """Labels corrected by a teacher's maps (3).

    `S_LC = max(S*, S_T)` per cell; `L_LC` is whichever of `L*` and `L_T` has the larger 2-norm, per cell and limb. The
    background follows from the fused part maps. A cell left out by W counts again where the teacher answers with at
    least `floor`: a fused label is a label. Without this W would hide exactly the covered joints that fusion restores.
    """
    parts = torch.maximum(labels.pcm[:, :-1], teacher_pcm[:, :-1].clamp(0, 1))
    pcm = torch.cat((parts, 1 - parts.amax(1, keepdim=True)), 1)
    answered = torch.cat((teacher_pcm[:, :-1] >= floor, (teacher_pcm[:, :-1] >= floor).any(1, keepdim=True)), 1)
    pcm_mask = labels.pcm_mask | answered

    own = labels.paf.unflatten(1, (-1, 2))
    other = teacher_paf.unflatten(1, (-1, 2))
    own_norm, other_norm = own.norm(dim=2, keepdim=True), other.norm(dim=2, keepdim=True)
    paf = torch.where(own_norm > other_norm, own, other).flatten(1, 2)
    field_answered = (other_norm >= floor).expand_as(own).flatten(1, 2)
    paf_mask = labels.paf_mask | field_answered
    return Maps(pcm, paf, pcm_mask, paf_mask)
