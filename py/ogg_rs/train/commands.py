"""What each command does."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from . import card, puppets
from .augment import AugmentParams
from .batches import BatchMaker, Joined, Normalisation
from .coco import COCO_CENTRE_PX, CocoKeypoints
from .engine import FitParams, fit, has_amx_bf16
from .evaluate import Case, onnx_runner, score, table
from .export import export
from .nets import build, parameter_count
from .skeleton import ARM_PARTS, PARTS, SKELETONS
from .targets import State


def draw_puppets(options: argparse.Namespace) -> None:
    """`puppets`."""
    puppets.write(options.out, options.count, options.seed)


def augmentation(strength: float) -> AugmentParams:
    """The default changes scaled by `strength`, 0 to 1."""
    if not 0 <= strength <= 1:
        raise ValueError(f"strength: expected 0 to 1, got {strength}")
    full = AugmentParams()
    return replace(
        full,
        scale=(full.scale[0] ** strength, full.scale[1] ** strength),
        **{
            name: getattr(full, name) * strength
            for name in ("rotation_rad", "shift", "gain", "gamma", "grey", "blur", "noise", "covers")
        },
    )


def train(options: argparse.Namespace) -> None:
    """`fit`."""
    skeleton = SKELETONS[options.profile]
    sets = [
        (CocoKeypoints(path, annotations=options.annotations, images=options.images, skeleton=skeleton), times)
        for path, times in options.data
    ]
    torch.manual_seed(options.seed)
    network = build(options.network, skeleton)
    bf16 = has_amx_bf16() if options.bf16 == "auto" else options.bf16 == "on"
    params = FitParams(
        steps=options.steps, learning_rate=options.learning_rate, warmup=options.warmup, emphasis=options.emphasis,
        threads=options.threads, autocast=bf16,
    )  # fmt: skip
    maker = BatchMaker(
        Joined(sets), skeleton, options.size, options.batch, options.seed, augmentation(options.strength), Normalisation()
    )
    teacher = _teacher(options.teacher) if options.teacher else None
    pictures = sum(len(s) for s, _ in sets)
    print(
        f"{options.network}: {parameter_count(network)} parameters, {pictures} pictures, {options.steps} steps of "
        f"{options.batch}, {'bfloat16' if bf16 else 'float32'}, {options.threads} threads"
    )
    options.out.mkdir(parents=True, exist_ok=True)
    about = {"network": options.network, "profile": options.profile, "size": list(options.size), "seed": options.seed}
    (options.out / "network.json").write_text(json.dumps(about))
    fit(network, maker, params, options.out, start=options.start, teacher=teacher)


def _teacher(path: Path) -> Callable[[torch.Tensor], tuple[torch.Tensor, torch.Tensor]]:
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected an exported network")
    run = onnx_runner(path)

    def answer(image: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        pcm, paf = run(image.contiguous(memory_format=torch.contiguous_format).numpy())
        return torch.from_numpy(pcm), torch.from_numpy(paf)

    return answer


def write_onnx(options: argparse.Namespace) -> None:
    """`export`."""
    about = json.loads((options.run / "network.json").read_text())
    skeleton = SKELETONS[about["profile"]]
    network = build(about["network"], skeleton)
    network.load_state_dict(torch.load(options.run / "checkpoint.pt", weights_only=True)["average"])
    metadata = {"network": about["network"], "profile": about["profile"], "licence": "MIT OR Apache-2.0"}
    options.out.parent.mkdir(parents=True, exist_ok=True)
    digest = export(network, tuple(about["size"]), options.out, metadata=metadata)
    if options.card:
        size = tuple(about["size"])
        card.write(options.card, options.out, digest, size, skeleton, peak_threshold=options.peak_threshold)
    print(f"{options.out}: {options.out.stat().st_size} bytes, sha256 {digest}")


def model_size(path: Path) -> tuple[int, int]:
    """Picture size (width, height) an exported network takes."""
    import onnxruntime

    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected an exported network")
    shape = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"]).get_inputs()[0].shape
    return shape[3], shape[2]


def score_data(options: argparse.Namespace) -> None:
    """`eval`: visible joints, covered arm joints, and both for the arms."""
    data = CocoKeypoints(options.data, images=options.images)
    visible = [data.visible(i) for i in range(len(data))]
    report = {}
    for subset in ("visible", "covered"):
        cases = []
        for i, seen in enumerate(visible):
            sample = data[i]
            if len(sample.joints_px) != 1:
                continue
            labelled = sample.states[0] == State.LABELLED
            counts = labelled & (seen[0] if subset == "visible" else ~seen[0])
            cases.append(Case(sample.image, sample.joints_px[0], counts, data.torso_px(i)))
        scores = score(onnx_runner(options.model), cases, model_size(options.model), Normalisation())
        names = [PARTS[i] for i in ARM_PARTS] + ([n for i, n in enumerate(PARTS) if i not in ARM_PARTS] if subset == "visible" else [])
        print(f"{subset} joints, {len(cases)} pictures")
        print(table(scores, names))
        report[subset] = {
            n: {"n": len(s.errors), "pck_0.1": s.pck(0.1), "pck_0.2": s.pck(0.2), "median_px": s.median_px()}
            for n, s in scores.items()
            if s.errors
        }
    if options.json:
        options.json.write_text(json.dumps(report, indent=1))


CROP_PARTS = ("nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist")


def score_crops(options: argparse.Namespace) -> None:
    """`eval-crops`: `C (n, h, w, 3)` BGR crops, `U (n, 8, 2)` joints, `T (n,)` torso lengths, `tag` subjects."""
    if not options.crops.is_file():
        raise FileNotFoundError(f"{options.crops}: expected an .npz with C, U, T and tag")
    data = np.load(options.crops)
    tags = np.array(data["tag"])
    for group in sorted({str(t).rstrip("0123456789") for t in tags}):
        cases = []
        for i in np.flatnonzero(np.char.startswith(tags, group)):
            joints = np.zeros((len(PARTS), 2), np.float32)
            counts = np.zeros(len(PARTS), bool)
            for k, name in enumerate(CROP_PARTS):
                joints[PARTS.index(name)] = data["U"][i, k] + COCO_CENTRE_PX
                counts[PARTS.index(name)] = PARTS.index(name) in ARM_PARTS
            image = Image.fromarray(np.ascontiguousarray(data["C"][i][:, :, ::-1]))
            cases.append(Case(image, joints, counts, float(data["T"][i])))
        scores = score(onnx_runner(options.model), cases, model_size(options.model), Normalisation())
        print(f"{group}: {len(cases)} crops")
        print(table(scores, [PARTS[i] for i in ARM_PARTS]))


def describe(options: argparse.Namespace) -> None:
    """`describe`."""
    skeleton = SKELETONS["openpose-18"]
    network = build(options.network, skeleton).eval()
    total = 0

    def count(module: torch.nn.Module, _: object, output: torch.Tensor) -> None:
        nonlocal total
        total += output.shape[-1] * output.shape[-2] * module.weight.numel()

    for module in network.modules():
        if isinstance(module, torch.nn.Conv2d):
            module.register_forward_hook(count)
    with torch.no_grad():
        stages = network(torch.zeros(1, 3, options.size[1], options.size[0]))
    print(network)
    print(
        f"{options.network} at {options.size[0]}x{options.size[1]}: {parameter_count(network)} parameters, "
        f"{total / 1e6:.1f} million multiply-adds, {len(stages)} stages, maps {tuple(stages[-1][0].shape[1:])} and "
        f"{tuple(stages[-1][1].shape[1:])}"
    )


RUN: dict[str, Callable[[argparse.Namespace], None]] = {
    "puppets": draw_puppets,
    "fit": train,
    "export": write_onnx,
    "eval": score_data,
    "eval-crops": score_crops,
    "describe": describe,
}
