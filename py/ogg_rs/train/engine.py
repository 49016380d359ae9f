"""The training loop: seeded, resumable, with a progress bar and a moving average of the weights.

A checkpoint holds everything the next step depends on and is written beside the old one and renamed, so an interrupted
run continues where its last checkpoint stands: `fit` with the same arguments goes on, and ends with the same weights
as an uninterrupted run (on the same machine and thread count).
"""

from __future__ import annotations

import copy
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch import Tensor, nn
from tqdm import tqdm

from .batches import BatchMaker, prefetch
from .losses import MapWeights, total_loss
from .nets.lite import Residual
from .targets import Maps, fuse
from .team import Team

Teacher = Callable[[Tensor], tuple[Tensor, Tensor]]
"""From a normalised picture batch to the teacher's `(pcm, paf)` at the network's stride and channel order."""


@dataclass(frozen=True)
class FitParams:
    """How long and how hard to train."""

    steps: int
    learning_rate: float = 3e-3
    warmup: float = 0.1
    """Share of the steps in which the rate rises; it then falls along a cosine."""
    weight_decay: float = 1e-4
    clip_norm: float = 5000.0
    """Largest gradient norm: a few times that of the first steps, so that only outliers are cut."""
    emphasis: float = 4.0
    arms: float = 1.0
    """Factor of the maps of shoulders, elbows, wrists and the limbs between them in the loss."""
    average: float = 0.998
    """Decay per step of the moving average of the weights, which is what is evaluated and exported."""
    threads: int = 1
    """Threads of the arithmetic. More than the cores that are free costs several times the CPU time: the threads of one
    operation wait for each other, spinning."""
    autocast: bool = False
    """bfloat16 arithmetic: several times faster where the CPU has AMX, slower where it has not."""
    checkpoint_every: int = 200

    def validate(self) -> FitParams:
        """Itself, or a `ValueError` naming the field."""
        for name, low, high in (
            ("steps", 1, 10**9), ("learning_rate", 1e-9, 1.0), ("warmup", 0.0, 0.9), ("weight_decay", 0.0, 1.0),
            ("clip_norm", 1e-6, 1e9), ("emphasis", 0.0, 1e3), ("arms", 0.0, 1e3), ("average", 0.0, 0.99999), ("threads", 1, 1024),
            ("checkpoint_every", 1, 10**9),
        ):  # fmt: skip
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"{name}: expected {low} to {high}, got {value}")
        return self


def average_into(average: nn.Module, network: nn.Module, decay: float) -> None:
    """`average <- decay average + (1 - decay) network`; counters and running statistics are copied or averaged alike."""
    with torch.no_grad():
        for mine, other in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
            if mine.is_floating_point():
                mine.lerp_(other, 1 - decay)
            else:
                mine.copy_(other)


def save_atomically(path: Path, state: dict) -> None:
    """Writes beside the target and renames."""
    part = path.with_suffix(".part")
    torch.save(state, part)
    part.rename(path)


def has_amx_bf16() -> bool:
    """Whether the CPU multiplies bfloat16 tiles, where autocast pays."""
    check = getattr(torch.cpu, "_is_amx_tile_supported", None)
    return bool(check()) if check else False


def start_from(network: nn.Module, paths: Sequence[Path]) -> list[str]:
    """Loads the averaged weights of checkpoints, of several their mean, and names the residual blocks that one of them lacks: those
    are identities, so that the network computes what the smaller one did.

    Raises `ValueError` where anything else is missing, left over, or of another shape.
    """
    mean, new = copy.deepcopy(network), []
    for number, path in enumerate(paths, 1):
        one = copy.deepcopy(network)
        new += [block for block in _load(one, path) if block not in new]
        average_into(mean, one, 1 - 1 / number)
    network.load_state_dict(mean.state_dict())
    return new


