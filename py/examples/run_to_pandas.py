"""Reads a run into pandas: how far the joints stray from their setpoints, and what the log says.

    ogg follow run --duration 8 --record runs
    python run_to_pandas.py runs/run-....mcap
"""

import argparse
from pathlib import Path

import pandas as pd

from ogg_rs import recording


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    run = recording.open(parser.parse_args().recording)
    print(run)
    measured = run.table("joint_states").to_pandas()
    setpoints = run.table("setpoints").to_pandas()
    both = pd.merge_asof(measured, setpoints, on="time_s", suffixes=("", "_wanted"))
    joints = [name.removesuffix(".position") for name in measured if name.endswith(".position")]
    errors = pd.DataFrame({j: both[f"{j}.position_wanted"] - both[f"{j}.position"] for j in joints})
    print("setpoint - measured (rad)")
    print(errors.describe().loc[["mean", "std", "min", "max"]].to_string(float_format="{:.5f}".format))
    print(run.table("log").to_pandas()[["time_s", "level", "message"]].to_string(index=False))


if __name__ == "__main__":
    main()
