"""Command line of the training package."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path


def size(text: str) -> tuple[int, int]:
    """`256x192` as (width, height), both multiples of 8."""
    try:
        width, height = (int(v) for v in text.split("x"))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT, got {text!r}") from error
    if width % 8 or height % 8 or width <= 0 or height <= 0:
        raise argparse.ArgumentTypeError(f"expected multiples of 8, got {text}")
    return width, height


def weighted(text: str) -> tuple[Path, int]:
    """`DIR` or `DIR*N`: a data set and how often it counts."""
    path, star, count = text.partition("*")
    if star and not (count.isdigit() and int(count) > 0):
        raise argparse.ArgumentTypeError(f"expected DIR or DIR*N, got {text!r}")
    return Path(path), int(count) if star else 1


def parser() -> argparse.ArgumentParser:
    """All commands and their options."""
    top = argparse.ArgumentParser(
        prog="python -m ogg_rs.train",
        description="Train, export and score the networks ogg-lite and ogg-vgg on pictures with COCO keypoints.",
    )
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    puppets = commands.add_parser("puppets", help="draw flat-shaded seated figures with exact joints, for pretraining")
    puppets.add_argument("--out", type=Path, required=True)
    puppets.add_argument("--count", type=int, required=True)
    puppets.add_argument("--seed", type=int, default=0)

    fit = commands.add_parser("fit", help="train a network; run again with the same options to resume")
    fit.add_argument("--network", choices=["ogg-lite", "ogg-vgg"], default="ogg-lite")
    fit.add_argument("--profile", choices=["openpose-18", "upper-limb-8"], default="openpose-18")
    fit.add_argument("--data", type=weighted, nargs="+", required=True, metavar="DIR[*N]",
                     help="folders with annotations.json; *N repeats a folder N times per epoch")  # fmt: skip
    fit.add_argument("--annotations", default="annotations.json", help="name of the annotation file in each folder")
    fit.add_argument("--images", type=Path, help="folder of the pictures, where it is not the data folder")
    fit.add_argument("--out", type=Path, required=True, help="folder for checkpoint, log and parameters")
    fit.add_argument("--start", type=Path, help="checkpoint.pt of an earlier run to start from")
    fit.add_argument("--teacher", type=Path, help="exported .onnx of the same size and profile: fuse its labels (3)")
    fit.add_argument("--size", type=size, default=(256, 192), metavar="WxH")
    fit.add_argument("--steps", type=int, required=True)
    fit.add_argument("--batch", type=int, default=16)
    fit.add_argument("--seed", type=int, default=0)
    fit.add_argument("--learning-rate", type=float, default=3e-3)
    fit.add_argument("--warmup", type=float, default=0.1)
    fit.add_argument("--emphasis", type=float, default=4.0, help="0 is the loss as printed in the paper")
    fit.add_argument("--strength", type=float, default=1.0, help="strength of the random picture changes, 0 to 1")
    fit.add_argument("--threads", type=int, default=1, help="set to the number of cores that are otherwise idle")
    fit.add_argument("--bf16", choices=["auto", "on", "off"], default="auto", help="auto: on where the CPU has AMX")

    export = commands.add_parser("export", help="write the averaged weights of a run as ONNX")
    export.add_argument("--run", type=Path, required=True, help="the --out folder of fit")
    export.add_argument("--out", type=Path, required=True, help="file to write")
    export.add_argument("--card", type=Path, help="model card to write or renew; its [about] section is kept")
    export.add_argument("--peak-threshold", type=float, default=0.1, help="card: smallest map value that is a joint")

    evaluate = commands.add_parser("eval", help="PCK and pixel errors of an exported network on a data set")
    evaluate.add_argument("--model", type=Path, required=True)
    evaluate.add_argument("--data", type=Path, required=True)
    evaluate.add_argument("--images", type=Path)
    evaluate.add_argument("--json", type=Path)

    crops = commands.add_parser("eval-crops", help="the same on an .npz of labelled crops (C, U, T, tag)")
    crops.add_argument("--model", type=Path, required=True)
    crops.add_argument("--crops", type=Path, required=True)

    about = commands.add_parser("describe", help="layers, parameters and multiply-adds of a network")
    about.add_argument("--network", choices=["ogg-lite", "ogg-vgg"], required=True)
    about.add_argument("--size", type=size, default=(256, 192), metavar="WxH")
    return top


def main(arguments: list[str] | None = None) -> int:
    """Runs one command; 2 for wrong input, with a message that names it."""
    options = parser().parse_args(arguments)
    from . import commands

    try:
        commands.RUN[options.command](options)
    except (FileNotFoundError, ValueError, KeyError, json.JSONDecodeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped; the same command resumes from the last checkpoint", file=sys.stderr)
        return 130
    return 0
