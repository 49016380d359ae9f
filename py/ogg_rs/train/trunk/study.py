"""What label fusion (3) does to covered arms: one network, one set of pictures, one budget, several ways to label what fabric covers.

The pictures are split: every second one teaches the teacher, which sees only labels of uncovered joints; the others teach the
students. Students differ in nothing but what they are told of arm joints that an annotator cannot see:

- `empty`: nothing, and the map counts there. This is what published OpenPose training makes of COCO's unlabelled joints;
- `masked`: nothing, and W = 0 for that joint all over the person (decision 0093);
- with `fused`: the teacher's maps besides, by (3);
- `exact`: the true place, which no annotator can give: the upper bound;
- with `draped`: fabric drawn over arms whose labels were set before it came.

The network is the frozen public trunk with a linear map from its features to the part maps of the arms, the first stage of `ogg-trunk`
without its neighbourhood. The weights that minimise the paper's loss (1) are solved for, so no run can be under-trained; a seed draws the
pictures (with replacement, as many as there are) and the empty cells. Scores are of held-out pictures with rendered fabric over a wrist or
an elbow.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from ..augment import AugmentParams, letterboxed
from ..batches import Joined
from ..coco import CocoKeypoints
from ..engine import save_atomically
from ..evaluate import FLOOR, decode_single
from ..skeleton import ARM_PARTS, NECK, OPENPOSE18, PARTS
from ..targets import Maps, State, encode, fuse
from . import SIZE, STRIDE
from .drawing import montage
from .features import Features
from .head import AROUND, AT, Inputs
from .stages import measure_inputs

ARM_SIGMAS = np.array([0.079, 0.072, 0.062] * 2)
"""COCO's deviations of shoulder, elbow and wrist, in the order of `ARM_PARTS`."""

EMPTY = 1 / 6
"""Share of the cells far from every arm joint that count; they weigh as much more."""
_ANNOTATED = torch.zeros(len(PARTS), dtype=torch.bool)
_ANNOTATED[[*ARM_PARTS, NECK]] = True


@dataclass(frozen=True)
class Way:
    """One way to label covered arm joints."""

    name: str
    covered: State
    """`OUTSIDE`: as if there were none; `UNKNOWN`: masked; `LABELLED`: exact."""
    fused: bool = False
    draped: bool = False


WAYS: tuple[Way, ...] = (
    Way("empty", State.OUTSIDE),
    Way("empty, fused", State.OUTSIDE, fused=True),
    Way("masked", State.UNKNOWN),
    Way("masked, fused", State.UNKNOWN, fused=True),
    Way("masked, draped", State.UNKNOWN, draped=True),
    Way("masked, draped, fused", State.UNKNOWN, fused=True, draped=True),
    Way("exact", State.LABELLED),
)


def annotated(states: torch.Tensor, seen: torch.Tensor, covered: State) -> torch.Tensor:
    """States `(pictures, people, 18)` where arm joints that nobody sees have become `covered`."""
    hidden = (states == State.LABELLED) & ~seen & _ANNOTATED
    return torch.where(hidden, torch.full_like(states, int(covered)), states)


