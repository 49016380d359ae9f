"""What each command does."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from tqdm import tqdm

from . import card, grouping, puppets, quantise, real, teaching
from .augment import AugmentParams
from .batches import BatchMaker, Joined, Normalisation
from .coco import CocoKeypoints
from .engine import FitParams, fit, has_amx_bf16, start_from
from .evaluate import Case, onnx_runner, score_found, table
from .export import export
from .nets import build, parameter_count
from .seen import best_person, everybody
from .skeleton import ARM_PARTS, PARTS, SKELETONS
from .targets import State
from .team import Team


def draw_puppets(options: argparse.Namespace) -> None:
    """`puppets`."""
    puppets.write(options.out, options.count, options.seed)


def augmentation(strength: float, rotation_deg: float | None = None) -> AugmentParams:
    """The default changes scaled by `strength`, 0 to 1, with rotations of up to `rotation_deg` where that is given."""
    if not 0 <= strength <= 1:
        raise ValueError(f"strength: expected 0 to 1, got {strength}")
    if rotation_deg is not None and not 0 <= rotation_deg <= 180:
        raise ValueError(f"rotation: expected 0 to 180 degrees, got {rotation_deg}")
    full = AugmentParams()
    scaled = replace(
        full,
        scale=(full.scale[0] ** strength, full.scale[1] ** strength),
        **{
            name: getattr(full, name) * strength
            for name in ("rotation_rad", "shift", "gain", "gamma", "grey", "blur", "noise", "covers")
        },
    )
    return scaled if rotation_deg is None else replace(scaled, rotation_rad=math.radians(rotation_deg))


def train(options: argparse.Namespace) -> None:
    """`fit`."""
    if options.processes < 1:
        raise ValueError(f"--processes: expected at least 1, got {options.processes}")
    if not 0 <= options.nobody <= 1:
        raise ValueError(f"--nobody: expected a share from 0 to 1, got {options.nobody}")
    skeleton, team = SKELETONS[options.profile], Team.join()

    def read(path: Path) -> CocoKeypoints:
        return CocoKeypoints(path, annotations=options.annotations, images=options.images, skeleton=skeleton)

    sets = [(team.leader_first(lambda path=path: read(path)), times) for path, times in options.data]
    torch.manual_seed(options.seed)
    network = build(options.network, skeleton)
    bf16 = has_amx_bf16() if options.bf16 == "auto" else options.bf16 == "on"
    params = FitParams(
        steps=options.steps, learning_rate=options.learning_rate, warmup=options.warmup, emphasis=options.emphasis,
        arms=options.arms, threads=options.threads, autocast=bf16,
    )  # fmt: skip
    maker = BatchMaker(
        Joined(sets, behind=options.behind, sideways=options.sideways), skeleton, options.size, options.batch, options.seed,
        augmentation(options.strength, options.rotation), Normalisation(), options.nobody,
    )  # fmt: skip
    teacher = _teacher(options.teacher) if options.teacher else None
    pictures = sum(len(s) for s, _ in sets)
    if team.leads:
        options.out.mkdir(parents=True, exist_ok=True)
        about = {"network": options.network, "profile": options.profile, "size": list(options.size), "seed": options.seed}
        (options.out / "network.json").write_text(json.dumps(about))
        print(
            f"{options.network}: {parameter_count(network)} parameters, {pictures} pictures, {options.steps} steps of "
            f"{team.size} x {options.batch}, {'bfloat16' if bf16 else 'float32'}, {options.threads} threads"
        )
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
    about = json.loads((options.run[-1] / "network.json").read_text())
    skeleton = SKELETONS[about["profile"]]
    network = build(about["network"], skeleton)
    start_from(network, [run / "checkpoint.pt" for run in options.run])
    metadata = {"network": about["network"], "profile": about["profile"], "licence": "MIT OR Apache-2.0"}
    options.out.parent.mkdir(parents=True, exist_ok=True)
    digest = export(network, tuple(about["size"]), options.out, half=options.half, metadata=metadata)
    if options.card:
        size = tuple(about["size"])
        card.write(options.card, options.out, digest, size, skeleton, peak_threshold=options.peak_threshold)
    print(f"{options.out}: {options.out.stat().st_size} bytes, sha256 {digest}")


def render_people(options: argparse.Namespace) -> None:
    """`people`."""
    from .people import write

    write(
        options.out, options.count, options.seed, size=options.size, backgrounds=options.backgrounds, second=options.second,
        sewing=options.sewing,
    )  # fmt: skip


def label(options: argparse.Namespace) -> None:
    """`label`."""
    if options.every < 1 or options.side < 32:
        raise ValueError(f"--every, --side: expected at least 1 and 32, got {options.every} and {options.side}")
    teacher = best_person(options.teacher, "coco-17", weights=options.weights, threads=options.threads)
    count, labelled = teaching.write(options.out, options.pictures, teacher, every=options.every, side=options.side)
    print(f"{options.out}: {labelled} of {count} pictures labelled")


def trunk(options: argparse.Namespace) -> None:
    """`trunk`."""
    from .trunk import building, fitting
    from .trunk.head import Head

    if options.fetch:
        card_file = options.head.with_name("ogg-trunk.toml")
        path, digest = building.build(options.out, options.head, card_file, package=options.package)
        print(f"{path}: {path.stat().st_size} bytes, sha256 {digest}; card {path.with_suffix('.toml').name}")
        return
    if options.trunk is None:
        raise ValueError("--trunk: expected the folder of the public trunk")
    model = building.fetch(options.trunk, options.package)
    skeleton = SKELETONS["openpose-18"]
    if options.fit:
        if not options.data:
            raise ValueError("--data: expected folders to train on")
        params = fitting.HeadParams(
            epochs=options.epochs, batch=options.batch, changes=options.changes, smallest=options.smallest, pairs=options.pairs,
            drapes=options.drapes, seed=options.seed, threads=options.threads,
        )  # fmt: skip
        pictures = Joined([(CocoKeypoints(path), times) for path, times in options.data])
        print(f"ogg-trunk: {len(pictures)} pictures, {params.changes} changes of each, {params.epochs} epochs")
        fitting.fit_head(pictures, model, params, options.out, first=options.first)
        return
    if options.run is None:
        raise ValueError("--run: expected the folder of a --fit")
    head = Head(skeleton.part_maps, skeleton.field_maps)
    state = torch.load(options.run / "checkpoint.pt", weights_only=True)
    head.load_state_dict(state["average"])
    stages = 2 if state["step"] > 0 else 1
    building.export_head(head.eval(), options.out, model, stages=stages)
    print(f"{options.out}: {options.out.stat().st_size} bytes, {stages} stage{'s' if stages > 1 else ''}")


def fusion_study(options: argparse.Namespace) -> None:
    """`fusion-study`."""
    from .trunk import building, study

    prepared = study.prepare(options.out, options.data, options.test, building.fetch(options.trunk), threads=options.threads)
    truth = prepared.truth
    print(
        f"{prepared.students.pictures} pictures for students, {prepared.teachers.pictures} for the teacher, {len(truth.rows)} to judge with "
        f"{int(truth.fabric.sum())} arm joints under fabric"
    )
    results = prepared.run(options.seeds)
    print(study.table(results))
    if options.pictures:
        columns = ["empty", "empty, fused", "masked, draped, fused"]
        study.pictures(prepared, CocoKeypoints(options.test), columns, options.seeds[0], options.pictures)


def load_answer(path: Path, *, decoder: bool = False, mirror: bool = False) -> real.Answer:
    """A network by its file, fed as its card says. Without a card: fed as `ogg-lite`. Joints are the highest peaks of
    their maps, or with the `decoder` what the daemon makes of the maps."""
    import onnxruntime

    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected an exported network")
    if decoder:
        return real.people_answer(path, mirror=mirror)
    shape = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"]).get_inputs()[0].shape
    size = (shape[3], shape[2])
    stride, normalise = card.reading(path.with_suffix(".toml"))
    return real.map_answer(onnx_runner(path), size, normalise, stride)


def score_model(options: argparse.Namespace) -> None:
    """`eval`."""
    if options.mirror and not (options.decoder or options.nobody):
        raise ValueError("--mirror: expected with --decoder or --nobody, the mean of two looks is the native module's")
    if options.data:
        score_data(options)
        return
    if options.nobody:
        score_nobody(options)
        return
    answer = load_answer(options.model, decoder=options.decoder, mirror=options.mirror)
    if options.crops:
        cases = real.crop_cases(options.crops)
        pairs = [(case, real.look(answer, case.image, case.window)) for case in tqdm(cases, desc="scoring", leave=False)]
    elif options.hand:
        cases = real.hand_cases(options.hand)
        if not cases:
            raise FileNotFoundError(f"{options.hand}: expected some of the recordings that hand_labels.csv names")
        pairs = [(case, real.twice(answer, case.image, case.window)) for case in tqdm(cases, desc="scoring", leave=False)]
    else:
        pairs, window, camera = [], None, ""
        for case in tqdm(real.reference_cases(options.reference, options.every), desc="scoring", leave=False):
            if case.subject != camera:
                window, camera = None, case.subject
            found = real.twice(answer, case.image, window)
            window = real.around(found, case.image, 2.0)
            pairs.append((replace(case, image=TINY), found))
    scores = real.judge(pairs)
    print(real.lines(scores))
    if options.json:
        rows = {
            subject: {j: {"n": len(t.errors), "pck_0.1": t.pck(0.1), "pck_0.2": t.pck(0.2)} for j, t in joints.items()}
            for subject, joints in scores.items()
        }
        options.json.write_text(json.dumps(rows, indent=1))


def score_nobody(options: argparse.Namespace) -> None:
    """People who are found where there is nobody."""
    if not options.nobody.is_dir():
        raise FileNotFoundError(f"{options.nobody}: expected a folder of pictures")
    seen = everybody(options.model.with_suffix(".toml"), "openpose-18", mirror=options.mirror)
    ghosts = [seen(picture.image) for picture in tqdm(teaching.shown([options.nobody], 1), desc="scoring", leave=False)]
    if not ghosts:
        raise FileNotFoundError(f"{options.nobody}: expected pictures ({', '.join(teaching.PICTURES)})")
    surest = max((float(people[..., 2].max()) for people in ghosts if len(people)), default=0.0)
    with_some = sum(len(people) > 0 for people in ghosts)
    print(f"nobody there, {len(ghosts)} pictures: somebody found in {with_some}, surest keypoint {surest:.2f}")
    if options.json:
        options.json.write_text(json.dumps({"pictures": len(ghosts), "with_people": with_some, "surest": surest}))


TINY = Image.new("RGB", (1, 1))
"""Stands for a frame that is no longer needed: a recording's frames do not fit into memory together."""