def _load(network: nn.Module, path: Path) -> list[str]:
    weights, own = torch.load(path, weights_only=True)["average"], network.state_dict()
    lacking = own.keys() - weights.keys()
    blocks = [
        name
        for name, block in network.named_modules()
        if isinstance(block, Residual) and all(f"{name}.{key}" in lacking for key in block.state_dict())
    ]
    lacking = {key for key in lacking if not any(key.startswith(f"{block}.") for block in blocks)}
    unlike = {key for key, values in weights.items() if key not in own or own[key].shape != values.shape}
    if lacking | unlike:
        strange = ", ".join(sorted(lacking | unlike)[:4])
        raise ValueError(f"{path}: expected weights of this network or of one with fewer residual blocks, they differ in {strange}")
    network.load_state_dict(weights, strict=False)
    return blocks


def fit(
    network: nn.Module,
    make_batch: BatchMaker,
    params: FitParams,
    out: Path,
    *,
    start: Sequence[Path] = (),
    teacher: Teacher | None = None,
) -> nn.Module:
    """Trains and returns the averaged network, resuming from `out/checkpoint.pt` where there is one.

    `start` gives initial weights: those of an earlier run (its averaged network), or the mean of several. With a `teacher` the
    labels are fused with its maps (3) before the loss, which makes the loss that of (4). All processes of a `Team` train one
    network.
    """
    params = params.validate()
    team = Team.join()
    out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(params.threads)
    torch.manual_seed(make_batch.seed)
    if start:
        new = start_from(network, start)
        if new and team.leads:
            print(f"--start: {', '.join(new)} not there; they begin as identities")
    network = network.to(memory_format=torch.channels_last).train()
    averaged = copy.deepcopy(network)
    optimiser = torch.optim.AdamW(network.parameters(), params.learning_rate, weight_decay=params.weight_decay, fused=True)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, params.learning_rate, total_steps=params.steps + 1, pct_start=max(params.warmup, 1e-3)
    )
    checkpoint = out / "checkpoint.pt"
    first = 0
    if checkpoint.is_file():
        state = torch.load(checkpoint, weights_only=True)
        network.load_state_dict(state["network"])
        averaged.load_state_dict(state["average"])
        optimiser.load_state_dict(state["optimiser"])
        schedule.load_state_dict(state["schedule"])
        first = state["step"]
    if team.leads:
        (out / "params.json").write_text(json.dumps(asdict(params), indent=1))
    bar = tqdm(
        prefetch(lambda step: make_batch(team.batch(step)), first, params.steps),
        total=params.steps, initial=first, unit="step", desc=out.name, disable=not team.leads,
    )  # fmt: skip
    weights = MapWeights.of_arms(make_batch.skeleton, params.arms) if params.arms != 1 else None
    recent, began = 0.0, time.monotonic()
    for step, batch in enumerate(bar, first):
        maps: Maps = batch.maps
        if teacher is not None:
            with torch.no_grad():
                maps = fuse(maps, *teacher(batch.image))
        with torch.autocast("cpu", torch.bfloat16, enabled=params.autocast):
            stages = network(batch.image)
        loss = total_loss(stages, maps, emphasis=params.emphasis, weights=weights)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        team.average_gradients(network)
        norm = nn.utils.clip_grad_norm_(network.parameters(), params.clip_norm)
        optimiser.step()
        schedule.step()
        # The average of few steps would still be the random start: its memory grows to `average` with the steps done.
        average_into(averaged, network, min(params.average, (step + 1) / (step + 10)))
        value = float(loss.detach())
        if not value < float("inf"):
            raise ArithmeticError(f"loss at step {step}: expected a finite number, got {value}")
        recent = value if recent == 0 else 0.95 * recent + 0.05 * value
        bar.set_postfix(loss=f"{recent:.2f}")
        done = step + 1
        if not team.leads:
            continue
        if done % 50 == 0:
            row = {"step": done, "loss": recent, "norm": float(norm), "seconds": round(time.monotonic() - began, 1)}
            with (out / "log.jsonl").open("a") as log:
                log.write(json.dumps(row) + "\n")
        if done % params.checkpoint_every == 0 or done == params.steps:
            save_atomically(
                checkpoint,
                {
                    "step": done,
                    "network": network.state_dict(),
                    "average": averaged.state_dict(),
                    "optimiser": optimiser.state_dict(),
                    "schedule": schedule.state_dict(),
                },
            )
    return averaged.eval()