class Cells:
    """The trunk's features at the cells of a picture set that count: all near an arm joint, and a share of the others."""

    def __init__(self, inputs: Inputs, parts: Sequence[tuple[Features, NDArray[np.int64]]], store: Path, *, emphasis: float) -> None:
        self._parts = parts
        self.pictures = sum(len(rows) for _, rows in parts)
        self._whole: dict[int, torch.Tensor] = {}
        if not store.is_file():
            save_atomically(store, self._chosen(inputs, emphasis))
        state = torch.load(store, weights_only=True)
        if len(state["places"]) != self.pictures:
            raise ValueError(f"{store}: expected cells of {self.pictures} pictures, got {len(state['places'])}; use another --out")
        self.values, self.weights, self.numbers, self._places = (state[k] for k in ("values", "weights", "numbers", "places"))

    def _chosen(self, inputs: Inputs, emphasis: float) -> dict:
        draw = np.random.default_rng(9)
        values, places, weights, numbers = [], [], [], []
        for number, (data, row) in enumerate(tqdm(self._all(), total=self.pictures, desc="cells", unit="img")):
            exact = self._encoded(data, row, State.LABELLED).pcm[0, list(ARM_PARTS)].amax(0).flatten()
            near = exact > 0.01
            chosen = near | torch.from_numpy(draw.random(len(near)) < EMPTY)
            place = chosen.nonzero()[:, 0]
            values.append(linear_inputs(inputs, data.read(np.array([row])))[0][:, place].T.half())
            places.append(place)
            weights.append(torch.where(near, 1 + emphasis * exact, torch.full_like(exact, 1 / EMPTY))[place])
            numbers.append(torch.full_like(place, number))
        return {"values": torch.cat(values), "weights": torch.cat(weights), "numbers": torch.cat(numbers), "places": places}

    def drawn(self, seed: int) -> torch.Tensor:
        """Weights of the cells when the pictures are drawn with replacement."""
        draw = np.random.default_rng((seed, 11)).integers(0, self.pictures, self.pictures)
        return self.weights * torch.from_numpy(np.bincount(draw, minlength=self.pictures)).float()[self.numbers]

    def gram(self, seed: int) -> torch.Tensor:
        """The system's left side where no cell is left out."""
        if seed not in self._whole:
            base = self.drawn(seed)
            self._whole = {seed: weighted_gram(self.values, base, base > 0)}
        return self._whole[seed]

    def _all(self) -> list[tuple[Features, int]]:
        return [(data, int(row)) for data, rows in self._parts for row in rows]

    @staticmethod
    def _encoded(data: Features, row: int, covered: State) -> Maps:
        states = annotated(data.states[row], data.seen[row], covered)
        return encode(data.exact[row][None], states[None], data.boxes[row][None], OPENPOSE18, SIZE, stride=STRIDE)

    def targets(self, covered: State, taught: Sequence[torch.Tensor] | None) -> tuple[torch.Tensor, torch.Tensor]:
        """Part maps of the arms and W at the cells, `(cells, 6)` each. `taught`: the teacher's maps of the arms by picture."""
        wanted, counts = [], []
        for number, (data, row) in enumerate(self._all()):
            maps = self._encoded(data, row, covered)
            if taught is not None:
                teacher = torch.zeros_like(maps.pcm)
                teacher[0, list(ARM_PARTS)] = taught[number].float()
                maps = fuse(maps, teacher, torch.zeros_like(maps.paf))
            wanted.append(maps.pcm[0, list(ARM_PARTS)].flatten(1)[:, self._places[number]].T)
            counts.append(maps.pcm_mask[0, list(ARM_PARTS)].flatten(1)[:, self._places[number]].T)
        return torch.cat(wanted), torch.cat(counts)

    def maps(self, inputs: Inputs, weights: torch.Tensor) -> list[torch.Tensor]:
        """Answers `(6, h, w)` of solved weights to every picture."""
        return [answer(inputs, weights, data.read(np.array([row])))[0].half() for data, row in self._all()]


def linear_inputs(inputs: Inputs, features: list[torch.Tensor]) -> torch.Tensor:
    """What the linear map reads: `(pictures, channels, cells)`, the last channel one."""
    with torch.no_grad():
        both = torch.cat(inputs(*features), 1).flatten(2)
    return torch.cat((both, torch.ones(len(both), 1, both.shape[2])), 1)