def score_data(options: argparse.Namespace) -> None:
    """Visible joints, covered arm joints, and arm joints under fabric of pictures with one person."""
    data = CocoKeypoints(options.data, images=options.images)
    answer = load_answer(options.model, decoder=options.decoder, mirror=options.mirror)
    fabric = data.under_fabric()
    subsets = {"visible": [], "covered": [], "under fabric": []}
    alone = [i for i in range(len(data)) if len(data.people[i][0]) == 1]
    measured = [i for i in alone if data.torso_px(i) > 0]
    if len(measured) < len(data):
        print(
            f"left out of PCK: {len(data) - len(alone)} pictures of several people, {len(alone) - len(measured)} without a shoulder "
            "and hip of one side"
        )
    for i in measured:
        sample = data[i]
        labelled, seen = sample.states[0] == State.LABELLED, data.visible(i)[0]
        counts = {"visible": labelled & seen, "covered": labelled & ~seen, "under fabric": labelled & fabric[i]}
        for name, cases in subsets.items():
            cases.append(Case(sample.image, sample.joints_px[0], counts[name], data.torso_px(i)))
    report: dict[str, dict] = {}
    if options.decoder and len(alone) < len(data):
        together = grouping.judge(data, everybody(options.model.with_suffix(".toml"), "openpose-18", mirror=options.mirror))
        print(together)
        report["several people"] = asdict(together)
    found = None
    for subset, cases in subsets.items():
        if not any(c.counts.any() for c in cases):
            continue
        found = found or [answer(c.image) for c in tqdm(cases, desc="scoring", unit="img", leave=False)]
        scores = score_found(found, cases)
        names = [PARTS[i] for i in ARM_PARTS]
        if subset == "visible":
            names += [n for i, n in enumerate(PARTS) if i not in ARM_PARTS]
        print(f"{subset} joints, {len(cases)} pictures")
        print(table(scores, names))
        report[subset] = {
            n: {"n": len(s.errors), "pck_0.1": s.pck(0.1), "pck_0.2": s.pck(0.2), "median_px": s.median_px()}
            for n, s in scores.items()
            if s.errors
        }
    if options.json:
        options.json.write_text(json.dumps(report, indent=1))


def describe(options: argparse.Namespace) -> None:
    """`describe`."""
    skeleton = SKELETONS["openpose-18"]
    network = build(options.network, skeleton).eval()
    total = 0

    def count(module: torch.nn.Module, _: object, output: torch.Tensor) -> None:
        nonlocal total
        if isinstance(module, torch.nn.ConvTranspose2d):  # each cell of the answer lies under one weight of every kernel
            total += output.shape[-1] * output.shape[-2] * module.weight.shape[:2].numel()
        else:
            total += output.shape[-1] * output.shape[-2] * module.weight.numel()

    for module in network.modules():
        if isinstance(module, torch.nn.Conv2d | torch.nn.ConvTranspose2d):
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
    "eval": score_model,
    "people": render_people,
    "label": label,
    "trunk": trunk,
    "fusion-study": fusion_study,
    "quantise": quantise.run,
    "describe": describe,
}
