"""Keypoint and limb orders of the networks, and the maps into them.

The part order is that of the OpenPose COCO model (18 parts and a background map). Its affinity fields come in
the channel order of the published COCO model, so that a decoder for one reads the other: limb `l` occupies the
channels `2 l` (x component) and `2 l + 1` (y component) and points from its first part to its second.
"""

from __future__ import annotations

from dataclasses import dataclass

PARTS: tuple[str, ...] = (
    "nose", "neck",
    "right_shoulder", "right_elbow", "right_wrist",
    "left_shoulder", "left_elbow", "left_wrist",
    "right_hip", "right_knee", "right_ankle",
    "left_hip", "left_knee", "left_ankle",
    "right_eye", "left_eye", "right_ear", "left_ear",
)  # fmt: skip

LIMBS: tuple[tuple[int, int], ...] = (
    (1, 8), (8, 9), (9, 10), (1, 11), (11, 12), (12, 13),
    (1, 2), (2, 3), (3, 4), (2, 16), (1, 5), (5, 6), (6, 7), (5, 17),
    (1, 0), (0, 14), (0, 15), (14, 16), (15, 17),
)  # fmt: skip

COCO17: tuple[str, ...] = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear",
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
    "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
)  # fmt: skip

NECK = PARTS.index("neck")
ARM_PARTS: tuple[int, ...] = tuple(
    PARTS.index(f"{side}_{joint}") for side in ("right", "left") for joint in ("shoulder", "elbow", "wrist")
)
UPPER_LIMB_PARTS: tuple[int, ...] = (0, 1, 2, 3, 4, 5, 6, 7)


@dataclass(frozen=True)
class Skeleton:
    """Parts and limbs one network speaks about.

    `parts[i]` names map `i`; the map after the last part is the background. `limbs` holds pairs of part indices,
    in the order of the affinity channels.
    """

    name: str
    parts: tuple[str, ...]
    limbs: tuple[tuple[int, int], ...]

    @property
    def part_maps(self) -> int:
        """Number of confidence maps, background included."""
        return len(self.parts) + 1

    @property
    def field_maps(self) -> int:
        """Number of affinity channels, two per limb."""
        return 2 * len(self.limbs)

    @property
    def mirror(self) -> tuple[int, ...]:
        """Part that takes the place of each part when the picture is mirrored."""

        def other(name: str) -> str:
            for here, there in (("left_", "right_"), ("right_", "left_")):
                if name.startswith(here):
                    return there + name.removeprefix(here)
            return name

        return tuple(self.parts.index(other(name)) for name in self.parts)


OPENPOSE18 = Skeleton("openpose-18", PARTS, LIMBS)
UPPER_LIMB = Skeleton(
    "upper-limb-8",
    tuple(PARTS[i] for i in UPPER_LIMB_PARTS),
    tuple(limb for limb in LIMBS if set(limb) <= set(UPPER_LIMB_PARTS)),
)

SKELETONS: dict[str, Skeleton] = {skeleton.name: skeleton for skeleton in (OPENPOSE18, UPPER_LIMB)}
