"""Trains the small pose network on pictures of synthetic workers: a first look at the loop, not a finished network.

Pictures and labels come from the simulated worker, targets are encoded in Rust on all cores. With more pictures and
steps than the defaults the loss goes on falling; `python -m ogg_rs.train` is the full training.
"""

import argparse

import numpy as np
import torch

from ogg_rs import pose, sim
from ogg_rs.train.nets import build
from ogg_rs.train.skeleton import OPENPOSE18

SIZE = (256, 192)


def batch(seeds: range) -> tuple[torch.Tensor, pose.TargetMaps]:
    frames = list(sim.random_frames(seeds, size=SIZE))
    joints = np.stack([frame.joints_px[np.newaxis] for frame in frames])
    visibility = np.stack([frame.visibility[np.newaxis] for frame in frames])
    # Covered joints are labelled, too: their places are known exactly.
    states = np.where(visibility > 0, pose.State.LABELLED, pose.State.OUTSIDE).astype(np.uint8)
    boxes = np.stack([frame.box_px[np.newaxis] for frame in frames])
    boxes[..., 2:] += boxes[..., :2]
    targets = pose.encode_targets(joints, states, np.nan_to_num(boxes), size=SIZE)
    bgr = np.stack([frame.image[:, :, ::-1] for frame in frames]).astype(np.float32)
    return torch.from_numpy(np.ascontiguousarray((bgr - 128.0) / 256.0).transpose(0, 3, 1, 2)), targets


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--batch", type=int, default=8)
    arguments = parser.parse_args()
    torch.manual_seed(0)
    network = build("ogg-lite", OPENPOSE18)
    optimiser = torch.optim.AdamW(network.parameters(), lr=2e-3)
    for step in range(arguments.steps):
        start = step * arguments.batch
        pictures, targets = batch(range(start, start + arguments.batch))
        pcm, paf, pcm_mask, paf_mask = (torch.from_numpy(array) for array in targets)
        loss = torch.zeros(())
        for stage_pcm, stage_paf in network(pictures):
            loss = loss + ((stage_pcm - pcm).square() * pcm_mask).mean()
            loss = loss + ((stage_paf - paf).square() * paf_mask).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        print(f"step {step}: loss {loss.item():.5f}", flush=True)


if __name__ == "__main__":
    main()
