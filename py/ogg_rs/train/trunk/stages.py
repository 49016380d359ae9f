"""Gradients for the second stage of a head, on answers of its first that are computed already: seeded, resumable."""

from __future__ import annotations

import copy
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from tqdm import tqdm

from ..engine import average_into, has_amx_bf16, save_atomically
from ..losses import stage_losses
from ..targets import Maps
from .head import LIKELY, Fields, Inputs

@dataclass(frozen=True)
class StageParams:
    """How long and how hard to train."""

    steps: int
    batch: int = 16
    learning_rate: float = 3e-3
    emphasis: float = 4.0
    seed: int = 0


def measure_inputs(inputs: Inputs, read: Callable[[NDArray[np.int64]], list[torch.Tensor]], rows: NDArray[np.int64]) -> None:
    """Sets the normalisation of a head's inputs to the mean and deviation over some pictures."""
    inputs.train()
    with torch.no_grad():
        for part in np.array_split(rows, max(1, len(rows) // 32)):
            inputs(*read(part))
    inputs.eval()


def train_fields(
    fields: Fields, seen: NDArray[np.float16], read: Callable[[NDArray[np.int64]], Maps], part_maps: int, params: StageParams, out: Path
) -> Fields:
    """Trains the second stage on `seen (n, channels, h, w)`, resuming from `out/fields.pt`; returns the averaged weights.

    `read` gives the targets of some pictures. What a step sees depends on the seed and its number alone.
    """
    averaged = copy.deepcopy(fields)
    fields = fields.to(memory_format=torch.channels_last).train()
    optimiser = torch.optim.AdamW(fields.parameters(), params.learning_rate, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, params.learning_rate, total_steps=params.steps + 1, pct_start=0.15)
    checkpoint, first = out / "fields.pt", 0
    if checkpoint.is_file():
        state = torch.load(checkpoint, weights_only=True)
        for part, name in ((fields, "network"), (averaged, "average"), (optimiser, "optimiser"), (schedule, "schedule")):
            part.load_state_dict(state[name])
        first = state["step"]
    per_epoch = max(1, len(seen) // params.batch)
    began, recent = time.monotonic(), 0.0
    bar = tqdm(range(first, params.steps), initial=first, total=params.steps, unit="step", desc="second stage")
    for step in bar:
        epoch, k = divmod(step, per_epoch)
        order = np.random.default_rng((params.seed, 4, epoch)).permutation(len(seen))
        rows = np.sort(order[k * params.batch : (k + 1) * params.batch])
        x, maps = torch.from_numpy(seen[rows].astype(np.float32)), read(rows)
        with torch.autocast("cpu", torch.bfloat16, enabled=has_amx_bf16()):
            correction = fields(x.contiguous(memory_format=torch.channels_last))
        paf = x[:, LIKELY + part_maps :] + correction.float()
        loss = stage_losses([(maps.pcm, paf)], maps, emphasis=params.emphasis)[0][1]
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(fields.parameters(), 20000.0)
        optimiser.step()
        schedule.step()
        average_into(averaged, fields, min(0.997, (step + 1) / (step + 10)))
        recent = float(loss.detach()) if recent == 0 else 0.95 * recent + 0.05 * float(loss.detach())
        bar.set_postfix(loss=f"{recent:.1f}")
        done = step + 1
        if done % 50 == 0 or done == params.steps:
            row = {"step": done, "loss": recent, "seconds": round(time.monotonic() - began, 1)}
            with (out / "log.jsonl").open("a") as log:
                log.write(json.dumps(row) + "\n")
            save_atomically(
                checkpoint,
                {
                    "step": done, "network": fields.state_dict(), "average": averaged.state_dict(),
                    "optimiser": optimiser.state_dict(), "schedule": schedule.state_dict(),
                },
            )  # fmt: skip
    return averaged.eval()
