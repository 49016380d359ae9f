"""Learns an action from a recording, saves the model, and plots it.

    ogg follow run --duration 8 --record runs
    python learn_an_action.py runs/run-....mcap learned
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt

import ogg_rs
from ogg_rs import plot, recording


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("out", type=Path, help="folder for the model and the pictures")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)

    run = recording.open(arguments.recording)
    times, joints = run.arm("right")
    model = ogg_rs.MotionModel.teach([(times, joints)])
    model.save(arguments.out / "action.json")
    print(f"{run}\n{model} of {model.demonstrations} repetitions")

    figure, (above, below) = plt.subplots(2, 1, figsize=(8, 8), layout="constrained")
    plot.motion_model(model, ax=above)
    plot.tracking_error(run, ax=below)
    figure.savefig(arguments.out / "action.png")


if __name__ == "__main__":
    main()