def answer(inputs: Inputs, weights: torch.Tensor, features: list[torch.Tensor]) -> torch.Tensor:
    """Part maps of the arms `(pictures, 6, h, w)`."""
    side = SIZE[0] // STRIDE
    return (weights.T @ linear_inputs(inputs, features)).unflatten(2, (SIZE[1] // STRIDE, side))


def solve(cells: Cells, wanted: torch.Tensor, counts: torch.Tensor, seed: int, *, ridge: float) -> torch.Tensor:
    """Weights `(channels, 6)` that minimise the masked squared error over a draw of the pictures, with a ridge."""
    base = cells.drawn(seed)
    size = cells.values.shape[1]
    penalty = torch.full((size,), ridge)
    penalty[-1] = 0
    columns = []
    for joint in range(wanted.shape[1]):
        left = cells.gram(seed) - weighted_gram(cells.values, base, (base > 0) & ~counts[:, joint])
        goal = base * counts[:, joint] * wanted[:, joint]
        hit = goal.abs() > 1e-4
        right = cells.values[hit].float().T @ goal[hit]
        columns.append(torch.linalg.solve((left + torch.diag(penalty)).double(), right.double()).float())
    return torch.stack(columns, 1)


def weighted_gram(values: torch.Tensor, weights: torch.Tensor, chosen: torch.Tensor) -> torch.Tensor:
    """`sum of weight x x^T` over the chosen rows."""
    total = torch.zeros(values.shape[1], values.shape[1])
    for rows in chosen.nonzero()[:, 0].split(16384):
        x = values[rows].float() * weights[rows].sqrt()[:, None]
        total.addmm_(x.T, x)
    return total


class Truth:
    """The held-out pictures whose first person has a wrist or an elbow under fabric."""

    def __init__(self, data: CocoKeypoints, features: Features) -> None:
        fabric = np.stack(data.under_fabric())
        arms = list(ARM_PARTS)
        low = [PARTS.index(f"{side}_{joint}") for side in ("right", "left") for joint in ("elbow", "wrist")]
        alone = np.array([len(people[0]) == 1 for people in data.people])
        inside = features.states[:, 0].numpy() == State.LABELLED
        self.rows = np.flatnonzero((fabric & inside)[:, low].any(1) & alone)
        self.joints = features.exact[self.rows, 0].numpy()[:, arms]
        self.labelled = inside[self.rows][:, arms]
        self.seen = features.seen[self.rows, 0].numpy()[:, arms] & self.labelled
        self.fabric = fabric[self.rows][:, arms] & self.labelled
        scales = np.array([min(SIZE[0] / data.records[i]["width"], SIZE[1] / data.records[i]["height"]) for i in self.rows])
        self.torso = scales * [data.torso_px(i) for i in self.rows]
        boxes = features.boxes[self.rows, 0].numpy()
        self.area = np.prod(boxes[:, 2:] - boxes[:, :2], 1)


def arm_ap(distance: NDArray[np.float64], labelled: NDArray[np.bool_], area: NDArray, score: NDArray) -> float:
    """COCO's AP of the six arm joints where every picture has one person and one answer.

    `distance (pictures, 6)` in pixels, infinite for a joint that was not found. The mean over the thresholds 0.5, 0.55 ... 0.95 of OKS of the
    precision at 101 recalls.
    """
    with np.errstate(over="ignore"):
        similar = np.exp(-(distance**2) / (2 * area[:, None] * (2 * ARM_SIGMAS) ** 2))
    oks = (similar * labelled).sum(1) / np.maximum(labelled.sum(1), 1)
    order = np.argsort(-score, kind="stable")
    precisions = []
    for threshold in np.linspace(0.5, 0.95, 10):
        hits = np.cumsum(oks[order] >= threshold)
        precision = np.maximum.accumulate((hits / np.arange(1, len(hits) + 1))[::-1])[::-1]
        recall = hits / len(hits)
        at = np.searchsorted(recall, np.linspace(0, 1, 101))
        precisions.append(np.mean([precision[k] if k < len(precision) else 0.0 for k in at]))
    return float(np.mean(precisions))


def scores(found: NDArray[np.float32], truth: Truth) -> dict[str, float]:
    """AP and PCK of the arms `found (pictures, 6, 3)`."""
    distance = np.linalg.norm(found[..., :2] - truth.joints, axis=-1).astype(np.float64)
    distance[found[..., 2] < FLOOR] = np.inf
    relative = distance / truth.torso[:, None]
    wrists = np.zeros_like(truth.labelled)
    wrists[:, [2, 5]] = True
    result = {"AP arms": arm_ap(distance, truth.labelled, truth.area, found[..., 2].mean(1))}
    for name, subset in (
        ("all", truth.labelled), ("seen", truth.seen), ("fabric", truth.fabric), ("fabric wrists", truth.fabric & wrists),
    ):  # fmt: skip
        for share in (0.1, 0.2):
            result[f"PCK@{share} {name}"] = float((relative[subset] <= share).mean())
        result[f"found {name}"] = float(np.isfinite(relative[subset]).mean())
    return result


@dataclass
class Study:
    """Everything that the runs share."""

    out: Path
    inputs: Inputs
    students: Cells
    draped: Cells
    teachers: Cells
    tests: Features
    truth: Truth
    ridge: float

    def run(self, seeds: Sequence[int], ways: Sequence[Way] = WAYS) -> dict[str, list[dict[str, float]]]:
        """Scores by way, one row for each seed. What is done is kept, so that an interrupted study goes on."""
        store = self.out / "results.json"
        results: dict[str, list[dict[str, float]]] = json.loads(store.read_text()) if store.is_file() else {}
        for seed in seeds:
            done = {name for name, rows in results.items() if any(row["seed"] == seed for row in rows)}
            missing = [way for way in ways if way.name not in done]
            if not missing:
                continue
            teacher = solve(self.teachers, *self.teachers.targets(State.UNKNOWN, None), seed, ridge=self.ridge)
            if "the teacher itself" not in done:
                self._keep(results, "the teacher itself", seed, teacher)
            taught = {draped: self._cells(draped).maps(self.inputs, teacher) for draped in {w.draped for w in missing if w.fused}}
            for way in tqdm(sorted(missing, key=lambda w: w.draped), desc=f"seed {seed}", unit="way"):
                cells = self._cells(way.draped)
                goal = cells.targets(way.covered, taught[way.draped] if way.fused else None)
                self._keep(results, way.name, seed, solve(cells, *goal, seed, ridge=self.ridge))
                part = store.with_suffix(".part")
                part.write_text(json.dumps(results, indent=1))
                part.rename(store)
        return results

    def _cells(self, draped: bool) -> Cells:
        return self.draped if draped else self.students

    def _keep(self, results: dict[str, list[dict[str, float]]], name: str, seed: int, weights: torch.Tensor) -> None:
        maps = [answer(self.inputs, weights, self.tests.read(rows)) for rows in np.array_split(self.truth.rows, 8)]
        # The decoder leaves out the last map, the background.
        padded = torch.nn.functional.pad(torch.cat(maps), (0, 0, 0, 0, 0, 1))
        found = decode_single(padded.numpy(), stride=STRIDE)
        np.save(self.out / f"found-{name}-{seed}.npy", found)
        results.setdefault(name, []).append({"seed": seed, **scores(found, self.truth)})


COLUMNS = ("AP arms", "PCK@0.1 all", "PCK@0.1 seen", "PCK@0.1 fabric", "PCK@0.2 fabric", "PCK@0.2 fabric wrists", "found fabric")


def table(results: dict[str, list[dict[str, float]]]) -> str:
    """Means over the seeds, in percent, each with half of the range between the lowest and the highest."""
    order = [name for name in ("the teacher itself", *(way.name for way in WAYS)) if name in results]
    lines = ["| covered arm joints | " + " | ".join(COLUMNS) + " |", "|---" * (len(COLUMNS) + 1) + "|"]
    for name in order:
        rows, cells = results[name], []
        for column in COLUMNS:
            values = 100 * np.array([row[column] for row in rows])
            cells.append(f"{values.mean():.1f} ± {np.ptp(values) / 2:.1f}")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def prepare(
    out: Path, data: Sequence[Path], test: Path, model: Path, *, threads: int, emphasis: float = 4.0, ridge: float = 30.0
) -> Study:
    """Features of all pictures, those of the students once more with draped arms; kept in `out`, so that the next call is quick."""
    torch.set_num_threads(threads)
    out.mkdir(parents=True, exist_ok=True)
    full, strength = AugmentParams(), 0.7
    change = AugmentParams(
        scale=(0.8, 1.25), rotation_rad=full.rotation_rad * strength, shift=full.shift * strength, flip=0.5,
        gain=full.gain * strength, gamma=full.gamma * strength, grey=0.08, blur=0.2, noise=full.noise * strength, covers=0.0,
    )  # fmt: skip
    students, draped, teachers = [], [], []
    for folder in data:
        pictures = Joined([(CocoKeypoints(folder), 1)])
        name = folder.resolve().name
        plain = Features(out, name, pictures, model, change, changes=1, seed=1, threads=threads)
        covered = Features(out, f"{name}-draped", pictures, model, change, changes=1, seed=1, threads=threads, drapes=0.6, every=2)
        teachers.append((plain, np.arange(1, plain.count, 2)))
        students.append((plain, np.arange(0, plain.count, 2)))
        draped.append((covered, np.arange(covered.count)))
    held_out = CocoKeypoints(test)
    tests = Features(
        out, test.resolve().name, Joined([(held_out, 1)]), model, AugmentParams.none(), changes=1, seed=1, threads=threads
    )
    inputs, measured = Inputs(), out / "inputs.pt"
    if not measured.is_file():
        measure_inputs(inputs, teachers[0][0].read, np.arange(min(192, teachers[0][0].count)))
        save_atomically(measured, inputs.state_dict())
    inputs.load_state_dict(torch.load(measured, weights_only=True))
    inputs.eval()
    cells = (
        Cells(inputs, parts, out / f"cells-{name}.pt", emphasis=emphasis)
        for name, parts in (("students", students), ("draped", draped), ("teachers", teachers))
    )
    return Study(out, inputs, *cells, tests, Truth(held_out, tests), ridge)


def pictures(study: Study, data: CocoKeypoints, columns: Sequence[str], seed: int, path: Path, rows: int = 4) -> None:
    """What several ways find in the same pictures, side by side, and the truth: where the first and the last differ most under fabric."""
    found = {name: np.load(study.out / f"found-{name}-{seed}.npy") for name in columns}
    truth = study.truth
    errors = []
    for joints in found.values():
        error = np.linalg.norm(joints[..., :2] - truth.joints, axis=-1) / truth.torso[:, None]
        error[joints[..., 2] < FLOOR] = 1.0
        errors.append((np.minimum(error, 1.0) * truth.fabric).sum(1) / np.maximum(truth.fabric.sum(1), 1))
    tiles = []
    for k in np.argsort(errors[-1] - errors[0], kind="stable")[:rows]:
        pixels, _ = letterboxed(data.image(int(truth.rows[k])), SIZE)
        true = np.concatenate((truth.joints[k], truth.labelled[k][:, None]), 1)
        tiles.append([(pixels, joints, truth.fabric[k]) for joints in (*(found[name][k] for name in columns), true)])
    montage(tiles, [*columns, "truth"], path)


__all__ = ["WAYS", "Study", "Way", "annotated", "arm_ap", "pictures", "prepare", "scores", "solve", "table"]
